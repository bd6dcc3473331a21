"""A figure for the screen: its description for plotly.js, as plain data.

plotly's Python package is not used at run time, because it validates each property, a tenth of a
second per figure. The tests validate the output with it.
"""

import json
import math
from collections.abc import Sequence

from ambkit.result.report import style
from ambkit.result.report.figure import Figure
from ambkit.result.report.item import Axis, Json, annotation
from ambkit.result.report.markup import label_html
from ambkit.result.report.surfaces import Cells

SANS = "-apple-system, 'Segoe UI', Roboto, 'Noto Sans', Ubuntu, 'Liberation Sans', sans-serif"
_TOP, _BOTTOM, _GAP, _TITLE = 56, 52, 16, 26


def described(figure: Figure) -> Json:
    """Return data and layout for plotly.js."""
    total, domains = _domains(figure)
    layout: Json = {
        "height": total,
        "margin": {"l": 64, "r": 16, "t": _TOP, "b": _BOTTOM},
        "font": {"family": SANS, "size": 13, "color": style.INK},
        "paper_bgcolor": style.PAPER,
        "plot_bgcolor": style.PAPER,
        "hovermode": "closest" if any(p.surface for p in figure.panels) else "x unified",
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
    }
    data, shapes, texts, named = list[Json](), list[Json](), list[Json](), {""}
    for index, (panel, domain) in enumerate(zip(figure.panels, domains, strict=True)):
        x, y = _axis_names(figure, index)
        parts = [(item, part) for item in panel.items for part in item.plotly(panel, x, y)]
        for item, part in parts:
            if "showarrow" in part:
                texts.append(part)
                continue
            part |= {"name": label_html(item.legend), "legendgroup": item.legend}
            if part.setdefault("showlegend", item.legend not in named):
                named.add(item.legend)
            if "xref" in part:
                shapes.append(part)
                continue
            data.append(part | {"xaxis": x, "yaxis": y})
            if "colorbar" in part:
                (_, right), (low, high) = domain["x"], domain["y"]
                beside = {"x": right + 0.01, "y": (low + high) / 2, "len": high - low}
                part["colorbar"] |= beside
        if panel.title:
            corner = {"xref": f"{x} domain", "x": 0, "yref": f"{y} domain", "y": 1}
            texts.append(annotation(panel.title, corner, "left", "bottom", font={"size": 13}))
        traces = [part for _, part in parts if "showarrow" not in part]
        layouts = [item.axis_layout(panel) for item in panel.items]
        up = {"domain": domain["y"], "anchor": x} | ({"scaleanchor": x} if panel.equal else {})
        layout[f"yaxis{y[1:]}"] = _axis(panel.y, "y", traces, [up, *(up for _, up in layouts)])
        if not figure.shares_x(index):
            title = {"text": f"<b>{panel.x.hover_format('x')}</b>"}
            along = {"domain": domain["x"], "anchor": y, "unifiedhovertitle": title}
            layout[f"xaxis{x[1:]}"] = _axis(
                panel.x, "x", traces, [along, *(along for along, _ in layouts)]
            )
    return {"data": data, "layout": layout | {"shapes": shapes, "annotations": texts}}


def to_json(described: Json) -> str:
    """Write it as JSON that is safe inside an HTML page."""
    written = json.dumps(described, separators=(",", ":"), ensure_ascii=False)
    return written.replace("<", "\\u003c")


def _axis_names(figure: Figure, index: int) -> tuple[str, str]:
    """Names of a panel's axes for plotly; panels in a column share the x axis of the lowest."""
    lowest = index
    while figure.shares_x(lowest):
        lowest += figure.columns
    number = ["", *map(str, range(2, len(figure.panels) + 1))]
    return f"x{number[lowest]}", f"y{number[index]}"


def _domains(figure: Figure) -> tuple[int, list[Json]]:
    """Height on the screen [px], and the share of the drawing area of each panel."""
    cells = [len(item.rows) for panel in figure.panels if (item := panel.item(Cells))]
    usual = {1: 340, 2: 230}.get(len(figure.rows), 190)
    height = max((28 * n + 30 for n in cells), default=usual)
    gutter = 0.1 if figure.columns > 1 else 0.0
    wide, places, depth = (1 + gutter) / figure.columns, list[tuple[float, float, int]](), 0
    for row in figure.rows:
        if row.start:
            joined = all(figure.shares_x(index - figure.columns) for index in row)
            depth += _GAP if joined else _BOTTOM + 8
            depth += _TITLE * any(figure.panels[index].title for index in row)
        for index in row:
            left = wide * (index - row.start)
            bar = 0.1 if figure.panels[index].surface and not cells else 0.0
            places.append((left, left + wide - gutter - bar, depth))
        depth += height
    return depth + _TOP + _BOTTOM, [
        {"x": [left, right], "y": [1 - (down + height) / depth, 1 - down / depth]}
        for left, right, down in places
    ]


def _axis(axis: Axis, name: str, traces: Sequence[Json], more: Sequence[Json]) -> Json:
    """Look of an axis for plotly."""
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
    if axis.scale == "log":
        look |= _log_ticks(axis, name, traces)
    for part in more:
        look |= part
    if axis.limits:
        look["range"] = [axis.position(limit) for limit in axis.limits]
    return look


def _log_ticks(axis: Axis, name: str, traces: Sequence[Json]) -> Json:
    """Say where labels stand on a logarithmic axis: whole numbers, never plotly's lone digits."""
    # Between powers of ten plotly writes "2" where 2×10⁻⁴ is meant, and beside 10⁻⁴ it reads as an
    # exponent. With a format of its own each label is the whole number.
    ends = [axis.shown(end) for end in axis.limits or ()] or [
        value
        for part in traces
        for value in part.get(name, [part.get(f"{name}0")])
        if value and value > 0 and part.get(f"{name}ref", "axis").find("domain") < 0
    ]
    if not ends:
        return {}
    low, high = min(ends), max(ends)
    decades = math.log10(high / low)
    if decades > 2.2:
        ticks = {"dtick": math.ceil(decades / 6)}
        return ticks if low < 1e-4 or high > 1e5 else ticks | {"tickformat": "~g"}
    # At 1, 2 and 5; below one decade plotly finds round numbers itself.
    return {"tickformat": "~g"} | ({"dtick": "D2"} if decades > 0.85 else {})
