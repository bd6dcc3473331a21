"""A rig's log into a record, with an account of its faults."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ambkit.verbs.words import Channels, Log, Time

if TYPE_CHECKING:
    from ambkit.data.reading.reader import Reading
    from ambkit.result.document import Document


def read(
    log: Log,
    channels: Channels | None = None,
    *,
    resample: bool = False,
    sampling_time: Time | None = None,
    segment: int | None = None,
    missing: Sequence[Literal["saturated", "frozen", "spike"]] = (),
) -> Reading:
    """Read a rig's log and report its faults.

    Rate, jitter, gaps and jumps of its clock; missing, saturated, frozen and coarse stretches and
    spikes of its channels; and what was done about each. Nothing is dropped or resampled unless
    asked for: a gap of a whole number of samples gets so many missing ones, an infinite value
    becomes a missing one, a delay of the channel map is taken out. Of a log that is refused, --plot
    shows where the trouble is.

    Parameters
    ----------
    log : str or path
        The log: .csv, .txt, .parquet, .mat, .h5, .mf4 and the like.
    channels : ChannelMap, str or path, optional
        Channel map: what is what in the log; `ambkit read guess` proposes one. By default a table
        whose columns have the names and units of a record.
    resample : bool, optional
        Put signals of several clocks, or of an uneven one, on one grid.
    sampling_time : float or str, optional
        Step of that grid [s]; by default the clock's own.
    segment : int, optional
        Of a clock that jumps, read the part of this number, from 1.
    missing : sequence of {"saturated", "frozen", "spike"}, optional
        Take such samples as missing. May be repeated.

    Returns
    -------
    Reading
        The record and its account.

    Raises
    ------
    RejectedLog
        The file is damaged; the map does not fit it; or there is no even grid: two clocks, jitter,
        jumps. The message has all of it, each with its place, and what would help.
    RecordError
        Nothing could be read.
    AmbkitError
        The file or the map cannot be read, or the library for such files is not installed.

    Examples
    --------
    $ ambkit read log.csv --channels map.toml --out log.parquet --plot log.png
    """
    from ambkit.base.errors import AmbkitError
    from ambkit.base.progress import progress
    from ambkit.data.reading import reader

    if sampling_time is not None and not resample:
        raise AmbkitError("sampling_time is the step to resample to: resample too")
    if segment is not None and segment < 1:
        raise AmbkitError(f"segment must be 1 or more, is {segment}")
    with progress(f"reading {Path(log).name}") as done:
        return reader.read(
            log, channels, resample=resample, sampling_time=sampling_time, segment=segment,
            missing=missing, progress=done,
        )  # fmt: skip


def guess_channels(log: Log) -> Document:
    """Propose a channel map for a rig's log.

    Parameters
    ----------
    log : str or path
        The log: .csv, .txt, .parquet, .mat, .h5, .mf4 and the like.

    Returns
    -------
    Document
        The map as TOML, to be looked through.

    Raises
    ------
    AmbkitError
        The file cannot be read, or nothing in it looks like a position and a control signal.

    Examples
    --------
    $ ambkit read guess log.csv > map.toml
    """
    from ambkit.base.progress import progress
    from ambkit.data.reading.propose import guess
    from ambkit.result.document import Document

    with progress(f"reading {Path(log).name}") as done:
        text = guess(log, progress=done)
    timed = "\n[signals.t]\n" in text
    notes = (f"{log}: the map has no time: fill in its sampling_time before a log is read by it",)
    return Document(text, {"map": text}, () if timed else notes)
