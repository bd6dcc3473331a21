"""What a figure shows, said once; `static` and `interactive` both draw from this description.

Data is given in SI. Each `Axis` says with which factor its data is shown, so that "mm" and "s"
appear on paper only. Labels may hold simple formulas between dollar signs: ``"stiffness $k_i$"``.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ambkit.report.style import style_of

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Axis:
    """What an axis shows.

    Parameters
    ----------
    label : str
        The quantity in words, with its symbol: ``"displacement $x$"``.
    unit : str
        The unit shown; empty for a pure number.
    factor : float
        What the data (SI) is multiplied with to be in `unit`: 1e3 for metres shown in mm.
    scale : {"linear", "log"}
        Scale of the axis.
    limits : tuple of float, optional
        Lower and upper end, in the unit of the data (SI).
    """

    label: str
    unit: str = ""
    factor: float = 1.0
    scale: Literal["linear", "log"] = "linear"
    limits: tuple[float, float] | None = None

    @property
    def title(self) -> str:
        """Label and unit as they stand beside the axis."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    def shown(self, values: Vector) -> Vector:
        """Data in the unit of the axis.

        Parameters
        ----------
        values : ndarray
            Data in SI.

        Returns
        -------
        ndarray
            The same shape, in `unit`.
        """
        return values * self.factor


@dataclass(frozen=True, eq=False)
class _Signal:
    """An item that belongs to one signal: it takes colour, dash and name from the style table."""

    signal: str = field(default="estimate", kw_only=True)
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
class Line(_Signal):
    """A curve through samples.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        The samples, in SI. NaN in `y` is a gap.
    signal : str
        Name in `style.SIGNALS`.
    label : str, optional
        Legend; the signal's own name if not given, no entry if empty.
    """

    x: Vector
    y: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("x", "y")


@dataclass(frozen=True, eq=False)
class Points(_Signal):
    """Single values as markers, with an error bar each if `error` is given.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        The values, in SI.
    error : ndarray, shape (n,), optional
        Half length of the vertical error bars, in SI.
    signal, label : str
        As in `Line`.
    """

    x: Vector
    y: Vector
    error: Vector | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("x", "y", *(["error"] if self.error is not None else []))


@dataclass(frozen=True, eq=False)
class Band(_Signal):
    """The area between two curves, for instance two standard deviations.

    Parameters
    ----------
    x, low, high : ndarray, shape (n,)
        Samples and the two borders, in SI.
    signal, label : str
        As in `Line`; the band takes the signal's colour, pale.
    """

    x: Vector
    low: Vector
    high: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("x", "low", "high")


@dataclass(frozen=True, eq=False)
class Bars(_Signal):
    """One bar a category. Several `Bars` in one panel stand side by side.

    Parameters
    ----------
    categories : sequence of str
        Names below the bars; the same in all `Bars` of a panel.
    values : ndarray, shape (n,)
        Heights, in SI.
    error : ndarray, shape (n,), optional
        Half length of the error bars, in SI.
    signal, label : str
        As in `Line`.
    """

    categories: Sequence[str]
    values: Vector
    error: Vector | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("values", *(["error"] if self.error is not None else []))
        if len(self.categories) != self.values.size:
            raise ValueError(
                f"Bars: {len(self.categories)} categories, but {self.values.size} values"
            )


@dataclass(frozen=True, eq=False)
class Heatmap:
    """A surface over a plane as colours, with labelled contour lines so that it reads in grey.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Abscissae of the columns, ascending, in SI.
    y : ndarray, shape (m,)
        Ordinates of the rows, ascending, in SI.
    z : ndarray, shape (m, n)
        The surface, in SI.
    bar : Axis
        What the colours mean: label, unit, factor, limits.
    diverging : bool
        True for a signed quantity: the palest colour is zero, limits are symmetric.
    lines : int
        About how many contour lines; they stand at round values.
    """

    x: Vector
    y: Vector
    z: Vector
    bar: Axis
    diverging: bool = False
    lines: int = 9

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
        return levels


@dataclass(frozen=True, eq=False)
class Rule(_Signal):
    """A straight line across the panel: a limit, a true value.

    Parameters
    ----------
    value : float
        Where it stands, in SI.
    axis : {"y", "x"}
        The axis it is a value of: "y" is a horizontal line, "x" a vertical one.
    text : str
        Written at its end.
    signal, label : str
        As in `Line`.
    """

    value: float
    axis: Literal["x", "y"] = "y"
    text: str = ""


@dataclass(frozen=True, eq=False)
class Span(_Signal):
    """A shaded stretch of the x axis: the load is on, the stop is touched.

    Parameters
    ----------
    start, stop : float
        Ends on the x axis, in SI.
    text : str
        Written at its top.
    signal, label : str
        As in `Line`.
    """

    start: float
    stop: float
    text: str = ""


@dataclass(frozen=True)
class Note:
    """A short text beside a point of the panel.

    Parameters
    ----------
    x, y : float
        The point, in SI.
    text : str
        What is written.
    side : {"above", "below"}
        Where the text stands.
    """

    x: float
    y: float
    text: str
    side: Literal["above", "below"] = "above"


Item = Line | Points | Band | Bars | Heatmap | Rule | Span | Note


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Parameters
    ----------
    x, y : Axis
        The axes.
    items : sequence of Item
        What is drawn.
    title : str
        A short heading above the axes.
    """

    x: Axis
    y: Axis
    items: Sequence[Item]
    title: str = ""

    @property
    def categories(self) -> Sequence[str]:
        """Names below the bars; empty where there are none."""
        return next((item.categories for item in self.items if isinstance(item, Bars)), ())

    @property
    def heatmap(self) -> Heatmap | None:
        """The panel's heat map, if it has one."""
        return next((item for item in self.items if isinstance(item, Heatmap)), None)


@dataclass(frozen=True)
class Figure:
    """A figure of the report.

    Parameters
    ----------
    id : str
        Name of its files and anchor: ``"fig15"``. Letters, digits, ``-`` and ``_``.
    title : str
        What it shows, in a few words.
    caption : str
        What to see in it (Markdown with formulas).
    panels : sequence of Panel
        Row by row.
    source : str
        Where it is from: ``"paper, Fig. 15"``.
    columns : int
        Number of panels beside each other.
    panel_height : float
        Height of one panel on paper [inch]; 0 chooses by the number of rows.
    alt : str
        What a reader who cannot see it is told; made of title, axes and legend if empty.

    Raises
    ------
    ValueError
        For an unusable id, for no panels, or if a panel's `Bars` name different categories.
    """

    id: str
    title: str
    caption: str
    panels: Sequence[Panel]
    source: str = ""
    columns: int = 1
    panel_height: float = 0.0
    alt: str = ""

    def __post_init__(self) -> None:
        if not self.id.replace("-", "").replace("_", "").isalnum():
            raise ValueError(f"figure id {self.id!r}: letters, digits, - and _ only")
        if not self.panels or self.columns < 1:
            raise ValueError(f"figure {self.id}: needs at least one panel and one column")
        for panel in self.panels:
            bars = [item for item in panel.items if isinstance(item, Bars)]
            if len({tuple(item.categories) for item in bars}) > 1:
                raise ValueError(f"figure {self.id}: Bars of one panel differ in their categories")

    @property
    def rows(self) -> int:
        """Number of rows of panels."""
        return -(-len(self.panels) // self.columns)

    def shares_x(self, index: int) -> bool:
        """Whether the panel below has the same x axis, so that it need not be labelled twice.

        Parameters
        ----------
        index : int
            Position in `panels`.

        Returns
        -------
        bool
            True if both axes are equal and neither carries categories.
        """
        below = index + self.columns
        if below >= len(self.panels):
            return False
        upper, lower = self.panels[index], self.panels[below]
        return upper.x == lower.x and not upper.categories and not lower.title

    def legend(self) -> Iterator[tuple[str, Item]]:
        """Each legend text once, with the first item that carries it.

        Yields
        ------
        tuple of str and Item
            In the order of the panels.
        """
        seen = {""}
        for panel in self.panels:
            for item in panel.items:
                if isinstance(item, _Signal) and item.legend not in seen:
                    seen.add(item.legend)
                    yield item.legend, item

    def description(self) -> str:
        """Text in place of the picture, for readers who cannot see it.

        Returns
        -------
        str
            `alt`, or a sentence of title, axes and legend.
        """
        if self.alt:
            return self.alt
        axes = "; ".join(dict.fromkeys(f"{p.y.title} over {p.x.title}" for p in self.panels))
        names = ", ".join(text for text, _ in self.legend())
        return f"{self.title}: {axes}{f'. Shown: {names}' if names else ''}.".replace("$", "")
