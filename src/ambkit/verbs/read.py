"""Logs of a rig, read into records."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ambkit.base.progress import progress
from ambkit.verbs.words import Channels, Log, Time

if TYPE_CHECKING:
    from ambkit.data.reading.reader import Reading
    from ambkit.result.result import Document


def read(
    log: Log,
    channels: Channels | None = None,
    *,
    resample: bool = False,
    sampling_time: Time | None = None,
    segment: int | None = None,
    missing: Sequence[Literal["saturated", "frozen", "spike"]] = (),
) -> Reading:
    """Read a log and report its defects.

    Rate, jitter, gaps and jumps of the clock; missing, saturated, stuck and coarsely quantised
    samples and outliers of the channels; and how each was handled. Samples are neither dropped nor
    resampled by default: a gap of whole samples is filled with missing samples, an infinite value
    becomes missing, and a delay in the channel map is compensated. If a log is rejected, --plot
    shows the defects.

    Parameters
    ----------
    log : str or path
        Log (.csv, .txt, .parquet, .mat, .h5, .mf4 and others).
    channels : ChannelMap, str or path, optional
        Channel map (`ambkit read guess` proposes one). Not needed for a table with names and units
        of a record.
    resample : bool, optional
        Resample signals with several or uneven clocks to one grid.
    sampling_time : float or str, optional
        Step of that grid [s]. By default that of the clock.
    segment : int, optional
        Read this segment, from 1, of a clock that jumps.
    missing : sequence of {"saturated", "frozen", "spike"}, optional
        Treat these samples as missing.

    Returns
    -------
    Reading
        The record and its defects.

    Raises
    ------
    RejectedLog
        The file is damaged, the channel map does not fit, or there is no even time grid (two
        clocks, jitter, jumps). The message lists every defect with its place and remedy.
    RecordError
        Nothing could be read.
    AmbkitError
        The file or the map cannot be read, or the library for its format is not installed.

    Examples
    --------
    $ ambkit read log.csv --channels map.toml --out log.parquet --plot log.png
    """
    from ambkit.base.errors import AmbkitError
    from ambkit.data.reading import reader

    if sampling_time is not None and not resample:
        raise AmbkitError("sampling_time is the step of --resample, which is missing")
    if segment is not None and segment < 1:
        raise AmbkitError(f"segment must be 1 or more, is {segment}")
    with progress(f"reading {Path(log).name}") as done:
        return reader.read(
            log, channels, resample=resample, sampling_time=sampling_time, segment=segment,
            missing=missing, progress=done,
        )  # fmt: skip


def guess_channels(log: Log) -> Document:
    """Propose a channel map for a log.

    Parameters
    ----------
    log : str or path
        As for `ambkit read`.

    Returns
    -------
    Document
        Channel map as TOML, to be reviewed.

    Raises
    ------
    AmbkitError
        The file cannot be read, or no column looks like a position and a control signal.

    Examples
    --------
    $ ambkit read guess log.csv > map.toml
    """
    from ambkit.data.reading.propose import guess
    from ambkit.result.result import Document

    with progress(f"reading {Path(log).name}") as done:
        text = guess(log, progress=done)
    timed = "\n[signals.t]\n" in text or "\nsampling_time =" in text
    notes = (f"{log}: the map has no time: fill in its sampling_time before a log is read by it",)
    return Document(text, {"map": text}, () if timed else notes)
