"""What an estimator says about a record: states, innovations, and how it fared."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.data.record import Record
from ambkit.models.model import Descriptor

Array = NDArray[np.float64]

UNITS = {"k_i": "N/A", "k_s": "N/m", "innovation": "m", "innovation_variance": "m^2", "status": "1"}


class Status(IntFlag):
    """What a step had to say; zero, or a sum of flags (``core/include/ambkit/status.h``)."""

    OK = 0
    MISSING = 1  #: the measurement was not finite, or far beyond the travel: predicted only
    FROZEN = 2  #: the measurement had not moved for too many samples: predicted only
    SATURATED = 4  #: control current beyond its limit: the limit was used
    BAD_CONTROL = 8  #: the control signal was NaN or infinite: the last good one was used
    BAD_VARIANCE = 16  #: rounding has eaten the covariance: correlations dropped
    HELD = 32  #: the position is known no better than the travel: mean and doubt held within it
    BAD_PARAMETER = 64  #: a stiffness was not finite: not predicted
    UNEXCITED = 128  #: too little excitation: the identified value was held
    OUTLIER = 256  #: the measurement was too far from its prediction: predicted only
    SURPRISED = 512  #: too many innovations larger than expected: model or noise is wrong
    NOISE_LIMIT = 1024  #: the noise found online is at the end of its range
    RESTARTED = 2048  #: started afresh: from this measurement, or with nothing known


def packed(i: int, j: int, n: int) -> int:
    """Return where entry (i, j), i <= j, stands in an upper triangle of n rows, row by row."""
    return i * n - i * (i + 1) // 2 + j


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimates of one estimator along one record, n samples.

    Attributes
    ----------
    t : ndarray (n,)
        Time [s].
    mean : ndarray (n, states)
        Displacement x [m], velocity v [m/s], disturbance force f_d [N], lagged position x_m [m],
        and what else the model has.
    innovation, innovation_variance : ndarray (n,)
        Measurement less its prediction [m], and the variance S that the filter expects [m^2].
        The innovation is zero where the measurement was not used, but told of an outlier. The
        variance is zero where the estimator has no idea of it.
    k_i, k_s : ndarray (n,)
        Stiffnesses that the prediction used [N/A], [N/m].
    status : ndarray of uint16 (n,)
        Flags of :class:`Status`.
    covariance : ndarray (n, states (states + 1) / 2) or None
        Upper triangle of the covariance, row by row [products of the states' units].
    estimator : str
        Name of the estimator.
    states : tuple of Descriptor
        What the columns of the mean are: name, unit, typical size, role.
    scale, scale_variance : ndarray (n,) or None
        Estimated magnet constant over the known one, and its variance [1], from estimators that
        estimate it.
    """

    t: Array
    mean: Array
    innovation: Array
    innovation_variance: Array
    k_i: Array
    k_s: Array
    status: NDArray[np.uint16]
    covariance: Array | None
    estimator: str
    states: tuple[Descriptor, ...]
    scale: Array | None = None
    scale_variance: Array | None = None

    @classmethod
    def from_core(
        cls, t: Array, history: dict[str, Any], estimator: str, states: tuple[Descriptor, ...]
    ) -> Estimate:
        """Wrap what the C core wrote.

        Parameters
        ----------
        t : ndarray (n,)
            Time [s].
        history : dict
            The core's arrays by name, n samples each.
        estimator : str
            Name of the estimator.
        states : tuple of Descriptor
            Of its model.
        """
        return cls(
            t=t,
            mean=np.asarray(history["mean"], dtype=float),
            innovation=np.asarray(history["innovation"], dtype=float),
            innovation_variance=np.asarray(history["variance"], dtype=float),
            k_i=np.asarray(history["k_i"], dtype=float),
            k_s=np.asarray(history["k_s"], dtype=float),
            status=history["status"],
            covariance=history.get("covariance"),
            estimator=estimator,
            states=states,
            scale=history.get("scale"),
            scale_variance=history.get("scale_variance"),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states, in their order."""
        return tuple(state.name for state in self.states)

    def __getitem__(self, name: str) -> Array:
        """Return a state by its symbol: ``estimate["f_d"]``; also k_i, k_s, innovation."""
        if name in self.names:
            return self.mean[:, self.names.index(name)]
        if name in ("k_i", "k_s", "innovation", "innovation_variance"):
            return np.asarray(getattr(self, name))
        raise KeyError(f"{name!r}; known: {', '.join((*self.names, 'k_i', 'k_s', 'innovation'))}")

    @property
    def x(self) -> Array:
        """Displacement [m], (n,)."""
        return self["x"]

    @property
    def v(self) -> Array:
        """Velocity [m/s], (n,)."""
        return self["v"]

    @property
    def f_d(self) -> Array:
        """Disturbance force F_St [N], (n,)."""
        return self["f_d"]

    @property
    def x_m(self) -> Array:
        """Lagged position [m], (n,)."""
        return self["x_m"]

    def of_role(self, role: str) -> tuple[str, ...]:
        """Return the names of the states of a role.

        Parameters
        ----------
        role : str
            Such as ``"current"`` or ``"noise"``, see `Descriptor`.
        """
        return tuple(state.name for state in self.states if state.role == role)

    @property
    def sensor_noise(self) -> Array | None:
        """What it takes for coloured noise and hum in the measurement [m], (n,).

        None where they are none of its states.
        """
        names = self.of_role("noise")
        return np.asarray(sum(self[name] for name in names)) if names else None

    @property
    def nis(self) -> Array:
        """Normalised innovation squared, (n,) [1]; its mean is 1 where model and noise are right.

        NaN where the estimator has no idea of the variance.
        """
        with np.errstate(divide="ignore", invalid="ignore"):  # no variance, no figure
            nis = self.innovation**2 / self.innovation_variance
        return np.where(self.innovation_variance > 0, nis, np.nan)

    @property
    def used(self) -> NDArray[np.bool_]:
        """Whether the measurement was taken in, (n,)."""
        unused = Status.MISSING | Status.FROZEN | Status.BAD_VARIANCE | Status.OUTLIER
        return np.asarray((self.status & np.uint16(unused)) == 0)

    def std(self, name: str) -> Array:
        """Standard deviation of a state as the filter believes it, (n,) [unit of the state].

        Parameters
        ----------
        name : str
            Of the state.

        Raises
        ------
        ValueError
            The run did not keep the covariances.
        """
        if self.covariance is None:
            raise ValueError("run(record, covariance=True) keeps the covariances that std needs")
        i = self.names.index(name)
        variance = self.covariance[:, packed(i, i, len(self.states))]
        return np.asarray(np.sqrt(variance), dtype=float)

    def to_record(self) -> Record:
        """Return the estimates as a :class:`Record`, ready to be saved or plotted."""
        signals = {name: self[name] for name in (*self.names, "k_i", "k_s", "innovation")}
        signals["innovation_variance"] = self.innovation_variance
        signals["status"] = self.status.astype(float)
        units = {state.name: state.unit for state in self.states} | UNITS
        return Record(self.t, signals, units, meta={"estimator": self.estimator})

    def save(self, path: str | Path) -> None:
        """Write the estimates to a file.

        Parameters
        ----------
        path : path
            Ends with ``.csv`` or ``.parquet``.
        """
        self.to_record().save(path)
