"""A record: its signals over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ambkit.base.escaping import label, markdown
from ambkit.data.signal_panels import MAX_PANELS, axis_of, missing_spans
from ambkit.result.card import SPAN, Card, spread, value
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Item, Line
from ambkit.result.signal_styles import TIME

TOGETHER = ({"y": "measured", "r": "reference", "x": "truth"},)
"""Signals that share a panel, with their looks; the first one names it."""

TOLD_BY = {"iu": "u", "f_mag": "f_d", "x_m": "y"}
"""Signals that are left out where the other one says nearly the same."""


def record_figure(record: Any) -> Figure:
    """Show a record's signals over time; of many the first eight panels."""
    groups = list(_groups(record))
    names = [name for names in groups[MAX_PANELS:] for name in names]
    left = f"Not shown: {', '.join(map(markdown, names))}." if names else ""
    return Figure(
        id="record",
        title=markdown(record.meta.get("source") or "Record"),
        caption=left,
        panels=[_panel(record, names) for names in groups[:MAX_PANELS]],
    )


def _groups(record: Any) -> Iterator[Sequence[str]]:
    signal_names = [name for name in record if TOLD_BY.get(name) not in record.signals]
    for group in TOGETHER:
        names = [name for name in group if name in signal_names]
        if names:
            yield names
        signal_names = [name for name in signal_names if name not in group]
    yield from ([name] for name in signal_names)


def _panel(record: Any, names: Sequence[str]) -> Panel:
    t = record.t
    styles = {name: style for group in TOGETHER for name, style in group.items()}
    several = len(names) > 1
    items: list[Item] = []
    for name in names:
        known = several and (name != "x" or record.has_truth)
        look, text = (styles[name], None) if known else ("channel", label(name) if several else "")
        items.append(Line(t, record[name], signal=look, label=text))
    lost = np.isnan(record[names[0]])
    edges = np.flatnonzero(np.diff(np.r_[False, lost, False])).reshape(-1, 2)
    items += missing_spans([(float(t[a]), float(t[b - 1])) for a, b in edges], t)
    values = np.concatenate([record[name] for name in names])
    time = replace(TIME, limits=(float(t[0]), float(t[-1])))
    return Panel(time, axis_of(names[0], record.units[names[0]], values), items)


def record_card(of: Any) -> Card:
    """Describe a record by its signals."""
    rows = [
        [name, *spread(of[name], of.units[name]), str(int(np.isnan(of[name]).sum()))] for name in of
    ]
    simulated = ", simulated" if of.has_truth else ""
    title = (
        f"Record{simulated}: {len(of)} samples, {value(float(of.t[0]), 's')} to "
        f"{value(float(of.t[-1]), 's')}, every {value(of.sampling_time, 's')}"
    )
    source = of.meta.get("source")
    notes = [] if source is None else [f"From {source}."]
    return Card(title, rows, record_figure(of), ["", *SPAN, "missing"], notes)
