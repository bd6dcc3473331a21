"""A figure on paper: PNG, SVG and PDF by matplotlib, the same bytes for the same figure.

Only the object interface is used, no global state is touched. The layout is laid out by hand in
inches: constrained layout would draw every figure twice.

There are two back ends, this and `ambkit.result.report.interactive`: no library makes one of the
other without loss. Of matplotlib, ``plotly.tools.mpl_to_plotly`` refused two of the tests' six
figures and drew coloured cells and maps as plain lines and points; mpld3 0.5 shows no formulas and
no legends, a map with its colours in the wrong places, and rules on logarithmic axes beside the
axes. Of plotly, kaleido makes pictures, with a Chrome that each user would have to install.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base import files
from ambkit.result.report import style
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.markup import plain
from ambkit.result.report.static_items import WIDTH, draw_item, legend_handle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import XAxis, YAxis
    from matplotlib.figure import Figure as Canvas

PIXELS_PER_INCH = 200
LIGHT = 110
"""Pixels per inch of a picture that stands in a notebook, and is kept with it."""

_LEFT, _RIGHT, _TOP, _BOTTOM = 0.7, 0.18, 0.1, 0.46
_LEGEND_ROW, _TITLE, _BAR = 0.165, 0.22, 0.76
_LETTER, _ROW, _HEADS, _HEAD = 0.068, 0.22, 0.27, 0.135
"""Width of a letter of the names beside cells, height of a row of cells, least height of the heads
above them, and height of a line of these."""
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
    "pdf.fonttype": 42,  # letters that can be searched
}


@dataclass(frozen=True)
class Picture:
    """A figure drawn."""

    png: bytes  #: Contents of the two files.
    svg: bytes

    def save(self, folder: Path, name: str) -> tuple[Path, Path]:
        """Write ``folder/<name>.png`` and ``folder/<name>.svg``."""
        files.make_folder(folder)
        png, svg = folder / f"{name}.png", folder / f"{name}.svg"
        files.write_bytes(png, self.png)
        files.write_bytes(svg, self.svg)
        return png, svg


def render(figure: Figure) -> Picture:
    """Draw a figure."""
    with drawn_as_on_paper(figure):
        canvas, _ = draw(figure)
        return Picture(_pixels(canvas), _vectors(canvas, plain(figure.title)))


def pdf(figure: Figure) -> bytes:
    """Draw a figure as PDF."""
    from matplotlib.backends.backend_pdf import FigureCanvasPdf

    content = BytesIO()
    with drawn_as_on_paper(figure):
        canvas, _ = draw(figure)
        canvas.set_dpi(PIXELS_PER_INCH / 2)  # of heat maps only
        vector: Any = FigureCanvasPdf(canvas)
        same = dict.fromkeys(("CreationDate", "Creator", "Producer"))  # the same bytes at any time
        vector.print_pdf(content, metadata=same | {"Title": plain(figure.title)})
    return content.getvalue()


def light(figure: Figure) -> bytes:
    """Draw a figure as a small PNG, for a notebook."""
    from PIL import Image  # which matplotlib writes its PNGs with

    with drawn_as_on_paper(figure):
        image = Image.open(BytesIO(_pixels(draw(figure, resolution=LIGHT)[0])))
    png = BytesIO()
    few = image.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    few.save(png, "PNG", optimize=True)
    return png.getvalue()


@contextmanager
def drawn_as_on_paper(figure: Figure) -> Iterator[None]:
    """Set matplotlib's fonts and lines for `draw`, whatever the user's matplotlibrc says."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({**_RC, "svg.hashsalt": figure.id})
        yield


def _pixels(canvas: "Canvas") -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    png = BytesIO()
    # Not `savefig`, which lays the figure out once more before it draws.
    agg: Any = FigureCanvasAgg(canvas)
    agg.print_png(png, metadata={"Software": None})
    return png.getvalue()


def _vectors(canvas: "Canvas", title: str) -> bytes:
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    svg = StringIO()
    canvas.set_dpi(PIXELS_PER_INCH / 2)  # of heat maps only, the rest has no pixels
    vector: Any = FigureCanvasSVG(canvas)
    vector.print_svg(svg, metadata={"Date": None, "Creator": None, "Title": title})
    return _shorten(svg.getvalue()).encode()


def save(figure: Figure, folder: Path) -> tuple[Path, Path]:
    """Draw a figure into ``folder/<id>.png`` and ``folder/<id>.svg``; see `Picture.save`."""
    return render(figure).save(folder, figure.id)


def draw(
    figure: Figure,
    make: "Callable[..., Canvas] | None" = None,
    resolution: float = PIXELS_PER_INCH,
) -> "tuple[Canvas, list[Axes]]":
    """Build the matplotlib figure; `drawn_as_on_paper` sets the fonts."""
    from matplotlib.figure import Figure as Canvas

    entries = list(figure.legend())
    columns = _legend_columns([text for text, _ in entries])
    legend_height = _LEGEND_ROW * -(-len(entries) // columns)
    height, boxes = _layout(figure, _TOP + legend_height)
    make = make or Canvas
    canvas = make(figsize=(WIDTH, height), dpi=resolution, facecolor=style.PAPER)
    below: dict[int, Axes] = {}
    for index in reversed(range(len(figure.panels))):
        shared = below.get(index + figure.columns) if figure.shares_x(index) else None
        axes = canvas.add_axes(boxes[index], sharex=shared)
        below[index] = axes
        _draw_panel(axes, figure.panels[index], labelled=shared is None)
        _place_labels(axes)
    if entries:
        canvas.legend(
            handles=[legend_handle(item, text) for text, item in entries],
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
    return canvas, [below[index] for index in range(len(figure.panels))]


def draw_into(axes: "Axes", panel: Panel) -> None:
    """Draw a panel into somebody's own axes, in the fonts that they have."""
    entries = list(Figure("panel", "", "", [panel]).legend())
    _draw_panel(axes, panel, labelled=True, own_layout=False)
    if entries:
        axes.legend(handles=[legend_handle(item, text) for text, item in entries])


def _layout(figure: Figure, top: float) -> tuple[float, list[tuple[float, float, float, float]]]:
    """Height of the figure [inch], and where each panel stands, in parts of the figure."""
    cells = [panel.cells for panel in figure.panels]
    usual = {1: 2.75, 2: 1.85}.get(figure.rows, 1.5)
    rows = max((_ROW * len(item.rows) for item in cells if item), default=usual)
    panel_height = figure.panel_height or rows
    cell = WIDTH / figure.columns
    places = []
    depth = top
    for start in range(0, len(figure.panels), figure.columns):
        row = range(start, min(start + figure.columns, len(figure.panels)))
        depth += _TITLE * any(figure.panels[index].title for index in row)
        heads = [name.count("\n") + 1 for n in row if (parts := cells[n]) for name in parts.columns]
        depth += max(_HEADS, _HEAD * max(heads)) if heads else 0.0
        for index in row:
            bar = _BAR if figure.panels[index].heatmap else 0.0
            table = cells[index]
            longest = max((len(name) for name in table.rows), default=0) if table else 0
            names = max(0.0, _LETTER * longest - _LEFT + 0.15)
            left = cell * (index - start) + _LEFT + names
            places.append((left, depth, cell - _LEFT - names - _RIGHT - bar))
        depth += panel_height
        joined = all(figure.shares_x(index) or figure.panels[index].cells for index in row)
        below = any(item and figure.panels[n].x.title for n, item in enumerate(cells) if n in row)
        depth += (_ROW + 0.1 if below else 0.12) if joined else _BOTTOM
    return depth, [
        (left / WIDTH, 1 - (down + panel_height) / depth, width / WIDTH, panel_height / depth)
        for left, down, width in places
    ]


def _legend_columns(texts: list[str]) -> int:
    """How many entries fit beside each other, at 0.06 inch a letter."""
    longest = max((len(text) for text in texts), default=1)
    return max(1, min(len(texts), int((WIDTH - _LEFT) / (0.06 * longest + 0.5))))


def _draw_panel(axes: "Axes", panel: Panel, labelled: bool, own_layout: bool = True) -> None:
    axes.set_xscale(panel.x.scale)
    axes.set_yscale(panel.y.scale)
    # Before the items: Matplotlib fails now and then to find limits of its own about one point.
    for axis, set_limits in ((panel.x, axes.set_xlim), (panel.y, axes.set_ylim)):
        if axis.limits:
            set_limits(axis.limits[0] * axis.factor, axis.limits[1] * axis.factor)
    for item in panel.items:
        draw_item(axes, panel, item, own_layout)
    if "log" in (panel.x.scale, panel.y.scale):
        axes.grid(which="minor", linewidth=0.3)
    if panel.categories:
        axes.set_xticks(range(len(panel.categories)), panel.categories)
        axes.tick_params(axis="x", length=0)
        axes.grid(visible=False, axis="x")
    if panel.x.scale == "linear" and not panel.categories and max(map(abs, axes.get_xlim())) >= 1e4:
        axes.locator_params(axis="x", nbins=4)  # long numbers would touch each other
    for scale, mpl_axis in ((panel.x.scale, axes.xaxis), (panel.y.scale, axes.yaxis)):
        if scale == "log":
            _plain_numbers(mpl_axis)
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(panel.title)
    axes.set_ylabel(panel.y.title)
    if labelled:
        axes.set_xlabel(panel.x.title)
    else:
        axes.tick_params(axis="x", which="both", labelbottom=False)


def _place_labels(axes: "Axes") -> None:
    """Put the labels of all panels' y axes below each other."""
    width = axes.get_position().width * WIDTH
    axes.yaxis.set_label_coords((0.2 - _LEFT) / width, 0.5)


def _plain_numbers(axis: "XAxis | YAxis") -> None:
    """Write 30, 60, 100 on a logarithmic axis, and not powers, where the numbers are short."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    low, high = sorted(axis.get_view_interval())
    if not 1e-4 < low < high < 1e5:
        return
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))
    # Over few decades the powers of ten alone are too few to read a value.
    digits = "36" if high < 100 * low else ""

    def between(value: float, _: object) -> str:
        return f"{value:.4g}" if f"{value:.0e}"[0] in digits else ""

    axis.set_minor_formatter(FuncFormatter(between) if digits else NullFormatter())


def _shorten(svg: str) -> str:
    """Cut coordinates after a hundredth of a point, which nobody can see; it halves the file."""
    return re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), svg)
