"""Shapes of a rotor's bending modes, with its magnets and sensors."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.machine.machine import Machine
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Points
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put

MODES = ("modes",)  #: Section of its rows.
POINTS = 401  #: Points along the shaft.


@dataclass(frozen=True, eq=False, repr=False)
class ModeShapes(Result):
    """Retained bending modes of the free rotor."""

    machine: str  #: Name of the machine.
    frequency: Array  #: (modes,) Undamped, at standstill [rad/s].
    damping_ratio: Array  #: (modes,) Of each uncoupled mode [1].
    mass: Array  #: (modes,) Modal masses for shapes with maximum 1 [kg].
    place: Array  #: (n,) Along the shaft, in the machine's coordinate [m].
    shape: Array  #: (n, modes) Deflections there [1].
    magnets: Mapping[str, tuple[float, Array]]  #: Place [m], deflections [1].
    sensors: Mapping[str, tuple[float, Array]]

    TITLE = "Bending modes of {0.machine}"

    @property
    def finding(self) -> str:
        text = ", ".join(engineering(f / math.tau, "Hz", 4) for f in self.frequency)
        return f"Bending modes of {self.machine}, free at standstill: {text}."

    @property
    def rows(self) -> list[Row]:
        results: list[Row] = []
        for k, frequency in enumerate(self.frequency):
            results += put([
                Row("frequency", "frequency", float(frequency) / math.tau, "Hz"),
                Row("damping_ratio", "damping ratio", float(self.damping_ratio[k])),
                Row("mass", "modal mass", float(self.mass[k]), "kg"),
            ], section=MODES, of=str(k + 1))  # fmt: skip
        for key, of in (("magnets", self.magnets), ("sensors", self.sensors)):
            for name, (place, shape) in of.items():
                results += put([
                    Row("place", "place", place, "m"),
                    *(Row(f"shape.{k}", f"mode {k}", float(out)) for k, out in enumerate(shape, 1)),
                ], section=(key,), of=name)  # fmt: skip
        return results

    SECTIONS = {
        MODES: Section("Modes", across=True),
        ("magnets",): Section("Deflections at magnets", across=True),
        ("sensors",): Section("Deflections at sensors", across=True),
    }

    @property
    def series(self) -> dict[str, Any]:
        return {"machine": self.machine}

    def figures(self) -> list[Figure]:
        return [mode_shapes_figure(self)]


def mode_shapes(machine: Machine) -> ModeShapes:
    """Return the retained bending modes of a machine's free rotor."""
    bending = machine.bending
    if bending is None:
        raise AmbkitError(f"{machine.name}: its rotor is rigid, and has no bending modes")
    mode_slice = slice(len(bending.frequency) - bending.attached)
    place = np.linspace(*bending.ends, POINTS)

    def marked(placed: tuple[object, ...], axial: str) -> dict[str, tuple[float, Array]]:
        return {
            item.name: (item.place, bending.shape(item.place)[mode_slice])  # type: ignore[attr-defined]
            for item in placed
            if item.type != axial  # type: ignore[attr-defined]
        }

    return ModeShapes(
        machine.name, bending.frequency[mode_slice], bending.damping_ratio[mode_slice],
        bending.mass[mode_slice],
        place, np.array([bending.shape(float(z)) for z in place])[:, mode_slice],
        marked(machine.bearings, "thrust"), marked(machine.sensors, "axial"),
    )  # fmt: skip


PLACE = Axis("place along the shaft", "mm", 1e3)
SHAPE = Axis("shape", limits=(-1.15, 1.15))


def mode_shapes_figure(result: ModeShapes) -> Figure:
    """Plot each mode shape with magnets and sensors."""
    panels, place = [], result.place
    for k, frequency in enumerate(result.frequency):
        items: list[Item] = [
            Line(place[[0, -1]], np.zeros(2), signal="reference", label=""),
            Line(place, result.shape[:, k], signal="series 1", label="shape"),
        ]
        for signal, name, of in (
            ("series 2", "magnets", result.magnets), ("spike", "sensors", result.sensors),
        ):  # fmt: skip
            places = np.array([at for at, _ in of.values()])
            out = np.array([outs[k] for _, outs in of.values()])
            items.append(Points(places, out, signal=signal, label=name))
        hertz = engineering(frequency / (2 * math.pi), "Hz", 5)
        title = f"Mode {k + 1}: {hertz}, damping ratio {result.damping_ratio[k]:.2g}"
        panels.append(Panel(PLACE, SHAPE, items, title=title))
    return Figure(
        id="mode_shapes",
        title=f"Bending modes of {markdown(result.machine)}",
        caption="Of the free rotor at rest, each 1 where it is largest; a magnet or a sensor near "
        "the line in the middle is at a node, and hardly excites or measures the mode.",
        panels=panels, columns=1 if len(panels) == 1 else 2, panel_height=2.0,
    )  # fmt: skip
