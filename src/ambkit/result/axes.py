"""A figure drawn for somebody who goes on with it: by plotly, or into axes of matplotlib."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.interactive import describe
from ambkit.result.report.markup import plain
from ambkit.result.report.static import draw, draw_into, drawn_as_on_paper


def plot(figure: Figure, *, ax: Any = None, panel: int | str = 0, static: bool = False) -> Any:
    """Draw a figure, see :meth:`ambkit.result.showing.Drawn.plot`."""
    if ax is not None:
        return _into(figure, ax, panel)
    widget = None if static else _interactive(figure)
    return _with_pyplot(figure) if widget is None else widget


def _interactive(figure: Figure) -> Any:
    """Return the figure of plotly; None where that is not installed."""
    try:
        from plotly.graph_objects import Figure as Interactive
    except ImportError:
        return None
    return Interactive(describe(figure))


def _with_pyplot(figure: Figure) -> Any:
    """Draw a figure of pyplot, which notebooks show by themselves, and return its axes."""
    from matplotlib import pyplot, rcParams

    resolution = rcParams["figure.dpi"]  # as the user has it, not as on paper
    with drawn_as_on_paper(figure):
        axes = draw(figure, pyplot.figure, resolution)[1]
    return np.array(axes, dtype=object)


def _into(figure: Figure, ax: Any, panel: int | str) -> Any:
    several = list(ax.flat) if isinstance(ax, np.ndarray) else ax
    if not isinstance(several, list | tuple):
        draw_into(_checked(ax), _panel(figure, panel))
        return ax
    if len(several) > len(figure.panels):
        raise AmbkitError(f"ax has {len(several)} axes, and there are {_names(figure)} to draw")
    for one, of in zip(several, figure.panels, strict=False):
        draw_into(_checked(one), of)
    return ax


def _checked(ax: Any) -> Any:
    from matplotlib.axes import Axes

    if not isinstance(ax, Axes):
        raise AmbkitError(f"ax must be axes of matplotlib, is of type {type(ax).__name__}")
    return ax


def _panel(figure: Figure, key: int | str) -> Panel:
    results = [
        panel
        for place, panel in enumerate(figure.panels)
        if (
            key.lower() in _name(panel).lower()
            if isinstance(key, str)
            else key in (place, place - len(figure.panels))
        )
    ]
    if not results:
        raise AmbkitError(f"there is no panel {key!r}; there are {_names(figure)}")
    return results[0]


def _names(figure: Figure) -> str:
    return ", ".join(f'{n} "{_name(panel)}"' for n, panel in enumerate(figure.panels))


def _name(panel: Panel) -> str:
    return plain(", ".join(filter(None, (panel.title, panel.y.label))) or panel.x.label)
