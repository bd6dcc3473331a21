"""Experiments: what identifies a machine, and what measures the sensitivity of its loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from ambkit.verbs.words import Axis, Band, Filter, Limit, Machine, Scenario, Time, Wander

if TYPE_CHECKING:
    from ambkit.assessment.injection import Injection
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
    wander: Wander | None = None,
) -> Design:
    """Design an experiment and predict the errors of its results.

    An excitation for the reference of the controller, as large as the limits on current and
    displacement allow in the simulated loop, in the band that tells most; and the standard errors
    that identification will have from it. The file of --out is what `ambkit simulate --reference`
    takes.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or a TOML file.
    axis : str, optional
        Of several axes, whose parameters are to be found; all others are closed.
    kind : {"stepped-sine", "multisine", "prbs"}, optional
        The signal.
    free : sequence of str, optional
        What is to be identified, such as magnet_constant. May be repeated. As for `identify`.
    scenario : Scenario, str or path, optional
        Controller, duration, disturbance and seed; by default a controller is tuned.
    duration : float or str, optional
        Length of the experiment [s].
    band : tuple or str, optional
        Frequencies [Hz], such as "5 Hz,100 Hz"; by default the best are found.
    limit : sequence of str, optional
        Greatest control current or displacement from the centre, such as "2 A" or "0.2 mm". May be
        repeated. By default 80 % of the current and half of the travel.
    wander : float or str, optional
        How far the disturbance force wanders in a second, rms [N]; by default 1 % of the weight.

    Returns
    -------
    Design
        Rows, a picture, and the reference, which is what is written as .csv and .parquet.

    Raises
    ------
    AmbkitError
        A limit is beyond what the machine can do, or the experiment is too short.

    Examples
    --------
    $ ambkit excite my.toml --duration "1 s" --out excitation.csv --plot excitation.png
    $ ambkit excite tum_mlps --axis A1 --out excitation.csv
    """
    from ambkit.assessment.arguments import given_band, given_limits, machine_argument
    from ambkit.base.progress import progress
    from ambkit.base.quantity_arguments import in_si
    from ambkit.identification.excitation import Limits, design
    from ambkit.machine.axes import isolated
    from ambkit.workflow.simulate import experiment_duration, scenario_for

    plant = isolated(machine_argument(machine), axis)
    if duration is None and scenario is None:
        duration = experiment_duration(plant)
    happening: Any = scenario_for(plant, scenario, duration=duration)
    with progress("comparing bands") as step:
        return design(
            plant, happening, kind=kind, free=free, limits=Limits.of(plant, *given_limits(limit)),
            band=given_band(band), load=in_si("wander", wander, "N"), axis=axis or "",
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
    """Design the signal that, added to the measurement, measures the sensitivity of a loop.

    A multisine at the summing point of one axis, as large as the limits on current and displacement
    allow in the simulated loop, and the interval of the peak of |S| that it will give. The file of
    --out is what `ambkit simulate --injection` takes.

    Parameters
    ----------
    machine : Machine, str or path
        A preset's name, or a TOML file.
    filter : Estimator, str or path, optional
        Whose estimate feeds the controller, or none. By default linear; of several axes as the
        scenario has it.
    axis : str, optional
        At which axis the signal is added; by default that which decides the zone.
    scenario : Scenario, str or path, optional
        Controller, duration and disturbance; by default a controller is tuned.
    duration : float or str, optional
        Length of the experiment [s]; by default 5 s, or the scenario's.
    band : tuple or str, optional
        Frequencies [Hz], such as "5 Hz,100 Hz".
    limit : sequence of str, optional
        Greatest control current or displacement from the centre, such as "2 A" or "0.2 mm". May be
        repeated. By default 80 % of the current, and a twentieth of the air gap beyond where the
        rotor is held.
    seed : int, optional
        Seed of the noise.

    Returns
    -------
    Injection
        Rows, a picture, and the signal, which is what is written as .csv and .parquet.

    Raises
    ------
    AmbkitError
        As `ambkit.design_injection`.

    Examples
    --------
    $ ambkit excite sensitivity my.toml --out injection.csv
    $ ambkit excite sensitivity tum_mlps --axis A1 --out injection.csv
    """
    from ambkit.assessment.arguments import NONE, given_band, given_limits, machine_argument
    from ambkit.assessment.injection_experiment import DURATION, design_injection
    from ambkit.base.progress import progress
    from ambkit.workflow.simulate import scenario_for

    plant, without = machine_argument(machine), isinstance(filter, str) and filter == NONE
    happening: Any = scenario_for(
        plant, scenario, duration=duration or (DURATION if scenario is None else None), seed=seed,
        from_estimate=not without,
    )  # fmt: skip
    if not plant.single and filter is not None:
        happening = happening.replace(feedback="measurement" if without else "estimate")
    current, displacement = given_limits(limit)
    with progress("trying amplitudes"):
        return design_injection(
            plant, happening, None if without else filter, axis=axis, current=current,
            displacement=displacement, band=given_band(band),
        )  # fmt: skip
