"""A figure on the screen: the description plotly.js draws, as plain data.

plotly's Python objects are not used: they check each property, at a tenth of a second a figure.
The tests let them check what is written here.
"""

import base64
import gzip
import json
import math
from pathlib import Path
from typing import Literal

from ambkit.result.report import style
from ambkit.result.report.delta_coding import shorten
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.formula import label_html
from ambkit.result.report.interactive_items import (
    Json,
    annotation,
    decorations_of,
    hover_format,
    shown_place,
    traces_of,
)
from ambkit.result.report.items import Axis, Cells, Heatmap, Item, Note, Vector

SANS = "-apple-system, 'Segoe UI', Roboto, 'Noto Sans', Ubuntu, 'Liberation Sans', sans-serif"

_PLOTLY = Path(__file__).parent / "plotly"
_TOP, _BOTTOM, _GAP, _TITLE = 56, 52, 16, 26


def describe(figure: Figure) -> Json:
    """Say in plotly's words what the figure shows."""
    total, domains = _domains(figure)
    layout: Json = {
        "height": total,
        "margin": {"l": 64, "r": 16, "t": _TOP, "b": _BOTTOM},
        "font": {"family": SANS, "size": 13, "color": style.INK},
        "paper_bgcolor": style.PAPER,
        "plot_bgcolor": style.PAPER,
        "hovermode": "closest" if any(p.heatmap or p.cells for p in figure.panels) else "x unified",
        "hoversubplots": "axis",
        "barmode": "group",
        "bargap": 0.2,
        "bargroupgap": 0.08,
        "legend": {
            "orientation": "h",
            "x": 0,
            "y": 1 + (_TITLE if figure.panels[0].title else 6) / (total - _TOP - _BOTTOM),
            "yanchor": "bottom",
            "traceorder": "normal",
        },
        "shapes": [],
        "annotations": [],
    }
    data: list[Json] = []
    named: set[str] = set()
    for index, panel in enumerate(figure.panels):
        x, y = _axis_names(figure, index)
        _add_axes(layout, figure, index, domains[index])
        if panel.title:
            corner = {"xref": f"{x} domain", "x": 0, "yref": f"{y} domain", "y": 1}
            layout["annotations"].append(annotation(panel.title, corner, yanchor="bottom", size=13))
        for item in panel.items:
            traces = [{**trace, "xaxis": x, "yaxis": y} for trace in traces_of(panel, item)]
            if isinstance(item, Heatmap):
                traces[0]["colorbar"] |= _beside(domains[index])
            shapes, texts = decorations_of(panel, item, x, y)
            _into_legend(traces + shapes, item, named)
            data += traces
            layout["shapes"] += shapes
            layout["annotations"] += texts
    return {"data": data, "layout": layout}


def to_json(figure: Figure) -> str:
    """`describe` as JSON that may stand inside an HTML page."""
    described = describe(figure)
    shorten(described)
    written = json.dumps(described, separators=(",", ":"), ensure_ascii=False)
    return written.replace("<", "\\u003c")


def height(figure: Figure) -> int:
    """Height the figure takes on the screen."""
    return _domains(figure)[0]


def plotly_js() -> str:
    """plotly.js itself, to be embedded once a page."""
    return gzipped((_PLOTLY / "plotly-cartesian.min.js").read_bytes())


def gzipped(content: bytes) -> str:
    """Pack bytes for the page's script to unpack, the same ones at any time."""
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


def _domains(figure: Figure) -> tuple[int, list[Json]]:
    """Height of the figure [px], and which part of the drawing area each panel takes."""
    rows = [len(panel.cells.rows) for panel in figure.panels if panel.cells]
    panel_height = max((28 * n + 30 for n in rows), default={1: 340, 2: 230}.get(figure.rows, 190))
    gutter = 0.1 if figure.columns > 1 else 0.0
    cell = (1 + gutter) / figure.columns
    places = []
    depth = 0
    for start in range(0, len(figure.panels), figure.columns):
        row = range(start, min(start + figure.columns, len(figure.panels)))
        if start:
            joined = all(figure.shares_x(index - figure.columns) for index in row)
            depth += _GAP if joined else _BOTTOM + 8
            depth += _TITLE * any(figure.panels[index].title for index in row)
        for index in row:
            left = cell * (index - start)
            bar = 0.1 if figure.panels[index].heatmap else 0.0
            places.append((left, left + cell - gutter - bar, depth))
        depth += panel_height
    return depth + _TOP + _BOTTOM, [
        {"x": [left, right], "y": [1 - (down + panel_height) / depth, 1 - down / depth]}
        for left, right, down in places
    ]


def _axis_names(figure: Figure, index: int) -> tuple[str, str]:
    """Names of a panel's axes for plotly; panels above each other share the lowest one's x."""
    lowest = index
    while figure.shares_x(lowest):
        lowest += figure.columns
    number = ["", *map(str, range(2, len(figure.panels) + 1))]
    return f"x{number[lowest]}", f"y{number[index]}"


def _add_axes(layout: Json, figure: Figure, index: int, domain: Json) -> None:
    panel = figure.panels[index]
    surface = panel.heatmap
    columns, rows = (surface.x, surface.y) if surface else (None, None)
    x, y = _axis_names(figure, index)
    layout[f"yaxis{y[1:]}"] = (
        _axis(panel.y, rows)
        | _log_ticks(panel, "y")
        | {
            "domain": domain["y"],
            "anchor": x,
        }
    )
    if panel.equal:
        layout[f"yaxis{y[1:]}"] |= {"scaleanchor": x}
    if panel.intervals:
        rows_down = {
            "type": "category",
            "showgrid": False,
            "range": [panel.intervals.values.size - 0.5, -0.62],
        }
        layout[f"yaxis{y[1:]}"] |= rows_down
    if not figure.shares_x(index):
        layout[f"xaxis{x[1:]}"] = (
            _axis(panel.x, columns)
            | _log_ticks(panel, "x")
            | {
                "domain": domain["x"],
                "anchor": y,
                "unifiedhovertitle": {"text": f"<b>{hover_format('x', panel.x)}</b>"},
            }
        )
        if panel.categories:
            layout[f"xaxis{x[1:]}"]["unifiedhovertitle"] = {"text": "<b>%{x}</b>"}
            layout[f"xaxis{x[1:]}"] |= {"type": "category", "showgrid": False}
        if panel.cells:
            bare = {"type": "category", "showgrid": False, "showline": False, "mirror": False}
            layout[f"xaxis{x[1:]}"] |= bare | {"side": "top"}
            layout[f"yaxis{y[1:]}"] |= bare | {"autorange": "reversed"}


def _axis(axis: Axis, area: Vector | None) -> Json:
    """Look of an axis; a heat map's `area` is shown whole, without a margin for its markers."""
    look: Json = {
        "title": {"text": label_html(axis.title), "standoff": 8, "font": {"size": 13}},
        "type": axis.scale,
        "showline": True,
        "mirror": "all",
        "linecolor": style.FRAME,
        "linewidth": 1,
        "gridcolor": style.GRID,
        "zeroline": False,
        "ticks": "",
        "ticklabelstandoff": 4,
        "automargin": True,
        "exponentformat": "power",
    }
    limits = axis.limits or (None if area is None else (float(area.min()), float(area.max())))
    if limits:
        look["range"] = [shown_place(axis, limit) for limit in limits]
    return look


def _log_ticks(panel: Panel, name: Literal["x", "y"]) -> Json:
    """Say where labels stand on a logarithmic axis: whole numbers, never plotly's lone digits."""
    # Between powers of ten plotly writes "2" where 2×10⁻⁴ is meant, and beside 10⁻⁴ it reads as an
    # exponent. With a format of its own each label is the whole number.
    axis = panel.x if name == "x" else panel.y
    if axis.scale != "log":
        return {}
    ends = axis.limits or panel.extent(name)
    if ends is None:
        return {}
    low, high = (axis.factor * end for end in ends)
    decades = math.log10(high / low)
    if decades > 2.2:
        ticks = {"dtick": math.ceil(decades / 6)}
        return ticks if low < 1e-4 or high > 1e5 else ticks | {"tickformat": "~g"}
    # At 1, 2 and 5; below one decade plotly finds round numbers itself.
    return {"tickformat": "~g"} | ({"dtick": "D2"} if decades > 0.85 else {})


def _beside(domain: Json) -> Json:
    """Place of a colour bar right of its panel."""
    (_, right), (bottom, top) = domain["x"], domain["y"]
    return {"x": right + 0.01, "y": (bottom + top) / 2, "len": top - bottom, "ypad": 0, "xpad": 4}


def _into_legend(traces: list[Json], item: Item, named: set[str]) -> None:
    """Name what was drawn; each name stands in the legend once and switches all of its group."""
    legend = "" if isinstance(item, Heatmap | Cells | Note) else item.legend
    for part in traces:
        part["name"] = label_html(legend)
        part["legendgroup"] = legend
        part.setdefault("showlegend", bool(legend) and legend not in named)
        if part["showlegend"]:
            named.add(legend)
