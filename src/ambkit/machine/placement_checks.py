"""What is wrong with where things are on a rotor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ambkit.base.config import Read
from ambkit.base.units import engineering
from ambkit.machine import geometry
from ambkit.machine.components import ROTORS, PlacedBearing, PlacedSensor
from ambkit.machine.geometry import Axis, Shaft


def beyond_the_rotor(
    read: Read, bearings: tuple[PlacedBearing, ...], sensors: tuple[PlacedSensor, ...]
) -> Iterator[tuple[str, str]]:
    """Yield what is at a place where there is no rotor."""
    if any(bearing.type == "single" for bearing in bearings):
        return  # a mass has no places
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
    bearings: tuple[PlacedBearing, ...], sensors: tuple[PlacedSensor, ...]
) -> Iterator[tuple[str, str]]:
    """Yield which coordinate no bearing holds, or no sensor sees."""
    if any(bearing.type == "single" for bearing in bearings):
        return
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


NODE = 0.02
"""Of where a mode is largest: what is out less than that is at a node of it."""


def unseen(
    read: Read, bearings: tuple[PlacedBearing, ...], sensors: tuple[PlacedSensor, ...]
) -> Iterator[tuple[str, str]]:
    """Yield which mode is too fast for the sampling, or at whose nodes all sensors are."""
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
    """Return the greatest distance of a bearing from the centre of mass [m]."""
    return max((abs(axis.line.place) for axis in axes), default=0.0) or 1.0
