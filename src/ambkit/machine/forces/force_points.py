"""Measured force points: grids, scattered points and their files, with standard errors."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, real
from ambkit.base.config import Document, Read
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.data.channel_map import Channel, ChannelMap
from ambkit.data.files.tables import Table, read_log, read_table


@dataclass(frozen=True, eq=False)
class ForcePoints:
    """Points at which the force was measured, for :func:`ambkit.train`."""

    # They may be scattered and repeated.

    current: Array  #: (n,) Control current [A].
    displacement: Array  #: (n,) Displacement [m].
    force: Array  #: (n,) Magnet force [N].
    #: (n,) Standard errors of the forces [N], > 0; None if unknown.
    standard_error: Array | None = None

    def __post_init__(self) -> None:
        for name in ("current", "displacement", "force", "standard_error"):
            raw_values = getattr(self, name)
            if raw_values is None:
                continue
            values = real(name, raw_values).copy()
            if values.ndim != 1 or values.size == 0 or values.shape != np.shape(self.current):
                raise AmbkitError(
                    f"{name} must be a list with a value for each point, has shape {values.shape} "
                    f"beside current's {np.shape(self.current)}"
                )
            low = 0.0 if name == "standard_error" else -np.inf
            wrong = np.flatnonzero(~(np.isfinite(values) & (values > low)))
            if wrong.size:
                more = " and greater than 0 N" if name == "standard_error" else ""
                raise AmbkitError(
                    f"{name} must be finite{more}, is {values[wrong[0]]} at point {wrong[0] + 1}"
                )
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return self.current.size

    def where(self, chosen: NDArray[np.bool_]) -> ForcePoints:
        """Return some of the points."""
        # chosen (n,)
        error = self.standard_error
        return ForcePoints(
            self.current[chosen],
            self.displacement[chosen],
            self.force[chosen],
            None if error is None else error[chosen],
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write them as ``.csv`` or ``.parquet`` for ``ambkit train map``."""
        columns = {"iu": self.current, "x": self.displacement, "f_mag": self.force}
        if self.standard_error is not None:
            columns["f_std"] = self.standard_error
        units = {"iu": "A", "x": "m", "f_mag": "N", "f_std": "N"}
        Table(columns, {name: units[name] for name in columns}, {}).save(path)

    def within(
        self, currents: tuple[float, float], displacements: tuple[float, float]
    ) -> NDArray[np.bool_]:
        """Return which points are in a box, including its edges (n,)."""
        inside = np.ones(len(self), dtype=bool)
        for values, (low, high) in ((self.current, currents), (self.displacement, displacements)):
            rounding = 1e-9 * (high - low)
            inside &= (values >= low - rounding) & (values <= high + rounding)
        return inside


COLUMNS = ("iu", "x", "f_mag")

NAMES = (
    "a measured force has columns iu [A], x [mm] and f_mag [N]; what others mean says a TOML "
    "file with [signals.iu], [signals.x] and [signals.f_mag], each with column and unit ('ambkit "
    "schema force'): --channels of 'ambkit check' and 'ambkit train', whose --out FILE.csv "
    "writes the points with these columns"
)
"""Advice for a file with other columns."""


class ForceChannels(Document):
    """Meaning of the columns of a force map, as in a channel map, without time."""

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
    """iu, x and f_mag, and f_std if the standard error of the force is known."""

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
        """Return the columns of a file in SI, by signal."""
        return ChannelMap(signals=self.signals, sampling_time=1.0).apply(read_log(path)).signals


def load_force_points(
    path: str | os.PathLike[str], channels: str | os.PathLike[str] | None = None
) -> ForcePoints:
    """Read measured points of the force, one per row, in any order."""
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
            read_log(path)  # raises if the columns are not the problem
            raise RecordError([*error.problems, f"{path}: {NAMES}"]) from None
    for name in COLUMNS:
        if name not in columns:
            problem = f"{path}: has no column {name}; it has {', '.join(columns)}"
            raise RecordError([problem, *([] if channels else [f"{path}: {NAMES}"])])
    try:
        return ForcePoints(columns["iu"], columns["x"], columns["f_mag"], columns.get("f_std"))
    except AmbkitError as error:
        raise AmbkitError(f"{path}: {error}") from None
