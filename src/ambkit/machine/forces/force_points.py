"""Measured points of the magnet's force, on a grid or scattered, each as sure as it is known."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import real
from ambkit.base.errors import AmbkitError

Array = NDArray[np.float64]


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
        from ambkit.data.files.tables import Table, write_table

        columns = {"iu": self.current, "x": self.displacement, "f_mag": self.force}
        if self.standard_error is not None:
            columns["f_std"] = self.standard_error
        units = {"iu": "A", "x": "m", "f_mag": "N", "f_std": "N"}
        write_table(path, Table(columns, {name: units[name] for name in columns}, {}))

    def within(
        self, currents: tuple[float, float], displacements: tuple[float, float]
    ) -> NDArray[np.bool_]:
        """Say which points lie in a box, its edges included; True or False for each (n,)."""
        inside = np.ones(len(self), dtype=bool)
        for values, (low, high) in ((self.current, currents), (self.displacement, displacements)):
            rounding = 1e-9 * (high - low)
            inside &= (values >= low - rounding) & (values <= high + rounding)
        return inside
