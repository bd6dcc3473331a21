"""Fault isolation along a record, and the table of what it cannot distinguish."""

from __future__ import annotations

import math
import os
from typing import Any

from ambkit.arguments import machine_argument, record_argument
from ambkit.base.errors import AmbkitError
from ambkit.data.record import Record
from ambkit.estimate.filter_file import FilterFile
from ambkit.estimate.named import FromFile, FromObject, factories
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import FILTER_SUFFIX, default_name
from ambkit.judge.isolation.diagnosis import Diagnosis, Distinction
from ambkit.judge.isolation.isolation import FaultIsolation, window_of
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import own_time
from ambkit.simulation.run import simulate
from ambkit.simulation.scenario import Reference, Scenario
from ambkit.simulation.waveforms import Sequence as Steps
from ambkit.workflow.tuning import check_signals, in_units, tune_disturbance

HEALTHY = 0.25  #: Share of a record used to tune the process noise.
MOVED = 0.1  #: Steps of the reference, over the clearance.


def diagnosed(record: Any, filter: Any, machine: Any, channels: Any, window: Any) -> Diagnosis:
    """Run a filter along a record, and name the faults."""
    is_file = isinstance(filter, str | os.PathLike) and os.fspath(filter).endswith(FILTER_SUFFIX)
    if machine is None and not is_file:
        raise AmbkitError("machine is missing: a preset's name, or a TOML file")
    plant = FilterFile.load(filter).plant if machine is None else machine_argument(machine)
    log = record_argument(record, channels, window)
    check_signals(plant, log)
    kalman, remarks = _filter(filter, plant, log)
    if plant.turns and not any(state.role == "unbalance" for state in kalman.states):
        remarks.append(
            f"{kalman.name} does not estimate the unbalance of the rotor, which may be named as a "
            "fault: use --filter extended+unbalance"
        )
    searches = FaultIsolation(kalman).run(log)
    return Diagnosis(f"{plant.name}, {kalman.name}", searches, plant.sampling_time, remarks)


def _filter(filter: Any, plant: Machine, log: Record) -> tuple[Any, list[str]]:
    """Return the filter; without a file its process noise is tuned on the start of the record."""
    (build,) = factories([filter or default_name(plant)], plant).values()
    if isinstance(build, FromFile | FromObject):
        return build(), []

    def made(intensity: Any) -> Any:
        return build(FilterNoise(disturbance=intensity))

    stop = float(log.t[0] + HEALTHY * (log.t[-1] - log.t[0]))
    intensity = tune_disturbance(plant, log.between(stop=stop), made).intensity
    return made(intensity), [
        f"process noise of the disturbance force {in_units(intensity)}, tuned on the record until "
        f"{stop:.3g} s: earlier faults are not detected"
    ]


def distinguished(machine: Any, filter: Any) -> Distinction:
    """Return which faults can be distinguished, from simulated runs of a healthy machine."""
    plant = machine_argument(machine)
    isolation = None
    sizes = {}
    for operation, share in (("at rest", 0.0), ("in steps", MOVED)):
        scenario = _scenario(plant, share)
        log = simulate(plant, scenario)
        if isolation is None:
            isolation = FaultIsolation(_filter(filter, plant, log)[0])
        log = simulate(plant, _to_a_search(scenario, isolation))
        isolation.run(log)
        sizes[operation] = isolation.least_sizes()
    assert isolation is not None
    kalman = isolation.kalman
    window = isolation.span * plant.sampling_time
    return Distinction(f"{plant.name}, {kalman.name}", isolation.signatures, sizes, window)


def _to_a_search(scenario: Scenario, isolation: FaultIsolation) -> Scenario:
    """Return a scenario that ends at an evaluation."""
    T = isolation.kalman.machine.sampling_time
    searches = math.ceil(scenario.duration / T / isolation.every)
    return scenario.replace(duration=(searches * isolation.every - 1) * T)


def _scenario(plant: Machine, share: float) -> Scenario:
    """Return a scenario in which each axis steps to and fro, one after another."""
    own, T = max(map(own_time, isolated_axes(plant))), plant.sampling_time
    period = window_of(plant) * T / 3
    duration = max(4000 * T, 60 * own, 12 * period)
    count = math.ceil(duration / period)
    reference = []
    for k, axis in enumerate(plant.axes):
        size = share * axis.bearing.clearance
        times = [0.0, *((n + k / len(plant.axes)) * period for n in range(1, count))]
        values = [0.0, *(size * (-1) ** n for n in range(1, count))]
        steps = Steps(times=tuple(times), values=tuple(values))
        reference.append(Reference(axis=axis.name, position=steps))
    return Scenario(duration=duration, reference=tuple(reference))
