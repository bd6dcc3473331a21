"""A record whose measured positions lack their spikes: a single one spoils what is fitted to it.

A filter leaves out what no rotor can have done. A likelihood counts all that was measured: one
sample of 3 mm in 6,000 makes a hundred times the sensor's noise of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambkit.data.reading.faults import noise, resolution
from ambkit.data.reading.spikes import spikes
from ambkit.data.record import Record


def spike_free(record: Record) -> tuple[Record, int]:
    """Return a record with the spikes of its positions missing, and how many samples these were.

    Parameters
    ----------
    record : Record
        With ``y``, or ``y_...`` for each reading of a machine.
    """
    cleaned, count = {name: record[name] for name in record}, 0
    for name in record:
        if name != "y" and not name.startswith("y_"):
            continue
        at = np.flatnonzero(np.isfinite(record[name]))
        there = record[name][at]
        starts, lengths = spikes(there, noise(there), resolution(there))
        if starts.size == 0:
            continue
        own = np.concatenate([
            np.arange(start, start + length)
            for start, length in zip(starts.tolist(), lengths.tolist(), strict=True)
        ])  # fmt: skip
        cleaned[name] = record[name].copy()
        cleaned[name][at[own]] = np.nan
        count += own.size
    if count == 0:
        return record, 0
    return Record(record.t, cleaned, record.units, record.meta), count


def without_spikes(records: Sequence[Record]) -> tuple[list[Record], str]:
    """Return records without the spikes of their positions, and what to say of it, if anything."""
    cleaned, counts = zip(*map(spike_free, records), strict=True)
    total = sum(counts)
    if total == 0:
        return list(cleaned), ""
    if total == 1:
        return list(
            cleaned
        ), "1 sample of the position, a spike amid others that agree, is left out"
    text = f"{total} samples of the position, spikes amid others that agree, are left out"
    return list(cleaned), text
