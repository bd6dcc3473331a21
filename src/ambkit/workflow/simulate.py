"""Simulation with defaults for controller, duration, step and disturbance."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import is_class
from ambkit.base.quantity_arguments import QuantityLike, in_si, of_type
from ambkit.base.units import figure
from ambkit.control.controllers import controllers_of
from ambkit.control.default_control import is_default
from ambkit.control.stabilising_controller import holding
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.angle import angle_notes
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.named import filter_of
from ambkit.estimate.registry import default_filter, default_name
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.contact import contact_notes
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.judge.unbalance import unbalance_notes
from ambkit.machine.axes import isolated_axes
from ambkit.machine.forces.force_map import true_magnet
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.plant import Plant
from ambkit.rotordynamics.harmonics import harmonics
from ambkit.rotordynamics.separation_margins import Separations, separations
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import Run, simulate_run
from ambkit.simulation.scenario import Scenario, check_for, default_for, settled_scenario
from ambkit.simulation.waveforms import Recorded, Step

NONE = "none"  #: Name of the filter in a loop without one.

STEP_AT, LOAD_AT = 0.1, 0.5
"""When the step of the reference and that of the load come, in lengths of the run."""

OWN_PERIODS = 40
"""Length of an experiment, in periods of the plant's own frequency, where it is not given."""


def scenario_for(
    machine: Machine,
    scenario: Scenario | str | os.PathLike[str] | None = None,
    *,
    duration: QuantityLike | None = None,
    step: QuantityLike | None = None,
    load: QuantityLike | None = None,
    seed: int | None = None,
    reference: str | Path | None = None,
    injection: str | Path | None = None,
    from_estimate: bool = True,
) -> Scenario:
    """Return a scenario for a machine, with tuned controller, and a step or disturbance added.

    Parameters
    ----------
    machine : Machine
        The controller of a single axis is tuned to it, unless `scenario` states otherwise.
    scenario : Scenario or path, optional
        Base scenario.
    duration : float or str, optional
        Length of the run [s].
    step : float or str, optional
        Reference step of the first axis [m], such as 5e-5 or ``"50 µm"``, after a tenth of the run.
    load : float or str, optional
        Step of the disturbance force on the first axis [N], after half of the run.
    seed : int, optional
        Random seed of the noise.
    reference : path, optional
        A record whose ``r``, with several axes ``r_NAME``, is the reference; by default it also
        sets the duration.
    injection : path, optional
        A record whose ``injected``, with several axes ``injected_NAME``, is added to the
        measurement, likewise.
    from_estimate : bool
        Whether the estimate may be fed back, unless `scenario` states the feedback.

    Raises
    ------
    AmbkitError
        A file cannot be read; both step and record define the reference; or a quantity is invalid.
    TypeError
        `bearing` is not a machine, or `scenario` not a scenario.
    """
    of_type(Machine, machine=machine)
    duration, step = in_si("duration", duration, "s"), in_si("step", step, "m")
    load = in_si("load", load, "N")
    full_scenario = Scenario() if scenario is None else scenario
    if isinstance(full_scenario, str | os.PathLike):
        full_scenario = Scenario.load(full_scenario)
    of_type(Scenario, scenario=full_scenario)
    if not from_estimate and full_scenario.feedback is None:
        full_scenario = full_scenario.fed("measurement")
    axes = tuple(machine.axis_names)
    check_for(full_scenario, machine)
    if duration is not None:
        full_scenario = full_scenario.replace(duration=duration)
    if reference is not None:
        if step is not None:
            raise AmbkitError("the reference is either a step or a record's: give one of them")
        full_scenario = _along(Path(reference), axes, full_scenario, duration, "reference", "r")
    if injection is not None:
        full_scenario = _along(
            Path(injection), axes, full_scenario, duration, "injection", "injected"
        )
    if step is not None:
        at = Step(amplitude=step, time=STEP_AT * full_scenario.duration)
        full_scenario = full_scenario.replace(reference=at)
    if load is not None:
        at = Step(amplitude=load, time=LOAD_AT * full_scenario.duration)
        full_scenario = full_scenario.replace(disturbance=at)
    return full_scenario if seed is None else full_scenario.replace(seed=seed)


def _along(
    path: Path, axes: tuple[str, ...], scenario: Scenario, duration: float | None, what: str,
    of: str,
) -> Scenario:  # fmt: skip
    """Return a scenario with the reference or injection of a record."""
    record = Record.load(path)
    if duration is None:
        scenario = scenario.replace(duration=float(record.t[-1]))
    there = [axis for axis in axes if signal(of, axis) in record]
    if not there:
        names = ", ".join(signal(of, axis) for axis in axes)
        raise AmbkitError(f"{path}: it has none of the signals {names}")
    signals = [
        {"axis": axis, "position": Recorded(file=str(path), signal=signal(of, axis))}
        for axis in there
    ]
    return scenario.replace(**{what: signals})


def with_plant(scenario: Scenario, plant: Any, machine: Machine) -> tuple[Scenario, Any]:
    """Return a scenario with the user's plant, or the true magnet."""
    if is_class(plant):
        return scenario.replace(plant=plant), None
    return scenario, true_magnet(plant, machine)


def simulate_with_filter(
    machine: Machine, scenario: Any, filter: Any, *, plant: Any, signals: Sequence[Any],
    external_inputs: ExternalInputs | None,
    **settings: Any,
) -> Run:  # fmt: skip
    """Simulate a machine with a filter, and judge whether that is adequate."""
    if filter is None:
        filter = default_name(machine)
    named = filter != NONE
    settings |= _of_signals(signals)
    full_scenario = scenario_for(machine, scenario, from_estimate=named, **settings)
    if not named and full_scenario.feedback == "estimate":
        place = f"{os.fspath(scenario)}: " if isinstance(scenario, str | os.PathLike) else ""
        raise AmbkitError(
            f'{place}the controller is fed by the estimate (feedback = "estimate"), so the '
            "estimator cannot be none"
        )
    estimator = filter_of(filter, machine) if named else None
    full_scenario, magnet = with_plant(full_scenario, plant, machine)
    run = simulate_run(
        machine, full_scenario, estimator=estimator, magnet=magnet,
        external_inputs=external_inputs,
    )  # fmt: skip
    if machine.rotor.type != "mass":
        run = replace(
            run,
            turning=() if estimator is None else harmonics(estimator, run.record),
            near_critical=partial(_separations, machine, full_scenario, estimator, run.final_speed),
        )
    return replace(run, judge=partial(_judged, full_scenario, estimator or NONE))


def _separations(
    machine: Machine, scenario: Scenario, filter: Estimator | None, speed: float
) -> Separations:
    """Return the separation of a speed from the critical speeds of the simulated loop."""
    scenario = settled_scenario(machine, scenario)
    if scenario.controller.custom or scenario.plant:  # a class has no poles
        return Separations(0.0)
    fed_by = filter or default_filter(machine) if scenario.feedback == "estimate" else None
    return separations(machine, speed, LoopBuilder(machine, scenario.controller), fed_by)


def _judged(scenario: Scenario, filter: Any, run: Run) -> tuple[Sequence[Finding], Sequence[str]]:
    """Return whether the filter of a run is adequate, and warnings on the run."""
    adequacy = judge_adequacy(filter, run.machine, scenario, run.nis)
    default = default_for(run.machine, scenario) if is_default(scenario.controller) else None
    remarks = [default.summary] if default and default.fastest else []
    of = filter if isinstance(filter, Estimator) else None
    return adequacy, [*remarks, *sentences(adequacy), *_remarks(run, scenario, of)]


def _of_signals(paths: Sequence[Any]) -> dict[str, Path]:
    """Return which record is the reference and which the injection."""
    results: dict[str, Path] = {}
    for path in map(Path, paths):
        injected = any(name.partition("_")[0] == "injected" for name in Record.load(path))
        what = "injection" if injected else "reference"
        if what in results:
            raise AmbkitError(f"signal: {results[what]} and {path} both are the {what}")
        results[what] = path
    return results


def _remarks(run: Run, scenario: Scenario, filter: Estimator | None) -> Iterator[str]:
    """Yield advice for a rotor that does not levitate properly."""
    machine, touched = run.machine, run.samples_at_the_stop
    plain = plain_control(machine, scenario, filter)
    if plain is not None:
        yield plain
    if run.estimate is not None:
        estimates = {filter.name if filter is not None else "the filter": run.estimate}
        yield from contact_notes(machine, run.record, estimates)
        yield from angle_notes(machine, run.record, estimates)
        yield from unbalance_notes(machine, run.record, estimates)
    if touched and scenario.start == "levitated":
        failed = scenario.off is not None and _touched_at(run) >= scenario.off
        yield _of_the_stop(run, failed)
        if machine.speed or failed:
            return
        if not holding(machine, scenario.feedback or "estimate").held:
            yield "No PID in the search stabilises it; see ambkit check."


def _touched_at(run: Run) -> float:
    """Return the time of the first contact [s]; infinity without one."""
    at, t = run.first_contact, run.record.t  # contact is recorded at the end of the sample
    return math.inf if at is None else float(t[min(at + 1, len(t) - 1)])


def _of_the_stop(run: Run, failed: bool) -> str:
    """Return the times of contact, and advice unless the power failed before."""
    clearance, at = min(axis.clearance for axis in isolated_axes(run.machine)), _touched_at(run)
    first = "" if math.isinf(at) else f", first at {figure(at, 's')}"
    advice = " after the power failure." if failed else (
        ": check the controller ([controller] in the scenario), or reduce the step or the "
        "disturbance force."
    )  # fmt: skip
    return (
        f"The rotor touched the stop at {figure(clearance, 'm')} in {run.samples_at_the_stop} of "
        f"{len(run.record)} samples{first}{advice}"
    )


def experiment_duration(machine: Machine) -> float:
    """Return the default duration [s]."""
    own = math.sqrt(ConstantStiffness.of(machine).k_s / machine.rotor.mass) / (2 * math.pi)
    return float(f"{OWN_PERIODS / own:.2g}")


def plain_control(machine: Machine, scenario: Scenario, estimator: Estimator | None) -> str | None:
    """Return a sentence on the speeds at which unbalance control is off."""
    if scenario.controller.unbalance == "off" or estimator is None:
        return None
    full_scenario = settled_scenario(machine, scenario)
    T = machine.sampling_time
    t = T * np.arange(max(2, round(full_scenario.duration / T) + 1) + 1, dtype=float)
    speed = np.abs(
        [machine.speed] if full_scenario.speed is None else full_scenario.speed.sample(t)
    )
    low, high = float(speed.min()), float(speed.max())
    turn = controllers_of(
        Plant(machine), full_scenario.controller, estimator, fastest=high
    ).unbalance_control
    return None if turn is None else turn.sentence(full_scenario.controller.unbalance, low, high)
