"""Items of a panel: lines, points, bands, bars, intervals, rules, spans and notes.

Each item draws itself with matplotlib and returns plain data for plotly.js.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ambkit.result.report import style
from ambkit.result.report.item import (
    Item,
    Json,
    Panel,
    Signal,
    Vector,
    annotation,
    error_bars,
    write,
)
from ambkit.result.report.markup import label_html

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BUCKETS = 700  #: Segments of a long line: about one per pixel column.

_HATCHES = {style.DASH: "/", style.LONG: "/", style.DASH_DOT: "\\", style.DOT: "."}


@dataclass(frozen=True, eq=False)
class Line(Signal):
    """A curve through samples."""

    x: Vector  #: (n,) The samples, in SI. NaN in `y` is a gap.
    y: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("x", "y")

    @cached_property
    def _decimated(self) -> tuple[Vector, Vector]:
        return decimate(self.x, self.y, BUCKETS)

    @cached_property
    def look(self) -> style.Style:
        """The signal's style; thin, solid and behind other lines where its ripple fills an area."""
        look, y = super().look, self._decimated[1][np.isfinite(self._decimated[1])]
        steps = np.diff(y)
        steps = steps[np.abs(steps) > 0.05 * np.ptp(y)] if y.size else steps
        if np.count_nonzero(steps[1:] * steps[:-1] < 0) < BUCKETS / 2:
            return look
        return replace(look, dash=style.SOLID, width=min(look.width, 0.6), layer=min(look.layer, 2))

    def draw(self, ax: Axes, panel: Panel) -> None:
        x, y = self._decimated
        ax.plot(panel.x.shown(x), panel.y.shown(y), **self._pen)

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        few = self._decimated
        curve = self._curve(panel.x.numbers(few[0]), panel.y.numbers(few[1]))
        return [curve | {"hovertemplate": panel.y.hover_format("y")}]


@dataclass(frozen=True, eq=False)
class Points(Signal):
    """Single values as markers, with error bars if `error` is given."""

    x: Vector  #: (n,) The values, in SI.
    y: Vector
    error: Vector | None = None  #: (n,) Half length of the vertical error bars, in SI.

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("x", "y", *(["error"] if self.error is not None else []))

    def draw(self, ax: Axes, panel: Panel) -> None:
        ax.errorbar(
            panel.x.shown(self.x),
            panel.y.shown(self.y),
            None if self.error is None else panel.y.shown(self.error),
            capsize=2.0,
            elinewidth=0.8,
            clip_on=not panel.surface,
            **self._marker,
        )
        ax.margins(x=0.05)

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        return [{
            "type": "scatter", "mode": "markers", "x": panel.x.numbers(self.x),
            "y": panel.y.numbers(self.y), "error_y": error_bars(panel.y, self.error, self.look),
            "marker": self._symbol, "cliponaxis": not panel.surface, "zorder": self.look.layer,
            "hovertemplate": panel.y.hover_format("y"),
        }]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Band(Signal):
    """The area between two curves, for instance two standard deviations."""

    x: Vector  #: (n,) Samples and the two borders, in SI.
    low: Vector
    high: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("x", "low", "high")

    def draw(self, ax: Axes, panel: Panel) -> None:
        x, low, high = panel.x.shown(self.x), panel.y.shown(self.low), panel.y.shown(self.high)
        colour = style.tint(self.look.colour, 0.25)
        ax.fill_between(x, low, high, color=colour, linewidth=0, zorder=1, **self.entry)

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        bare = {"line": {"width": 0}, "hoverinfo": "skip", "zorder": 0}
        low, high = (
            self._curve(panel.x.numbers(self.x), panel.y.numbers(border)) | bare
            for border in (self.low, self.high)
        )
        fill = {"fill": "tonexty", "fillcolor": style.tint(self.look.colour, 0.25)}
        return [low | {"showlegend": False}, high | fill]


@dataclass(frozen=True, eq=False)
class Bars(Signal):
    """One bar per category. Several `Bars` in one panel are side by side."""

    named_rows = True
    categories: Sequence[str]  #: Names below the bars; equal in all `Bars` of a panel.
    values: Vector  #: (n,) Heights, in SI.
    error: Vector | None = None  #: (n,) Half length of the error bars, in SI.

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("values", *(["error"] if self.error is not None else []))
        if len(self.categories) != self.values.size:
            raise ValueError(
                f"Bars: {len(self.categories)} categories, but {self.values.size} values"
            )

    def draw(self, ax: Axes, panel: Panel) -> None:
        group = [item for item in panel.items if isinstance(item, Bars)]
        width, places = 0.8 / len(group), np.arange(self.values.size)
        ax.bar(
            places + (group.index(self) - (len(group) - 1) / 2) * width,
            panel.y.shown(self.values),
            0.92 * width,
            yerr=None if self.error is None else panel.y.shown(self.error),
            error_kw={"ecolor": style.INK, "elinewidth": 0.8, "capsize": 2.0},
            facecolor=self.look.colour,
            edgecolor="white",
            linewidth=0.0,
            hatch=_HATCHES.get(self.look.dash, "") * 4,
            zorder=self.look.layer,
            **self.entry,
        )
        ax.margins(x=0.02)
        ax.set_xticks(places, self.categories)
        ax.tick_params(axis="x", length=0)
        ax.grid(visible=False, axis="x")

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        shape = _HATCHES.get(self.look.dash, "")
        pattern = {"shape": shape, "fgcolor": style.PAPER, "solidity": 0.15}
        return [{
            "type": "bar", "x": [*map(label_html, self.categories)],
            "y": panel.y.numbers(self.values),
            "error_y": error_bars(panel.y, self.error, self.look) | {"color": style.INK},
            "marker": {"color": self.look.colour,
                       "pattern": pattern | {"fillmode": "overlay", "size": 7}},
            "hovertemplate": panel.y.hover_format("y"),
        }]  # fmt: skip

    def axis_layout(self, panel: Panel) -> tuple[Json, Json]:
        title = {"unifiedhovertitle": {"text": "<b>%{x}</b>"}}
        return {"type": "category", "showgrid": False} | title, {}


@dataclass(frozen=True, eq=False)
class Intervals(Signal):
    """Values with intervals along the x axis, one per row."""

    named_rows = True
    rows: Sequence[str]  #: Names of the rows, from the top.
    values: Vector  #: (n,) The values and the ends of their intervals, in SI.
    low: Vector
    high: Vector
    texts: Sequence[str]  #: Text of each row, at the right.

    def __post_init__(self) -> None:
        super().__post_init__()
        self._vectors("values", "low", "high")
        sizes = {len(self.rows), len(self.texts), self.values.size}
        if len(sizes) > 1:
            raise ValueError(f"Intervals: rows, texts and values differ in length: {sorted(sizes)}")

    def draw(self, ax: Axes, panel: Panel) -> None:
        places, values = np.arange(self.values.size), panel.x.shown(self.values)
        ends = np.abs(panel.x.shown(np.array([self.low, self.high])) - values)
        over = self._marker | {"zorder": 8}  # above what they are next to
        ax.errorbar(values, places, xerr=ends, capsize=3.0, elinewidth=1.4, **over)
        for row, text in zip(places, self.texts, strict=True):
            place, frame = (1.0, row - 0.36), ("axes fraction", "data")
            write(ax, text, place, frame, (-4, 0), ha="right", va="center", cover=1.0)
        ax.margins(x=0.05)
        ax.set_yticks(places, self.rows)
        ax.set_ylim(self.values.size - 0.5, -0.62)
        ax.tick_params(axis="y", length=0)
        ax.grid(visible=False, axis="y")

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        look, right = self.look, {"xref": f"{x} domain", "x": 1, "yref": y}
        ends = error_bars(panel.x, self.high - self.values, look)
        ends |= {"arrayminus": panel.x.numbers(self.values - self.low), "symmetric": False}
        marks = {
            "type": "scatter", "mode": "markers", "x": panel.x.numbers(self.values),
            "y": [*map(label_html, self.rows)], "error_x": ends, "zorder": 8,
            "marker": self._symbol | {"size": 7}, "hovertemplate": panel.x.hover_format("x"),
        }  # fmt: skip
        # The line at the start must not cross the numbers.
        return [marks, *(
            annotation(text, right | {"y": row - 0.34}, "right", "middle", bgcolor=style.PAPER)
            for row, text in enumerate(self.texts) if text
        )]  # fmt: skip

    def axis_layout(self, panel: Panel) -> tuple[Json, Json]:
        ends = [self.values.size - 0.5, -0.62]
        return {}, {"type": "category", "showgrid": False, "range": ends}


@dataclass(frozen=True, eq=False)
class Rule(Signal):
    """A straight line across the panel: a limit, a true value."""

    value: float  #: Position, in SI.
    #: Axis of the value: "y" is a horizontal line, "x" a vertical one.
    axis: Literal["x", "y"] = "y"
    text: str = ""  #: Text at its end.

    def draw(self, ax: Axes, panel: Panel) -> None:
        if self.axis == "y":
            value = panel.y.shown(self.value)
            ax.axhline(value, **self._pen)
            write(ax, self.text, (1.0, value), ("axes fraction", "data"), (-4, 2), ha="right")
        else:
            value = panel.x.shown(self.value)
            ax.axvline(value, **self._pen)
            write(ax, self.text, (value, 1.0), ("data", "axes fraction"), (3, -3))

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        along, across, axis = ("y", "x", panel.y) if self.axis == "y" else ("x", "y", panel.x)
        refs = {f"{along}ref": y if along == "y" else x,
                f"{across}ref": f"{x if along == 'y' else y} domain"}  # fmt: skip
        value = axis.shown(self.value)
        # A marker must not hide the data.
        layer = "below" if along == "x" and self.look.layer < 3 else "above"
        shape = refs | {
            "type": "line", f"{along}0": value, f"{along}1": value, f"{across}0": 0,
            f"{across}1": 1, "line": self._stroke, "layer": layer,
        }  # fmt: skip
        place = refs | {along: axis.position(self.value), across: 1}
        anchors = ("right", "bottom") if along == "y" else ("left", "top")
        return [shape, *([annotation(self.text, place, *anchors)] if self.text else [])]


@dataclass(frozen=True, eq=False)
class Span(Signal):
    """A shaded range of the x axis, such as a disturbance or contact."""

    start: float  #: Ends on the x axis, in SI.
    stop: float
    text: str = ""  #: Text at its top.

    def draw(self, ax: Axes, panel: Panel) -> None:
        ends = panel.x.shown(self.start), panel.x.shown(self.stop)
        colour = style.tint(self.look.colour, 0.12)
        ax.axvspan(*ends, color=colour, linewidth=0, zorder=0.5, **self.entry)
        write(ax, self.text, (min(ends), 1.0), ("data", "axes fraction"), (3, -3))

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        refs = {"xref": x, "yref": f"{y} domain"}
        shape = refs | {
            "type": "rect", "x0": panel.x.shown(self.start), "x1": panel.x.shown(self.stop),
            "y0": 0, "y1": 1, "fillcolor": style.tint(self.look.colour, 0.12),
            "line": {"width": 0}, "layer": "below",
        }  # fmt: skip
        place = refs | {"x": panel.x.position(min(self.start, self.stop)), "y": 1}
        return [shape, *([annotation(self.text, place)] if self.text else [])]


@dataclass(frozen=True)
class Note(Item):
    """A short text at a point of the panel."""

    x: float  #: The point, in SI.
    y: float
    text: str  #: Text.
    side: Literal["above", "below"] = "above"  #: Position of the text.

    def draw(self, ax: Axes, panel: Panel) -> None:
        place = panel.x.shown(self.x), panel.y.shown(self.y)
        write(ax, self.text, place, "data", (0, 5 if self.side == "above" else -5), ha="center")

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        place = {"xref": x, "x": panel.x.position(self.x)}
        place |= {"yref": y, "y": panel.y.position(self.y)}
        anchor = "bottom" if self.side == "above" else "top"
        return [annotation(self.text, place, "center", anchor)]


def decimate(
    x: NDArray[np.float64], y: NDArray[np.float64], buckets: int = 1000
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the extreme samples in x and y of each segment."""
    # For a time series the extremes in x are the first and the last sample, which makes this the M4
    # aggregation (Jugel, Jerzak, Hackenbroich and Markl, 2014): with one segment per pixel column
    # the line looks the same. A curve that is no function of x is divided into ten times as many
    # segments, with its extremes in x too. All points are samples; gaps (NaN) remain. x (n,); y
    # (n,)
    if x.size > 4 * buckets and not (np.diff(x) >= 0).all():
        buckets *= 10
    if x.size <= 4 * buckets:
        return x, y
    size = -(-x.size // buckets)
    padding = -x.size % size
    first = np.arange(0, x.size, size)
    # The last segment is padded with its last sample.
    xs, ys = (np.pad(values, (0, padding), mode="edge").reshape(-1, size) for values in (x, y))
    gap = np.isnan(ys)
    low = np.where(gap, np.inf, ys).argmin(axis=1)
    high = np.where(gap, -np.inf, ys).argmax(axis=1)
    index_parts = [first + place for place in (xs.argmin(axis=1), xs.argmax(axis=1), low, high)]
    broken = gap.any(axis=1)
    index_parts.append(first[broken] + gap[broken].argmax(axis=1))
    index = np.unique(np.minimum(np.concatenate(index_parts), x.size - 1))
    return x[index], y[index]
