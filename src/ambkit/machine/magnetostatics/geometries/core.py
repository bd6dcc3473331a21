"""E-core and U-core at a flat rotor, such as a guide rail or a bar."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import numpy as np

from ambkit.base.config import Read
from ambkit.base.config.quantities import Quantity
from ambkit.base.units import engineering
from ambkit.machine.magnetostatics.geometries.geometry import CLEAR, Geometry, Windings, two_poles
from ambkit.machine.magnetostatics.layout import Layout, Region, rectangle


class Core(Geometry):
    """Laminated core facing a bar; if two-sided, with an equal core behind the bar."""

    window_share: ClassVar[float] = 1.0
    """Share of a window that belongs to one winding [1]."""
    sides: Literal["two-sided", "one-sided"] = "two-sided"
    """Cores on both sides of the rotor, or on one; their fields are separate."""
    leg_width: Annotated[float, Quantity("m", "10 mm", above=0)]
    """Width of an outer leg [m]."""
    leg_height: Annotated[float, Quantity("m", "25 mm", above=0)]
    """Height from the pole face to the back iron [m]."""
    window_width: Annotated[float, Quantity("m", "15 mm", above=0)]
    """Distance of two legs [m]."""
    back_iron: Annotated[float, Quantity("m", "10 mm", above=0)]
    """Thickness of the back iron [m]."""
    coil_width: Annotated[float, Quantity("m", "10 mm", above=0)]
    """Thickness of the winding beside a leg [m]."""
    rotor_thickness: Annotated[float, Quantity("m", "12 mm", above=0)]
    """Thickness of the bar [m]."""
    stack_length: Annotated[float, Quantity("m", "30 mm", above=0)]
    """Length of the stack [m]."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        most = read("window_width") * (cls.window_share - 0.02) - CLEAR * read("leg_height")
        if read("coil_width") > most:
            yield (
                "coil_width",
                f"windings overlap in the window; at most {engineering(most, 'm', 3)} fits",
            )

    def _layout(
        self, windings: Windings, legs: list[tuple[float, float]], wound: list[int]
    ) -> Layout:
        """Return the section of legs, each from and to a height; those in `wound` have coils."""
        gap, height = self.air_gap, self.leg_height
        root, back = gap + height, gap + height + self.back_iron
        low, high = legs[0][0], legs[-1][1]
        comb: list[complex] = [gap + 1j * low, back + 1j * low, back + 1j * high]
        for at, (near, far) in enumerate(reversed(legs)):
            comb += [gap + 1j * far, gap + 1j * near]
            if at < len(legs) - 1:
                comb += [root + 1j * near, root + 1j * legs[-2 - at][1]]
        clear = CLEAR * height
        coils = []
        for leg in wound:
            near, far = legs[leg]
            sign = 1 if leg >= len(legs) // 2 else -1
            for edge, way in ((near, -1), (far, 1)):
                beside = rectangle(
                    gap + clear + 1j * (edge + way * clear),
                    root - clear + 1j * (edge + way * (clear + self.coil_width)),
                )
                coils.append(Region(beside, "geometry.coil_width", coil=0,
                                    turns=-way * sign * windings.turns))  # fmt: skip
        margin = 0.6 * (high - low)
        bar = rectangle(
            -self.rotor_thickness + 1j * (low - 0.1 * margin), 1j * (high + 0.1 * margin)
        )
        around = rectangle(-self.rotor_thickness - margin + 1j * (low - margin),
                           back + margin + 1j * (high + margin))  # fmt: skip
        regions = [
            Region(np.array(comb[:-1]), "geometry.leg_width", windings.iron),
            *coils,
            Region(bar, "geometry.rotor_thickness", windings.rotor_iron, moves=True),
        ]
        one = np.ones(1)
        return Layout(Region(around, "geometry"), regions, (1.0,), one, one[None, :],
                      self.stack_length, opposed=self.sides == "two-sided")  # fmt: skip


class ECore(Core):
    """Three legs with one coil on the middle one."""

    type: Literal["E-core"] = "E-core"
    middle_width: Annotated[float, Quantity("m", "20 mm", above=0)]
    """Width of the middle leg [m]."""

    def magnet_constant(self, turns: float) -> float:
        length = self.stack_length
        return two_poles(turns, self.middle_width * length, 2 * self.leg_width * length)

    def layout(self, windings: Windings) -> Layout:
        near = self.middle_width / 2
        far = near + self.window_width
        outer = (far, far + self.leg_width)
        return self._layout(windings, [(-outer[1], -far), (-near, near), outer], [1])


class UCore(Core):
    """Two legs with a coil each, in series."""

    type: Literal["U-core"] = "U-core"

    window_share = 0.5

    def magnet_constant(self, turns: float) -> float:
        return two_poles(2 * turns, *2 * [self.leg_width * self.stack_length])

    def layout(self, windings: Windings) -> Layout:
        near = self.window_width / 2
        far = near + self.leg_width
        return self._layout(windings, [(-far, -near), (near, far)], [0, 1])
