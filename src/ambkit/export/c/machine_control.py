"""Estimator and controllers of a machine in one step, as C: what `simulate_machine` flew."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.estimate.engine import NODE
from ambkit.export.c import data
from ambkit.export.c.control_scenes import QUICK
from ambkit.export.c.crc import Constants
from ambkit.export.c.vectors import within
from ambkit.simulation.control import settling_of
from ambkit.simulation.control_machine import MachineController
from ambkit.simulation.controllers import Controllers, arrays, controllers_of
from ambkit.simulation.flight import Disturbance, Flight, Reference
from ambkit.simulation.machine import simulate_machine
from ambkit.simulation.plant import Plant
from ambkit.simulation.waveforms import Constant, Ramp, Step, Sum

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.export.c.data import CPrecision
    from ambkit.machine.machine import Machine
    from ambkit.simulation.let_turn import LetTurn

Array = NDArray[np.float64]

SOURCES = ("src/controllers.c", "src/controller.c")
"""Files of the core that it needs besides the filter's."""
OF_SEQUENCE = ("src/control.c", "src/sequence.c")
"""And with lift-off and landing."""
FILES = {
    "{name}_control.h": "machine_control.h", "{name}_control.c": "machine_control.c",
    "{name}_control_data.c": "machine_control_data.c",
    "selftest/{name}_control_selftest.c": "machine_control_selftest.c",
}  # fmt: skip
"""What is written, and by which template."""

FLIGHT, LIFTED = 150, 300
"""Samples of a flight in the self-test, and of one with lift-off and landing."""
PUSH, PULL = 0.2, 3.0
"""Loads of the flights, in what an axis can pull with its greatest current."""


class Vectors(NamedTuple):
    """Flights one after the other, N samples."""

    y: Array  # (N, readings) [m]
    r: Array  # (N, axes) [m]
    u: Array  # (N, axes): what the controllers gave [V]
    speed: Array  # (N,) [rad/s]
    mode: NDArray[np.uint8]  # (N,): what they were doing; all 0 without lift-off
    fly: NDArray[np.bool_]  # (N,): whether they were told to fly
    starts: list[int]  # where flights begin
    saturated: int  # samples in which a current was at its limit


def context(
    estimator: Estimator, flight: Flight, name: str, precision: CPrecision, bound: float
) -> dict[str, Any]:
    """Return what the templates of the controllers say.

    Parameters
    ----------
    estimator : Estimator
        Of a whole machine, of the precision that is exported.
    flight : Flight
        With its ``[control]``, and what feeds it.
    name : str
        Prefix.
    precision : {"float", "double"}
        Of the numbers.
    bound : float
        See `vectors`.

    Raises
    ------
    AmbkitError
        There is no whole machine, or the controllers cannot be had with this estimator.
    """
    if estimator.whole is None:
        raise AmbkitError("controllers are exported of a whole machine; this is one axis")
    machine = estimator.whole.machine
    fed = estimator if flight.feedback == "estimate" else None
    plant = Plant(machine)
    speeds = speeds_of(machine, flight)
    fastest = machine.speed if speeds is None else max(map(abs, speeds))
    controllers = controllers_of(plant, flight.control, fed, fastest=fastest)
    fields = arrays(controllers, plant, fed)
    named, matrices = _matrices(fields)
    integral = _integrals(plant, controllers, flight, fed)
    pids = [[machine.sampling_time, *each] for each in controllers.pids]
    coils = [(b.magnet.bias_current, b.magnet.type == "two-sided") for b in plant.alone]
    gains = np.array([axis.bearing.amplifier.gain for axis in machine.axes])
    numbers = {
        "k_ui": gains, "integral": integral, "bias": np.array([i0 for i0, _ in coils]),
        "iu_min": np.array(fields["iu_min"]), "iu_max": np.array(fields["iu_max"]),
    }  # fmt: skip
    turn = controllers.let_turn
    if turn is not None:
        named |= {"motion": turn.motion.ravel(), "current": turn.current.ravel()}
    whole = flight.sequence and MachineController(
        plant, estimator, controllers, flight.sequence, fed is not None
    )
    flown = whole.fields if whole else {}
    numbers |= {key: np.array(flown[key]) for key in _FLIGHT if whole}
    sequence = {key: flown[key] for key in _COUNTS if whole}
    constants = Constants(precision)
    for key, values in (numbers | named).items():
        constants.array(f"control_{key}", values)
    for j, each in enumerate(pids):
        constants.fields(f"control_pid[{j}]", dict(zip(_PID, each, strict=True)), arrays=False)
    if whole:
        constants.fields("control_sequence", sequence, arrays=False)
        judged = {key: flown[key] for key in ("feedback_estimate", "settling", "bound")}
        constants.fields(f"{name}_flight", judged, arrays=False)
    tested = vectors(estimator, flight, bound, controllers)
    most = float(np.finfo(np.float32 if precision == "float" else np.float64).max)
    return {
        "kind": flight.control.type,
        "fed": fed is not None,
        "start": flight.start,
        "pids": [
            {key: data.number(v, precision) for key, v in zip(_PID, each, strict=True)}
            for each in pids
        ],
        "control_states": len(estimator.states) if fed else len(machine.readings),
        "control_arrays": [
            {"name": f"control_{key}", "length": values.size, "text": data.array(values, precision)}
            for key, values in (numbers | named).items()
        ],
        "matrices": matrices,
        "let_turn": _let_turn(turn, precision),
        "two_sided": [two for _, two in coils],
        "speed": data.number(machine.speed, precision),
        "sequence": None if not whole else _sequence(whole, flown, sequence, precision),
        "control_crc": constants.crc(),
        "in_flight": {
            "steps": len(tested.y),
            "saturated": tested.saturated,
            "y": data.array(np.nan_to_num(tested.y, nan=most).ravel(), precision),
            "r": data.array(tested.r.ravel(), precision),
            "u": data.array(tested.u.ravel(), precision),
            "speed": data.array(tested.speed, precision),
            "marks": data.array(_marks(tested), precision),
        },
    }


def speeds_of(machine: Machine, flight: Flight) -> tuple[float, float] | None:
    """Return the slowest and the fastest rotation of a flight [rad/s]; None at the machine's own.

    Parameters
    ----------
    machine : Machine
        What flies.
    flight : Flight
        What happens to it.
    """
    if flight.speed is None:
        return None
    n = max(2, round(flight.duration / machine.sampling_time) + 1)
    speed = flight.speed.sample(machine.sampling_time * np.arange(n + 1, dtype=float))
    if bool((speed == machine.speed).all()):
        return None
    return float(speed.min()), float(speed.max())


def _sequence(
    whole: MachineController, flown: dict[str, Any], sequence: dict[str, Any],
    precision: CPrecision,
) -> dict[str, Any]:  # fmt: skip
    """Return what the templates say of lift-off and landing."""
    quick = QUICK | {"settling": min(flown["settling"], QUICK["settling"])}
    return {
        "times": whole.sequence,
        "text": data.struct(sequence, precision, {}),
        "feedback_estimate": "true" if flown["feedback_estimate"] else "false",
        "settling": f"{flown['settling']}U",
        "bound": data.number(flown["bound"], precision),
        "quick": data.struct({key: quick[key] for key in _COUNTS}, precision, {}),
        "quick_settling": f"{quick['settling']}U",
    }


def _let_turn(turn: LetTurn | None, precision: CPrecision) -> dict[str, str] | None:
    if turn is None:
        return None
    counts = {key: str(value) for key, value in turn.counts.items()}
    return counts | {key: data.number(getattr(turn, key), precision) for key in ("first", "step")}


_FLIGHT = ("place", "down", "hold", "hold_by")
_COUNTS = ("waiting", "lost", "overloaded", "rise", "descent")
_PID = ("T", "kp", "ki", "kd", "T_f", "T_t", "weight", "iu_min", "iu_max")


def _matrices(fields: dict[str, Any]) -> tuple[dict[str, Array], dict[str, str]]:
    """Return the matrices that there are, and what the struct says of each."""
    names = {
        "position": "position", "velocity": "velocity", "turning": "turning", "spread": "spread",
        "reference": "reference", "fed_back": "gain_0", "fed_back_by_speed": "gain_1",
        "fed_back_by_square": "gain_2",
    }  # fmt: skip
    there = {to: np.array(fields[of]) for of, to in names.items() if fields[of] is not None}
    said = {to: f"control_{to}" if to in there else "NULL" for to in names.values()}
    return there, said


def _integrals(
    plant: Plant, controllers: Controllers, flight: Flight, fed: Estimator | None
) -> Array:
    """Return what the PIDs' integrals begin with: hovering in the middle, or lying at rest."""
    p = len(plant.axes)
    nothing = np.zeros(p)
    if flight.start == "rest" and flight.control.type != "lqg":
        return controllers.integrals(nothing, nothing, None)
    q, currents = plant.hovering(nothing, nothing)
    known = None if fed is None else fed.at_rest(q, current=currents)
    return controllers.integrals(currents, nothing, known)


def vectors(
    estimator: Estimator, flight: Flight, bound: float, controllers: Controllers
) -> Vectors:
    """Fly what the self-test flies, with the plant of the simulation.

    A step of the reference with a load, and loads beyond what the magnets hold with readings lost
    and far away; on all axes in turn, and where the flight's speed changes up and down with it.
    With lift-off these are longer flights, from where the rotor lies to where it lies again.

    Parameters
    ----------
    estimator : Estimator
        Beside the controllers, or feeding them.
    flight : Flight
        Its start, speeds, feedback and controllers are flown.
    bound : float
        Caps beyond which the exported filter starts anew, which the simulation does not without
        lift-off: a flight ends before that.
    controllers : Controllers
        The controllers.
    """
    assert estimator.whole is not None
    machine = estimator.whole.machine
    parts = []
    for scene in _scenes(machine, flight):
        run = simulate_machine(
            machine, scene.flight, estimator=estimator, controllers=controllers,
            readings=scene.readings, from_readings=True, fly=scene.fly,
            other=None if flight.sequence is None else _quick(estimator),
        )  # fmt: skip
        record = run.record
        y = np.column_stack([record[f"y_{r.name}"] for r in machine.readings])
        r, u = (
            np.column_stack([record[f"{which}_{axis.name}"] for axis in machine.axes])
            for which in "ru"
        )
        assert run.estimate is not None
        sequenced = flight.sequence is not None
        n = len(y) if sequenced else within(estimator, run.estimate.mean, bound)
        mode = record["mode"].astype(np.uint8) if sequenced else np.zeros(len(y), np.uint8)
        parts.append((y[:n], r[:n], u[:n], record["speed"][:n], mode[:n], scene.fly[:n] > 0))
    estimator.turning(None, 1)  # what is written of the filter is of the machine's own speed
    y, r, u, speed, mode, fly = (np.concatenate(each) for each in zip(*parts, strict=True))
    gain = np.array([axis.bearing.amplifier.gain for axis in machine.axes])
    low, high = (
        np.array([getattr(alone, f"current_{end}") for alone in Plant(machine).alone])
        for end in ("min", "max")
    )
    full = ((u * gain >= high * (1 - 1e-6)) | (u * gain <= low * (1 - 1e-6))).any(axis=1)
    starts = np.cumsum([0, *(len(each[0]) for each in parts[:-1])])
    return Vectors(y, r, u, speed, mode, fly, starts.tolist(), int(full.sum()))


def _quick(estimator: Estimator) -> dict[str, Any]:
    """Return fields of a sequence that firmware need not hold seconds of."""
    return QUICK | {"settling": min(settling_of(estimator), QUICK["settling"])}


class Scene(NamedTuple):
    """One flight of the self-test, n samples."""

    flight: Flight
    readings: Array  # (n, readings): what is added to them [m]; NaN: lost
    fly: Array  # (n,): whether it is told to fly, 1 or 0


def _scenes(machine: Machine, flight: Flight) -> Iterator[Scene]:
    if flight.sequence is None:
        for sign, share in ((1.0, PUSH), (-1.0, PULL)):
            happening = _happening(machine, flight, sign, share, FLIGHT)
            yield Scene(happening, _spoilt(machine, sign < 0, FLIGHT), np.ones(FLIGHT))
        return
    fly = np.ones(LIFTED)
    fly[:8], fly[100:106], fly[230:] = 0.0, 0.0, 0.0  # on the way up it is called back, and lands
    happening = _happening(machine, flight, 1.0, PUSH, LIFTED, 130)
    yield Scene(happening, _spoilt(machine, True, LIFTED, 150), fly)
    fly = np.ones(LIFTED)
    fly[200:210] = 0.0  # it has tripped by then, and lifts again
    yield Scene(_happening(machine, flight, -1.0, PULL, LIFTED, 130), _lost(machine), fly)


def _happening(
    machine: Machine, flight: Flight, sign: float, share: float, n: int, after: int = 0
) -> Flight:
    """Return a flight on all axes in turn: references of a twentieth of the travel, and loads."""
    T = machine.sampling_time
    references, loads = [], []
    for k, axis in enumerate(machine.axes):
        way = sign * (-1.0 if k % 2 else 1.0)
        law = axis.bearing.magnet
        most = 4 * law.magnet_constant * law.bias_current * axis.bearing.amplifier.current_limit
        force, late = way * share * most / law.air_gap**2, after + 8 * k
        push = Step(amplitude=force, time=(50 + late) * T)
        wanted = Step(amplitude=0.05 * way * axis.bearing.travel_limit, time=(12 + late) * T)
        references.append(Reference(axis=axis.name, position=wanted))
        loads.append(Disturbance(axis=axis.name, force=push))
    return Flight(
        duration=(n - 1) * T, start=flight.start, feedback=flight.feedback,
        control=flight.control, reference=tuple(references), disturbance=tuple(loads),
        seed=flight.seed, speed=_speed(machine, flight, sign, n), sequence=flight.sequence,
    )  # fmt: skip


def _speed(machine: Machine, flight: Flight, sign: float, n: int) -> Sum | None:
    """Return a speed that grows over two nodes of the model, or falls, within those of a flight."""
    speeds = speeds_of(machine, flight)
    if speeds is None:
        return None
    low, high = speeds
    by = min(2 * NODE / machine.sampling_time, high - low)
    first = low + 0.3 * (high - low - by) if sign > 0 else high - 0.1 * (high - low - by)
    turned = Ramp(slope=sign * by / (n * machine.sampling_time))
    return Sum(parts=(Constant(value=first), turned))


def _spoilt(machine: Machine, spoil: bool, n: int, after: int = 0) -> Array:
    """Return what is added to the readings: nothing, or losses and readings far away."""
    m = len(machine.readings)
    added = np.zeros((n, m))
    if spoil:
        travel = min(each.travel_limit for each in machine.bearing)
        added[after + 20 : after + 24, 0], added[after + 28, :] = np.nan, np.nan
        added[after + 34, m - 1], added[after + 38, 0] = 3 * travel, -3 * travel
    return added


def _lost(machine: Machine) -> Array:
    """Return readings that begin far away, and of which all are lost until it trips."""
    added = np.zeros((LIFTED, len(machine.readings)))
    added[:2] = 30 * max(each.travel_limit for each in machine.bearing)
    added[145:180] = np.nan
    return added


def _marks(tested: Vectors) -> NDArray[np.uint8]:
    """Return the mode of each sample, 8 where it is told to fly, 16 where a flight begins (N,)."""
    found = tested.mode + 8 * tested.fly.astype(np.uint8)
    found[tested.starts] += 16
    return found.astype(np.uint8)
