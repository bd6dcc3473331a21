"""Logs as the commands take them: filled where they have gaps, cut, and looked at."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ambkit.data.channel_map import ChannelMap
    from ambkit.data.record import Record


def load_log(
    path: Path,
    channels: ChannelMap | Path | None,
    begin: float | None = None,
    end: float | None = None,
) -> Record:
    """Read a log, say what was filled in it, and cut it."""
    from ambkit.cli import printing
    from ambkit.data.reading import load_filled

    record = load_filled(path, channels, printing.note)
    return record if begin is None and end is None else record.between(begin, end)
