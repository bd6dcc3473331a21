"""The controller of a machine as C: its constants, and what its self-test flies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.estimate.estimate import Status
from ambkit.export.c import data, machine_scenes
from ambkit.export.c.control_scenes import QUICK, scenes, taken_over
from ambkit.export.c.crc import Constants
from ambkit.export.c.data import CPrecision, Name
from ambkit.machine.magnets import own_time
from ambkit.simulation.sequence import Mode

if TYPE_CHECKING:
    from ambkit.simulation.control import Controller
    from ambkit.simulation.flight import Flight

SOURCES = ("src/control.c", "src/controllers.c", "src/controller.c", "src/sequence.c")

TEMPLATES = {
    "{}.h": "control.h", "{}.c": "control.c", "README.md": "control.md",
    "selftest/{}_selftest.h": "control_selftest.h", "selftest/{}_selftest.c": "control_selftest.c",
    "selftest/{}_vectors.c": "control_vectors.c",
}  # fmt: skip
"""What stands in the place of a filter's files."""
BESIDE = {
    "{}_control.h": "control.h", "{}_control.c": "control.c",
    "selftest/{}_control_selftest.c": "machine_control_selftest.c",
}  # fmt: skip
"""What stands beside them, of several axes."""

_PID = ("kp", "ki", "kd", "T_f", "T_t", "weight", "iu_min", "iu_max")
_LAW = ("reference", "position", "velocity", "spread", "iu_min", "iu_max")
_GAINS = ("fed_back", "fed_back_by_speed", "fed_back_by_square")
_CONTROL = ("start", "start_by", "place", "down", "hold", "hold_by")
_COUNTS = ("waiting", "lost", "overloaded", "rise", "descent")
_TURN = ("motion", "current", "reach", "ampere")


class Structs(NamedTuple):
    """The constants, by their names in C."""

    arrays: dict[str, NDArray[np.float64]]
    pids: list[dict[str, float]]
    let_turn: dict[str, Any]
    law: dict[str, Any]
    sequence: dict[str, Any]
    control: dict[str, Any]


def structs(controller: Controller, name: str) -> Structs:
    """Return a controller's constants."""
    fields, machine = controller.fields, controller.estimator.machine
    several = len(machine.axes) > 1
    of_filter = {key: Name(f"{name}_{key}") for key in ("start", "start_by") if several}
    keys = (*_LAW, *_GAINS, *(key for key in _CONTROL if key not in of_filter))
    told = {key: fields[key] for key in keys if fields[key] is not None}
    let_turn: dict[str, Any] = {}
    if fields["let_turn_motion"] is not None:
        told |= {key: fields[f"let_turn_{key}"] for key in _TURN}
        numbers = ("nodes", "from", "width", "moved", "first", "step")
        let_turn = {key: fields[f"let_turn_{key}"] for key in numbers}
        let_turn |= {key: Name(f"of_{key}") for key in _TURN}
    arrays = {f"of_{key}": np.array(values, float) for key, values in told.items()}

    def at(key: str) -> Name:
        return of_filter.get(key, Name(f"of_{key}" if key in told else "NULL"))

    pids = [
        {"T": machine.sampling_time} | dict(zip(_PID, gains, strict=True))
        for gains in fields["pid"]
    ]
    states = len(fields["position"]) // len(pids)
    law = {"axes": len(machine.axes), "states": states, "pids": len(pids), "pid": Name("of_pid")}
    law |= {key: at(key) for key in _LAW if key in told or key != "reference"}
    law["gain"] = Name("{" + ", ".join(at(key) for key in _GAINS) + "}")
    law |= {"let_turn": Name("&let_turn")} if let_turn else {}
    control = {
        "estimator": Name(f"&{name}_estimator"), "law": Name("&law"),
        "sequence": Name("&sequence" if controller.sequence is not None else "NULL"),
        "feedback_estimate": fields["feedback_estimate"], "settling": fields["settling"],
        "bound": fields["bound"], "std": Name(f"{name}_std"),
    }  # fmt: skip
    control |= {key: at(key) for key in _CONTROL}
    counts = {key: fields[key] for key in _COUNTS if key in fields}
    return Structs(arrays, pids, let_turn, law, counts, control)


def _in_c(of: Structs, precision: CPrecision) -> dict[str, Any]:
    return {
        "arrays": data.declared(of.arrays, precision),
        "pids": [data.struct(pid, precision, {}) for pid in of.pids],
        "law": data.struct(of.law, precision, {}),
        "sequence": data.struct(of.sequence, precision, {}),
        "control": data.struct(of.control, precision, {}),
    }


def of_several(
    controller: Controller, flight: Flight, name: str, precision: CPrecision
) -> dict[str, Any]:
    """Return what the templates say of the controller of several axes."""
    estimator, of = controller.estimator, structs(controller, name)
    machine = estimator.machine
    tested = machine_scenes.vectors(estimator, flight, controller.law)
    quick = QUICK | {"settling": min(of.control["settling"], QUICK["settling"])}
    most = float(np.finfo(np.float32 if precision == "float" else np.float64).max)
    magnets = [axis.bearing.magnet for axis in machine.axes]

    def listed(values: NDArray[np.float64]) -> str:
        stood_in = np.nan_to_num(values, nan=most, posinf=most / 2, neginf=-most / 2)
        return data.array(stood_in.ravel(), precision)

    return {
        "law_said": f"{flight.control.type}, fed by the {flight.feedback}",
        "controller": _in_c(of, precision) | {
            "bias": data.array(np.array([each.bias_current for each in magnets]), precision),
            "two_sided": ", ".join(str(each.type == "two-sided").lower() for each in magnets),
            "let_turn": data.struct(of.let_turn, precision, {}) if of.let_turn else "",
        },
        "speed": data.number(machine.speed, precision),
        "sequence": {
            "times": controller.sequence,
            "quick": data.struct({key: quick[key] for key in _COUNTS}, precision, {}),
            "quick_settling": f"{quick['settling']}U",
        },
        "in_flight": {
            "steps": len(tested.y),
            "amplified": int(tested.amplified.sum()),
            "saturated": tested.saturated,
            "y": listed(machine_scenes.also_infinite(tested.y)),
            "r": listed(machine_scenes.also_infinite(tested.r)),
            "u": data.array(tested.u.ravel(), precision),
            "speed": data.array(tested.speed, precision),
            "status": data.array(tested.status, precision),
            "mean": data.array(machine_scenes.in_turn(tested.mean), precision),
            "taken_with": data.array(tested.taken_with, precision),
            "marks": data.array(machine_scenes.marks_of(tested), precision),
        },
    }  # fmt: skip


def context(controller: Controller, name: str, precision: CPrecision) -> dict[str, Any]:
    """Return what the templates say of a controller."""
    of = structs(controller, name)
    tested = vectors(controller)
    number = np.float32 if precision == "float" else np.float64
    quick = QUICK | {"settling": min(of.control["settling"], QUICK["settling"])}
    bearing = controller.bearing
    return {
        **_in_c(of, precision),
        "bias": data.number(bearing.magnet.bias_current, precision),
        "limit": data.number(float(number(bearing.amplifier.current_limit)), precision),
        "coils": controller.coils,
        "law_said": _said(controller),
        "fed": controller.pid.feedback,
        "own_time": f"{1e3 * own_time(bearing):.3g} ms",
        "times": controller.sequence,
        "taken_with": data.number(float(number(taken_over(controller))), precision),
        "quick_settling": quick["settling"],
        "quick": data.struct({key: quick[key] for key in _COUNTS}, precision, {}),
        "steps": len(tested.y),
        "columns": tested.expected.shape[1],
        "y": data.array(tested.y, precision),
        "r": data.array(tested.r, precision),
        "told": data.array(tested.expected, precision),
        "status": data.array(tested.status, precision),
        "marks": data.array(tested.marks, precision),
        "runs": tested.runs,
        "coverage": coverage(controller, tested),
    }


def _said(controller: Controller) -> str:
    pid = controller.pid
    if pid.type == "lqg":
        return "linear-quadratic regulator of the estimated states"
    ahead = f", {pid.feed_forward:g} of the estimated load taken back" if pid.feed_forward else ""
    return f"PID, fed by the {pid.feedback}{ahead}"


def constants(controller: Controller, name: str, crc: Constants) -> None:
    """Take the controller's constants into the CRC."""
    of = structs(controller, name)
    for place, values in of.arrays.items():
        crc.array(place, values)
    for k, pid in enumerate(of.pids):
        crc.fields(f"of_pid[{k}]", pid, arrays=False)
    crc.fields("let_turn", of.let_turn, arrays=False)
    crc.fields("law", of.law, arrays=False)
    crc.fields("sequence", of.sequence, arrays=False)
    crc.fields(f"{name}_control", of.control, arrays=False)
    axes = controller.estimator.machine.axes
    bias = np.array([axis.bearing.magnet.bias_current for axis in axes])
    crc.array(f"{name}_bias" if len(axes) > 1 else f"&{name}_bias", bias)


class Vectors(NamedTuple):
    """N samples of several runs, one after the other."""

    y: NDArray[np.float64]  # (N,), as the rig has them; stand-ins for what is no number
    r: NDArray[np.float64]  # (N,) [m]
    expected: NDArray[np.float64]  # (N, columns): coils, iu, u, means
    status: NDArray[np.uint16]  # (N,)
    marks: NDArray[np.uint8]  # (N,): mode, and flags
    runs: list[tuple[str, int]]


FLY, START, TAKEN, USABLE = 8, 16, 32, 64
"""Marks of a sample, beside the mode after it: told to fly, a run starts at power-on or by taking
over, and what is told of whether the estimate can be used."""


def vectors(controller: Controller) -> Vectors:
    """Let a controller live through all scenes, with a quick sequence."""
    most = float(np.finfo(controller.estimator.precision).max)
    settling = min(controller.fields["settling"], QUICK["settling"])
    found, runs = [], []
    for scene in scenes(controller):
        other = QUICK | {"settling": settling}
        told = controller.run(scene.y, scene.r, scene.fly, taken_over=scene.taken_over, other=other)
        parts = (told["coil"], told["iu"][:, None], told["u"][:, None], told["mean"])
        marks = told["mode"].astype(np.uint8) + USABLE * told["usable"].astype(np.uint8)
        marks += (FLY * scene.fly).astype(np.uint8)
        marks[0] += START if scene.taken_over is None else TAKEN
        y = np.nan_to_num(scene.y, nan=most, posinf=most / 2, neginf=-most / 2)
        r = np.nan_to_num(scene.r, nan=most, posinf=most / 2, neginf=-most / 2)
        found.append((y, r, np.hstack(parts).astype(float), told["status"], marks))
        runs.append((scene.name, len(y)))
    joined = [np.concatenate(each) for each in zip(*found, strict=True)]
    y, r, expected, status, marked = joined
    return Vectors(y, r, expected, status, marked, runs)


def coverage(controller: Controller, tested: Vectors) -> list[tuple[str, str]]:
    """Return what the samples visit, in words: what, and how much of it."""
    rows = [("samples", f"{len(tested.y)}, in {len(tested.runs)} runs, each from a start")]
    names = [f"current of coil {k}" for k in range(controller.coils)] + ["`iu`", "`u`"]
    units = ["A"] * (controller.coils + 1) + ["V"]
    names += [f"`{state.name}`" for state in controller.estimator.states]
    units += [state.unit for state in controller.estimator.states]
    for name, unit, values in zip(names, units, tested.expected.T, strict=True):
        rows.append((name, f"{values.min():.4g} to {values.max():.4g} {unit}"))
    for mode in Mode:
        rows.append((f"`AMB_{mode.name}`", f"{int((tested.marks % 8 == mode).sum())} samples"))
    never = []
    for flag in Status:
        count = int(((tested.status & flag) != 0).sum())
        never += [] if count else [f"`AMB_{flag.name}`"]
        rows += [(f"`AMB_{flag.name}`", f"{count} samples")] if count else []
    return [*rows, ("flags that are not raised", ", ".join(never) or "none")]
