"""The whole controller of an axis as C: its constants, and its self-test's vectors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.estimate.estimate import Status
from ambkit.export.c import data
from ambkit.export.c.control_scenes import QUICK, scenes, taken_over
from ambkit.export.c.crc import Constants
from ambkit.export.c.data import CPrecision, Name
from ambkit.machine.magnets import own_time
from ambkit.simulation.sequence import Mode

if TYPE_CHECKING:
    from ambkit.simulation.control import Controller

SOURCES = ("src/control.c", "src/controllers.c", "src/controller.c", "src/sequence.c")

TEMPLATES = {
    "{}.h": "control.h", "{}.c": "control.c", "README.md": "control.md",
    "selftest/{}_selftest.h": "control_selftest.h", "selftest/{}_selftest.c": "control_selftest.c",
    "selftest/{}_vectors.c": "control_vectors.c",
}  # fmt: skip
"""What stands in the place of a filter's files."""

_PID = ("kp", "ki", "kd", "T_f", "T_t", "weight", "iu_min", "iu_max")
_LAW = ("position", "velocity", "spread", "iu_min", "iu_max")
_GAINS = ("fed_back", "fed_back_by_speed", "fed_back_by_square")
_CONTROL = ("start", "start_by", "place", "down", "hold", "hold_by")
_COUNTS = ("waiting", "lost", "overloaded", "rise", "descent")


class Structs(NamedTuple):
    """The constants, by their names in C."""

    arrays: dict[str, NDArray[np.float64]]
    pids: list[dict[str, float]]
    law: dict[str, Any]
    sequence: dict[str, Any]
    control: dict[str, Any]


def structs(controller: Controller, name: str) -> Structs:
    """Return a controller's constants."""
    fields = controller.fields
    told = {key: fields[key] for key in (*_LAW, *_GAINS, *_CONTROL) if fields[key] is not None}
    arrays = {f"of_{key}": np.array(values, float) for key, values in told.items()}

    def at(key: str) -> Name:
        return Name(f"of_{key}" if key in told else "NULL")

    T = controller.bearing.sampling_time
    pids = [{"T": T} | dict(zip(_PID, gains, strict=True)) for gains in fields["pid"]]
    states = len(controller.estimator.states) if fields["feedback_estimate"] else 1
    law = {"axes": 1, "states": states, "pids": len(pids), "pid": Name("of_pid")}
    law |= {key: at(key) for key in _LAW}
    law["gain"] = Name("{" + ", ".join(at(key) for key in _GAINS) + "}")
    control = {
        "estimator": Name(f"&{name}_estimator"), "law": Name("&law"),
        "sequence": Name("&sequence" if controller.sequence is not None else "NULL"),
        "feedback_estimate": fields["feedback_estimate"], "settling": fields["settling"],
        "bound": fields["bound"], "std": Name(f"{name}_std"),
    }  # fmt: skip
    control |= {key: at(key) for key in _CONTROL}
    counts = {key: fields[key] for key in _COUNTS if key in fields}
    return Structs(arrays, pids, law, counts, control)


def context(controller: Controller, name: str, precision: CPrecision) -> dict[str, Any]:
    """Return what the templates say of a controller."""
    of = structs(controller, name)
    tested = vectors(controller)
    number = np.float32 if precision == "float" else np.float64
    quick = QUICK | {"settling": min(of.control["settling"], QUICK["settling"])}
    bearing = controller.bearing
    return {
        "arrays": data.declared(of.arrays, precision),
        "pids": [data.struct(pid, precision, {}) for pid in of.pids],
        "law": data.struct(of.law, precision, {}),
        "sequence": data.struct(of.sequence, precision, {}),
        "control": data.struct(of.control, precision, {}),
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
    crc.fields("law", of.law, arrays=False)
    crc.fields("sequence", of.sequence, arrays=False)
    crc.fields(f"{name}_control", of.control, arrays=False)
    crc.array(f"&{name}_bias", np.array([controller.bearing.magnet.bias_current]))


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
