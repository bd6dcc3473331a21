"""Items that fill a panel with colours: heat maps with contour lines, and tables of cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.result.report import style
from ambkit.result.report.item import Axis, Item, Json, Panel, Vector
from ambkit.result.report.markup import label_html

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def _colours(diverging: bool) -> tuple[str, ...]:
    return style.DIVERGING if diverging else style.SEQUENTIAL


def _colour_map(diverging: bool) -> Any:
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("", _colours(diverging))


def _colour_scale(diverging: bool) -> list[list[Any]]:
    colours = _colours(diverging)
    return [[n / (len(colours) - 1), colour] for n, colour in enumerate(colours)]


@dataclass(frozen=True, eq=False)
class Heatmap(Item):
    """A surface as a heat map, with labelled contour lines so that it is readable in grey."""

    surface = True
    x: Vector  #: (n,) Abscissae of the columns, ascending, in SI.
    y: Vector  #: (m,) Ordinates of the rows, ascending, in SI.
    z: Vector  #: (m, n) The surface, in SI.
    bar: Axis  #: Quantity of the colours: label, unit, factor, limits.
    #: True for a signed quantity: the palest colour is zero, limits are symmetric.
    diverging: bool = False
    lines: int = 9  #: Approximate number of contour lines, at round values; 0: none.
    #: Whether there is one at zero. On a flat surface its place is arbitrary.
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
        """Ends of the colour scale, in the unit of `bar`."""
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
        """Values of the contour lines, round and equidistant, in the unit of `bar`."""
        low, high = self.shown_limits
        if not high > low:
            return np.array([low, low + 1.0])
        if not self.lines:
            return np.array([low, high])
        rough = (high - low) / self.lines
        decade = 10.0 ** math.floor(math.log10(rough))
        step = next(nice * decade for nice in (1, 2, 5, 10) if rough <= 1.001 * nice * decade)
        levels: Vector = step * np.arange(math.ceil(low / step), math.floor(high / step) + 1.0)
        return levels if self.zero else levels[levels != 0]

    def draw(self, ax: Axes, panel: Panel) -> None:
        low, high = self.shown_limits
        x, y, z = panel.x.shown(self.x), panel.y.shown(self.y), self.bar.shown(self.z)
        mesh = ax.pcolormesh(
            x, y, z, cmap=_colour_map(self.diverging), vmin=low, vmax=high, shading="gouraud",
            rasterized=True,  # one embedded image instead of a path per cell
        )  # fmt: skip
        if self.lines:
            contours = ax.contour(x, y, z, levels=self.levels, colors=style.INK, linewidths=0.6)
            text = "{:.4g}".format
            for number in ax.clabel(
                contours, fontsize=6.5, fmt=lambda v: text(v).replace("-", "−")
            ):
                number.set_clip_on(False)  # a number cut at the border would be a wrong number
        ax.grid(visible=False)
        canvas = ax.get_figure(root=True)
        assert canvas is not None  # for the type checker: these axes are part of one
        bar = canvas.colorbar(mesh, ax=ax, label=self.bar.title, aspect=18, pad=0.02)
        bar.outline.set_linewidth(0.6)

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        (low, high), levels = self.shown_limits, self.levels
        at = panel.x.hover_format("x")
        up = panel.y.hover_format("y")
        value = self.bar.hover_format("z")
        title = {"text": label_html(self.bar.title), "side": "right", "font": {"size": 13}}
        return [{
            "type": "contour", "x": panel.x.numbers(self.x), "y": panel.y.numbers(self.y),
            "z": self.bar.numbers(self.z), "colorscale": _colour_scale(self.diverging),
            "zmin": low, "zmax": high, "autocontour": False,
            "contours": {
                "start": float(levels[0]), "end": float(levels[-1]),
                "size": float(levels[1] - levels[0]), "coloring": "heatmap",
                "showlines": bool(self.lines), "showlabels": bool(self.lines),
                "labelfont": {"size": 11, "color": style.INK},
            },
            "line": {"width": 0.8, "color": style.INK},
            "colorbar": {"title": title, "ticks": "", "thickness": 12, "outlinewidth": 0.6,
                         "ypad": 0, "xpad": 4},
            "hovertemplate": f"{at}, {up}: <b>{value}</b><extra></extra>",
        }]  # fmt: skip

    def axis_layout(self, panel: Panel) -> tuple[Json, Json]:
        x, y = (
            {"range": [axis.position(float(end)) for end in axis.limits or (of.min(), of.max())]}
            for axis, of in ((panel.x, self.x), (panel.y, self.y))
        )
        return x, y


@dataclass(frozen=True, eq=False)
class Cells(Item):
    """A table of coloured cells: names at the side and below, a text in each."""

    surface = named_rows = True
    columns: Sequence[str]  #: Names, from the left and from the top.
    rows: Sequence[str]
    #: (rows, columns) From 0, palest, to 1, darkest (or see `diverging`); NaN is white.
    shade: Vector
    texts: Sequence[Sequence[str]]  #: Texts of the cells, row by row.
    diverging: bool = False  #: True if 1/2 is neutral, and palest.

    def __post_init__(self) -> None:
        object.__setattr__(self, "shade", np.asarray(self.shade, dtype=np.float64))
        size = (len(self.rows), len(self.columns))
        shapes = {self.shade.shape, (len(self.texts), *{len(row) for row in self.texts})}
        if shapes != {size}:
            raise ValueError(f"Cells: {size[0]} rows and {size[1]} columns, but shapes {shapes}")

    def draw(self, ax: Axes, panel: Panel) -> None:
        down, across = np.arange(len(self.rows) + 1.0), np.arange(len(self.columns) + 1.0)
        ax.pcolormesh(
            across - 0.5, down - 0.5, np.ma.masked_invalid(self.shade), vmin=0.0, vmax=1.0,
            cmap=_colour_map(self.diverging), edgecolors="white", linewidth=1.2,
        )  # fmt: skip
        for (row, column), shade in np.ndenumerate(self.shade):
            ink = style.ink_on(_colours(self.diverging), float(shade))
            text = self.texts[row][column]
            ax.text(column, row, text, ha="center", va="center", fontsize=7.0, color=ink)
        ax.set_yticks(range(len(self.rows)), self.rows)
        ax.set_xticks(range(len(self.columns)), self.columns)
        ax.set_ylim(len(self.rows) - 0.5, -0.5)
        ax.tick_params(length=0)
        ax.xaxis.tick_top()
        ax.grid(visible=False)
        ax.spines[:].set_visible(False)

    def plotly(self, panel: Panel, x: str, y: str) -> list[Json]:
        return [{
            "type": "heatmap", "x": [*map(label_html, self.columns)],
            "y": [*map(label_html, self.rows)], "z": Axis("").numbers(self.shade),
            "text": [list(row) for row in self.texts], "texttemplate": "%{text}",
            "colorscale": _colour_scale(self.diverging), "zmin": 0.0, "zmax": 1.0,
            "showscale": False, "hoverongaps": False, "xgap": 2, "ygap": 2,
            "hovertemplate": "%{y}, %{x}: <b>%{text}</b><extra></extra>",
        }]  # fmt: skip

    def axis_layout(self, panel: Panel) -> tuple[Json, Json]:
        bare = {"type": "category", "showgrid": False, "showline": False, "mirror": False}
        return bare | {"side": "top"}, bare | {"autorange": "reversed"}
