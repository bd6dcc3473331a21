"""Experiment design: for identification, and for the measured sensitivity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from ambkit.base.progress import progress
from ambkit.verbs.words import Axis, Band, Filter, Limit, Machine, RandomWalk, Scenario, Time

if TYPE_CHECKING:
    from ambkit.assessment.injection_experiment import Injection
    from ambkit.identification.excitation import Design


def excite(
    machine: Machine,
    *,
    axis: Axis | None = None,
    kind: Literal["stepped-sine", "multisine", "prbs"] = "stepped-sine",
    free: Sequence[str] | None = None,
    scenario: Scenario | None = None,
    duration: Time | None = None,
    band: Band | None = None,
    limit: Sequence[Limit] = (),
    random_walk: RandomWalk | None = None,
) -> Design:
    """Design an identification experiment and predict its errors.

    The excitation is a reference signal for the controller, in the most informative band and as
    large as the limits allow in the simulated loop. The standard errors of identification are
    predicted. `ambkit simulate --signal` reads the file of --out.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file.
    axis : str, optional
        Axis to identify; all others are closed.
    kind : {"stepped-sine", "multisine", "prbs"}, optional
        Excitation signal.
    free : sequence of str, optional
        Parameter to identify, such as magnet_constant. By default as `ambkit identify`.
    scenario : Scenario, str or path, optional
        Controller, duration, disturbance force and seed. By default the controller is tuned.
    duration : float or str, optional
        Duration [s].
    band : tuple or str, optional
        Frequency band [Hz], such as "5 Hz,100 Hz". By default the most informative one.
    limit : sequence of str, optional
        Maximum control current or displacement, such as "2 A" or "0.2 mm". By default 80 % of the
        current limit and half of the clearance.
    random_walk : float or str, optional
        Random walk of the disturbance force, rms after 1 s [N]. By default 1 % of the weight.

    Returns
    -------
    Design
        Rows, a figure, and the reference signal (.csv, .parquet).

    Raises
    ------
    AmbkitError
        A limit exceeds that of the machine, or the experiment is too short.

    Examples
    --------
    $ ambkit excite my.toml --duration "1 s" --out excitation.csv --plot excitation.png
    $ ambkit excite tum_mlps --axis A1 --out excitation.csv
    """
    from ambkit.arguments import band_argument, limit_arguments, machine_argument
    from ambkit.base.quantity_arguments import in_si
    from ambkit.identification.excitation import Limits, design
    from ambkit.machine.axes import isolated
    from ambkit.workflow.simulate import experiment_duration, scenario_for

    of = machine_argument(machine)
    plant = isolated(of, axis)
    if duration is None and scenario is None:
        duration = experiment_duration(plant)
    happening: Any = scenario_for(plant, scenario, duration=duration)
    with progress("comparing bands") as step:
        # A scenario of the user's is of the axis alone.
        return design(
            of if scenario is None else plant, happening, kind=kind, free=free,
            limits=Limits.of(plant, *limit_arguments(limit)), band=band_argument(band),
            load=in_si("random_walk", random_walk, "N"), axis=axis or "",
            done=lambda text: step(f"comparing bands: {text}"),
        )  # fmt: skip


def excite_sensitivity(
    machine: Machine,
    filter: Filter | None = None,
    *,
    axis: Axis | None = None,
    scenario: Scenario | None = None,
    duration: Time | None = None,
    band: Band | None = None,
    limit: Sequence[Limit] = (),
    seed: int | None = None,
) -> Injection:
    """Design an injected signal that measures the sensitivity of a loop.

    A multisine at the measurement of one axis, as large as the limits allow in the simulated loop,
    and the predicted interval of the sensitivity peak. `ambkit simulate --signal` reads the file of
    --out.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file.
    filter : Estimator, str or path, optional
        Filter of the controller, or none. By default as for `ambkit simulate`; with several
        axes as in the scenario.
    axis : str, optional
        Axis of the injection. By default the one that decides the zone.
    scenario : Scenario, str or path, optional
        Controller, duration and disturbance force. By default the controller is tuned.
    duration : float or str, optional
        Duration [s]. By default 5 s, or that of the scenario.
    band : tuple or str, optional
        Frequency band [Hz], such as "5 Hz,100 Hz".
    limit : sequence of str, optional
        Maximum control current or displacement, such as "2 A" or "0.2 mm". By default 80 % of the
        current limit, and a displacement of 5 % of the air gap from the operating point.
    seed : int, optional
        Random seed of the noise.

    Returns
    -------
    Injection
        Rows, a figure, and the signal (.csv, .parquet).

    Raises
    ------
    AmbkitError
        The machine has no such axis, the loop is unstable, or no signal keeps the limits.

    Examples
    --------
    $ ambkit excite sensitivity my.toml --out injection.csv
    $ ambkit excite sensitivity tum_mlps --axis A1 --out injection.csv
    """
    from ambkit.arguments import NONE, band_argument, limit_arguments, machine_argument
    from ambkit.assessment.injection_experiment import DURATION, design_injection
    from ambkit.workflow.simulate import scenario_for

    plant, without = machine_argument(machine), isinstance(filter, str) and filter == NONE
    happening: Any = scenario_for(
        plant, scenario, duration=duration or (DURATION if scenario is None else None), seed=seed,
        from_estimate=not without,
    )  # fmt: skip
    if not plant.single and filter is not None:
        happening = happening.fed("measurement" if without else "estimate")
    current, displacement = limit_arguments(limit)
    with progress("trying amplitudes"):
        return design_injection(
            plant, happening, None if without else filter, axis=axis, current=current,
            displacement=displacement, band=band_argument(band),
        )  # fmt: skip
