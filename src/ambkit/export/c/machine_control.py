"""Estimator and controllers of a machine in one step, as C: what `simulate_machine` flew."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.export.c import data
from ambkit.export.c.crc import Constants
from ambkit.export.c.vectors import within
from ambkit.simulation.controllers import Controllers, arrays, controllers_of
from ambkit.simulation.flight import Disturbance, Flight, Reference
from ambkit.simulation.machine import simulate_machine
from ambkit.simulation.plant import Plant
from ambkit.simulation.waveforms import Step

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.export.c.data import CPrecision
    from ambkit.simulation.let_turn import LetTurn

Array = NDArray[np.float64]

SOURCES = ("src/controllers.c", "src/controller.c")
"""Files of the core that it needs besides the filter's."""
FILES = {
    "{name}_control.h": "machine_control.h", "{name}_control.c": "machine_control.c",
    "{name}_control_data.c": "machine_control_data.c",
    "selftest/{name}_control_selftest.c": "machine_control_selftest.c",
}  # fmt: skip
"""What is written, and by which template."""

FLIGHT = 150
"""Samples of a flight in the self-test."""
PUSH, PULL = 0.2, 3.0
"""Loads of the flights, in what an axis can pull with its greatest current."""


class Vectors(NamedTuple):
    """Flights one after the other, N samples."""

    y: Array  # (N, readings) [m]
    r: Array  # (N, axes) [m]
    u: Array  # (N, axes): what the controllers gave [V]
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
    controllers = controllers_of(plant, flight.control, fed)
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
    constants = Constants(precision)
    for key, values in (numbers | named).items():
        constants.array(f"control_{key}", values)
    for j, each in enumerate(pids):
        constants.fields(f"control_pid[{j}]", dict(zip(_PID, each, strict=True)), arrays=False)
    tested = vectors(estimator, flight, bound)
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
        "control_crc": constants.crc(),
        "in_flight": {
            "steps": len(tested.y),
            "saturated": tested.saturated,
            "y": data.array(np.nan_to_num(tested.y, nan=most).ravel(), precision),
            "r": data.array(tested.r.ravel(), precision),
            "u": data.array(tested.u.ravel(), precision),
            "starts": data.array(_marks(tested).astype(np.uint8), precision),
        },
    }


def _let_turn(turn: LetTurn | None, precision: CPrecision) -> dict[str, str] | None:
    if turn is None:
        return None
    counts = {key: str(value) for key, value in turn.counts.items()}
    return counts | {key: data.number(getattr(turn, key), precision) for key in ("first", "step")}


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


def vectors(estimator: Estimator, flight: Flight, bound: float = 10.0) -> Vectors:
    """Fly what the self-test flies, with the plant of the simulation.

    Two flights: a step of the reference with a load, and loads beyond what the magnets hold with
    readings lost and far away; both at the machine's speed, on all axes in turn.

    Parameters
    ----------
    estimator : Estimator
        Beside the controllers, or feeding them.
    flight : Flight
        Its start, feedback and controllers are flown.
    bound : float
        Caps beyond which the exported filter starts anew, which the simulation does not: a flight
        ends before that.
    """
    assert estimator.whole is not None
    machine = estimator.whole.machine
    parts = []
    for k, sign in enumerate((1.0, -1.0)):
        happening = _happening(machine, flight, sign, PUSH if k == 0 else PULL)
        spoilt = _spoilt(machine, k == 1)
        run = simulate_machine(
            machine, happening, estimator=estimator, readings=spoilt, from_readings=True
        )
        y = np.column_stack([run.record[f"y_{r.name}"] for r in machine.readings])
        r, u = (
            np.column_stack([run.record[f"{which}_{axis.name}"] for axis in machine.axes])
            for which in "ru"
        )
        assert run.estimate is not None
        n = within(estimator, run.estimate.mean, bound)
        parts.append((y[:n], r[:n], u[:n]))
    y, r, u = (np.concatenate(each) for each in zip(*parts, strict=True))
    gain = np.array([axis.bearing.amplifier.gain for axis in machine.axes])
    low, high = (
        np.array([getattr(alone, f"current_{end}") for alone in Plant(machine).alone])
        for end in ("min", "max")
    )
    full = ((u * gain >= high * (1 - 1e-6)) | (u * gain <= low * (1 - 1e-6))).any(axis=1)
    return Vectors(y, r, u, [0, len(parts[0][0])], int(full.sum()))


def _happening(machine: Any, flight: Flight, sign: float, share: float) -> Flight:
    """Return a flight on all axes in turn: references of a twentieth of the travel, and loads."""
    T = machine.sampling_time
    references, loads = [], []
    for k, axis in enumerate(machine.axes):
        way = sign * (-1.0 if k % 2 else 1.0)
        law = axis.bearing.magnet
        most = 4 * law.magnet_constant * law.bias_current * axis.bearing.amplifier.current_limit
        push = Step(amplitude=way * share * most / law.air_gap**2, time=(50 + 8 * k) * T)
        wanted = Step(amplitude=0.05 * way * axis.bearing.travel_limit, time=(12 + 7 * k) * T)
        references.append(Reference(axis=axis.name, position=wanted))
        loads.append(Disturbance(axis=axis.name, force=push))
    return Flight(
        duration=(FLIGHT - 1) * T, start=flight.start, feedback=flight.feedback,
        control=flight.control, reference=tuple(references), disturbance=tuple(loads),
        seed=flight.seed,
    )  # fmt: skip


def _spoilt(machine: Any, spoil: bool) -> Array:
    """Return what is added to the readings: nothing, or losses and readings far away."""
    m = len(machine.readings)
    added = np.zeros((FLIGHT, m))
    if spoil:
        travel = min(each.travel_limit for each in machine.bearing)
        added[20:24, 0], added[28, :] = np.nan, np.nan
        added[34, m - 1], added[38, 0] = 3 * travel, -3 * travel
    return added


def _marks(tested: Vectors) -> NDArray[np.bool_]:
    """Return where flights begin (N,)."""
    found = np.zeros(len(tested.y), bool)
    found[tested.starts] = True
    return found
