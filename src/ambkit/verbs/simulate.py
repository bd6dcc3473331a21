"""A machine in closed loop, simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import (
    Force,
    Inputs,
    Length,
    LoopFilter,
    Machine,
    Scenario,
    Signals,
    Time,
    TrueMagnet,
)

if TYPE_CHECKING:
    from ambkit.simulation.run import Run


def simulate(
    machine: Machine,
    scenario: Scenario | None = None,
    filter: LoopFilter = "linear",
    *,
    plant: TrueMagnet | None = None,
    duration: Time | None = None,
    step: Length | None = None,
    disturbance: Force | None = None,
    signal: Signals = (),
    seed: int | None = None,
    external_inputs: Inputs | None = None,
) -> Run:
    """Simulate a machine in closed loop.

    With its nonlinear magnets, noise, sensor lag, current limit and stops, gyroscopics, unbalance
    and runout; of several axes with orbits in the picture. Controller settings that the scenario
    omits are tuned automatically. A filter in single precision is simulated in single precision.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or a TOML file.
    scenario : Scenario, str or path, optional
        What happens; `ambkit schema scenario`.
    filter : Estimator, class, str or path, optional
        A kind, linear+unbalance to estimate that too, a filter's file, an expert (.json) or force
        map (.csv) of the adaptive filter, a class of your own as my.py:MyFilter, or none. The
        controller is fed by it unless the scenario says otherwise.
    plant : MagnetModel, str or path, optional
        Force map of the true magnet, points of iu, x and f_mag, which the filter does not know; of
        one axis.
    duration : float or str, optional
        Length of the run [s]; by default the scenario's.
    step : float or str, optional
        Step of the reference of the first axis [m], after a tenth of the run.
    disturbance : float or str, optional
        Disturbance force on the first axis [N], after half of the run.
    signal : str, path or sequence of them, optional
        Record whose r is the reference, or whose injected is added to the measurement, such as
        `ambkit excite` writes; the run is as long as it. May be repeated.
    seed : int, optional
        Seed of the noise; by default the scenario's.
    external_inputs : ExternalInputs, optional
        Series of disturbance, noise and magnet from outside; in Python only.

    Returns
    -------
    Run
        The record, with truth, and the estimate.

    Raises
    ------
    AmbkitError
        A file cannot be read, there is no such filter, the controller is to be fed by an estimate
        and there is none, or both a step and a signal give the reference.
    TypeError
        One of the arguments is of another type.

    Examples
    --------
    $ ambkit simulate zittau_axial --step "0.5 mm" --disturbance "3 N" --out run.csv --plot run.png
    $ ambkit simulate tum_mlps --plot orbits.png
    """
    from ambkit.assessment.arguments import machine_argument
    from ambkit.base.progress import progress
    from ambkit.base.quantity_arguments import names_in
    from ambkit.workflow import simulate

    with progress("simulating"):
        return simulate.flown(
            machine_argument(machine), scenario, filter, plant=plant,
            signals=names_in(signal=signal), external_inputs=external_inputs,
            duration=duration, step=step, load=disturbance, seed=seed,
        )  # fmt: skip
