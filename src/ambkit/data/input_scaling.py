"""Scaling of a rig's numbers: unit, scale, sign and offset of one signal."""

import re
from collections.abc import Iterator
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from ambkit.base import units
from ambkit.base.arrays import Array
from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Line
from ambkit.base.units import engineering
from ambkit.data.signals import si_unit

_SCALE = re.compile(r"\s*(\S+)\s+(\S.*?)\s*")


class Scaling(Part):
    """Scaling of a rig's signal: ``value = sign * scale * number * unit + offset``, in SI."""

    unit: Line
    """Unit of the numbers such as "mm"."""
    scale: float | Line = 1.0
    """Factor; with a unit if it converts one quantity to another, such as "2 A/V"."""
    sign: Annotated[int, Field(strict=True)] = 1
    """1, or -1 for the opposite direction."""
    offset: Line = ""
    """Offset of the result, with its unit, such as "10 mm"."""

    unwritten = ("scale", "sign", "offset")

    @property
    def si_unit(self) -> str:
        """SI unit of the signal."""
        return si_unit(_scaled_unit(self.unit, self.scale))

    @property
    def gain(self) -> float:
        """Factor from a number to SI."""
        return self.sign * _factor(self.unit, self.scale, self.si_unit)

    @property
    def zero(self) -> float:
        """Offset in SI."""
        return units.parse(self.offset, self.si_unit) if self.offset else 0.0

    def value(self, numbers: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
        """Convert a rig's numbers to the signal, in SI."""
        raw = np.asarray(numbers, dtype)
        if self.gain == 1.0 and not self.zero:
            return raw
        return np.asarray(dtype(self.gain) * raw + dtype(self.zero))

    def shifted(self, by: float) -> Self:
        """Return a scaling with values larger by an amount [SI]."""
        if not by:
            return self
        offset = engineering(self.zero + by, self.si_unit, digits=None)
        return self.model_copy(update={"offset": offset})

    def numbers(self, values: ArrayLike) -> Array:
        """Convert a signal in SI to a rig's numbers."""
        signal = np.asarray(values, float)
        if self.gain == 1.0 and not self.zero:
            return signal
        return np.asarray((signal - self.zero) / self.gain)

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("sign") not in (1, -1) and isinstance(read("sign"), int):
            yield "sign", f"must be 1 or -1, is {read('sign')}"
        unit, scale, offset = read("unit"), read("scale"), read("offset")
        if scale == 0.0:
            yield "scale", "must not be 0"
        key = "unit"
        try:
            si_unit(unit if isinstance(unit, str) else "1")
            if isinstance(unit, str) and isinstance(scale, str | float):
                key = "scale"
                si = si_unit(_scaled_unit(unit, scale))
                _factor(unit, scale, si)
                key = "offset"
                units.parse(offset, si) if offset and isinstance(offset, str) else 0.0
        except ValueError as error:
            inversion_text = _turned(unit, scale) if key == "scale" else ""
            yield key, inversion_text or str(error)


class Inputs(Part):
    """Scaling of a controller's inputs; by default metres and volts."""

    y: Scaling = Field(default_factory=lambda: Scaling(unit="m"))
    """The position sensor."""
    u: Scaling = Field(default_factory=lambda: Scaling(unit="V"))
    """The control signal that acts until the next sample."""

    @property
    def in_si(self) -> bool:
        """Whether its numbers equal the signals in SI."""
        return all(item.gain == 1 and not item.zero for item in (self.y, self.u))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        for name, allowed in (("y", ("m",)), ("u", ("V", "A"))):
            scaling = read(name)
            if isinstance(scaling, Scaling) and scaling.si_unit not in allowed:
                what = f"makes {name} a quantity in {scaling.si_unit}, it is one in {allowed[0]}"
                yield f"{name}.unit", what


def _scaled_unit(unit: str, scale: float | str) -> str:
    """Return the unit of number times scale."""
    match = _SCALE.fullmatch(scale) if isinstance(scale, str) else None
    return f"({unit}) * ({match[2]})" if match else unit


def _turned(unit: str, scale: float | str) -> str:
    """Suggest the inverse of a scale with the inverse unit: a sensor's V/mm instead of mm/V."""
    match = _SCALE.fullmatch(scale) if isinstance(scale, str) else None
    if not match or match[2].count("/") != 1:
        return ""
    above, below = match[2].split("/")
    try:
        number = 1.0 / float(match[1])
        si_unit(f"({unit}) * ({below}) / ({above})")
    except (ValueError, ZeroDivisionError):
        return ""
    return (
        f"it multiplies a number, and {unit} times {match[2]} measures nothing; is "
        f'it upside down: "{number:.9g} {below.strip()}/{above.strip()}"?'
    )


def _factor(unit: str, scale: float | str, to: str) -> float:
    if isinstance(scale, str):
        return units.parse(scale, "1" if unit == to else f"({to}) / ({unit})")
    return scale * units.factor(unit, to)
