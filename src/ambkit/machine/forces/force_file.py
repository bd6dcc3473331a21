"""A measured or computed force of the magnet, read from a file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ambkit.base.config import Document, Read
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.data.channel_map import Channel, ChannelMap
from ambkit.data.files.formats import read_log
from ambkit.data.files.tables import read_table
from ambkit.machine.forces.force_points import ForcePoints

COLUMNS = ("iu", "x", "f_mag")

NAMES = (
    "a measured force has columns iu [A], x [mm] and f_mag [N]; what others mean says a TOML "
    "file with [signals.iu], [signals.x] and [signals.f_mag], each with column and unit ('ambkit "
    "schema force'): --channels of 'ambkit check' and 'ambkit train', whose --out FILE.csv "
    "writes the points with these columns"
)
"""What helps where a file has other columns."""


class ForceChannels(Document):
    """What the columns of a force map mean, as in a channel map of a log, without times."""

    # ::
    #     [signals.iu]
    #     column = "Strom"
    #     unit = "A"
    #     [signals.x]
    #     column = "Luftspalt"
    #     unit = "mm"
    #     sign = -1
    #     offset = "0.78 mm"
    #     [signals.f_mag]
    #     column = "Kraft"
    #     unit = "N"

    signals: dict[str, Channel]
    """iu, x and f_mag, and f_std where the force's standard error is known."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        signals = read("signals")
        if isinstance(signals, dict):
            for name in COLUMNS:
                if name not in signals:
                    yield "signals", f"{name} is missing; a force map has {', '.join(COLUMNS)}"
            units = {"iu": "A", "x": "m", "f_mag": "N", "f_std": "N"}
            for name, channel in signals.items():
                if isinstance(channel, Channel) and channel.si_unit != units.get(name):
                    known = (
                        f"must be a quantity in {units[name]}" if name in units else "is unknown"
                    )
                    yield f"signals.{name}", f"{known}; known are {', '.join(units)}"

    def columns(self, path: str | os.PathLike[str]) -> Mapping[str, NDArray[np.float64]]:
        """Return the columns of a file in SI, by the names of the signals."""
        return ChannelMap(signals=self.signals, sampling_time=1.0).apply(read_log(path)).signals


def load_force_points(
    path: str | os.PathLike[str], channels: str | os.PathLike[str] | None = None
) -> ForcePoints:
    """Read measured points of the force: a row each, anywhere and in any order."""
    # ::
    #     iu [A],x [mm],f_mag [N],f_std [N]
    #     -1.5,-0.48,-11.9,0.2
    #     -1.2,0.05,-11.6,0.1
    if channels is not None:
        columns = ForceChannels.load(channels).columns(path)
    else:
        try:
            columns = read_table(path).columns
        except RecordError as error:
            read_log(path)  # which raises where it is not the columns that are wrong
            raise RecordError([*error.problems, f"{path}: {NAMES}"]) from None
    for name in COLUMNS:
        if name not in columns:
            problem = f"{path}: has no column {name}; it has {', '.join(columns)}"
            raise RecordError([problem, *([] if channels else [f"{path}: {NAMES}"])])
    try:
        return ForcePoints(columns["iu"], columns["x"], columns["f_mag"], columns.get("f_std"))
    except AmbkitError as error:
        raise AmbkitError(f"{path}: {error}") from None
