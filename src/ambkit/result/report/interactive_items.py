"""How plotly.js is told to draw each item of a panel."""

import base64
from typing import Any

import numpy as np

from ambkit.result.report import style
from ambkit.result.report.decimate import decimate
from ambkit.result.report.figure import Panel
from ambkit.result.report.formula import label_html
from ambkit.result.report.items import (
    Axis,
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
    Vector,
)

BUCKETS = 1000
"""Stretches a long line is cut into: about one a pixel column."""

Json = dict[str, Any]

_MARKERS = {
    "circle": "circle",
    "square": "square",
    "diamond": "diamond",
    "triangle": "triangle-up",
    "triangle down": "triangle-down",
    "cross": "x-thin",
}
_PATTERNS = {style.DASH: "/", style.LONG: "/", style.DASH_DOT: "\\", style.DOT: "."}


def shown_place(axis: Axis, value: float) -> float:
    """Where a value stands on an axis, as plotly wants it for ranges and annotations."""
    scaled_value = value * axis.factor
    return float(np.log10(scaled_value)) if axis.scale == "log" else scaled_value


def hover_format(coordinate: str, axis: Axis) -> str:
    """Say how a coordinate is written when the mouse is over it."""
    return f"%{{{coordinate}:.5~g}} {axis.unit}".rstrip()


def traces_of(panel: Panel, item: Item) -> list[Json]:
    """What plotly draws as data: everything but rules, spans and notes."""
    match item:
        case Line():
            x, y = decimate(panel.x.shown(item.x), panel.y.shown(item.y), BUCKETS)
            return [_curve(item.signal, x, y) | {"hovertemplate": hover_format("y", panel.y)}]
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
        case Intervals():
            return [_intervals(panel, item)]
        case Heatmap():
            return [_surface(panel, item)]
        case Cells():
            return [_cells(item)]
    return []


def _curve(signal: str, x: Vector, y: Vector) -> Json:
    look = style.style_of(signal)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": packed(x),
        "y": packed(y),
        "line": _line(signal) | {"simplify": False},  # it shows as corners in smooth curves
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
        "x": packed(panel.x.shown(item.x)),
        "y": packed(panel.y.shown(item.y)),
        "error_y": _error(error, look.colour),
        "marker": {
            "symbol": f"{symbol}-open" if look.hollow or symbol == "x-thin" else symbol,
            "color": look.colour,
            "size": 1.75 * look.size,
            "line": {"width": 0.35 * look.size, "color": look.colour},
        },
        "cliponaxis": panel.heatmap is None,
        "hovertemplate": hover_format("y", panel.y),
        "zorder": look.layer,
    }


def _bars(panel: Panel, item: Bars) -> Json:
    look = style.style_of(item.signal)
    error = None if item.error is None else panel.y.shown(item.error)
    pattern = {"shape": _PATTERNS.get(look.dash, ""), "fgcolor": style.PAPER, "solidity": 0.15}
    return {
        "type": "bar",
        "x": [label_html(name) for name in item.categories],
        "y": packed(panel.y.shown(item.values)),
        "error_y": _error(error, style.INK),
        "marker": {"color": look.colour, "pattern": pattern | {"fillmode": "overlay", "size": 7}},
        "hovertemplate": hover_format("y", panel.y),
    }


def _intervals(panel: Panel, item: Intervals) -> Json:
    look = style.style_of(item.signal)
    values, low, high = (panel.x.shown(at) for at in (item.values, item.low, item.high))
    ends = {"arrayminus": packed(values - low), "symmetric": False}
    return {
        "type": "scatter",
        "mode": "markers",
        "x": packed(values),
        "y": [label_html(row) for row in item.rows],
        "error_x": _error(high - values, look.colour) | ends,
        "marker": {"symbol": _MARKERS[look.marker], "color": look.colour, "size": 7},
        "hovertemplate": hover_format("x", panel.x),
        "zorder": 8,
    }


def _error(values: Vector | None, colour: str) -> Json:
    if values is None:
        return {"visible": False}
    bar = {"type": "data", "array": packed(values), "visible": True}
    return bar | {"color": colour, "thickness": 1.2, "width": 4}


def _surface(panel: Panel, item: Heatmap) -> Json:
    colours = style.DIVERGING if item.diverging else style.SEQUENTIAL
    low, high = item.shown_limits
    levels = item.levels
    x, y, z = (hover_format(*pair) for pair in (("x", panel.x), ("y", panel.y), ("z", item.bar)))
    return {
        "type": "contour",
        "x": packed(panel.x.shown(item.x)),
        "y": packed(panel.y.shown(item.y)),
        "z": packed(item.bar.shown(item.z)),
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
        "hovertemplate": f"{x}, {y}: <b>{z}</b><extra></extra>",
    }


def _cells(item: Cells) -> Json:
    colours = style.DIVERGING if item.diverging else style.SEQUENTIAL
    return {
        "type": "heatmap",
        "x": [label_html(name) for name in item.columns],
        "y": [label_html(name) for name in item.rows],
        "z": packed(item.shade),
        "text": [list(row) for row in item.texts],
        "texttemplate": "%{text}",
        "colorscale": [[n / (len(colours) - 1), colour] for n, colour in enumerate(colours)],
        "zmin": 0.0,
        "zmax": 1.0,
        "showscale": False,
        "hoverongaps": False,
        "xgap": 2,
        "ygap": 2,
        "hovertemplate": "%{y}, %{x}: <b>%{text}</b><extra></extra>",
    }


def decorations_of(panel: Panel, item: Item, x: str, y: str) -> tuple[list[Json], list[Json]]:
    """What plotly draws as shapes and annotations: rules, spans and notes."""
    whole_x, whole_y = f"{x} domain", f"{y} domain"
    match item:
        case Rule(axis="y"):
            value = item.value * panel.y.factor
            shape = {"type": "line", "xref": whole_x, "x0": 0, "x1": 1, "yref": y}
            ends = {"y0": value, "y1": value, "line": _line(item.signal), "layer": "above"}
            place = {"xref": whole_x, "x": 1, "yref": y, "y": shown_place(panel.y, item.value)}
            return [shape | ends], _texts(item.text, place, xanchor="right", yanchor="bottom")
        case Rule():
            value = item.value * panel.x.factor
            shape = {"type": "line", "xref": x, "x0": value, "x1": value, "yref": whole_y}
            ends = {"y0": 0, "y1": 1, "line": _line(item.signal), "layer": _layer(item.signal)}
            place = {"xref": x, "x": shown_place(panel.x, item.value), "yref": whole_y, "y": 1}
            return [shape | ends], _texts(item.text, place)
        case Span():
            start, stop = item.start * panel.x.factor, item.stop * panel.x.factor
            shape = {"type": "rect", "xref": x, "x0": start, "x1": stop, "yref": whole_y}
            look = {"fillcolor": style.tint(_colour(item), 0.12), "line": {"width": 0}}
            place = {"xref": x, "x": shown_place(panel.x, min(item.start, item.stop))}
            corner = {"yref": whole_y, "y": 1}
            extent = {"y0": 0, "y1": 1, "layer": "below"}
            return [shape | look | extent], _texts(item.text, place | corner)
        case Intervals():
            right = {"xref": whole_x, "x": 1, "yref": y}
            return [], [
                part | {"bgcolor": style.PAPER}  # the start's line must not run through the numbers
                for row, text in enumerate(item.texts)
                for part in _texts(text, right | {"y": row - 0.34}, "right", "middle")
            ]
        case Note():
            place = {"xref": x, "x": shown_place(panel.x, item.x)}
            anchor = "bottom" if item.side == "above" else "top"
            level = {"yref": y, "y": shown_place(panel.y, item.y)}
            return [], _texts(item.text, place | level, xanchor="center", yanchor=anchor)
    return [], []


def _layer(signal: str) -> str:
    """Where a vertical rule stands: what marks a place must not hide what happens there."""
    return "below" if style.style_of(signal).layer < 3 else "above"


def _texts(text: str, place: Json, xanchor: str = "left", yanchor: str = "top") -> list[Json]:
    return [annotation(text, place, xanchor, yanchor)] if text else []


def _colour(item: Band | Span) -> str:
    return style.style_of(item.signal).colour


def packed(values: Vector) -> Json:
    """Numbers in base64, which is half of what they take as text."""
    finite = values[np.isfinite(values)]
    exact = finite.size == 0 or 1e-7 * np.abs(finite).max() <= 1e-6 * np.ptp(finite)
    numbers = values.astype("<f4" if exact else "<f8")
    spec = {"dtype": numbers.dtype.str[1:], "bdata": base64.b64encode(numbers.tobytes()).decode()}
    return spec if values.ndim == 1 else spec | {"shape": ",".join(map(str, values.shape))}


def annotation(
    text: str, place: Json, xanchor: str = "left", yanchor: str = "top", size: int = 12
) -> Json:
    """Text at a place of a panel."""
    look = {"text": label_html(text), "showarrow": False, "font": {"size": size}}
    return look | place | {"xanchor": xanchor, "yanchor": yanchor}
