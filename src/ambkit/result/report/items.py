"""What can be drawn in a panel: axes, lines, points, bands, bars, heat maps, cells and so on.

Data is given in SI. Each `Axis` says with which factor its data is shown, so that "mm" stands on
paper only. Labels may hold simple formulas between dollar signs: ``"stiffness $k_i$"``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ambkit.result.report.style import style_of

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Axis:
    """What an axis shows."""

    label: str  #: The quantity in words, with its symbol: ``"displacement $x$"``.
    unit: str = ""  #: The unit shown; empty for a pure number.
    #: What the data (SI) is multiplied with to be in `unit`: 1e3 for metres shown in mm.
    factor: float = 1.0
    scale: Literal["linear", "log"] = "linear"  #: Scale of the axis.
    limits: tuple[float, float] | None = None  #: Lower and upper end, in the unit of the data (SI).

    @property
    def title(self) -> str:
        """Label and unit as they stand beside the axis."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    def shown(self, values: Vector) -> Vector:
        """Data in the unit of the axis."""
        return values * self.factor


@dataclass(frozen=True, eq=False)
class Signal:
    """An item that belongs to one signal: it takes colour, dash and name from the style table."""

    signal: str = field(default="estimate", kw_only=True)  #: Name in `style.SIGNALS`.
    #: Legend; the signal's own name if not given, no entry if empty.
    label: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        style_of(self.signal)

    @property
    def legend(self) -> str:
        """Text of the legend: the label, or else the signal's own name. Empty: no entry."""
        return style_of(self.signal).label if self.label is None else self.label

    def _vectors(self, *names: str) -> None:
        """Turn the named fields into float vectors of one common length."""
        sizes = {}
        for name in names:
            array = np.asarray(getattr(self, name), dtype=np.float64)
            if array.ndim != 1:
                raise ValueError(
                    f"{type(self).__name__}.{name}: one dimension expected, shape is {array.shape}"
                )
            object.__setattr__(self, name, array)
            sizes[name] = array.size
        if len(set(sizes.values())) > 1:
            raise ValueError(f"{type(self).__name__}: lengths differ: {sizes}")


@dataclass(frozen=True, eq=False)
class Line(Signal):
    """A curve through samples."""

    x: Vector  #: (n,) The samples, in SI. NaN in `y` is a gap.
    y: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("x", "y")


@dataclass(frozen=True, eq=False)
class Points(Signal):
    """Single values as markers, with an error bar each if `error` is given."""

    x: Vector  #: (n,) The values, in SI.
    y: Vector
    error: Vector | None = None  #: (n,) Half length of the vertical error bars, in SI.

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("x", "y", *(["error"] if self.error is not None else []))


@dataclass(frozen=True, eq=False)
class Band(Signal):
    """The area between two curves, for instance two standard deviations."""

    x: Vector  #: (n,) Samples and the two borders, in SI.
    low: Vector
    high: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("x", "low", "high")


@dataclass(frozen=True, eq=False)
class Bars(Signal):
    """One bar a category. Several `Bars` in one panel stand side by side."""

    categories: Sequence[str]  #: Names below the bars; the same in all `Bars` of a panel.
    values: Vector  #: (n,) Heights, in SI.
    error: Vector | None = None  #: (n,) Half length of the error bars, in SI.

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("values", *(["error"] if self.error is not None else []))
        if len(self.categories) != self.values.size:
            raise ValueError(
                f"Bars: {len(self.categories)} categories, but {self.values.size} values"
            )


@dataclass(frozen=True, eq=False)
class Intervals(Signal):
    """Values with their intervals along the x axis, one below the other."""

    rows: Sequence[str]  #: Names beside the rows, from the top.
    values: Vector  #: (n,) The values and the ends of their intervals, in SI.
    low: Vector
    high: Vector
    texts: Sequence[str]  #: Written in each row, at the right.

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("values", "low", "high")
        sizes = {len(self.rows), len(self.texts), self.values.size}
        if len(sizes) > 1:
            raise ValueError(f"Intervals: rows, texts and values differ in length: {sorted(sizes)}")


@dataclass(frozen=True, eq=False)
class Heatmap:
    """A surface over a plane as colours, with labelled contour lines so that it reads in grey."""

    x: Vector  #: (n,) Abscissae of the columns, ascending, in SI.
    y: Vector  #: (m,) Ordinates of the rows, ascending, in SI.
    z: Vector  #: (m, n) The surface, in SI.
    bar: Axis  #: What the colours mean: label, unit, factor, limits.
    #: True for a signed quantity: the palest colour is zero, limits are symmetric.
    diverging: bool = False
    lines: int = 9  #: About how many contour lines; they stand at round values.
    #: Whether one stands at zero. Where a surface is flat there, its place is an accident of the
    #: grid.
    zero: bool = True

    def __post_init__(self) -> None:
        for name in ("x", "y", "z"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))
        if self.z.shape != (self.y.size, self.x.size):
            raise ValueError(
                f"Heatmap: z has shape {self.z.shape}, y and x ask for {self.y.size, self.x.size}"
            )

    @property
    def shown_limits(self) -> tuple[float, float]:
        """Lower and upper end of the colours, in the unit of `bar`."""
        if self.bar.limits is not None:
            low, high = self.bar.limits
        else:
            low, high = float(np.nanmin(self.z)), float(np.nanmax(self.z))
        if self.diverging:
            high = max(abs(low), abs(high))
            low = -high
        return low * self.bar.factor, high * self.bar.factor

    @property
    def levels(self) -> Vector:
        """Values of the contour lines, round and evenly spaced, in the unit of `bar`."""
        low, high = self.shown_limits
        if not high > low:
            return np.array([low, low + 1.0])
        rough = (high - low) / self.lines
        decade = 10.0 ** math.floor(math.log10(rough))
        step = next(nice * decade for nice in (1, 2, 5, 10) if rough <= 1.001 * nice * decade)
        levels: Vector = step * np.arange(math.ceil(low / step), math.floor(high / step) + 1.0)
        return levels if self.zero else levels[levels != 0]


@dataclass(frozen=True, eq=False)
class Cells:
    """A table of coloured cells: names beside and below, a text in each."""

    columns: Sequence[str]  #: Names, from the left and from the top.
    rows: Sequence[str]
    #: (rows, columns) From 0, palest, to 1, darkest (or else see `diverging`); NaN is left white.
    shade: Vector
    texts: Sequence[Sequence[str]]  #: What stands in the cells, row by row.
    diverging: bool = False  #: True where 1/2 is neither good nor bad: the palest colour then.

    def __post_init__(self) -> None:
        object.__setattr__(self, "shade", np.asarray(self.shade, dtype=np.float64))
        size = (len(self.rows), len(self.columns))
        shapes = {self.shade.shape, (len(self.texts), *{len(row) for row in self.texts})}
        if shapes != {size}:
            raise ValueError(f"Cells: {size[0]} rows and {size[1]} columns, but shapes {shapes}")


@dataclass(frozen=True, eq=False)
class Rule(Signal):
    """A straight line across the panel: a limit, a true value."""

    value: float  #: Where it stands, in SI.
    #: The axis it is a value of: "y" is a horizontal line, "x" a vertical one.
    axis: Literal["x", "y"] = "y"
    text: str = ""  #: Written at its end.


@dataclass(frozen=True, eq=False)
class Span(Signal):
    """A shaded stretch of the x axis: the load is on, the stop is touched."""

    start: float  #: Ends on the x axis, in SI.
    stop: float
    text: str = ""  #: Written at its top.


@dataclass(frozen=True)
class Note:
    """A short text beside a point of the panel."""

    x: float  #: The point, in SI.
    y: float
    text: str  #: What is written.
    side: Literal["above", "below"] = "above"  #: Where the text stands.


Item = Line | Points | Band | Bars | Intervals | Heatmap | Cells | Rule | Span | Note
