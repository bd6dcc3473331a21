"""What a figure shows, said once; `static` and `interactive` both draw from this description."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ambkit.result.report.items import (
    Axis,
    Band,
    Bars,
    Cells,
    Heatmap,
    Intervals,
    Item,
    Line,
    Points,
    Rule,
    Signal,
    Vector,
)
from ambkit.result.report.markup import plain


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    x: Axis  #: The axes.
    y: Axis
    items: Sequence[Item]  #: What is drawn.
    title: str = ""  #: A short heading above the axes.
    equal: bool = False  #: Whether a length is as long along both axes: an orbit's circle is round.

    @property
    def categories(self) -> Sequence[str]:
        """Names below the bars; empty where there are none."""
        return next((item.categories for item in self.items if isinstance(item, Bars)), ())

    @property
    def intervals(self) -> Intervals | None:
        """The panel's rows of intervals, if it has some."""
        return next((item for item in self.items if isinstance(item, Intervals)), None)

    @property
    def heatmap(self) -> Heatmap | None:
        """The panel's heat map, if it has one."""
        return next((item for item in self.items if isinstance(item, Heatmap)), None)

    @property
    def cells(self) -> Cells | None:
        """The panel's table of cells, if it has one."""
        return next((item for item in self.items if isinstance(item, Cells)), None)

    def extent(self, axis: Literal["x", "y"]) -> tuple[float, float] | None:
        """Least and greatest positive value along an axis, in SI: what a logarithmic one shows."""
        parts = [part for item in self.items for part in _along(item, axis)]
        values = np.concatenate([np.zeros(0), *parts])
        values = values[np.isfinite(values) & (values > 0)]
        return (float(values.min()), float(values.max())) if values.size else None


def _along(item: Item, axis: Literal["x", "y"]) -> Sequence[Vector]:
    """Return what an item shows along an axis."""
    match item:
        case Line() | Points() | Heatmap():
            return [item.x if axis == "x" else item.y]
        case Band():
            return [item.x] if axis == "x" else [item.low, item.high]
        case Intervals() if axis == "x":
            return [item.low, item.high]
        case Bars() if axis == "y":
            return [item.values]
        case Rule() if item.axis == axis:
            return [np.array([item.value])]
    return []


@dataclass(frozen=True)
class Figure:
    """A figure of the report."""

    id: str  #: Name of its files and anchor: ``"fig15"``. Letters, digits, ``-`` and ``_``.
    title: str  #: What it shows, in a few words.
    caption: str  #: What to see in it (Markdown with formulas).
    panels: Sequence[Panel]  #: Row by row.
    source: str = ""  #: Where it is from: ``"paper, Fig. 15"``.
    columns: int = 1  #: Number of panels beside each other.
    #: Height of one panel on paper [inch]; 0 chooses by the number of rows.
    panel_height: float = 0.0
    #: What a reader who cannot see it is told; made of title, axes and legend if empty.
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
        """Whether the panel below has the same x axis, so that it need not be labelled twice."""
        below = index + self.columns
        if below >= len(self.panels):
            return False
        upper, lower = self.panels[index], self.panels[below]
        rows = upper.intervals or lower.intervals
        return upper.x == lower.x and not upper.categories and not lower.title and not rows

    def legend(self) -> Iterator[tuple[str, Item]]:
        """Each legend text once, with the first item that carries it."""
        seen = {""}
        for panel in self.panels:
            for item in panel.items:
                if isinstance(item, Signal) and item.legend not in seen:
                    seen.add(item.legend)
                    yield item.legend, item

    def description(self) -> str:
        """Text in place of the picture, for readers who cannot see it."""
        if self.alt:
            return self.alt
        axes = "; ".join(dict.fromkeys(f"{p.y.title} over {p.x.title}" for p in self.panels))
        names = ", ".join(text for text, _ in self.legend())
        cells = [panel.cells for panel in self.panels if panel.cells]
        if cells:
            columns = ", ".join(name.split("\n")[0] for name in cells[0].columns)
            return plain(f"{self.title}: {', '.join(cells[0].rows)} by {columns}.")
        return plain(f"{self.title}: {axes}{f'. Shown: {names}' if names else ''}.")
