"""Estimator and controllers of a machine in one step, as C: what `simulate_machine` flew."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.export.c import data
from ambkit.export.c.control_scenes import QUICK
from ambkit.export.c.crc import Constants
from ambkit.export.c.machine_scenes import also_infinite, in_turn, marks_of, speeds_of, vectors
from ambkit.simulation.control_machine import MachineController
from ambkit.simulation.controllers import Controllers, arrays, controllers_of
from ambkit.simulation.default_control import settled_flight
from ambkit.simulation.plant import Plant

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.export.c.data import CPrecision
    from ambkit.simulation.flight import Flight
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


def context(
    estimator: Estimator, flight: Flight, name: str, precision: CPrecision, bound: float
) -> dict[str, Any]:
    """Return what the templates of the controllers say."""
    machine = estimator.machine
    flight = settled_flight(machine, flight)
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
        tables = ("motion", "current", "reach", "ampere")
        named |= {key: getattr(turn, key).ravel() for key in tables}
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

    def listed(values: Array) -> str:
        stood_in = np.nan_to_num(values, nan=most, posinf=most / 2, neginf=-most / 2)
        return data.array(stood_in.ravel(), precision)

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
        "tracking": all(pid[_PID.index("T_t")] > 0 for pid in pids),
        "two_sided": [two for _, two in coils],
        "speed": data.number(machine.speed, precision),
        "sequence": None if not whole else _sequence(whole, flown, sequence, precision),
        "control_crc": constants.crc(),
        "in_flight": {
            "steps": len(tested.y),
            "amplified": int(tested.amplified.sum()),
            "saturated": tested.saturated,
            "y": listed(also_infinite(tested.y)),
            "r": listed(also_infinite(tested.r)),
            "u": data.array(tested.u.ravel(), precision),
            "speed": data.array(tested.speed, precision),
            # Without lift-off the simulated filter starts wherever the rotor is, the exported one
            # not where it lies.
            "estimates": bool(whole) or flight.start != "rest",
            "status": data.array(tested.status, precision),
            "mean": data.array(in_turn(tested.mean), precision),
            "taken_with": data.array(tested.taken_with, precision),
            "marks": data.array(marks_of(tested), precision),
        },
    }


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
        "position": "position", "velocity": "velocity", "spread": "spread",
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
