"""Contradictions in a machine: its names, places, speed, unbalance and weight."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ambkit.base.config import Read
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.machine import geometry
from ambkit.machine.accessories import (
    delay_contradictions,
    eddy_current_contradictions,
    line_contradictions,
)
from ambkit.machine.components import ROTORS, BearingAt, SensorAt
from ambkit.machine.geometry import Axis, Shaft
from ambkit.machine.magnets import magnet_of
from ambkit.machine.parts import GRAVITY, along_x, levitation_current_of
from ambkit.machine.short_form import LISTS

OF_A_ROTOR = "is of a rigid or flexible rotor; a mass has runout at most"


def contradictions(read: Read, unchecked: Callable[..., Any]) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with values that are valid on their own."""
    yield from delay_contradictions(read("sampling_time"), read("delay"))
    yield from eddy_current_contradictions(read("sampling_time"), read("bearings"))
    if read("bearings.0.type") == "single" and all(
        isinstance(read(f"{key}s.1.type"), float)
        for key in LISTS  # none given
    ):
        yield from mass_contradictions(read)
        return
    bearings, sensors = (
        item if isinstance(item, tuple) else () for item in (read("bearings"), read("sensors"))
    )
    yield from double_names("bearing", bearings)
    yield from double_names("sensor", sensors)
    has_places = not any(bearing.type == "single" for bearing in bearings)  # a mass has none
    if has_places:
        yield from off_the_rotor(read, bearings, sensors)
        yield from loose(bearings, sensors)
    yield from too_fast(read, sensors)
    yield from unbalance_contradictions(read)
    if has_places:
        yield from too_heavy(read, bearings, sensors, unchecked)
    yield from unseen(read, bearings, sensors)


def off_the_rotor(
    read: Read, bearings: tuple[BearingAt, ...], sensors: tuple[SensorAt, ...]
) -> Iterator[tuple[str, str]]:
    """Yield parts at places beyond the rotor."""
    first, second = read("rotor.first_end"), read("rotor.second_end")
    planes = read("unbalance")
    placed: dict[str, tuple[Any, ...]] = {"bearing": bearings, "sensor": sensors}
    placed["unbalance"] = planes if isinstance(planes, tuple) else ()
    for key, all_of in placed.items():
        for at, item in enumerate(all_of):
            if getattr(item, "type", "") in ("thrust", "axial"):
                continue
            for end, name, beyond in ((first, "first_end", -1), (second, "second_end", 1)):
                if end is not None and (item.place - end) * beyond > 0:
                    limit = f"is beyond the rotor, whose {name} is at {engineering(end, 'm')}"
                    yield f"{key}.{at}.place", f"{engineering(item.place, 'm')} {limit}"


def loose(
    bearings: tuple[BearingAt, ...], sensors: tuple[SensorAt, ...]
) -> Iterator[tuple[str, str]]:
    """Yield coordinates that no bearing supports, or no sensor measures."""
    axes, readings = geometry.axes_of(bearings), geometry.readings_of(sensors)
    for key, lines, does in (("bearing", axes, "holds"), ("sensor", readings, "sees")):
        if not axes or not readings:
            return
        positions = geometry.positions_of(axes)
        if key == "sensor" and "z" not in positions and any(r.line.axial for r in readings):
            at = next(k for k, sensor in enumerate(sensors) if sensor.type == "axial")
            yield f"sensor.{at}.type", "looks along the shaft, where there is no thrust bearing"
            continue
        H = geometry.matrix([line.line for line in lines], positions)
        scale = np.array([1.0 if q in "xyz" else _reach(axes) for q in positions])
        if np.linalg.matrix_rank(H / scale, tol=1e-9) < len(positions):
            *_, rows = np.linalg.svd(H / scale)
            parts = np.abs(rows[-1]) > 0.1
            loose = max((q for q, there in zip(positions, parts, strict=True) if there), key=len)
            text = f"no {key} {does} the rotor's {loose}"
            if loose.startswith("th"):
                text += f": it takes two radial {key}s at places apart"
            yield f"{key}.0", text


NODE = 0.02  #: Share of a mode's maximum below which a place counts as a node.


def unseen(
    read: Read, bearings: tuple[BearingAt, ...], sensors: tuple[SensorAt, ...]
) -> Iterator[tuple[str, str]]:
    """Yield modes that are too fast for the sampling, or with nodes at all sensors."""
    rotor, T = read("rotor"), read("sampling_time")
    if not (bearings and sensors and isinstance(rotor, ROTORS)):
        return
    shaft = Shaft.of(rotor, bearings)
    bending = shaft.bending
    if bending is None:
        return
    modes = len(bending.frequency) - bending.attached
    highest = bending.frequency[:modes].max(initial=0.0)
    if highest * T >= math.pi:
        text = f"keeps a mode at {engineering(highest / 2 / math.pi, 'Hz')}, and the sampling tells"
        key = "rotor.modes_up_to" if hasattr(rotor, "modes_up_to") else f"rotor.mode.{modes - 1}"
        yield key, f"{text} frequencies only up to {engineering(0.5 / T, 'Hz')}"
    radial = [(at, item) for at, item in enumerate(sensors) if item.type != "axial"]
    inside = [item for item in radial if bending.ends[0] <= item[1].place <= bending.ends[1]]
    if not radial or len(inside) < len(radial):
        return
    out = np.array([bending.shape(item.place) for _, item in radial])
    for k in range(modes):
        if np.abs(out[:, k]).max() < NODE:
            at, sensor = radial[0]
            frequency = engineering(bending.frequency[k] / 2 / math.pi, "Hz", 5)
            text = f"{engineering(sensor.place, 'm')} is at a node of mode {k + 1}, {frequency}"
            yield f"sensor.{at}.place", f"{text}, as are all others: no sensor sees it"


def _reach(axes: tuple[Axis, ...]) -> float:
    """Return the largest distance of a bearing from the centre of mass [m]."""
    return max((abs(axis.line.place) for axis in axes), default=0.0) or 1.0


def mass_contradictions(read: Read) -> Iterator[tuple[str, str]]:
    """Yield contradictions of the one axis of a mass."""

    def of_axis(key: str) -> Any:
        return read(key if key.startswith("rotor.") else f"bearings.0.{key}")

    speed, runout = read("speed"), read("sensors.0.runout")
    if speed < 0:
        yield "speed", f"must be at least 0 rad/s, is {engineering(speed, 'rad/s')}"
    if isinstance(runout, tuple) and runout and not speed:
        yield "speed", "missing: sensor.runout is at multiples of it"
    else:
        hum, T = read("sensors.0.hum"), read("sampling_time")
        for key, text in line_contradictions(T, speed, runout, hum):
            yield f"sensor.0.{key}", text
    if read("unbalance"):
        yield "unbalance", OF_A_ROTOR
    kind, gravity = of_axis("magnet.type"), of_axis("rotor.gravity")
    if kind == "one-sided" and along_x(gravity) >= 0:
        gravity_text = f'"{gravity}"' if isinstance(gravity, str) else engineering(gravity, "rad")
        what = "pull towards -x" if not isinstance(gravity, str) else 'be "-x"'
        text = f"must {what}, is {gravity_text}: nothing else pulls against a one-sided magnet"
        yield "rotor.gravity", text
    current = of_axis("amplifier.current_limit")
    needed_current = abs(levitation_current_of(of_axis, current))
    if needed_current > current:
        limit = f"at least {engineering(needed_current, 'A')}, which carries the rotor at x = 0"
        if math.isinf(needed_current):
            limit = "such that it carries the rotor at x = 0, which no current does"
        text = f"must be {limit}; is {engineering(current, 'A')}"
        yield "bearing.0.amplifier.current_limit", text


def double_names(key: str, placed: tuple[Any, ...]) -> Iterator[tuple[str, str]]:
    """Yield names that are used twice."""
    names = [item.name for item in placed]
    lines = geometry.axes_of(placed) if key == "bearing" else geometry.readings_of(placed)
    of_lines = [line.name for line in lines]
    for at, name in enumerate(names):
        if name in names[:at]:
            yield f"{key}.{at}.name", f'there is another {key} "{name}"'
        elif names.count(name) == 1 and any(
            of_lines.count(f"{name}{end}") > 1 for end in ("", "1", "2")
        ):
            yield f"{key}.{at}.name", f'"{name}" and another {key} give the same names of axes'


def too_fast(read: Read, sensors: tuple[SensorAt, ...]) -> Iterator[tuple[str, str]]:
    """Yield parts that are too fast for the sampling."""
    T, speed = read("sampling_time"), abs(read("speed"))
    if T * speed >= math.pi:
        limit = f"half the sampling frequency, {engineering(0.5 / T, 'Hz')}"
        yield "speed", f"must be less than {limit}; is {engineering(speed / 2 / math.pi, 'Hz')}"
        return
    for at, sensor in enumerate(sensors):
        for key, text in line_contradictions(T, speed, sensor.runout, sensor.hum):
            yield f"sensor.{at}.{key}", text


def unbalance_contradictions(read: Read) -> Iterator[tuple[str, str]]:
    """Yield unbalances whose grade is not defined."""
    planes, speed = read("unbalance"), read("speed")
    graded = [
        at for at, plane in enumerate(planes if isinstance(planes, tuple) else ())
        if plane.grade is not None
    ]  # fmt: skip
    if graded and speed == 0:
        yield "speed", "missing: unbalance by a grade is what is permitted at the machine's speed"
    if len(graded) > 2:
        text = "ISO 21940-11 gives each its share of one or two planes, not of more; give amounts"
        yield f"unbalance.{graded[2]}.grade", text
    elif len(graded) == 2:
        centre = read("rotor").centre if isinstance(read("rotor"), ROTORS) else math.nan
        one, other = (planes[at].place - centre for at in graded)
        if one * other >= 0:
            text = "must be on the other side of the centre of mass than the other graded plane"
            yield f"unbalance.{graded[1]}.place", f"{text}; is {engineering(other, 'm')}"


def too_heavy(
    read: Read,
    bearings: tuple[BearingAt, ...],
    sensors: tuple[SensorAt, ...],
    construct: Callable[..., Any],
) -> Iterator[tuple[str, str]]:
    """Yield axes with too little current for their share of the weight."""
    rotor, T = read("rotor"), read("sampling_time")
    if not (bearings and sensors and isinstance(rotor, ROTORS)) or math.isnan(T):
        return
    axes = geometry.axes_of(bearings, Shaft.of(rotor, bearings))
    if rotor.gravity == "-z" and not any(axis.line.axial for axis in axes):
        yield "rotor.gravity", 'must not be "-z" where no thrust bearing carries the rotor'
        return
    forces = geometry.supporting_forces(rotor, axes, GRAVITY)
    machine = construct(
        name="isolated", sampling_time=T, delay=None, speed=0.0, rotor=rotor, bearing=bearings,
        sensor=sensors, unbalance=(),
    )  # fmt: skip
    for at, one in enumerate(bearings):
        for axis, force in zip(axes, forces, strict=True):
            if axis.bearing is not one or not force:
                continue
            try:
                law = magnet_of(machine.isolated_axis(axis.name))
                needed = abs(law.current_for(float(force)))
            except AmbkitError:  # errors of the bearing itself are reported there
                continue
            current = one.amplifier.current_limit
            if needed > current:
                limit = (
                    f"at least {engineering(needed, 'A')}, which carries the rotor on {axis.name}"
                )
                text = f"must be {limit}; is {engineering(current, 'A')}"
                yield f"bearing.{at}.amplifier.current_limit", text
                break
