"""The short form of a machine with one axis: reading, writing and keys.

``[magnet]``, ``[amplifier]``, ``[stop]`` and ``[coil]`` are those of its bearing, ``[rotor]`` has
the clearance, and ``[sensor]`` is not a list.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from ambkit.base.config.document import updated
from ambkit.base.config.problems import (
    Problem,
    fields_of,
    nearest,
    no_table,
    table_of,
    unknown_key,
    with_home,
)
from ambkit.base.errors import AmbkitError
from ambkit.machine import geometry
from ambkit.machine.accessories import Coil, Stop
from ambkit.machine.components import MassRotor, SensorAt
from ambkit.machine.parts import Amplifier, Magnet, Sensor

LISTS = ("bearing", "sensor")  #: Keys that are lists in the long form.
OF_BEARING = ("magnet", "amplifier", "stop", "coil")  #: Tables of its one bearing.
ABOVE = ("name", "description", "source", "sampling_time", "delay", "speed")

TABLES: dict[str, tuple[str, ...]] = {
    "": (*ABOVE, "magnet", "rotor", "amplifier", "sensor", "stop", "coil"),
    "magnet": tuple(fields_of(Magnet)),
    "rotor": ("mass", "gravity", "clearance"),
    "amplifier": tuple(fields_of(Amplifier)),
    "sensor": tuple(fields_of(Sensor)),
    "stop": tuple(fields_of(Stop)),
    "coil": tuple(fields_of(Coil)),
}
"""Keys of the short form, by table."""


def is_short(data: Any) -> bool:
    """Whether a description is in the short form."""
    return isinstance(data, Mapping) and not any(
        isinstance(data.get(key), list | tuple) for key in LISTS
    )


def expanded(data: Mapping[str, Any]) -> tuple[dict[str, Any], list[Problem]]:
    """Return a description in the long form, and the errors of short-form keys."""
    problems: list[Problem] = []
    tables: dict[str, Any] = {"": _known("", data, problems)}
    for table in tables[""].keys() & TABLES.keys():
        part = data[table]
        if isinstance(part, Mapping):
            tables[table] = _known(table, part, problems)
        elif isinstance(part, BaseModel) or (part is None and table in ("stop", "coil")):
            tables[table] = part
        else:
            problems.append(Problem((table,), no_table(part)))
    long = {key: value for key, value in tables[""].items() if key in ABOVE}
    bearing = {"type": "single"} | {key: tables[key] for key in OF_BEARING if key in tables}
    if "rotor" in tables:
        rotor = {"type": "mass"} | dict(tables["rotor"])
        if "clearance" in rotor:
            bearing["clearance"] = rotor.pop("clearance")
        long["rotor"] = rotor
    if "sensor" in tables:
        sensor = tables["sensor"]
        if not isinstance(sensor, SensorAt):
            sensor = {"type": "single"} | dict(sensor)
        long["sensor"] = [sensor]
    return long | {"bearing": [bearing]}, problems


def _known(table: str, part: Mapping[str, Any], problems: list[Problem]) -> dict[str, Any]:
    """Return the known keys of a table, and report the others."""
    keys = TABLES[table]
    for key in part:
        if key not in keys:
            around = (table,) if table else ()
            meant = (*around, nearest(str(key), keys) or "")
            problem = Problem((*around, key), unknown_key(str(key), keys), meant=meant)
            problems.append(with_home(problem, TABLES.items()))
    return {key: value for key, value in part.items() if key in keys}


def moved(problems: list[Problem], own: list[Problem]) -> list[Problem]:
    """Return errors of the long form with short-form keys, and its own."""
    meant = {problem.meant for problem in own}
    results = list(own)
    for problem in problems:
        path = short_path(problem.path)
        reported = any(path[: len(other.path)] == other.path for other in results)
        if problem.missing and (reported or path in meant):
            continue
        if problem.missing and path == ("sensor",):
            problem = problem._replace(text=f"missing: {table_of(Sensor)}")
        elif problem.missing and path == ("rotor",):
            problem = problem._replace(text=f"missing: a table with {', '.join(TABLES['rotor'])}")
        results.append(problem._replace(path=path))
    return results


def short_path(path: tuple[str | int, ...]) -> tuple[str | int, ...]:
    """Return the short-form path of a value."""
    match path:
        case ("bearing", 0, "clearance"):
            return ("rotor", "clearance")
        case ("bearing", 0, *rest):
            return tuple(rest)
        case ("sensor", 0, *rest):
            return ("sensor", *rest)
        case ("rotor", "mass", step, *rest):  # pydantic inserts the type
            return ("rotor", step, *rest)
    return path


def short_text(text: str) -> str:
    """Return a message with the short form of its initial key."""
    if text.startswith("bearing[0].clearance"):
        return text.replace("bearing[0]", "rotor", 1)
    return text.removeprefix("bearing[0].").replace("sensor[0].", "sensor.", 1)


def long_key(key: str) -> str:
    """Return a dotted short-form key in the long form; others unchanged."""
    table, _, rest = key.partition(".")
    if table in OF_BEARING:
        return f"bearing.0.{key}"
    if key == "rotor.clearance":
        return "bearing.0.clearance"
    return f"sensor.0.{rest}" if table == "sensor" and rest[:1].isalpha() else key


def shortened(long: Mapping[str, Any]) -> dict[str, Any]:
    """Return the description of a machine with one axis in the short form."""
    bearing, sensor, rotor = long["bearing"][0], long["sensor"][0], long["rotor"]
    parts = dict(bearing)
    parts["rotor"] = {key: rotor.get(key, bearing["clearance"]) for key in TABLES["rotor"]}
    parts["sensor"] = {key: sensor[key] for key in TABLES["sensor"] if key in sensor}
    above = {key: long[key] for key in ABOVE if key in long}
    return above | {key: parts[key] for key in TABLES[""] if key in parts and key not in ABOVE}


def tables_of(machine: Any) -> dict[str, Any]:
    """Return the values of a machine with one axis by short-form keys."""
    bearing, rotor = machine.bearings[0], machine.rotor
    values = {
        "rotor": {"mass": rotor.mass, "gravity": rotor.gravity, "clearance": bearing.clearance},
        "sensor": machine.sensors[0],
    }
    return {key: values[key] if key in values else getattr(machine, key) for key in TABLES[""]}


def with_schema(long: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON schema of a machine in either form, from that of the long one."""
    definitions, own = long["$defs"], long["properties"]
    bearing = definitions["BearingAt"]["properties"]
    rotor, sensor = (
        {key: definitions[name][key] for key in ("type", "properties", "required")}
        for name in ("MassRotor", "SensorAt")
    )
    for table, part in (("rotor", rotor), ("sensor", sensor)):
        known = part["properties"] | {"clearance": bearing["clearance"]}
        part["properties"] = {key: known[key] for key in TABLES[table]}
        part["additionalProperties"] = False
    rotor["required"] = [*TABLES["rotor"]]
    tables = {**own, **bearing, "name": own["name"], "rotor": rotor, "sensor": sensor}
    short = {
        "type": "object", "additionalProperties": False,
        "properties": {key: tables[key] for key in TABLES[""]},
        "required": ["name", "sampling_time", "magnet", "rotor", "amplifier", "sensor"],
    }  # fmt: skip
    long_keys = {key: long.pop(key) for key in [*long] if key in short}
    return long | {"anyOf": [long_keys, short]}


ONLY = {"name": "", "type": "single", "place": 0.0, "angle": 0.0}
"""Place of the bearing and the sensor of a machine with one axis."""


def isolated(machine: Any, axis: str) -> dict[str, Any]:
    """Return the description of an axis as a machine of its own."""
    names = [item.name for item in machine.axes]
    if axis not in names:
        raise AmbkitError(f"{machine.name} has no axis {axis}; there are {', '.join(names)}")
    at = names.index(axis)
    result = machine.axes[at]
    sensor = geometry.nearest(machine.sensors, result)
    if not machine.speed:
        sensor = updated(sensor, {"runout": ()})  # undefined without speed
    mass, stop = float(machine.effective_masses[at]), result.bearing.stop
    stop = stop and updated(stop, {"friction": None, "radius": None})  # properties of a ring
    gravity: Any = "none" if result.bearing.magnet.type == "two-sided" else "-x"
    if machine.rotor.type == "mass":  # the bias carries the weight of a body
        gravity = machine.rotor.gravity
    return {
        "name": axis, "sampling_time": machine.sampling_time, "delay": machine.delay,
        "speed": abs(machine.speed), "rotor": MassRotor(mass=mass, gravity=gravity),
        "bearing": [updated(result.bearing, ONLY | {"stop": stop})],
        "sensor": [updated(sensor, ONLY)],
    }  # fmt: skip


def updates(machine: Any, update: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a machine that change with keys of a file, or fields."""
    of_bearing = (*OF_BEARING, "clearance")
    if own := {key: value for key, value in update.items() if key in of_bearing}:
        yield "bearings", (updated(machine._one, own),)
    for key, value in update.items():
        if key in LISTS and isinstance(value, tuple):
            yield f"{key}s", value
        elif key == "sensor":
            own = {name: getattr(value, name) for name in TABLES["sensor"]}
            yield "sensors", (updated(machine.sensors[0], own),)
        elif key not in of_bearing:
            yield key, value
