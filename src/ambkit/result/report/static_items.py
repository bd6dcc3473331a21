"""How matplotlib draws each item of a panel."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.result.report import style
from ambkit.result.report.decimate import decimate
from ambkit.result.report.figure import Panel
from ambkit.result.report.items import (
    Band,
    Bars,
    Cells,
    Heatmap,
    Intervals,
    Item,
    Line,
    Note,
    Points,
    Rule,
    Span,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

WIDTH = 7.2
"""Width of every figure [inch]: the text width of an A4 page."""

BUCKETS = 600
"""Stretches a long line is cut into; a panel is about 1200 pixels wide, its pen two."""

_MARKERS = {
    "circle": "o",
    "square": "s",
    "diamond": "D",
    "triangle": "^",
    "triangle down": "v",
    "cross": "x",
}


def draw_item(axes: "Axes", panel: Panel, item: Item, own_layout: bool = True) -> None:
    """Draw one item into its axes."""
    x_axis, y_axis = panel.x, panel.y
    match item:
        case Line():
            x, y = decimate(x_axis.shown(item.x), y_axis.shown(item.y), BUCKETS)
            axes.plot(x, y, **_pen(item.signal))
        case Points():
            error = None if item.error is None else y_axis.shown(item.error)
            marker = {**_marker(item.signal), "linestyle": "none"}
            x, y = x_axis.shown(item.x), y_axis.shown(item.y)
            axes.errorbar(
                x, y, error, capsize=2.0, elinewidth=0.8, clip_on=not panel.heatmap, **marker
            )
            axes.margins(x=0.05)
        case Band():
            low, high = y_axis.shown(item.low), y_axis.shown(item.high)
            colour = style.tint(style.style_of(item.signal).colour, 0.25)
            axes.fill_between(x_axis.shown(item.x), low, high, color=colour, linewidth=0, zorder=1)
        case Bars():
            _draw_bars(axes, panel, item)
        case Intervals():
            _draw_intervals(axes, panel, item)
        case Heatmap():
            _draw_heatmap(axes, panel, item, own_layout)
        case Cells():
            _draw_cells(axes, item)
        case Rule():
            _draw_rule(axes, panel, item)
        case Span():
            ends = x_axis.factor * item.start, x_axis.factor * item.stop
            colour = style.tint(style.style_of(item.signal).colour, 0.12)
            axes.axvspan(*ends, color=colour, linewidth=0, zorder=0.5)
            _write(axes, item.text, (min(ends), 1.0), ("data", "axes fraction"), (3, -3))
        case Note():
            place = item.x * x_axis.factor, item.y * y_axis.factor
            up = 1 if item.side == "above" else -1
            _write(axes, item.text, place, "data", (0, 5 * up), horizontal="center")


def _draw_bars(axes: "Axes", panel: Panel, item: Bars) -> None:
    group = [other for other in panel.items if isinstance(other, Bars)]
    width = 0.8 / len(group)
    centres = np.arange(item.values.size) + (group.index(item) - (len(group) - 1) / 2) * width
    axes.bar(
        centres,
        panel.y.shown(item.values),
        0.92 * width,
        yerr=None if item.error is None else panel.y.shown(item.error),
        error_kw={"ecolor": style.INK, "elinewidth": 0.8, "capsize": 2.0},
        **_fill(item.signal),
    )
    axes.margins(x=0.02)


def _draw_intervals(axes: "Axes", panel: Panel, item: Intervals) -> None:
    down = np.arange(item.values.size)
    values = panel.x.shown(item.values)
    ends = np.abs(panel.x.shown(np.array([item.low, item.high])) - values)
    over = _marker(item.signal) | {"linestyle": "none", "zorder": 8}  # over what they are beside
    axes.errorbar(values, down, xerr=ends, capsize=3.0, elinewidth=1.4, **over)
    for row, text in zip(down, item.texts, strict=True):
        frame = ("axes fraction", "data")
        place = (1.0, row - 0.36)
        _write(axes, text, place, frame, (-4, 0), "right", "center", cover=1.0)
    axes.margins(x=0.05)
    axes.set_yticks(down, item.rows)
    axes.set_ylim(item.values.size - 0.5, -0.62)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")


def _draw_heatmap(axes: "Axes", panel: Panel, item: Heatmap, own_layout: bool) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    colours = style.DIVERGING if item.diverging else style.SEQUENTIAL
    low, high = item.shown_limits
    x, y, z = panel.x.shown(item.x), panel.y.shown(item.y), item.bar.shown(item.z)
    mesh = axes.pcolormesh(
        x,
        y,
        z,
        cmap=LinearSegmentedColormap.from_list("", colours),
        vmin=low,
        vmax=high,
        shading="gouraud",
        rasterized=True,  # one embedded picture instead of a path a cell
    )
    contours = axes.contour(x, y, z, levels=item.levels, colors=style.INK, linewidths=0.6)
    for number in axes.clabel(contours, fontsize=6.5, fmt=_number):
        number.set_clip_on(False)  # half a number at the border would be a wrong number
    axes.grid(visible=False)
    canvas = axes.get_figure(root=True)
    assert canvas is not None  # for the type checker: these axes were added to one
    if not own_layout:
        canvas.colorbar(mesh, ax=axes, label=item.bar.title)
        return
    box = axes.get_position()
    bar = canvas.add_axes((box.x1 + 0.1 / WIDTH, box.y0, 0.13 / WIDTH, box.height))
    canvas.colorbar(mesh, cax=bar).outline.set_linewidth(0.6)
    bar.set_ylabel(item.bar.title)


def _draw_cells(axes: "Axes", item: Cells) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    colours = style.DIVERGING if item.diverging else style.SEQUENTIAL
    down, across = np.arange(len(item.rows) + 1.0), np.arange(len(item.columns) + 1.0)
    axes.pcolormesh(
        across - 0.5,
        down - 0.5,
        np.ma.masked_invalid(item.shade),
        cmap=LinearSegmentedColormap.from_list("", colours),
        vmin=0.0,
        vmax=1.0,
        edgecolors="white",
        linewidth=1.2,
    )
    for place in np.ndindex(item.shade.shape):
        text = item.texts[place[0]][place[1]]
        ink = style.ink_on(colours, float(item.shade[place]))
        axes.text(place[1], place[0], text, ha="center", va="center", fontsize=7.0, color=ink)
    axes.set_yticks(range(len(item.rows)), item.rows)
    axes.set_xticks(range(len(item.columns)), item.columns)
    axes.set_ylim(len(item.rows) - 0.5, -0.5)
    axes.tick_params(length=0)
    axes.xaxis.tick_top()
    axes.grid(visible=False)
    for side in axes.spines.values():
        side.set_visible(False)


def _number(value: float) -> str:
    return f"{value:.4g}".replace("-", "−")


def _draw_rule(axes: "Axes", panel: Panel, item: Rule) -> None:
    if item.axis == "y":
        value = item.value * panel.y.factor
        axes.axhline(value, **_pen(item.signal))
        place, frame = (1.0, value), ("axes fraction", "data")
        _write(axes, item.text, place, frame, (-4, 2), horizontal="right", vertical="bottom")
    else:
        value = item.value * panel.x.factor
        axes.axvline(value, **_pen(item.signal))
        _write(axes, item.text, (value, 1.0), ("data", "axes fraction"), (3, -3))


def _write(
    axes: "Axes",
    text: str,
    place: tuple[float, float],
    frame: str | tuple[str, str],
    offset: tuple[float, float],
    horizontal: str = "left",
    vertical: str | None = None,
    cover: float = 0.75,
) -> None:
    """Put a small text at a place, `offset` points away from it, readable over lines."""
    # `cover` is how much of them its white ground hides.
    if text:
        axes.annotate(
            text,
            place,
            offset,
            xycoords=frame,
            textcoords="offset points",
            horizontalalignment=horizontal,
            verticalalignment=vertical or ("bottom" if offset[1] > 0 else "top"),
            fontsize=7.0,
            zorder=9,
            bbox={"facecolor": "white", "alpha": cover, "linewidth": 0, "pad": 0.8},
        )


def _pen(signal: str) -> dict[str, Any]:
    look = style.style_of(signal)
    # Dashes are given in points; matplotlib would stretch them with the line's width.
    dashes = tuple(length / look.width for length in look.dash)
    return {
        "color": look.colour,
        "linewidth": look.width,
        "linestyle": (0, dashes) if dashes else "-",
        "zorder": look.layer,
        "solid_joinstyle": "round",
        "dash_capstyle": "butt",
    }


def _marker(signal: str) -> dict[str, Any]:
    look = style.style_of(signal)
    return {
        "color": look.colour,
        "marker": _MARKERS[look.marker],
        "markersize": look.size,
        "markerfacecolor": "white" if look.hollow else look.colour,
        "markeredgewidth": 1.0,
        "zorder": look.layer,
    }


def _fill(signal: str) -> dict[str, Any]:
    look = style.style_of(signal)
    hatch = {style.DASH: "////", style.LONG: "////", style.DASH_DOT: "\\\\\\\\", style.DOT: "..."}
    return {
        "facecolor": look.colour,
        "edgecolor": "white",
        "linewidth": 0.0,
        "hatch": hatch.get(look.dash),
        "zorder": look.layer,
    }


def legend_handle(item: Item, text: str) -> "Artist":
    """Make the little picture beside a legend's text."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    signal = getattr(item, "signal", "estimate")
    text = f" {text}" if text.startswith("_") else text  # matplotlib hides such names
    match item:
        case Points() | Intervals():
            return Line2D([], [], linestyle="none", label=text, **_marker(signal))
        case Bars():
            return Patch(label=text, **_fill(signal))
        case Band() | Span():
            strength = 0.25 if isinstance(item, Band) else 0.12
            colour = style.tint(style.style_of(signal).colour, strength)
            return Patch(label=text, facecolor=colour, linewidth=0)
    return Line2D([], [], label=text, **_pen(signal))
