"""A figure on the screen: the description plotly.js draws, as plain data.

plotly's Python objects are not used: they check each property, at a tenth of a second a figure.
The tests let them check what is written here.
"""

import base64
import json
from typing import Any

import numpy as np

from ambkit.report import style
from ambkit.report.decimate import decimate
from ambkit.report.figure import (
    Axis,
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
    Vector,
)
from ambkit.report.formula import label_html

BUCKETS = 1000
"""Stretches a long line is cut into: about one a pixel column."""

SANS = "-apple-system, 'Segoe UI', Roboto, 'Noto Sans', Ubuntu, 'Liberation Sans', sans-serif"

_TOP, _BOTTOM, _GAP, _TITLE = 56, 52, 16, 26
_MARKERS = {"circle": "circle", "square": "square", "diamond": "diamond"} | {
    "triangle": "triangle-up",
    "cross": "x-thin",
}
_PATTERNS = {style.DASH: "/", style.LONG: "/", style.DASH_DOT: "\\", style.DOT: "."}

Json = dict[str, Any]


def describe(figure: Figure) -> Json:
    """Say in plotly's words what the figure shows.

    Parameters
    ----------
    figure : Figure
        What to draw.

    Returns
    -------
    dict
        ``data`` and ``layout`` for ``Plotly.newPlot``; long arrays are written in base64.
    """
    total, domains = _domains(figure)
    layout: Json = {
        "height": total,
        "margin": {"l": 64, "r": 16, "t": _TOP, "b": _BOTTOM},
        "font": {"family": SANS, "size": 13, "color": style.INK},
        "paper_bgcolor": style.PAPER,
        "plot_bgcolor": style.PAPER,
        "hovermode": "closest" if any(p.heatmap for p in figure.panels) else "x unified",
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
            layout["annotations"].append(_text(panel.title, corner, yanchor="bottom", size=13))
        for item in panel.items:
            traces = [{**trace, "xaxis": x, "yaxis": y} for trace in _traces(panel, item)]
            if isinstance(item, Heatmap):
                traces[0]["colorbar"] |= _beside(domains[index])
            shapes, texts = _decorations(panel, item, x, y)
            _into_legend(traces + shapes, item, named)
            data += traces
            layout["shapes"] += shapes
            layout["annotations"] += texts
    return {"data": data, "layout": layout}


def to_json(figure: Figure) -> str:
    """`describe` as JSON that may stand inside an HTML page.

    Parameters
    ----------
    figure : Figure
        What to draw.

    Returns
    -------
    str
        JSON without ``<``, so that nothing in it can end the script element around it.
    """
    text = json.dumps(describe(figure), separators=(",", ":"), ensure_ascii=False)
    return text.replace("<", "\\u003c")


def height(figure: Figure) -> int:
    """Height the figure takes on the screen.

    Parameters
    ----------
    figure : Figure
        What to draw.

    Returns
    -------
    int
        Height [px].
    """
    return _domains(figure)[0]


def plotly_js() -> str:
    """plotly.js itself, to be embedded once a page.

    Returns
    -------
    str
        JavaScript.
    """
    from plotly.offline import get_plotlyjs

    return str(get_plotlyjs())


def _domains(figure: Figure) -> tuple[int, list[Json]]:
    """Height of the figure [px], and which part of the drawing area each panel takes."""
    panel_height = {1: 340, 2: 230}.get(figure.rows, 190)
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
    layout[f"yaxis{y[1:]}"] = _axis(panel.y, rows) | {
        "domain": domain["y"],
        "anchor": x,
    }
    if not figure.shares_x(index):
        layout[f"xaxis{x[1:]}"] = _axis(panel.x, columns) | {
            "domain": domain["x"],
            "anchor": y,
            "unifiedhovertitle": {"text": f"<b>{_hover('x', panel.x)}</b>"},
        }
        if panel.categories:
            layout[f"xaxis{x[1:]}"]["unifiedhovertitle"] = {"text": "<b>%{x}</b>"}
            layout[f"xaxis{x[1:]}"] |= {"type": "category", "showgrid": False}


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
        "exponentformat": "power",
    }
    if axis.scale == "log":
        look["dtick"] = "D2"  # labels at 1, 2 and 5
    limits = axis.limits or (None if area is None else (float(area.min()), float(area.max())))
    if limits:
        look["range"] = [_place(axis, limit) for limit in limits]
    return look


def _place(axis: Axis, value: float) -> float:
    """A value where plotly wants the exponent on logarithmic axes: ranges and annotations."""
    shown = value * axis.factor
    return float(np.log10(shown)) if axis.scale == "log" else shown


def _hover(coordinate: str, axis: Axis) -> str:
    return f"%{{{coordinate}:.5~g}} {axis.unit}".rstrip()


def _traces(panel: Panel, item: Item) -> list[Json]:
    """What plotly draws as data: everything but straight lines, areas and texts."""
    match item:
        case Line():
            x, y = decimate(panel.x.shown(item.x), panel.y.shown(item.y), BUCKETS)
            return [_curve(item.signal, x, y) | {"hovertemplate": _hover("y", panel.y)}]
        case Points():
            return [_points(panel, item)]
        case Band():
            fill = {"fill": "tonexty", "fillcolor": style.tint(_colour(item), 0.25)}
            bare = {"line": {"width": 0}, "hoverinfo": "skip", "zorder": 0}
            low, high = (
                _curve(item.signal, panel.x.shown(item.x), panel.y.shown(border)) | bare
                for border in (item.low, item.high)
            )
            return [low | {"showlegend": False}, high | fill]
        case Bars():
            return [_bars(panel, item)]
        case Heatmap():
            return [_surface(panel, item)]
    return []


def _curve(signal: str, x: Vector, y: Vector) -> Json:
    look = style.style_of(signal)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": _array(x),
        "y": _array(y),
        "line": _line(signal),
        "zorder": look.layer,
    }


def _line(signal: str) -> Json:
    look = style.style_of(signal)
    dash = ",".join(f"{1.3 * length:.3g}px" for length in look.dash)
    return {"color": look.colour, "width": 1.2 * look.width, "dash": dash or "solid"}


def _points(panel: Panel, item: Points) -> Json:
    look = style.style_of(item.signal)
    symbol = _MARKERS[look.marker]
    error = None if item.error is None else panel.y.shown(item.error)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": _array(panel.x.shown(item.x)),
        "y": _array(panel.y.shown(item.y)),
        "error_y": _error(error, look.colour),
        "marker": {
            "symbol": f"{symbol}-open" if look.hollow or symbol == "x-thin" else symbol,
            "color": look.colour,
            "size": 7,
            "line": {"width": 1.4, "color": look.colour},
        },
        "cliponaxis": panel.heatmap is None,
        "hovertemplate": _hover("y", panel.y),
        "zorder": look.layer,
    }


def _bars(panel: Panel, item: Bars) -> Json:
    look = style.style_of(item.signal)
    error = None if item.error is None else panel.y.shown(item.error)
    pattern = {"shape": _PATTERNS.get(look.dash, ""), "fgcolor": style.PAPER, "solidity": 0.15}
    return {
        "type": "bar",
        "x": list(item.categories),
        "y": _array(panel.y.shown(item.values)),
        "error_y": _error(error, style.INK),
        "marker": {"color": look.colour, "pattern": pattern | {"fillmode": "overlay", "size": 7}},
        "hovertemplate": _hover("y", panel.y),
    }


def _error(values: Vector | None, colour: str) -> Json:
    if values is None:
        return {"visible": False}
    bar = {"type": "data", "array": _array(values), "visible": True}
    return bar | {"color": colour, "thickness": 1.2, "width": 4}


def _surface(panel: Panel, item: Heatmap) -> Json:
    colours = style.DIVERGING if item.diverging else style.SEQUENTIAL
    low, high = item.shown_limits
    levels = item.levels
    hover = f"{_hover('x', panel.x)}, {_hover('y', panel.y)}: <b>{_hover('z', item.bar)}</b>"
    return {
        "type": "contour",
        "x": _array(panel.x.shown(item.x)),
        "y": _array(panel.y.shown(item.y)),
        "z": _array(item.bar.shown(item.z)),
        "colorscale": [[n / (len(colours) - 1), colour] for n, colour in enumerate(colours)],
        "zmin": low,
        "zmax": high,
        "autocontour": False,
        "contours": {
            "start": levels[0],
            "end": levels[-1],
            "size": levels[1] - levels[0],
            "coloring": "heatmap",
            "showlabels": True,
            "labelfont": {"size": 11, "color": style.INK},
        },
        "line": {"width": 0.8, "color": style.INK},
        "colorbar": {
            "title": {"text": label_html(item.bar.title), "side": "right", "font": {"size": 13}},
            "ticks": "",
            "thickness": 12,
            "outlinewidth": 0.6,
        },
        "hovertemplate": f"{hover}<extra></extra>",
    }


def _beside(domain: Json) -> Json:
    """Place of a colour bar right of its panel."""
    (_, right), (bottom, top) = domain["x"], domain["y"]
    return {"x": right + 0.01, "y": (bottom + top) / 2, "len": top - bottom, "ypad": 0, "xpad": 4}


def _decorations(panel: Panel, item: Item, x: str, y: str) -> tuple[list[Json], list[Json]]:
    """Shapes and texts that belong to an item."""
    whole_x, whole_y = f"{x} domain", f"{y} domain"
    match item:
        case Rule(axis="y"):
            value = item.value * panel.y.factor
            shape = {"type": "line", "xref": whole_x, "x0": 0, "x1": 1, "yref": y}
            ends = {"y0": value, "y1": value, "line": _line(item.signal), "layer": "above"}
            place = {"xref": whole_x, "x": 1, "yref": y, "y": _place(panel.y, item.value)}
            return [shape | ends], _texts(item.text, place, xanchor="right", yanchor="bottom")
        case Rule():
            value = item.value * panel.x.factor
            shape = {"type": "line", "xref": x, "x0": value, "x1": value, "yref": whole_y}
            ends = {"y0": 0, "y1": 1, "line": _line(item.signal), "layer": "above"}
            place = {"xref": x, "x": _place(panel.x, item.value), "yref": whole_y, "y": 1}
            return [shape | ends], _texts(item.text, place)
        case Span():
            start, stop = item.start * panel.x.factor, item.stop * panel.x.factor
            shape = {"type": "rect", "xref": x, "x0": start, "x1": stop, "yref": whole_y}
            look = {"fillcolor": style.tint(_colour(item), 0.12), "line": {"width": 0}}
            place = {"xref": x, "x": _place(panel.x, min(item.start, item.stop))}
            corner = {"yref": whole_y, "y": 1}
            extent = {"y0": 0, "y1": 1, "layer": "below"}
            return [shape | look | extent], _texts(item.text, place | corner)
        case Note():
            place = {"xref": x, "x": _place(panel.x, item.x)}
            anchor = "bottom" if item.side == "above" else "top"
            level = {"yref": y, "y": _place(panel.y, item.y)}
            return [], _texts(item.text, place | level, xanchor="center", yanchor=anchor)
    return [], []


def _texts(text: str, place: Json, xanchor: str = "left", yanchor: str = "top") -> list[Json]:
    return [_text(text, place, xanchor, yanchor)] if text else []


def _text(
    text: str, place: Json, xanchor: str = "left", yanchor: str = "top", size: int = 12
) -> Json:
    look = {"text": label_html(text), "showarrow": False, "font": {"size": size}}
    return look | place | {"xanchor": xanchor, "yanchor": yanchor}


def _into_legend(drawn: list[Json], item: Item, named: set[str]) -> None:
    """Name what was drawn; each name stands in the legend once and switches all of its group."""
    legend = "" if isinstance(item, Heatmap | Note) else item.legend
    for part in drawn:
        part["name"] = label_html(legend)
        part["legendgroup"] = legend
        part.setdefault("showlegend", bool(legend) and legend not in named)
        if part["showlegend"]:
            named.add(legend)


def _colour(item: Band | Span) -> str:
    return style.style_of(item.signal).colour


def _array(values: Vector) -> Json:
    """Numbers in base64: float32 where it is exact to a millionth of what is seen."""
    finite = values[np.isfinite(values)]
    exact = finite.size == 0 or 1e-7 * np.abs(finite).max() <= 1e-6 * np.ptp(finite)
    packed = values.astype("<f4" if exact else "<f8")
    spec = {"dtype": packed.dtype.str[1:], "bdata": base64.b64encode(packed.tobytes()).decode()}
    return spec if values.ndim == 1 else spec | {"shape": ",".join(map(str, values.shape))}
