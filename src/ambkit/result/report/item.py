"""Axes, panels, and common parts of their items.

Data is in SI; an `Axis` has the display factor. Labels may contain formulas between dollar signs:
``"stiffness $k_i$"``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from ambkit.result.report import style
from ambkit.result.report.markup import label_html, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Vector = NDArray[np.float64]
Json = dict[str, Any]
Kind = TypeVar("Kind", bound="Item")

LONG = 200  #: Numbers of longer lines are rounded for the screen.

_PAPER_MARKERS = {
    "circle": "o", "square": "s", "diamond": "D", "triangle": "^", "triangle down": "v",
    "cross": "x",
}  # fmt: skip
_SCREEN_MARKERS = {"triangle": "triangle-up", "triangle down": "triangle-down", "cross": "x-thin"}


@dataclass(frozen=True)
class Axis:
    """An axis of a panel."""

    label: str  #: Quantity in words, with its symbol: ``"displacement $x$"``.
    unit: str = ""  #: Displayed unit; empty for a pure number.
    #: Factor from the data (SI) to `unit`: 1e3 for metres shown in mm.
    factor: float = 1.0
    scale: Literal["linear", "log"] = "linear"  #: Scale of the axis.
    limits: tuple[float, float] | None = None  #: Ends, in the unit of the data (SI).

    @property
    def title(self) -> str:
        """Label and unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    def shown(self, values: Any) -> Any:
        """Data in the unit of the axis."""
        return values * self.factor

    def position(self, value: float) -> float:
        """Plotly's position of an axis end or a text."""
        return math.log10(self.shown(value)) if self.scale == "log" else float(self.shown(value))

    def hover_format(self, coordinate: str) -> str:
        """Plotly's format of a coordinate under the mouse."""
        return f"%{{{coordinate}:.5~g}} {self.unit}".rstrip()

    def numbers(self, values: Vector) -> list[Any]:
        """Data in the unit of the axis as JSON: long lines with visible digits only."""
        scaled = self.shown(values)
        if scaled.ndim == 1 and scaled.size >= LONG:
            if self.scale == "log":
                return [float(f"{value:.6g}") if math.isfinite(value) else None for value in scaled]
            ends = self.shown(np.array(self.limits)) if self.limits else scaled[np.isfinite(scaled)]
            span = np.ptp(ends) if ends.size else 0.0
            scaled = np.round(scaled, 5 - math.floor(math.log10(span))) if span > 0 else scaled
        known: Any = np.where(np.isfinite(scaled), scaled, None)
        return list(known.tolist())


class Item:
    """An item of a panel."""

    surface: ClassVar[bool] = False
    """Whether it fills the panel with colours."""
    named_rows: ClassVar[bool] = False
    """Whether an axis has names instead of numbers."""

    @property
    def legend(self) -> str:
        """Text of the legend. Empty: no entry."""
        return ""

    def draw(self, ax: Axes, panel: Panel) -> None:
        """Draw it into matplotlib axes."""
        raise NotImplementedError

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        """Return its traces, shapes and annotations for plotly axes of these names."""
        raise NotImplementedError

    def axis_layout(self, panel: Panel) -> tuple[Json, Json]:
        """Return its properties of plotly's x and y axis."""
        return {}, {}


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    x: Axis  #: The axes.
    y: Axis
    items: Sequence[Item]  #: Items.
    title: str = ""  #: A short heading above the axes.
    equal: bool = False  #: Whether both axes have the same scale: an orbit's circle is round.

    def item(self, kind: type[Kind]) -> Kind | None:
        """Return the first item of a kind, if there is one."""
        return next((item for item in self.items if isinstance(item, kind)), None)

    @property
    def surface(self) -> bool:
        """Whether colours fill it."""
        return any(item.surface for item in self.items)

    @property
    def named_rows(self) -> bool:
        """Whether an axis has names instead of numbers."""
        return any(item.named_rows for item in self.items)

    @property
    def name(self) -> str:
        """Name of the item type for the user."""
        return plain(", ".join(filter(None, (self.title, self.y.label))) or self.x.label)

    def draw(self, ax: Axes) -> None:
        """Draw it into matplotlib axes."""
        ax.set_xscale(self.x.scale)
        ax.set_yscale(self.y.scale)
        # Before the items: Matplotlib sometimes fails to find its own limits around one point.
        for axis, set_limits in ((self.x, ax.set_xlim), (self.y, ax.set_ylim)):
            if axis.limits:
                set_limits(axis.shown(axis.limits[0]), axis.shown(axis.limits[1]))
        for item in self.items:
            item.draw(ax, self)
        if "log" in (self.x.scale, self.y.scale):
            ax.grid(which="minor", linewidth=0.3)
        for axis, mpl_axis in ((self.x, ax.xaxis), (self.y, ax.yaxis)):
            if axis.scale == "log":
                _plain_numbers(mpl_axis)
        if self.equal:
            ax.set_aspect("equal", adjustable="datalim")
        ax.set_title(self.title)
        ax.set_xlabel(self.x.title)
        ax.set_ylabel(self.y.title)


@dataclass(frozen=True, eq=False)
class Signal(Item):
    """An item of one signal: colour, dash and name from the style table."""

    signal: str = field(default="estimate", kw_only=True)  #: Name in `style.SIGNALS`.
    #: Legend; by default the signal's name, no entry if empty.
    label: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        style.style_of(self.signal)

    @property
    def look(self) -> style.Style:
        """Colour, dash and marker."""
        return style.style_of(self.signal)

    @property
    def legend(self) -> str:
        return self.look.label if self.label is None else self.label

    @property
    def entry(self) -> Json:
        """The label for matplotlib, which hides those with an initial underscore."""
        return {"label": f" {self.legend}" if self.legend.startswith("_") else self.legend}

    def _vectors(self, *names: str) -> None:
        """Convert the named fields to float vectors of equal length."""
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

    @property
    def _pen(self) -> Json:
        look = self.look
        # Dashes are in points; matplotlib would scale them with the line width.
        dashes = tuple(length / look.width for length in look.dash)
        return {
            "color": look.colour, "linewidth": look.width, "zorder": look.layer,
            "linestyle": (0, dashes) if dashes else "-", "solid_joinstyle": "round",
            "dash_capstyle": "butt", **self.entry,
        }  # fmt: skip

    @property
    def _stroke(self) -> Json:
        look = self.look
        dash = ",".join(f"{1.3 * length:.3g}px" for length in look.dash)
        return {"color": look.colour, "width": 1.2 * look.width, "dash": dash or "solid"}

    @property
    def _marker(self) -> Json:
        look = self.look
        return {
            "color": look.colour, "marker": _PAPER_MARKERS[look.marker], "markersize": look.size,
            "markerfacecolor": "white" if look.hollow else look.colour, "markeredgewidth": 1.0,
            "zorder": look.layer, "linestyle": "none", **self.entry,
        }  # fmt: skip

    @property
    def _symbol(self) -> Json:
        look = self.look
        symbol = _SCREEN_MARKERS.get(look.marker, look.marker)
        return {
            "symbol": f"{symbol}-open" if look.hollow or symbol == "x-thin" else symbol,
            "color": look.colour, "size": 1.75 * look.size,
            "line": {"width": 0.35 * look.size, "color": look.colour},
        }  # fmt: skip

    def _curve(self, x: list[Any], y: list[Any]) -> Json:
        # plotly's own simplification makes corners in smooth curves.
        line = self._stroke | {"simplify": False}
        curve = {"type": "scatter", "mode": "lines", "x": x, "y": y, "line": line}
        return curve | {"zorder": self.look.layer}


def write(
    ax: Axes, text: str, place: tuple[float, float], frame: Any, offset: tuple[float, float],
    *, ha: str = "left", va: str = "", cover: float = 0.75,
) -> None:  # fmt: skip
    """Write a small text `offset` points from a place, over `cover` of the lines."""
    if text:
        ax.annotate(
            text, place, offset, xycoords=frame, textcoords="offset points", fontsize=7.0,
            horizontalalignment=ha, verticalalignment=va or ("bottom" if offset[1] > 0 else "top"),
            zorder=9, bbox={"facecolor": "white", "alpha": cover, "linewidth": 0, "pad": 0.8},
        )  # fmt: skip


def annotation(
    text: str, place: Json, xanchor: str = "left", yanchor: str = "top", **more: Any
) -> Json:
    """Text at a place of a panel, for plotly."""
    look = {"text": label_html(text), "showarrow": False, "font": {"size": 12}}
    return look | place | {"xanchor": xanchor, "yanchor": yanchor} | more


def error_bars(axis: Axis, values: Vector | None, look: style.Style) -> Json:
    """Error bars for plotly."""
    if values is None:
        return {"visible": False}
    bar = {"type": "data", "array": axis.numbers(values), "visible": True}
    return bar | {"color": look.colour, "thickness": 1.2, "width": 4}


def _plain_numbers(axis: Any) -> None:
    """Label a logarithmic axis with short numbers such as 30, 60, 100 instead of powers."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

    low, high = sorted(axis.get_view_interval())
    if not 1e-4 < low < high < 1e5:
        return
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))
    if high < 5 * low:  # as on a linear axis: powers of ten are too far apart
        axis.set_major_locator(MaxNLocator(5))
        axis.set_minor_formatter(NullFormatter())
        return
    # Over few decades the powers of ten are too sparse.
    digits = "36" if high < 100 * low else ""

    def between(value: float, _: object) -> str:
        return f"{value:.4g}" if f"{value:.0e}"[0] in digits else ""

    axis.set_minor_formatter(FuncFormatter(between) if digits else NullFormatter())
