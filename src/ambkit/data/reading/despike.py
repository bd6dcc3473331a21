"""A record whose measured positions lack their spikes: a single one spoils what is fitted to it.

A filter leaves out what no rotor can have done. A likelihood counts all that was measured: one
sample of 3 mm in 6,000 makes a hundred times the sensor's noise of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambkit.data.reading.faults import noise, resolution
from ambkit.data.reading.spikes import is_valid, spikes
from ambkit.data.record import Record


def spike_free(record: Record) -> tuple[Record, int]:
    """Return a record with the spikes of its positions missing, and how many samples these were."""
    cleaned, count = {name: record[name] for name in record}, 0
    for name in record:
        if name != "y" and not name.startswith("y_"):
            continue
        at = np.flatnonzero(np.isfinite(record[name]))
        there = record[name][at]
        fine = is_valid(there.size, *spikes(there, noise(there), resolution(there)))
        cleaned[name] = record[name].copy()
        cleaned[name][at[~fine]] = np.nan
        count += int(np.count_nonzero(~fine))
    if count == 0:
        return record, 0
    return Record(record.t, cleaned, record.units, record.meta), count


def without_spikes(records: Sequence[Record]) -> tuple[list[Record], str]:
    """Return records without the spikes of their positions, and what to say of it, if anything."""
    pairs = [spike_free(record) for record in records]
    total, remark = sum(count for _, count in pairs), ""
    if total == 1:
        remark = "1 sample of the position, a spike amid others that agree, is left out"
    elif total > 1:
        remark = f"{total} samples of the position, spikes amid others that agree, are left out"
    return [cleaned for cleaned, _ in pairs], remark
