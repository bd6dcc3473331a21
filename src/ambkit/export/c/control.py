"""Controller of a machine as C: its constants, and its self-test."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import name_of
from ambkit.control.controller_states import Controller
from ambkit.control.controllers import controllers_of
from ambkit.estimate.estimator import Estimator
from ambkit.export.c import c_literals, controller_test_cases, test_vectors
from ambkit.export.c.c_literals import Constants, CPrecision, Name
from ambkit.machine.magnets import own_time
from ambkit.models.plant import Plant
from ambkit.simulation.scenario import Scenario, settled_scenario

SOURCES = ("src/control.c", "src/controllers.c", "src/controller.c", "src/sequence.c")

TEMPLATES = {
    "{}.h": "control.h", "{}.c": "control.c", "selftest/{}_selftest.h": "control_selftest.h",
    "selftest/{}_selftest.c": "control_selftest.c", "selftest/{}_vectors.c": "control_vectors.c",
}  # fmt: skip
"""Files that replace those of an axis's filter, and that supplement those of several axes."""

_BOUNDS: dict[tuple[bool, CPrecision], tuple[str, str]] = {
    (False, "float"): ("3e-4", "3e-5"), (False, "double"): ("1e-10", "1e-11"),
    (True, "float"): ("5e-2", "1e-3"), (True, "double"): ("2e-5", "1e-9"),
}  # fmt: skip
"""Tolerances of one step if the compiler contracts, with several axes and with one: states over
their initial standard deviations, and currents over the maximum. A machine's covariance has
fewer digits.
"""

_PID = ("kp", "ki", "kd", "T_f", "T_t", "weight", "iu_min", "iu_max")
_LAW = ("reference", "position", "velocity", "spread", "iu_min", "iu_max")
_GAINS = ("fed_back", "fed_back_by_speed", "fed_back_by_square")
_CONTROL = ("start", "start_by", "place", "down", "hold", "hold_by")
_COUNTS = ("waiting", "lost", "overloaded", "rise", "descent")
_SCHEDULE = ("speed", "gain")
_TURN = ("motion", "current", "reach", "ampere")


class Structs(NamedTuple):
    """Constants by their names in C."""

    arrays: dict[str, Array]
    pids: list[dict[str, Any]]
    unbalance_control: dict[str, Any]
    schedule: dict[str, Any]
    law: dict[str, Any]
    sequence: dict[str, Any]
    control: dict[str, Any]


def controller_of(filter: Estimator, scenario: Scenario) -> Controller:
    """Return the controller of a scenario around an estimator."""
    machine = filter.machine
    if scenario.controller.custom:
        raise AmbkitError(
            f"controller.custom: {name_of(scenario.controller.custom)} is Python, and has no C"
        )
    settled = settled_scenario(machine, scenario)
    feeding = filter if settled.feedback == "estimate" else None
    plant, speeds = Plant(machine), controller_test_cases.speeds_of(machine, settled)
    max_speed = machine.speed if speeds is None else max(map(abs, speeds))
    result = controllers_of(plant, settled.controller, feeding, fastest=max_speed)
    control = settled.controller
    return Controller(plant, filter, result, settled.sequence, feeding is not None, control)


def structs(controller: Controller, name: str, *, of_filter: bool = True) -> Structs:
    """Return a controller's constants; `of_filter`: with several axes the start is the filter's."""
    fields, machine = controller.fields, controller.plant.machine
    several = len(machine.axes) > 1 and of_filter
    elsewhere = {key: Name(f"{name}_{key}") for key in ("start", "start_by") if several}
    keys = (*_LAW, *_GAINS, *(key for key in _CONTROL if key not in elsewhere))
    array_fields = {key: fields[key] for key in keys if fields[key] is not None}
    unbalance_control: dict[str, Any] = {}
    if fields["unbalance_control_motion"] is not None:
        array_fields |= {key: fields[f"unbalance_control_{key}"] for key in _TURN}
        numbers = ("nodes", "from", "width", "moved", "first", "step")
        unbalance_control = {key: fields[f"unbalance_control_{key}"] for key in numbers}
        unbalance_control |= {key: Name(f"of_{key}") for key in _TURN}
    schedule: dict[str, Any] = {}
    if (speeds := fields["schedule_speed"]) is not None:
        array_fields |= {f"schedule_{key}": fields[f"schedule_{key}"] for key in _SCHEDULE}
        schedule = {"nodes": len(speeds)} | {k: Name(f"of_schedule_{k}") for k in _SCHEDULE}
    arrays = {f"of_{key}": np.array(values, float) for key, values in array_fields.items()}

    def at(key: str) -> Name:
        return elsewhere.get(key, Name(f"of_{key}" if key in array_fields else "NULL"))

    pids = [pid_fields(machine.sampling_time, gains) for gains in fields["pid"]]
    arrays |= _behind(pids, fields["pid"])
    states = len(fields["position"]) // len(pids)
    law = {"axes": len(machine.axes), "states": states, "pids": len(pids), "pid": Name("of_pid")}
    law |= {key: at(key) for key in _LAW if key in array_fields or key != "reference"}
    law["gain"] = Name("{" + ", ".join(at(key) for key in _GAINS) + "}")
    law |= {"unbalance_control": Name("&unbalance_control")} if unbalance_control else {}
    law |= {"schedule": Name("&schedule")} if schedule else {}
    control = {
        "estimator": Name(f"&{name}_estimator"), "law": Name("&law"),
        "sequence": Name("&sequence" if controller.sequence is not None else "NULL"),
        "feedback_estimate": fields["feedback_estimate"], "settling": fields["settling"],
        "bound": fields["bound"], "std": Name(f"{name}_std"),
    }  # fmt: skip
    control |= {key: at(key) for key in _CONTROL}
    counts = {key: fields[key] for key in _COUNTS if key in fields}
    return Structs(arrays, pids, unbalance_control, schedule, law, counts, control)


def pid_fields(T: float, gains: Sequence[float]) -> dict[str, Any]:
    """Return the fields of ``amb_pid``, without the sections behind it."""
    return {"T": T} | dict(zip(_PID, gains, strict=False))


def _behind(pids: list[dict[str, Any]], gains: Sequence[list[float]]) -> dict[str, Any]:
    """Point PIDs to their sections, which are returned; {} without any."""
    all_: list[float] = []
    for pid, gain in zip(pids, gains, strict=True):
        if sections := gain[len(_PID) :]:
            pid["sections"] = len(sections) // 5
            pid["section"] = Name(f"&of_section[{len(all_)}]")
            all_ += sections
    return {"of_section": np.array(all_, float)} if all_ else {}


def in_c(of: Structs, precision: CPrecision) -> dict[str, Any]:
    """Format all constants as C; missing ones are empty."""
    structs = of._asdict()
    arrays, pids = structs.pop("arrays"), structs.pop("pids")
    return {
        "arrays": c_literals.declared(arrays, precision),
        "pids": [c_literals.struct(pid, precision) for pid in pids],
    } | {k: c_literals.struct(item, precision) if item else "" for k, item in structs.items()}


def context(
    controller: Controller, scenario: Scenario, name: str, precision: CPrecision
) -> dict[str, Any]:
    """Return the template variables of a controller."""
    of, machine = structs(controller, name), controller.plant.machine
    bias = np.array([axis.bearing.magnet.bias_current for axis in machine.axes])
    two_sided = [axis.bearing.magnet.type == "two-sided" for axis in machine.axes]
    several = len(machine.axes) > 1
    control_bound, current_bound = _BOUNDS[several, precision]
    samples = _levitated(controller, scenario, precision)
    return {
        "control_bound": control_bound,
        "current_bound": current_bound,
        "law_text": f"{scenario.controller.type}, fed by the {scenario.feedback}" if several
        else _controller_text(controller),
        "controller": in_c(of, precision) | {
            "bias": c_literals.array(bias, precision)
            if several
            else c_literals.number(bias[0], precision),
            "two_sided": ", ".join(str(item).lower() for item in two_sided),
        },
        "coils": controller.coils,
        "own_time": f"{1e3 * own_time(controller.first_axis):.3g} ms",
        "speed": c_literals.number(machine.speed, precision),
        "times": controller.sequence,
        "levitated": samples,
        "snapshots": samples["snapshots"],
    }  # fmt: skip


def _levitated(controller: Controller, scenario: Scenario, precision: CPrecision) -> dict[str, Any]:
    """Return the template variables of the self-test."""
    tested = controller_test_cases.vectors(controller, scenario)
    fast_sequence, filter = controller_test_cases.fast_sequence(controller), controller.estimator

    def listed(values: Array) -> str:
        result = controller_test_cases.with_infinite_inputs(values)
        return c_literals.array(test_vectors.with_stand_ins(result, precision).ravel(), precision)

    between, beyond = test_vectors.stops(filter)
    middle = np.ravel(filter.inputs.y.numbers(0.0))[0]
    starts = np.array([*tested.starts, *tested.transfers, len(tested.y)])
    kinds = ["from power-on"] * len(tested.starts) + ["taken over"] * len(tested.transfers)
    return {
        "steps": len(tested.y),
        "amplified": int(tested.snapshots.amplified.sum()),
        "snapshots": {
            "count": len(tested.snapshots.at),
            "at": c_literals.array(np.array(tested.snapshots.at, np.uint16), precision),
            "covariance": c_literals.array(tested.snapshots.before.ravel(), precision),
        },
        "y": listed(tested.y),
        "r": listed(tested.r),
        "u": c_literals.array(tested.u.ravel(), precision),
        "speed": listed(tested.speed),
        "status": c_literals.array(tested.status, precision),
        "mean": c_literals.array(tested.mean.ravel(), precision),
        "taken_with": c_literals.array(tested.transfer_currents, precision),
        "marks": c_literals.array(controller_test_cases.marks_of(tested), precision),
        "quick": c_literals.struct({key: fast_sequence[key] for key in _COUNTS}, precision),
        "settling": f"{fast_sequence['settling']}U",
        "places": c_literals.rows(np.vstack([between, beyond]), precision),
        "middle": c_literals.number(middle, precision),
        "runs": list(zip(kinds, np.diff(starts).tolist(), strict=True)),
        "coverage": controller_test_cases.coverage(controller, tested),
    }


def _controller_text(controller: Controller) -> str:
    pid = controller.pid
    if pid.type == "lqg":
        return "linear-quadratic regulator of the estimated states"
    ahead = f", {pid.feed_forward:g} of the estimated load taken back" if pid.feed_forward else ""
    behind = f", with {', '.join(item.type for item in pid.block)} behind it" if pid.block else ""
    return f"PID, fed by the {pid.feedback}{ahead}{behind}"


def constants(controller: Controller, name: str, crc: Constants) -> None:
    """Add the controller's constants to the CRC."""
    of = structs(controller, name)
    for place, values in of.arrays.items():
        crc.array(place, values)
    for k, pid in enumerate(of.pids):
        crc.fields(f"of_pid[{k}]", pid, arrays=False)
    for part in ("unbalance_control", "schedule", "law", "sequence"):
        crc.fields(part, getattr(of, part), arrays=False)
    crc.fields(f"{name}_control", of.control, arrays=False)
    axes = controller.plant.machine.axes
    bias = np.array([axis.bearing.magnet.bias_current for axis in axes])
    crc.array(f"{name}_bias" if len(axes) > 1 else f"&{name}_bias", bias)
