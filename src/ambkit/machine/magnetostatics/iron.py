"""Magnetisation of iron: by grade, by saturation and permeability, or by a table."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ambkit.base.arrays import Array
from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Quantity
from ambkit.machine.force_law import MU_0

GRADES = {
    "M330-50A": (500.0, 0.7, 24000.0, 9.38, 9.6),
    "M350-50A": (1210.0, 1.16, 24630.0, 2.44, 14.0),
    "M530-50A": (2120.0, 1.25, 12400.0, 1.6, 13.5),
    "M700-100A": (1120.0, 1.2, 20750.0, 3.55, 13.15),
    "M940-100A": (680.0, 1.26, 17760.0, 3.13, 13.9),
    "9SMnPb28": (400.0, 1.488, 1200.0, 3.0, 12.5),
}
"""Electric sheets, and free-cutting steel 1.0718: initial permeability mu_i, flux density B_m of
the greatest permeability [T], c_a, c_b and n of Roschke's approximation
``mu_r = 1 + (mu_i - 1 + c_a b) / (1 + c_b b + b^n)``, ``b = B/B_m``. Values of the Modelica
Standard Library, ``Modelica.Magnetic.FluxTubes.Material.SoftMagnetic`` (BSD-3-Clause)."""

HIGHEST = 2.6  #: Maximum flux density of a sampled formula [T].


class Curve:
    """Field strength H(B) and energy density of an isotropic material without hysteresis."""

    # Between the points a monotone cubic (Fritsch and Butland 1984); beyond the last one the slope
    # of air.

    def __init__(self, B: Array, H: Array, iron: Iron | None = None) -> None:
        from scipy.interpolate import PchipInterpolator

        self.stacking, self._end = 1.0 if iron is None else iron.stacking_factor, float(B[-1])
        self.conductivity = (iron and iron.conductivity) or 0.0  #: [S/m]
        self.lamination = (iron and iron.lamination) or 0.0  #: Thickness of sheets [m]; 0 if solid.
        self.hysteresis = (iron and iron.hysteresis_loss) or 0.0  #: Specific hysteresis loss [W/kg]
        self._h = PchipInterpolator(B, H)
        self._slope, self._energy = self._h.derivative(), self._h.antiderivative()
        self._h_end, self._w_end = float(H[-1]), float(self._energy(B[-1]))

    def at(self, b: Array) -> tuple[Array, Array, Array]:
        """Return H [A/m], dH/dB [A/(m T)] and energy density [J/m^3] at flux densities [T]."""
        b = b / self.stacking  # the flux is in the sheets
        inside = np.minimum(b, self._end)
        beyond = b - inside
        h = self._h(inside) + beyond / MU_0
        slope = np.where(beyond > 0, 1 / MU_0, self._slope(inside)) / self.stacking
        energy = self._energy(inside) + beyond * (self._h_end + 0.5 * beyond / MU_0)
        return h, slope, self.stacking * energy


class Iron(Part):
    """The magnetisation curve of a part."""

    material: Literal[tuple(GRADES)] | None = None  # type: ignore[valid-type]
    """Grade of steel."""
    saturation: Annotated[float, Quantity("T", "1.8 T", above=0)] | None = None
    """Saturation polarisation [T] (Fröhlich's law); with relative_permeability."""
    relative_permeability: Annotated[float, Quantity("1", "2000", above=1)] | None = None
    """Initial relative permeability [1]."""
    flux_density: tuple[Annotated[float, Quantity("T", "1.2 T", at_least=0)], ...] = Field(
        default=(), max_length=1000
    )
    """Flux densities of a measured curve [T], increasing; with field_strength."""
    field_strength: tuple[Annotated[float, Quantity("A/m", "400 A/m", at_least=0)], ...] = Field(
        default=(), max_length=1000
    )
    """Field strengths at these flux densities [A/m]."""
    stacking_factor: Annotated[float, Quantity("1", "0.97", above=0, at_most=1)] = 1.0
    """Share of the stack that is iron [1]."""
    conductivity: Annotated[float, Quantity("S/m", "4.5e6 S/m", above=0)] | None = None
    """Electrical conductivity of the iron [S/m], for eddy currents. By default none."""
    lamination: Annotated[float, Quantity("m", "0.35 mm", above=0)] | None = None
    """Thickness of the sheets [m]. By default solid."""
    hysteresis_loss: Annotated[float, Quantity("W/kg", "2 W/kg", above=0)] | None = None
    """Hysteresis loss at 1.5 T and 50 Hz [W/kg], as frequency times squared flux density."""

    unwritten = ("flux_density", "field_strength", "stacking_factor")

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        b, h = read("flux_density"), read("field_strength")
        if sum([read("material") is not None, read("saturation") is not None, bool(b)]) != 1:
            ways = "material, saturation with relative_permeability, flux_density with"
            yield "material", f"the curve is given by one of {ways} field_strength"
        if (read("saturation") is None) != (read("relative_permeability") is None):
            yield "saturation", "goes with relative_permeability"
        if read("lamination") is not None and read("conductivity") is None:
            yield "lamination", "goes with conductivity"
        if isinstance(b, tuple) and isinstance(h, tuple) and b != h:
            if len(b) != len(h):
                yield "field_strength", f"must have a value for each of {len(b)} flux densities"
            for key, values in (("flux_density", b), ("field_strength", h)):
                if any(later <= one for one, later in pairwise(values)):
                    yield key, "must increase from point to point"

    @cached_property
    def curve(self) -> Curve:
        """The curve as the field solution takes it."""
        if self.flux_density:
            b, h = np.array(self.flux_density), np.array(self.field_strength)
            if b[0] > 0:
                b, h = np.append(0.0, b), np.append(0.0, h)
            return Curve(b, h, self)
        b = np.linspace(0.0, max(HIGHEST, self.saturation or 0.0), 521)
        if self.material is not None:
            mu_i, most, c_a, c_b, n = GRADES[self.material]
            x = b / most
            h = b / MU_0 / (1 + (mu_i - 1 + c_a * x) / (1 + c_b * x + x**n))
        else:  # B = mu0 H + Js H / (H + c), solved for H
            saturation, mu_r = self.saturation or 0.0, self.relative_permeability or 1.0
            c = saturation / (MU_0 * (mu_r - 1))
            p = 0.5 * (MU_0 * c + saturation - b)
            h = MU_0 * c * b / (p + np.sqrt(p**2 + MU_0 * c * b)) / MU_0
        return Curve(b, h, self)
