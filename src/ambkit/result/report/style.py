"""Style of each signal: one table for all figures, on screen and on paper.

Colours follow Okabe and Ito (2008), suitable for colour blindness, with a slightly darker blue.
Lines in a figure also differ in dash or lightness, so that grey prints are legible.
"""

import difflib
from dataclasses import dataclass

BLACK, GREY, PALE = "#000000", "#6E6E6E", "#B4BFC9"
BLUE, VERMILION, GREEN = "#00649E", "#D55E00", "#009E73"
PURPLE, OCHRE, TAN, RED, TEAL = "#9B4A86", "#A67600", "#B58C3C", "#B3261E", "#5A9696"
NAVY = "#141B4D"

SOLID: tuple[float, ...] = ()
LONG, DASH, DOT = (7.0, 2.5), (4.0, 2.0), (1.2, 1.8)
DASH_DOT = (7.0, 2.0, 1.5, 2.0)

INK, FRAME, GRID, PAPER = "#1D2329", "#8A949E", "#E3E7EB", "#FFFFFF"
"""Text, frame of the axes, grid lines, background."""

SEQUENTIAL = ("#FBF7DC", "#D9EBC8", "#A8D8C1", "#74BDC1", "#4A9DBC", "#3579A8")
"""Heat maps from low to high: monotonically darker, so they are readable in grey."""

DIVERGING = ("#3C75B0", "#7FA9D3", "#BCD4E8", "#F5F5F2", "#F0CBA9", "#DB9A66", "#B9682F")
"""Heat maps of signed values: blue for negative, brown for positive."""


@dataclass(frozen=True)
class Style:
    """Style of a signal."""

    label: str  #: Name in the legend.
    colour: str  #: ``#RRGGBB``.
    #: Lengths of dashes and gaps in points; empty for a solid line.
    dash: tuple[float, ...] = SOLID
    width: float = 1.4  #: Line width in points.
    marker: str = "circle"  #: Symbol of points.
    hollow: bool = False  #: Whether the symbols are outlines only.
    layer: int = 3  #: Drawing order: noise 1, most lines 3.
    size: float = 4.0  #: Size of the symbols, in points.


SIGNALS = {
    "reference": Style("reference", GREY, LONG, 1.1, layer=2),
    "start": Style("initial model", OCHRE, DASH, 1.6, "diamond", hollow=True, layer=7),
    "truth": Style("truth", BLACK, SOLID, 2.2, "cross", layer=3),
    "measured": Style("measured", PALE, SOLID, 0.6, layer=1),
    "measurement": Style("measurement", GREY, SOLID, 1.0, layer=4),
    "place": Style("measurement", GREY, SOLID, 1.0, layer=4, size=1.4),
    "estimate": Style("estimate", BLUE, SOLID, 1.2, layer=5),
    "mode": Style("mode", BLUE, SOLID, 1.2, layer=5, size=1.4),
    # Often the same curve: the later ones are thinner and dashed, so that the others are visible.
    "smoothed": Style("smoothed", OCHRE, SOLID, 2.6, layer=7),
    "smoothed 2": Style("smoothed", PURPLE, LONG, 1.6, layer=8),
    "smoothed 3": Style("smoothed", NAVY, DOT, 1.6, layer=9),
    "estimate linear": Style("linear Kalman filter", VERMILION, DASH, 1.2, "square", layer=4),
    "estimate adaptive": Style("adaptive Kalman filter", BLUE, SOLID, 1.2, layer=5),
    "estimate closed law": Style("closed law", GREEN, DASH_DOT, 1.2, "triangle", layer=6),
    "estimate wide box": Style("adaptive, rules to ±0.8 mm", OCHRE, DOT, 1.6, "diamond", layer=5),
    # Filters without a style of their own, often on another curve: the wide ones below.
    "another": Style("another filter", OCHRE, SOLID, 3.4, "diamond", hollow=True, layer=2),
    "another 2": Style("another filter", PURPLE, LONG, 2.2, "circle", hollow=True, layer=4),
    "another 3": Style("another filter", NAVY, DOT, 1.6, "cross", layer=7),
    "another 4": Style("another filter", TAN, DASH, 2.8, "square", hollow=True, layer=3),
    "logged": Style("logged by the rig", PURPLE, DOT, 1.5, "diamond", layer=4),
    "constant": Style("constant", GREY, DOT, 1.5, "square", hollow=True, layer=2),
    "paper": Style("paper", PURPLE, DASH, 1.4, "circle", hollow=True, layer=4),
    "ours": Style("ambkit", BLUE, SOLID, 1.4, "cross", layer=5),
    "disturbance": Style("disturbance force", PURPLE, LONG, 1.3, layer=3),
    "control": Style("control signal", OCHRE, SOLID, 1.0, layer=3),
    "force": Style("magnet force", GREEN, SOLID, 1.3, layer=3),
    "identified": Style("identified", BLUE, SOLID, 1.4, layer=5),
    "fit": Style("fit", BLUE, SOLID, 1.4, layer=4),
    "innovation": Style("innovation", TEAL, SOLID, 0.6, layer=2),
    "bound": Style("bound", BLACK, LONG, 1.1, layer=4),
    "beyond above": Style("beyond the axis", RED, SOLID, 1.4, "triangle", layer=6),
    "beyond below": Style("beyond the axis", RED, SOLID, 1.4, "triangle down", layer=6),
    "limit": Style("limit", RED, DOT, 1.4, layer=2),
    "channel": Style("as read", BLUE, SOLID, 0.8, layer=3),
    "saturated": Style("saturated", RED, SOLID, 2.6, layer=5),
    "frozen": Style("frozen", OCHRE, SOLID, 2.6, layer=5),
    "spike": Style("spike", RED, SOLID, 1.4, "circle", hollow=True, layer=6),
    "missing": Style("missing", VERMILION, SOLID, 1.4, layer=2),
    "contact": Style("in contact", GREY, SOLID, 0.8, layer=2),
    "passed": Style("good", GREEN, SOLID, 0.6, layer=2),
    "failed": Style("not good", RED, SOLID, 0.6, layer=3),
    "series 1": Style("series 1", BLUE, SOLID, 1.4, "circle", layer=6),
    "series 2": Style("series 2", VERMILION, DASH, 1.4, "square", layer=5),
    "series 3": Style("series 3", GREEN, DASH_DOT, 1.4, "triangle", layer=4),
    "series 4": Style("series 4", PURPLE, LONG, 1.4, "diamond", layer=3),
}
_RECORDS = ((GREEN, "triangle"), (VERMILION, "square"), (PURPLE, "diamond"), (BLACK, "cross"))
for _place, (_colour, _marker) in enumerate(_RECORDS):
    _name = f"record {_place + 1}"
    SIGNALS |= {
        _name: Style(_name, _colour, SOLID, 1.4, _marker, layer=6 - _place),
        f"{_name} start": Style("start", _colour, DASH, 1.2, _marker, hollow=True, layer=2),
        f"{_name} held": Style("held", _colour, DOT, 1.2, _marker, hollow=True, layer=2),
    }
"""Colour and marker tell the record, the dash what is shown of it; blue is what was found."""

OF_KINDS = (
    Style("", GREY, DOT, 1.4, "circle", hollow=True, layer=3),
    Style("", TAN, DASH_DOT, 1.4, "triangle", hollow=True, layer=3),
    Style("", VERMILION, DASH, 1.4, "square", layer=4),
    Style("", VERMILION, DOT, 1.4, "square", hollow=True, layer=4),
    Style("", PURPLE, LONG, 1.4, "diamond", layer=4),
    Style("", BLUE, SOLID, 1.4, "circle", layer=5),
    Style("", GREEN, DASH_DOT, 1.4, "triangle", layer=6),
    Style("", OCHRE, SOLID, 1.4, "diamond", layer=5),
    Style("", OCHRE, DASH, 1.4, "diamond", hollow=True, layer=5),
    Style("", PURPLE, SOLID, 1.2, "cross", layer=4),
    Style("", RED, LONG, 1.2, "square", hollow=True, layer=4),
    Style("", BLUE, DOT, 1.4, "circle", hollow=True, layer=4),
    Style("", GREEN, DOT, 1.4, "triangle", hollow=True, layer=4),
    Style("", GREY, DASH, 1.2, "cross", layer=3),
    Style("", VERMILION, LONG, 1.2, "triangle down", hollow=True, layer=4),
    Style("", OCHRE, DOT, 1.2, "triangle down", layer=5),
)
"""Styles of the kinds of filters, in order."""

SIGNALS |= {f"kind {number}": look for number, look in enumerate(OF_KINDS)}
"""Each signal's look, by name."""


def style_of(signal: str) -> Style:
    """Return the style of a signal."""
    if signal in SIGNALS:
        return SIGNALS[signal]
    near = difflib.get_close_matches(signal, SIGNALS, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(SIGNALS)}"
    raise ValueError(f"unknown signal {signal!r}: {hint}")


def ink_on(colours: tuple[str, ...], place: float) -> str:
    """Return the colour of text that is readable on a colour."""
    if not 0 <= place <= 1:
        return INK
    behind = _luminance(colours[round(place * (len(colours) - 1))])
    dark = (behind + 0.05) / (_luminance(INK) + 0.05)
    return INK if dark >= 1.05 / (behind + 0.05) else PAPER


def _luminance(colour: str) -> float:
    parts = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    linear = (p / 12.92 if p <= 0.03928 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return sum(w * p for w, p in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def tint(colour: str, strength: float) -> str:
    """Return a colour mixed with white, which prints the same everywhere, unlike transparency."""
    parts = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return "#" + "".join(f"{round(255 + (part - 255) * strength):02X}" for part in parts)
