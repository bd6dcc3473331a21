"""Simulation in closed loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs import words

if TYPE_CHECKING:
    from ambkit.simulation.run import Run


def simulate(
    machine: words.Machine,
    scenario: words.Scenario | None = None,
    filter: words.LoopFilter | None = None,
    *,
    plant: words.TruePlant | None = None,
    duration: words.Time | None = None,
    step: words.Length | None = None,
    disturbance: words.Force | None = None,
    signal: words.Signals = (),
    seed: int | None = None,
    external_inputs: words.Inputs | None = None,
) -> Run:
    """Simulate a machine in closed loop.

    Nonlinear magnets, noise, sensor lag, current limits and contact; on rotors also gyroscopics,
    unbalance and runout. Controller settings that the scenario omits are tuned automatically. A
    filter in single precision runs in single precision.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file.
    scenario : Scenario, str or path, optional
        Scenario (`ambkit schema scenario`).
    filter : Estimator, class, str or path, optional
        Kind (linear+unbalance also estimates the unbalance), filter file, expert (.json) or force
        map (.csv) of the adaptive filter, a class as my.py:MyFilter, or none. By default extended,
        with the unbalance and runout that the machine states. It feeds the controller unless the
        scenario selects the measurement.
    plant : MagnetModel, class, str or path, optional
        True plant, unknown to the filter: the force map of the magnet (iu, x, f_mag) of one axis,
        or a class as my.py:MyPlant.
    duration : float or str, optional
        Duration [s]. By default that of the scenario.
    step : float or str, optional
        Reference step of the first axis at a tenth of the duration [m].
    disturbance : float or str, optional
        Disturbance force step on the first axis at half of the duration [N].
    signal : str, path or sequence of them, optional
        Record with the reference r or a signal injected into the measurement, as written by `ambkit
        excite`; sets the duration.
    seed : int, optional
        Random seed of the noise. By default that of the scenario.
    external_inputs : ExternalInputs, optional
        Series of disturbance force, noise and magnet (Python only).

    Returns
    -------
    Run
        Record with truth, and estimate.

    Raises
    ------
    AmbkitError
        A file cannot be read, the filter is unknown, the controller needs an estimate without a
        filter, or step and signal both define the reference.
    TypeError
        An argument has the wrong type.

    Examples
    --------
    $ ambkit simulate zittau_axial --step "0.5 mm" --disturbance "3 N" --out run.csv --plot run.png
    $ ambkit simulate tum_mlps --plot orbits.png
    """
    from ambkit.arguments import machine_argument
    from ambkit.base.progress import progress
    from ambkit.base.quantity_arguments import names_in
    from ambkit.workflow import simulate

    with progress("simulating"):
        return simulate.simulate_with_filter(
            machine_argument(machine), scenario, filter, plant=plant,
            signals=names_in(signal=signal), external_inputs=external_inputs,
            duration=duration, step=step, load=disturbance, seed=seed,
        )  # fmt: skip
