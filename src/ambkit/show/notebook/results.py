"""What a notebook shows of what was identified."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.units import engineering, typeset
from ambkit.identification.online.side_by_side import NAMES
from ambkit.result.card import Card, value
from ambkit.show.plots.identification import identification_figure
from ambkit.show.plots.online import online_figure

if TYPE_CHECKING:
    from ambkit.identification.online.magnet_constant import Identification
    from ambkit.identification.online.side_by_side import SideBySide

K = "N m^2/A^2"
"""Unit of a magnet constant."""


def with_spread(mean: float, spread: float, unit: str) -> str:
    """Print a value with its error, both in the same unit."""
    if not np.isfinite(spread):
        return value(mean, unit)
    number, _, shown = engineering(mean, unit, 4).partition(" ")
    error = engineering(spread, unit, 2, like=mean).partition(" ")[0]
    return typeset(f"{number} ± {error} {shown}")


def identification(of: Identification) -> Card:
    """Describe what one learned of a magnet constant along a record."""
    rows = [
        ("magnet constant", with_spread(of.magnet_constant, of.spread, K)),
        ("standard error", value(of.history.standard_error, K)),
        ("drift in the last quarter", value(of.history.drift, K)),
        ("samples in which it was held", f"{100 * float(of.history.held.mean()):.3g} %"),
    ]
    notes = [] if of.history.settled else ["It still drifts; a longer record may settle it."]
    figure = identification_figure(of, float(of.history.k[0]))
    return Card(f"Identification of {of.bearing.name}", rows, figure, notes=notes)


def side_by_side(of: SideBySide) -> Card:
    """Describe what each learned of a magnet constant along a record."""
    rows = [
        [NAMES[name], value(one.magnet_constant, K), value(one.standard_error, K)]
        for name, one in of.results.items()
    ]
    title = f"Magnet constant of {of.bearing.name}, learned online"
    heads = ["", "magnet constant", "standard error"]
    return Card(title, rows, online_figure(of), heads, [of.agreement, *of.notes])
