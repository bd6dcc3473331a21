"""Measured force points: grids, scattered points and their files, with standard errors."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array, real
from ambkit.base.config import Document, Read
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.data.channel_map import Channel, ChannelMap
from ambkit.data.files.tables import Table, read_log, read_table


@dataclass(frozen=True, eq=False)
class ForcePoints:
    """Points at which the force was measured, for :func:`ambkit.train`."""

    # They may lie anywhere, and the same point may be measured again.

    current: Array  #: (n,) Control current [A].
    displacement: Array  #: (n,) Displacement [m].
    force: Array  #: (n,) Whole force of the magnet [N].
    #: (n,) Standard errors of the forces [N], > 0; None where they are not known.
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
        """Write them as ``.csv`` or ``.parquet``, as ``ambkit train map`` reads them."""
        columns = {"iu": self.current, "x": self.displacement, "f_mag": self.force}
        if self.standard_error is not None:
            columns["f_std"] = self.standard_error
        units = {"iu": "A", "x": "m", "f_mag": "N", "f_std": "N"}
        Table(columns, {name: units[name] for name in columns}, {}).save(path)

    def within(
        self, currents: tuple[float, float], displacements: tuple[float, float]
    ) -> NDArray[np.bool_]:
        """Say which points lie in a box, its edges included; True or False for each (n,)."""
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


class ForceTable:
    """Force function from a table, to be given to :func:`ambkit.stiffness_map` as ``force``."""

    # It goes through all values; for those that scatter there is
    # :class:`~ambkit.machine.forces.force_surface.ForceSurface`. Bicubic between the nodes
    # (not-a-knot spline). Outside, its last polynomial goes on for up to one node step, which is
    # where the nine points of an edge node lie (paper, eq. 27).
    # current (ni,) Nodes of the control current [A], ascending, at least 4.
    # displacement (nx,) Nodes of the displacement [m], ascending, at least 4.
    # values (nx, ni) Force [N], bias force included; rows are displacements.

    def __init__(
        self,
        current: ArrayLike,
        displacement: ArrayLike,
        values: ArrayLike,
    ) -> None:
        from scipy.interpolate import RegularGridInterpolator
        from scipy.sparse.linalg import spsolve

        self.current = np.array(current, dtype=float)
        self.displacement = np.array(displacement, dtype=float)
        self.values = np.array(values, dtype=float)
        check_nodes("current", self.current, "A", least=4)
        check_nodes("displacement", self.displacement, "m", least=4)
        expected = (self.displacement.size, self.current.size)
        if self.values.shape != expected:
            raise AmbkitError(
                f"values must have shape {expected}, a row for each displacement and a column for "
                f"each current, has {self.values.shape}"
            )
        if not np.all(np.isfinite(self.values)):
            row, column = np.argwhere(~np.isfinite(self.values))[0]
            raise AmbkitError(
                f"values[{row}, {column}] must be finite, is {self.values[row, column]}"
            )
        # Counted in whole ranges: micrometres beside amperes would be badly conditioned.
        self._spline = RegularGridInterpolator(
            (
                _in_ranges(self.displacement, self.displacement),
                _in_ranges(self.current, self.current),
            ),
            self.values,
            method="cubic",
            bounds_error=False,
            fill_value=None,  # the last polynomial goes on
            solver=spsolve,
        )

    def __call__(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Force [N] at the points (iu [A], x [m]), of shapes that broadcast."""
        iu, x = np.broadcast_arrays(real("iu", iu), real("x", x))
        for name, places, nodes, unit in (
            ("iu", iu, self.current, "A"),
            ("x", x, self.displacement, "m"),
        ):
            low, high = 2 * nodes[0] - nodes[1], 2 * nodes[-1] - nodes[-2]
            beyond = ~((places >= low) & (places <= high))  # NaN is beyond, too
            if np.any(beyond):
                raise AmbkitError(
                    f"{name} = {places[beyond][0]:g} {unit} is more than one node step outside the "
                    f"force table, {nodes[0]:g} to {nodes[-1]:g} {unit}"
                )
        points = _in_ranges(x, self.displacement), _in_ranges(iu, self.current)
        return np.asarray(self._spline(np.stack(points, axis=-1)))


def check_nodes(name: str, nodes: Array, unit: str, *, least: int = 2) -> None:
    """Raise AmbkitError unless nodes are a list of finite, ascending numbers, ``least`` or more."""
    if nodes.ndim != 1 or nodes.size < least:
        raise AmbkitError(
            f"{name} must be a list of at least {least} nodes, has shape {nodes.shape}"
        )
    if not np.all(np.isfinite(nodes)):
        raise AmbkitError(f"{name} must be finite, has {nodes[~np.isfinite(nodes)][0]} {unit}")
    descents = np.flatnonzero(np.diff(nodes) <= 0)
    if descents.size:
        before, after = nodes[descents[0]], nodes[descents[0] + 1]
        raise AmbkitError(f"{name} must ascend, has {before:g} {unit} before {after:g} {unit}")


def _in_ranges(values: Array, nodes: Array) -> Array:
    """Count from the first node in ranges of the nodes."""
    origin, extent = float(nodes[0]), float(nodes[-1] - nodes[0])
    return (values - origin) / extent
