"""What the self-test of a machine's controllers lives through, as the simulation flies it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.data.signals import signal
from ambkit.estimate.engine import NODE
from ambkit.estimate.estimate import Status
from ambkit.export.c.control_scenes import QUICK
from ambkit.export.c.vectors import without_digits
from ambkit.simulation.control import Controller, settling_of
from ambkit.simulation.flight import Disturbance, Flight, Reference
from ambkit.simulation.machine import simulate_machine
from ambkit.simulation.plant import Plant
from ambkit.simulation.run import Run
from ambkit.simulation.sequence import Mode
from ambkit.simulation.waveforms import Constant, Ramp, Step, Sum

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.machine import Machine
    from ambkit.simulation.controllers import Controllers

Array = NDArray[np.float64]

LIFTED, UP = 300, 130
"""Samples of a flight in the self-test, and from which on the rotor is up."""
TAKEN = 40
"""Samples of a flight that is taken over."""
PUSH, PULL = 0.2, 3.0
"""Loads of the flights, in what an axis can pull with its greatest current."""
DRAWN, ROUNDED = 4, 256
"""Flights whose readings are off, and by how many roundings of the travel."""
PART = 2e-3
"""Of the greatest current: a tenth of what the self-test lets pass."""


class Vectors(NamedTuple):
    """Flights one after the other, N samples."""

    y: Array  # (N, readings) [m]
    r: Array  # (N, axes) [m]
    u: Array  # (N, axes): what the controllers gave [V]
    speed: Array  # (N,) [rad/s]
    mode: NDArray[np.uint8]  # (N,): what they were doing
    fly: NDArray[np.bool_]  # (N,): whether they were told to fly
    status: NDArray[np.uint16]  # (N,): flags of filter and controllers
    usable: NDArray[np.bool_]  # (N,): whether the estimate could be used
    mean: Array  # (N, states), each in its unit
    starts: list[int]  # where flights begin at power-on ...
    taken: list[int]  # ... and where those do that are taken over, ...
    taken_with: Array  # ... with these currents (axes,) [A]
    amplified: NDArray[np.bool_]  # (N,): samples where rounding is amplified
    saturated: int  # samples in which a current was at its limit


def speeds_of(machine: Machine, flight: Flight) -> tuple[float, float] | None:
    """The slowest and the fastest rotation of a flight [rad/s]; None at the machine's own."""
    if flight.speed is None:
        return None
    n = max(2, round(flight.duration / machine.sampling_time) + 1)
    speed = flight.speed.sample(machine.sampling_time * np.arange(n + 1, dtype=float))
    if bool((speed == machine.speed).all()):
        return None
    return float(speed.min()), float(speed.max())


def vectors(estimator: Estimator, flight: Flight, controllers: Controllers) -> Vectors:
    """Fly what the self-test flies, with the plant of the simulation."""
    # A step of the reference with a load, and loads beyond what the magnets hold with readings lost
    # and far away, and references that are none; on all axes in turn, and where the flight's speed
    # changes up and down with it: from where the rotor lies to where it lies again. Some trip, and
    # a rotor in flight is taken over.
    assert estimator.whole is not None
    machine = estimator.whole.machine
    parts = []
    for scene in _scenes(machine, flight):
        run = _flown(estimator, controllers, scene, scene.readings)
        record = run.record
        y = np.column_stack([record[signal("y", r.name)] for r in machine.readings])
        r, u = (
            np.column_stack([record[f"{which}_{axis.name}"] for axis in machine.axes])
            for which in "ru"
        )
        assert run.estimate is not None
        assert run.usable is not None
        mode = record["mode"].astype(np.uint8)
        # From readings on that are lost or far away, from where rounding decides, and from where
        # readings are refused of a rotor that has tripped, and is thrown between its stops.
        spoilt = (scene.readings != 0).any(axis=1)
        spoilt |= (mode == Mode.TRIPPED) & ((run.status & Status.OUTLIER) != 0)
        amplified = np.maximum.accumulate(spoilt | _spread(estimator, controllers, scene, run))
        # Where float has no digits left before that, all that it says is rounding.
        amplified |= bool((without_digits(estimator, y, u) & ~amplified).any())
        parts.append((y, r, u, record["speed"], mode, scene.fly > 0, run.status, run.usable,
                      run.estimate.mean, amplified))  # fmt: skip
    flown = len(parts)
    taken_with = np.zeros(len(machine.axes))
    # Of a model that turns the core's controller alone follows no speed.
    if speeds_of(machine, flight) is None:
        over, taken_with = _taken_over(estimator, flight, controllers, parts[0])
        parts += over
    starts = np.cumsum([0, *(len(each[0]) for each in parts[:-1])]).tolist()
    estimator.turning(None, 1)  # what is written of the filter is of the machine's own speed
    y, r, u, speed, mode, fly, status, usable, mean, amplified = (
        np.concatenate(each) for each in zip(*parts, strict=True)
    )
    gain = np.array([axis.bearing.amplifier.gain for axis in machine.axes])
    low, high = (
        np.array([getattr(alone, f"current_{end}") for alone in Plant(machine).alone])
        for end in ("min", "max")
    )
    full = ((u * gain >= high * (1 - 1e-6)) | (u * gain <= low * (1 - 1e-6))).any(axis=1)
    return Vectors(
        y, r, u, speed, mode, fly, status, usable, mean, starts[:flown], starts[flown:],
        taken_with, amplified, int(full.sum()),
    )  # fmt: skip


def _flown(estimator: Estimator, controllers: Controllers, scene: Scene, readings: Array) -> Run:
    """Return one flight, with this added to its readings (n, m) [m]."""
    assert estimator.whole is not None
    return simulate_machine(
        estimator.whole.machine, scene.flight, estimator=estimator, controllers=controllers,
        readings=readings, references=scene.references, from_readings=True, fly=scene.fly,
        other=_quick(estimator),
    )  # fmt: skip


def _spread(
    estimator: Estimator, controllers: Controllers, scene: Scene, run: Run
) -> NDArray[np.bool_]:
    """Return where flights differ (n,) whose readings differ by no more than rounding makes."""
    # A compiler that contracts rounds otherwise. A rotor that is thrown between its stops makes of
    # that another flight, and a reading at the gate another decision.
    assert estimator.whole is not None
    machine = estimator.whole.machine
    least = ROUNDED * min(each.travel_limit for each in machine.bearing)
    least *= float(np.finfo(estimator.precision).eps)
    axes = [(signal("u", axis.name), axis.bearing.amplifier) for axis in machine.axes]
    random, found = np.random.default_rng(0), np.zeros(len(scene.readings), bool)
    for _ in range(DRAWN):
        off = least * random.choice([-1.0, 1.0], scene.readings.shape)
        other = _flown(estimator, controllers, scene, scene.readings + off)
        for key, amplifier in axes:
            away = np.abs(other.record[key] - run.record[key]) * amplifier.gain
            found |= away > PART * amplifier.current_limit
        found |= (other.status != run.status) | (other.usable != run.usable)
        found |= other.record["mode"] != run.record["mode"]
    return found


def _taken_over(
    estimator: Estimator, flight: Flight, controllers: Controllers, flown: tuple[Any, ...]
) -> tuple[list[tuple[Any, ...]], Array]:
    """Flights that are taken over, as `vectors` has them, and the currents that acted then."""
    # The readings are those of a flight at that time, and go on whatever is demanded now: it lands,
    # and it is overloaded from the first sample on.
    assert estimator.whole is not None
    assert flight.sequence is not None
    y, r, u, speed, mode, *_ = flown
    flying = np.flatnonzero(mode == Mode.FLYING)  # none, where it is overloaded on its way up
    at = int(flying[10]) if len(flying) > 10 else UP
    y, r, speed = y[at : at + TAKEN], r[at : at + TAKEN], np.full(TAKEN, speed[at])
    gain = np.array([axis.bearing.amplifier.gain for axis in estimator.whole.machine.axes])
    number = np.dtype(estimator.precision).type
    taken_with = (gain * u[at - 1]).astype(number)
    fed = flight.feedback == "estimate"
    plant = Plant(estimator.whole.machine)
    whole = Controller(plant, estimator, controllers, flight.sequence, fed)
    core = whole.in_core(**_quick(estimator))
    landing, staying = np.where(np.arange(TAKEN) < TAKEN // 2, 1.0, 0.0), np.ones(TAKEN)
    far = 60 * max(each.travel_limit for each in estimator.whole.machine.bearing)
    over = []
    for wanted, fly in ((r, landing), (r + far, staying)):
        given = (np.ascontiguousarray(each, number) for each in (y, wanted, fly))
        told = core.run(*given, float(speed[0]), taken_with)
        over.append((y, wanted, told["u"], speed, told["mode"], fly > 0, told["status"],
                     told["usable"] > 0, told["mean"], np.full(TAKEN, flown[-1][0])))  # fmt: skip
    return over, taken_with


def _quick(estimator: Estimator) -> dict[str, Any]:
    """Return fields of a sequence that firmware need not hold seconds of."""
    return QUICK | {"settling": min(settling_of(estimator), QUICK["settling"])}


class Scene(NamedTuple):
    """One flight of the self-test, n samples."""

    flight: Flight
    readings: Array  # (n, readings): what is added to them [m]; NaN: lost
    references: Array  # (n, axes): what is added to the references [m]; NaN: none
    fly: Array  # (n,): whether it is told to fly, 1 or 0


def _scenes(machine: Machine, flight: Flight) -> Iterator[Scene]:
    fly = np.ones(LIFTED)
    fly[:8], fly[100:106], fly[230:] = 0.0, 0.0, 0.0  # on the way up it is called back, and lands
    happening = _happening(machine, flight, 1.0, PUSH)
    none = _unwanted(machine)
    yield Scene(happening, _spoilt(machine), none, fly)
    fly = np.ones(LIFTED)
    fly[200:210] = 0.0  # it has tripped by then, and lifts again
    pulled = _happening(machine, flight, -1.0, PULL)
    yield Scene(pulled, _lost(machine), np.zeros_like(none), fly)
    well = np.zeros((LIFTED, len(machine.readings)))  # a current at its limit trips it
    none = np.zeros_like(none)
    none[180::3] = np.nan
    yield Scene(pulled, well, none, np.ones(LIFTED))


def _happening(machine: Machine, flight: Flight, sign: float, share: float) -> Flight:
    """Return a flight on all axes in turn: references of a twentieth of the travel, and loads."""
    # It begins where the rotor lies, as the exported controller does at power-on.
    T = machine.sampling_time
    references, loads = [], []
    for k, axis in enumerate(machine.axes):
        way = sign * (-1.0 if k % 2 else 1.0)
        law = axis.bearing.magnet
        most = 4 * law.magnet_constant * law.bias_current * axis.bearing.amplifier.current_limit
        force, late = way * share * most / law.air_gap**2, UP + 8 * k
        push = Step(amplitude=force, time=(50 + late) * T)
        wanted = Step(amplitude=0.05 * way * axis.bearing.travel_limit, time=(12 + late) * T)
        references.append(Reference(axis=axis.name, position=wanted))
        loads.append(Disturbance(axis=axis.name, force=push))
    return Flight(
        duration=(LIFTED - 1) * T, start="rest", feedback=flight.feedback,
        control=flight.control, reference=tuple(references), disturbance=tuple(loads),
        seed=flight.seed, speed=_speed(machine, flight, sign), sequence=flight.sequence,
    )  # fmt: skip


def _speed(machine: Machine, flight: Flight, sign: float) -> Sum | None:
    """Return a speed that grows over two nodes of the model, or falls, within those of a flight."""
    speeds = speeds_of(machine, flight)
    if speeds is None:
        return None
    low, high = speeds
    by = min(2 * NODE / machine.sampling_time, high - low)
    first = low + 0.3 * (high - low - by) if sign > 0 else high - 0.1 * (high - low - by)
    turned = Ramp(slope=sign * by / (LIFTED * machine.sampling_time))
    return Sum(parts=(Constant(value=first), turned))


def _spoilt(machine: Machine) -> Array:
    """Return what is added to the readings: losses, and readings far away."""
    m = len(machine.readings)
    added = np.zeros((LIFTED, m))
    travel = min(each.travel_limit for each in machine.bearing)
    added[170:174, 0], added[178, :] = np.nan, np.nan
    added[184, m - 1], added[188, 0] = 3 * travel, -3 * travel
    return added


def _unwanted(machine: Machine) -> Array:
    """Return what is added to the references: three that are no numbers."""
    added = np.zeros((LIFTED, len(machine.axes)))
    added[190, 0], added[193, -1], added[196, :] = np.nan, np.nan, np.nan
    return added


def in_turn(mean: Array) -> Array:
    """Return of each sample one state (N,), the next one each time."""
    k = np.arange(len(mean))
    return np.asarray(mean[k, k % mean.shape[1]])


def also_infinite(values: Array) -> Array:
    """Return the numbers, of which those that are none are infinite in turn: it is all the same."""
    found = values.copy()
    none = np.flatnonzero(np.isnan(values))
    found.flat[none[1::3]], found.flat[none[2::3]] = np.inf, -np.inf
    return found


def _lost(machine: Machine) -> Array:
    """Return readings that begin far away, and of which all are lost until it trips."""
    added = np.zeros((LIFTED, len(machine.readings)))
    travel = max(each.travel_limit for each in machine.bearing)
    added[0], added[1] = 30 * travel, 3 * travel
    added[145:180] = np.nan
    return added


def marks_of(tested: Vectors) -> NDArray[np.uint8]:
    """Return the mode of each sample and the marks that the template of the self-test has (N,)."""
    found = tested.mode + 8 * tested.fly.astype(np.uint8) + 32 * tested.usable.astype(np.uint8)
    found[tested.starts] += 16
    found[tested.taken] += 64
    found[tested.amplified] += 128
    return found.astype(np.uint8)
