"""Figure and description of an estimate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ambkit.base.escaping import label, markdown
from ambkit.estimate.estimate_panels import innovation_panel, settled_samples, with_limits
from ambkit.estimate.status import Status
from ambkit.result.card import SPAN, Card, spread
from ambkit.result.report import Axis, Band, Figure, Item, Line, Panel
from ambkit.result.signal_styles import CURRENT, DISTURBANCE, POSITION, TIME, VELOCITY

AXES = {
    "position": POSITION,
    "velocity": VELOCITY,
    "disturbance force": DISTURBANCE,
    "current": CURRENT,
}
"""Plotted states, by role."""


def estimate_figure(estimate: Any) -> Figure:
    """Plot the states with their 95 % bands, and the innovations."""
    t = estimate.t
    time = replace(TIME, limits=(float(t[0]), float(t[-1])))
    settled = settled_samples(t, [estimate])
    panels = []
    for role, axis in AXES.items():
        items: list[Item] = []
        names = estimate.states_with_role(role)
        for place, name in enumerate(names):
            style = f"series {1 + place % 4}" if len(names) > 1 else "estimate"
            if estimate.covariance is not None:
                half = 2 * estimate.std(name)
                mean = estimate[name]
                items.append(Band(t, mean - half, mean + half, signal=style, label="±2σ"))
            text = label(name) if len(names) > 1 else None
            items.append(Line(t, estimate[name], signal=style, label=text))
        if items:
            panels.append(Panel(time, with_limits(axis, items, settled), items))
    if estimate.scale is not None:
        scale: list[Item] = [Line(t, estimate.scale, signal="identified", label="")]
        panels.append(Panel(time, Axis("magnet constant over the known"), scale))
    return Figure(
        id="estimate",
        title=markdown(estimate.estimator),
        caption="Errors at the start may exceed the axes.",
        panels=[*panels, innovation_panel("", estimate, time, [])],
    )


def estimate_card(of: Any) -> Card:
    """Describe an estimate by its states and their consistency."""
    rows = [[state.name, *spread(of[state.name], state.unit)] for state in of.states]
    rows.append(["innovation", *spread(of["innovation"], "m")])
    nis = of.nis[1:]  # the first sample's belongs to the start
    known = nis[np.isfinite(nis)]
    consistent = f"Mean NIS {known.mean():.3f} (1: consistent). " if known.size else ""
    flags = ", ".join(
        f"{flag.name} {count}"
        for flag in Status
        if flag and (count := int(((of.status & np.uint16(flag)) != 0).sum()))
    )
    title = f"{of.estimator}: {len(of.t)} samples"
    notes = [f"{consistent}Samples with a status: {flags or 'none'}."]
    return Card(title, rows, estimate_figure(of), ["", *SPAN], notes)
