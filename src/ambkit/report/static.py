"""A figure on paper: PNG and SVG by matplotlib, the same bytes for the same figure.

Only the object interface is used, no global state is touched. The layout is laid out by hand in
inches: constrained layout would draw every figure twice.
"""

import re
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.report import style
from ambkit.report.decimate import decimate
from ambkit.report.figure import (
    Band,
    Bars,
    Figure,
    Heatmap,
    Item,
    Line,
    Note,
    Panel,
    Points,
    Rule,
    Span,
)
from ambkit.report.files import replace_file

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

WIDTH = 7.2
"""Width of every figure [inch]: the text width of an A4 page."""

PIXELS_PER_INCH = 200
BUCKETS = 600
"""Stretches a long line is cut into; a panel is about 1200 pixels wide, its pen two."""

_LEFT, _RIGHT, _TOP, _BOTTOM = 0.7, 0.18, 0.1, 0.46
_LEGEND_ROW, _TITLE, _BAR = 0.165, 0.22, 0.76
_MARKERS = {"circle": "o", "square": "s", "diamond": "D", "triangle": "^", "cross": "x"}
_RC: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"],  # comes with matplotlib, so every machine draws the same
    "font.size": 8.0,
    "mathtext.fontset": "dejavusans",
    "text.color": style.INK,
    "axes.labelcolor": style.INK,
    "axes.edgecolor": style.FRAME,
    "axes.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.xmargin": 0.0,
    "axes.formatter.limits": (-4, 5),
    "axes.titlesize": 8.0,
    "axes.titlelocation": "left",
    "axes.titlepad": 4.0,
    "grid.color": style.GRID,
    "grid.linewidth": 0.6,
    "xtick.color": style.FRAME,
    "ytick.color": style.FRAME,
    "xtick.labelcolor": style.INK,
    "ytick.labelcolor": style.INK,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "hatch.linewidth": 0.6,
    "svg.fonttype": "path",
}


@dataclass(frozen=True)
class Picture:
    """A figure drawn.

    Parameters
    ----------
    png, svg : bytes
        Contents of the two files.
    """

    png: bytes
    svg: bytes


def render(figure: Figure) -> Picture:
    """Draw a figure.

    Parameters
    ----------
    figure : Figure
        What to draw.

    Returns
    -------
    Picture
        PNG and SVG, free of dates and of the machine they were made on.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    png, svg = BytesIO(), StringIO()
    with matplotlib.rc_context():
        matplotlib.rcdefaults()  # whatever the user's matplotlibrc says
        matplotlib.rcParams.update({**_RC, "svg.hashsalt": figure.id})
        canvas = draw(figure)
        # Not `savefig`, which lays the figure out once more before it draws.
        agg: Any = FigureCanvasAgg(canvas)
        agg.print_png(png, metadata={"Software": None})
        canvas.set_dpi(PIXELS_PER_INCH / 2)  # of heat maps only, the rest has no pixels
        vector: Any = FigureCanvasSVG(canvas)
        metadata = {"Date": None, "Creator": None, "Title": figure.title}
        vector.print_svg(svg, metadata=metadata)
    return Picture(png.getvalue(), _shorten(svg.getvalue()).encode())


def save(figure: Figure, folder: Path) -> tuple[Path, Path]:
    """Draw a figure into ``folder/<id>.png`` and ``folder/<id>.svg``.

    Parameters
    ----------
    figure : Figure
        What to draw.
    folder : Path
        Made if it is not there.

    Returns
    -------
    tuple of Path
        The two files.

    Raises
    ------
    AmbkitError
        If the folder cannot be written.
    """
    picture = render(figure)
    return (
        replace_file(folder / f"{figure.id}.png", picture.png),
        replace_file(folder / f"{figure.id}.svg", picture.svg),
    )


def draw(figure: Figure) -> "Canvas":
    """Build the matplotlib figure; `render` sets the fonts and draws it.

    Parameters
    ----------
    figure : Figure
        What to draw.

    Returns
    -------
    matplotlib.figure.Figure
        Not attached to any window.
    """
    from matplotlib.figure import Figure as Canvas

    entries = list(figure.legend())
    columns = _legend_columns([text for text, _ in entries])
    legend_height = _LEGEND_ROW * -(-len(entries) // columns)
    height, boxes = _layout(figure, _TOP + legend_height)
    canvas = Canvas((WIDTH, height), dpi=PIXELS_PER_INCH, facecolor=style.PAPER)
    below: dict[int, Axes] = {}
    for index in reversed(range(len(figure.panels))):
        shared = below.get(index + figure.columns) if figure.shares_x(index) else None
        axes = canvas.add_axes(boxes[index], sharex=shared)
        below[index] = axes
        _draw_panel(axes, figure.panels[index], labelled=shared is None)
    if entries:
        canvas.legend(
            handles=[_handle(item, text) for text, item in entries],
            loc="upper left",
            bbox_to_anchor=(boxes[0][0], 1 - 0.3 * _TOP / height),
            borderaxespad=0.0,
            borderpad=0.0,
            ncols=columns,
            frameon=False,
            handlelength=2.4,
            handletextpad=0.6,
            columnspacing=1.6,
            labelspacing=0.35,
        )
    return canvas


def _layout(figure: Figure, top: float) -> tuple[float, list[tuple[float, float, float, float]]]:
    """Height of the figure [inch], and where each panel stands, in parts of the figure."""
    panel_height = figure.panel_height or {1: 2.75, 2: 1.85}.get(figure.rows, 1.5)
    cell = WIDTH / figure.columns
    places = []
    depth = top
    for start in range(0, len(figure.panels), figure.columns):
        row = range(start, min(start + figure.columns, len(figure.panels)))
        depth += _TITLE * any(figure.panels[index].title for index in row)
        for index in row:
            bar = _BAR if figure.panels[index].heatmap else 0.0
            left = cell * (index - start) + _LEFT
            places.append((left, depth, cell - _LEFT - _RIGHT - bar))
        depth += panel_height
        depth += 0.12 if all(figure.shares_x(index) for index in row) else _BOTTOM
    return depth, [
        (left / WIDTH, 1 - (down + panel_height) / depth, width / WIDTH, panel_height / depth)
        for left, down, width in places
    ]


def _legend_columns(texts: list[str]) -> int:
    """How many entries fit beside each other, at 0.06 inch a letter."""
    longest = max((len(text) for text in texts), default=1)
    return max(1, min(len(texts), int((WIDTH - _LEFT) / (0.06 * longest + 0.5))))


def _draw_panel(axes: "Axes", panel: Panel, labelled: bool) -> None:
    axes.set_xscale(panel.x.scale)
    axes.set_yscale(panel.y.scale)
    for item in panel.items:
        _draw_item(axes, panel, item)
    if "log" in (panel.x.scale, panel.y.scale):
        axes.grid(which="minor", linewidth=0.3)
    if panel.categories:
        axes.set_xticks(range(len(panel.categories)), panel.categories)
        axes.tick_params(axis="x", length=0)
        axes.grid(visible=False, axis="x")
    for axis, set_limits in ((panel.x, axes.set_xlim), (panel.y, axes.set_ylim)):
        if axis.limits:
            set_limits(axis.limits[0] * axis.factor, axis.limits[1] * axis.factor)
    axes.set_title(panel.title)
    axes.set_ylabel(panel.y.title)
    width = axes.get_position().width * WIDTH
    axes.yaxis.set_label_coords((0.2 - _LEFT) / width, 0.5)
    if labelled:
        axes.set_xlabel(panel.x.title)
    else:
        axes.tick_params(axis="x", labelbottom=False)


def _draw_item(axes: "Axes", panel: Panel, item: Item) -> None:
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
        case Heatmap():
            _draw_heatmap(axes, panel, item)
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


def _draw_heatmap(axes: "Axes", panel: Panel, item: Heatmap) -> None:
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
    box = axes.get_position()
    canvas = axes.get_figure(root=True)
    assert canvas is not None  # for the type checker: these axes were added to one
    bar = canvas.add_axes((box.x1 + 0.1 / WIDTH, box.y0, 0.13 / WIDTH, box.height))
    canvas.colorbar(mesh, cax=bar).outline.set_linewidth(0.6)
    bar.set_ylabel(item.bar.title)


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
) -> None:
    """Put a small text at a place, `offset` points away from it, readable over lines."""
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
            bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 0.8},
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
        "markersize": 4.0,
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


def _handle(item: Item, text: str) -> "Artist":
    """The little picture beside a legend's text."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    signal = getattr(item, "signal", "estimate")
    match item:
        case Points():
            return Line2D([], [], linestyle="none", label=text, **_marker(signal))
        case Bars():
            return Patch(label=text, **_fill(signal))
        case Band() | Span():
            strength = 0.25 if isinstance(item, Band) else 0.12
            colour = style.tint(style.style_of(signal).colour, strength)
            return Patch(label=text, facecolor=colour, linewidth=0)
    return Line2D([], [], label=text, **_pen(signal))


def _shorten(svg: str) -> str:
    """Cut coordinates after a hundredth of a point, which nobody can see; it halves the file."""
    return re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), svg)
