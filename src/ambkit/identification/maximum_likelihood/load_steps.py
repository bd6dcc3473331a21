"""Fits of records in which the disturbance force steps: a model of the parts between its steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.estimate import maximum_likelihood
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.result import MaximumLikelihood
from ambkit.identification.maximum_likelihood.structure import Structure, examine

MOST = 4  #: Maximum number of steps.
SHORTEST = 400  #: Minimum samples of a part of a record after the filter has settled.


def fit_between_load_steps(
    records: Sequence[Record], start: LoopModel, free: Sequence[str], **options: Any
) -> tuple[MaximumLikelihood, list[Record], Structure]:
    """Fit records by maximum likelihood, cut where the disturbance force steps, and test it."""
    # Process noise that explains a step is too large everywhere else, and the step's motion then
    # looks like friction or a resonance. The force of the next part is as unknown as the first's.
    parts = list(records)
    while True:
        result = maximum_likelihood(parts, start, free, **options)
        structure = examine(result, parts)
        pieces = _cut_at_a_step(structure, parts, result.settling)
        if len(pieces) == len(parts) or len(parts) == len(records) + MOST:
            return result, parts, structure
        parts = pieces


def cut_at_load_steps(result: MaximumLikelihood, records: Sequence[Record]) -> list[Record]:
    """Return other records, cut where the disturbance force steps."""
    parts = list(records)
    for _ in range(MOST):
        pieces = _cut_at_a_step(examine(result, parts), parts, result.settling)
        if len(pieces) == len(parts):
            break
        parts = pieces
    return parts


def _cut_at_a_step(
    structure: Structure, records: Sequence[Record], settling: float
) -> list[Record]:
    """Return the records, one cut at a force step, if both parts are long enough."""
    parts = list(records)
    by_name = {item.kind.name: item for item in structure.departures}
    step = by_name.get("load jump")
    other = {"change", "sensor jump"} & set(by_name)  # of which it may be the effect
    if step is not None and not other and all(np.isfinite(record["u"]).all() for record in records):
        number, at = step.record, step.begins
        record = records[number]
        least = round(settling / record.sampling_time) + SHORTEST
        if least <= at <= len(record) - least:
            parts[number : number + 1] = [
                record.between(stop=record.t[at]), record.between(start=record.t[at])
            ]  # fmt: skip
    return parts


def names_of_parts(
    names: Sequence[str], records: Sequence[Record], parts: Sequence[Record]
) -> list[str]:
    """Return the names of parts of records, in sequence."""
    ends = np.cumsum([len(record) for record in records])
    begins = np.cumsum([0, *(len(part) for part in parts[:-1])])
    owners = np.searchsorted(ends, begins, side="right")
    return [
        names[k] if begin in (0, *ends) else f"{names[k]} from {engineering(part.t[0], 's', 3)}"
        for k, begin, part in zip(owners.tolist(), begins.tolist(), parts, strict=True)
    ]
