"""What a notebook shows of a bearing, a record, an estimate, and an expert."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel

from ambkit.base.config.problems import quantity_of
from ambkit.estimate.estimate import Status
from ambkit.machine.magnets import ConstantStiffness
from ambkit.result.card import Card, value
from ambkit.show.plots.bearing import bearing_figure
from ambkit.show.plots.estimate import estimate_figure
from ambkit.show.plots.record import record_figure
from ambkit.show.plots.training import expert_figure

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.estimate.estimate import Estimate
    from ambkit.fuzzy.expert import Expert
    from ambkit.machine.machine import Bearing

SPAN = ("from", "to", "rms")


def bearing(of: Bearing) -> Card:
    """Describe a bearing by what its file says, and by the stiffnesses that follow."""
    linear = ConstantStiffness.of(of)
    own = ", ".join(_said(of))
    parts = {name: ", ".join(_said(getattr(of, name))) for name in type(of).model_fields
             if isinstance(getattr(of, name), BaseModel)}  # fmt: skip
    centre = (
        f"k_i {value(linear.k_i, 'N/A')}, k_s {value(linear.k_s, 'N/m')}, "
        f"hovers with {value(of.levitation_current, 'A')}"
    )
    rows = [("", own), *parts.items(), ("at x = 0", centre)]
    return Card(
        of.name, rows, bearing_figure(of), notes=[text for text in (of.description,) if text]
    )


def _said(part: Any) -> Iterator[str]:
    """Yield the values of a part that are not as if nothing had been said."""
    for name, field in type(part).model_fields.items():
        of, quantity = getattr(part, name), quantity_of(field)
        words = name.replace("_", " ")
        if of is None or (of == field.default and not field.is_required()):
            continue
        if quantity and isinstance(of, float):
            yield f"{words} {value(of, quantity.unit)}"
        elif isinstance(of, tuple):
            yield f"{len(of)} {words}"
        elif isinstance(of, str) and name not in ("name", "description", "source"):
            yield of if name == "type" else f"{words} {of}"


def record(of: Record) -> Card:
    """Describe a record by its signals."""
    rows = [[name, *_spread(of[name], of.units[name]), _missing(of[name])] for name in of]
    simulated = ", simulated" if of.has_truth else ""
    title = (
        f"Record{simulated}: {len(of)} samples, {value(float(of.t[0]), 's')} to "
        f"{value(float(of.t[-1]), 's')}, every {value(of.sampling_time, 's')}"
    )
    source = of.meta.get("source")
    notes = [] if source is None else [f"From {source}."]
    return Card(title, rows, record_figure(of), ["", *SPAN, "missing"], notes)


def _spread(values: Any, unit: str) -> list[str]:
    there = values[np.isfinite(values)]
    if not there.size:
        return ["–"] * len(SPAN)
    ends = (there.min(), there.max(), np.sqrt(np.mean(there**2)))
    return [value(float(end), unit) for end in ends]


def _missing(values: Any) -> str:
    return str(int(np.isnan(values).sum()))


def estimate(of: Estimate) -> Card:
    """Describe an estimate by its states, and by how it fared."""
    rows = [[state.name, *_spread(of[state.name], state.unit)] for state in of.states]
    rows.append(["innovation", *_spread(of["innovation"], "m")])
    nis = of.nis[1:]  # the first sample's is of the start
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


def expert(of: Expert) -> Card:
    """Describe an expert by its box, its rules and its training."""
    (low_i, high_i), (low_x, high_x) = of.current_range, of.displacement_range
    rows = [
        ("rules", str(len(of.rules))),
        ("control current", f"{value(low_i, 'A')} to {value(high_i, 'A')}"),
        ("displacement", f"{value(low_x, 'm')} to {value(high_x, 'm')}"),
        ("memberships", "divided by their sum" if of.normalised else "as printed (eq. 33)"),
    ]
    if of.training is not None:
        first, last = of.training.force_rms[0], of.training.force_rms[-1]
        rows.append(("trained by", of.training.method))
        rows.append(("force error", f"{value(first, 'N')} untrained, {value(last, 'N')} trained"))
    return Card("Expert", rows, expert_figure(of), notes=[f"Of {of.source}."])
