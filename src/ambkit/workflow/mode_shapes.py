"""Shapes of a rotor's bending modes, and where its magnets and sensors are on them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.base.showing import Drawn

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine
    from ambkit.result.report.figure import Figure

Array = NDArray[np.float64]

POINTS = 401
"""Places along the shaft."""


@dataclass(frozen=True, eq=False)
class ModeShapes(Drawn):
    """Bending modes of the free rotor that its model keeps."""

    machine: str  #: Its name.
    frequency: Array  #: (modes,) Undamped, at rest [rad/s].
    damping_ratio: Array  #: (modes,) Of each mode alone [1].
    mass: Array  #: (modes,) Modal masses of shapes that are 1 where they are largest [kg].
    place: Array  #: (n,) Along the shaft, as the machine's places are measured [m].
    shape: Array  #: (n, modes) Deflections there [1].
    #: (float, ndarray (modes,)) Of each radial one its place [m], and the deflections there [1].
    magnets: Mapping[str, tuple[float, Array]]
    sensors: Mapping[str, tuple[float, Array]]

    def to_dict(self) -> dict[str, object]:
        """Return the figures as plain data, in SI."""
        return {
            "machine": self.machine,
            "frequency": (self.frequency / (2 * math.pi)).tolist(),
            "damping_ratio": self.damping_ratio.tolist(),
            "mass": self.mass.tolist(),
            **{
                key: {name: {"place": at, "shape": out.tolist()} for name, (at, out) in of.items()}
                for key, of in (("magnets", self.magnets), ("sensors", self.sensors))
            },
        }

    def figure(self) -> Figure:
        """Show the shapes along the shaft, with magnets and sensors marked."""
        from ambkit.show.plots.mode_shapes import mode_shapes_figure

        return mode_shapes_figure(
            self.machine, (self.frequency, self.damping_ratio), self.place, self.shape,
            self.magnets, self.sensors,
        )  # fmt: skip


def mode_shapes(machine: Machine) -> ModeShapes:
    """Return the bending modes of a machine's free rotor, as far as its model keeps them.

    Parameters
    ----------
    machine : Machine
        The whole machine.

    Raises
    ------
    AmbkitError
        Its rotor is rigid.
    """
    bending = machine.bending
    if bending is None:
        raise AmbkitError(f"{machine.name}: its rotor is rigid, and has no bending modes")
    kept = slice(len(bending.frequency) - bending.attached)
    place = np.linspace(*bending.ends, POINTS)

    def marked(placed: tuple[object, ...], axial: str) -> dict[str, tuple[float, Array]]:
        return {
            each.name: (each.place, bending.shape(each.place)[kept])  # type: ignore[attr-defined]
            for each in placed
            if each.type != axial  # type: ignore[attr-defined]
        }

    return ModeShapes(
        machine.name, bending.frequency[kept], bending.damping_ratio[kept], bending.mass[kept],
        place, np.array([bending.shape(float(z)) for z in place])[:, kept],
        marked(machine.bearings, "thrust"), marked(machine.sensors, "axial"),
    )  # fmt: skip
