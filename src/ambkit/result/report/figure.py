"""A figure, declared once and drawn with matplotlib; `screen` describes it for plotly.js."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.result.report import style
from ambkit.result.report.item import Item, Panel
from ambkit.result.report.items import Bars
from ambkit.result.report.markup import plain
from ambkit.result.report.surfaces import Cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

WIDTH = 7.2  #: Width of every figure [inch]: the text width of an A4 page.
PIXELS_PER_INCH = 200
ENDINGS = (".png", ".svg", ".pdf", ".html")  #: File types.

_RC: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"],  # included in matplotlib, so the result is the same everywhere
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
    "figure.constrained_layout.h_pad": 0.05,
    "figure.constrained_layout.w_pad": 0.06,
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
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "legend.handletextpad": 0.6,
    "legend.columnspacing": 1.6,
    "legend.labelspacing": 0.35,
    "legend.borderpad": 0.3,
    "legend.borderaxespad": 0.2,
    "hatch.linewidth": 0.6,
    "svg.fonttype": "path",
    "pdf.fonttype": 42,  # searchable text
}


@dataclass(frozen=True)
class Figure:
    """Panels shown together."""

    page: ClassVar[Callable[[Figure], str]]
    """Writes a page with one figure; set by the module `page`."""

    id: str  #: Name of its files and anchor: ``"fig15"``. Letters, digits, ``-`` and ``_``.
    title: str  #: Short title.
    caption: str  #: What the figure shows (Markdown with formulas).
    panels: Sequence[Panel]  #: Row by row.
    source: str = ""  #: Origin: ``"paper, Fig. 15"``.
    columns: int = 1  #: Number of panels per row.
    #: Height of one panel on paper [inch]; 0 chooses by the number of rows.
    panel_height: float = 0.0
    #: Alternative text; from title, axes and legend if empty.
    alt: str = ""

    def __post_init__(self) -> None:
        if not self.id.replace("-", "").replace("_", "").isalnum():
            raise ValueError(f"figure id {self.id!r}: letters, digits, - and _ only")
        if not self.panels or self.columns < 1:
            raise ValueError(f"figure {self.id}: needs at least one panel and one column")
        for panel in self.panels:
            bars = {tuple(item.categories) for item in panel.items if isinstance(item, Bars)}
            if len(bars) > 1:
                raise ValueError(f"figure {self.id}: Bars of one panel differ in their categories")

    @property
    def rows(self) -> list[range]:
        """Panels of each row, by index."""
        starts = range(0, len(self.panels), self.columns)
        return [range(n, min(n + self.columns, len(self.panels))) for n in starts]

    def shares_x(self, index: int) -> bool:
        """Whether the panel below has the same x axis, which is then labelled once."""
        below = index + self.columns
        if below >= len(self.panels):
            return False
        upper, lower = self.panels[index], self.panels[below]
        return upper.x == lower.x and not (lower.title or upper.named_rows or lower.named_rows)

    def legend(self) -> Iterator[tuple[str, Item]]:
        """Legend texts, each with the first item that has it."""
        seen = {""}
        for item in (item for panel in self.panels for item in panel.items):
            if item.legend not in seen:
                seen.add(item.legend)
                yield item.legend, item

    def description(self) -> str:
        """Alternative text."""
        if self.alt:
            return self.alt
        if cells := next(filter(None, (panel.item(Cells) for panel in self.panels)), None):
            columns = ", ".join(name.split("\n")[0] for name in cells.columns)
            return plain(f"{self.title}: {', '.join(cells.rows)} by {columns}.")
        axes = "; ".join(dict.fromkeys(f"{p.y.title} over {p.x.title}" for p in self.panels))
        names = ", ".join(text for text, _ in self.legend())
        return plain(f"{self.title}: {axes}{f'. Shown: {names}' if names else ''}.")

    def draw(
        self, make: Callable[..., Canvas] | None = None, resolution: float = PIXELS_PER_INCH
    ) -> tuple[Canvas, list[Axes]]:
        """Draw it with matplotlib, in the style of `paper_style`."""
        from matplotlib.figure import Figure as Canvas
        from matplotlib.ticker import AutoLocator

        texts = [text for text, _ in self.legend()]
        longest = max(map(len, texts), default=1)
        columns = max(1, min(len(texts), int((WIDTH - 0.7) / (0.06 * longest + 0.5))))
        height = 0.15 + 0.165 * -(-len(texts) // columns) + self._height()
        canvas = (make or Canvas)(
            figsize=(WIDTH, height), dpi=resolution, facecolor=style.PAPER, layout="constrained"
        )
        grid = canvas.add_gridspec(len(self.rows), self.columns)
        by_index: dict[int, Axes] = {}
        for index, panel in reversed([*enumerate(self.panels)]):
            below = by_index.get(index + self.columns) if self.shares_x(index) else None
            ax = canvas.add_subplot(grid[divmod(index, self.columns)], sharex=below)
            panel.draw(ax)
            if self.columns > 1 and isinstance(ax.xaxis.get_major_locator(), AutoLocator):
                # Long numbers would overlap.
                ax.locator_params(axis="x", nbins=6 if self.columns == 2 else 4)
            if below:
                ax.set_xlabel("")
                ax.tick_params(axis="x", which="both", labelbottom=False)
            by_index[index] = ax
        axes = [by_index[index] for index in range(len(self.panels))]
        canvas.align_ylabels()
        if texts:
            known = dict(entry for ax in axes[::-1] for entry in zip(*_entries(ax), strict=True))
            legend = canvas.legend(
                [known[f" {text}" if text.startswith("_") else text] for text in texts], texts,
                loc="outside upper left", ncols=columns,
            )  # fmt: skip
            for line in legend.get_lines():  # thin lines hide their colour
                line.set_linewidth(max(1.2, line.get_linewidth()))
        return canvas, axes

    def _height(self) -> float:
        """Height of all panels with what is written around them [inch]."""
        cells = [cells for panel in self.panels if (cells := panel.item(Cells))]
        usual = {1: 2.75, 2: 1.85}.get(len(self.rows), 1.5)
        of_cells = max((0.22 * len(item.rows) for item in cells), default=usual)
        heads = [name.count("\n") + 1 for item in cells for name in item.columns]
        height = len(self.rows) * ((self.panel_height or of_cells) + 0.135 * max(heads, default=0))
        for row in self.rows:
            labelled = any(self.panels[n].x.title and not self.shares_x(n) for n in row)
            height += 0.46 if labelled else 0.12
            height += 0.22 * any(self.panels[index].title for index in row)
        return height

    def image(self, ending: str, resolution: float = PIXELS_PER_INCH) -> bytes:
        """Render it as ``.png``, ``.svg`` or ``.pdf``: the same bytes for the same figure."""
        with paper_style(self):
            return printed(self.draw(resolution=resolution)[0], ending, plain(self.title))

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write it to a file: ``.png``, ``.svg``, ``.pdf`` or, zoomable, ``.html``."""
        path = Path(path)
        ending = path.suffix.lower()
        if ending not in ENDINGS:
            raise AmbkitError(f"{path}: cannot draw {ending or 'that'}, use {', '.join(ENDINGS)}")
        if ending == ".html":
            files.write_text(path, Figure.page(self))
        else:
            files.write_bytes(path, self.image(ending))
        return path

    def plot(self, *, ax: Any = None, panel: int | str = 0) -> Any:
        """Draw it with matplotlib, see :meth:`ambkit.result.showing.Plotted.plot`."""
        if ax is not None:
            several = list(ax.flat) if isinstance(ax, np.ndarray) else ax
            if not isinstance(several, list | tuple):
                several, panels = [ax], [self._panel(panel)]
            elif len(several) > len(self.panels):
                names = self._names()
                raise AmbkitError(f"ax has {len(several)} axes, and there are {names} to draw")
            else:
                panels = list(self.panels)
            for one, of in zip(several, panels, strict=False):
                _draw_into(one, of)
            return ax
        from matplotlib import pyplot, rcParams

        resolution = rcParams["figure.dpi"]  # the user's setting, not that of paper
        # Loads the backend, which makes a notebook interactive.
        pyplot.draw_if_interactive()  # type: ignore[no-untyped-call]
        with paper_style(self):  # notebooks show pyplot's figures by themselves
            return np.array(self.draw(pyplot.figure, resolution)[1], dtype=object)

    def _panel(self, key: int | str) -> Panel:
        for place, panel in enumerate(self.panels):
            if isinstance(key, str):
                named = key.lower() in panel.name.lower()
            else:
                named = key in (place, place - len(self.panels))
            if named:
                return panel
        raise AmbkitError(f"there is no panel {key!r}; there are {self._names()}")

    def _names(self) -> str:
        return ", ".join(f'{n} "{panel.name}"' for n, panel in enumerate(self.panels))


@contextmanager
def paper_style(figure: Figure) -> Iterator[None]:
    """Set matplotlib's fonts and lines, independent of the user's matplotlibrc."""
    import matplotlib

    interactive = matplotlib.is_interactive()
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({**_RC, "svg.hashsalt": figure.id})
        matplotlib.interactive(interactive)
        yield


def printed(canvas: Canvas, ending: str, title: str) -> bytes:
    """Return a drawn figure as a file, without software name and date."""
    backend = {".png": "agg", ".svg": "svg", ".pdf": "pdf"}[ending]
    metadata: dict[str, dict[str, str | None]] = {
        ".png": {"Software": None},
        ".svg": {"Date": None, "Creator": None, "Title": title},
        ".pdf": {"CreationDate": None, "Creator": None, "Producer": None, "Title": title},
    }
    content = BytesIO()
    if ending != ".png":
        canvas.set_dpi(PIXELS_PER_INCH / 2)  # heat maps only, the rest is vectors
    # Not `savefig`, which computes the layout again.
    backend_canvas = import_module(f"matplotlib.backends.backend_{backend}").FigureCanvas(canvas)
    getattr(backend_canvas, f"print_{ending[1:]}")(content, metadata=metadata[ending])
    if ending == ".svg":
        # Rounded to invisible hundredths of a point, which halves the file.
        short = re.compile(rb"(\.\d\d)\d+")
        return re.sub(rb' d="[^"]*"', lambda path: short.sub(rb"\1", path[0]), content.getvalue())
    return content.getvalue()


def _draw_into(ax: Any, panel: Panel) -> None:
    """Draw a panel into given axes, in their fonts."""
    from matplotlib.axes import Axes

    if not isinstance(ax, Axes):
        raise AmbkitError(f"ax must be axes of matplotlib, is of type {type(ax).__name__}")
    panel.draw(ax)
    texts, handles = _entries(ax)
    if texts:
        ax.legend(handles, texts)


def _entries(ax: Axes) -> tuple[list[str], list[Any]]:
    """Return the unique texts of a legend, with their artists."""
    handles, texts = ax.get_legend_handles_labels()
    entries = dict(zip(reversed(texts), reversed(handles), strict=True))
    return list(entries)[::-1], list(entries.values())[::-1]
