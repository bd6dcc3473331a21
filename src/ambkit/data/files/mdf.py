"""MDF 4 and 3, the format of automotive measurements: channels in groups, each with its clock.

A channel keeps its name if it is unique; otherwise it is ``2/name`` with the number of its group.
The clock of a group is ``time`` if there is one group, else ``2/time``.
"""

from collections import Counter
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base import memory_limit
from ambkit.base.arrays import Array
from ambkit.base.errors import library
from ambkit.base.escaping import one_line
from ambkit.data.files.log import Log, Request, check_readable, library_errors


def read(path: str, request: Request) -> Log:
    """Read channels, and the clock of each; see `ambkit.data.files.tables.read_log`."""
    check_readable(path)
    MDF = library("asammdf", f"{path}: an MDF file", "mdf").MDF
    with library_errors(path):
        try:
            with Path(path).open("rb") as stream, MDF(stream) as file:
                return _read(file, path, request)
        except Exception as error:
            _close(error)
            raise


def _close(error: Exception) -> None:
    """Close an incomplete object of asammdf, which otherwise prints an error on deletion."""
    step = error.__traceback__
    while step is not None:
        half_built: Any = step.tb_frame.f_locals.get("self")
        if type(half_built).__name__ in ("MDF4", "MDF3"):
            with suppress(Exception):  # what it would close last is missing
                half_built.close()
        step = step.tb_next


def _read(file: Any, name: str, request: Request) -> Log:
    masters = dict(file.masters_db)
    groups = [g for g, group in enumerate(file.groups) if group.channel_group.cycles_nr]
    channels = [
        (g, c, one_line(channel.name))
        for g in groups
        for c, channel in enumerate(file.groups[g].channels)
        if c != masters.get(g)
    ]
    count = Counter(label for _, _, label in channels)
    arrays: dict[str, Array] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    remarks: list[str] = []
    names = set(request.columns or ())
    labels = {(g, c): (label if count[label] == 1 else f"{g}/{label}") for g, c, label in channels}
    times = {g: "time" if len(groups) == 1 else f"{g}/time" for g in groups}
    all_known = names <= {*labels.values(), *times.values()}
    chosen = {
        place: label
        for place, label in labels.items()
        if request.columns is None or not all_known or {label, times[place[0]]} & names
    }
    memory_limit.check(
        name, _memory_of(file, chosen), " a channel map that names fewer takes less;"
    )
    for (g, c), label in chosen.items():
        clock = times[g]
        request.progress(f"reading {label}")
        file.groups[g].channels[c].attachment = None  # it may be any file, and is read with it
        signal = file.get(group=g, index=c)
        arrays.setdefault(clock, np.asarray(signal.timestamps, dtype=np.float64))
        units[clock] = "s"
        if signal.samples.dtype.kind not in "fiub" or signal.samples.ndim != 1:
            remarks.append(f"{label} holds no plain numbers: not read")
            continue
        values = np.array(signal.samples, dtype=np.float64)
        if signal.invalidation_bits is not None:
            values[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
            remarks.append(f"{label}: samples that the logger marked invalid are missing")
        arrays[label] = values
        clocks[label] = clock
        if signal.unit:
            units[label] = one_line(signal.unit)
    return Log(name, arrays, units, clocks, {"start": str(file.start_time)}, remarks=tuple(remarks))


def _memory_of(file: Any, chosen: Collection[tuple[int, int]]) -> int:
    """Return the memory of channels: the largest group unpacked, and all as float64 [byte]."""
    of = {g: file.groups[g].channel_group for g, _ in chosen}
    width = {g: group.samples_byte_nr for g, group in of.items()}
    largest_group = max(
        (int(group.cycles_nr) * int(width[g]) for g, group in of.items()), default=0
    )
    return largest_group + sum(16 * int(of[g].cycles_nr) for g, _ in chosen)
