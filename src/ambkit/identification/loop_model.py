"""What a record is explained by: a bearing, and what a log has besides (delay, offsets, load)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.bearing import GRAVITY
from ambkit.errors import AmbkitError
from ambkit.estimators import AdaptiveKalmanFilter, FilterNoise, KalmanFilter
from ambkit.magnets import ClosedLaw, StiffnessSource
from ambkit.record import Record

if TYPE_CHECKING:
    from ambkit.bearing import Bearing

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LoopModel:
    """A bearing together with what its log adds to it.

    Attributes
    ----------
    bearing : Bearing
        Magnet, rotor, amplifier and sensor.
    delay : float
        Time from a logged control signal to the force, to the logged position [s]: that of the
        whole loop, for the part before the magnet and the part after it look alike. Whole samples
        shift the signal; a fraction f gives each sample the mean of what acts in it,
        ``(1 - f) u[k] + f u[k - 1]``. That is exact for the momentum; the position misses
        ``f (1 - f)/2 T^2`` times the step of the acceleration, nanometres.
    current_lag : float
        Time constant with which the current that pulls follows the logged control signal [s]:
        amplifier, coil and eddy currents; 0: at once.
    position_offset : float
        Measured position of a rotor at x = 0 [m].
    current_offset : float
        Control current at a control signal of zero [A].
    load_growth : float
        Growth of the variance of the load, a force that wanders [N^2/s].
    load_std : float
        How well the load at the start is known to be zero, standard deviation [N].
    source : StiffnessSource, optional
        The magnet, where it is not the bearing's closed law.
    """

    bearing: Bearing
    delay: float = 0.0
    current_lag: float = 0.0
    position_offset: float = 0.0
    current_offset: float = 0.0
    load_growth: float = math.nan
    load_std: float = math.nan
    source: StiffnessSource | None = None

    def __post_init__(self) -> None:
        weight = self.bearing.rotor.mass * GRAVITY
        if math.isnan(self.load_growth):
            object.__setattr__(self, "load_growth", (2 * weight) ** 2)
        if math.isnan(self.load_std):
            object.__setattr__(self, "load_std", weight)

    def kalman(self) -> KalmanFilter:
        """Return the filter whose innovations judge this model, in the C core."""
        return AdaptiveKalmanFilter(
            self.bearing,
            self.source or ClosedLaw(self.bearing),
            noise=FilterNoise(disturbance=self.load_growth),
        )

    def corrected(self, record: Record) -> Record:
        """Return the record as it would be without delay, current lag and offsets.

        The filter lets the rotor's position at the start of a sample act on the sensor's lag
        throughout it (eq. 18, as the paper's discretisation has it). That is late by
        ``T/(1 - exp(-T/T_Sen)) - T_Sen``, half a sample where the lag is long; the control signal
        comes early by as much, so that the delay is that of the rig.

        Parameters
        ----------
        record : Record
            With ``y`` [m] and ``u`` [V]; its other signals stay as they are.
        """
        y, u = self._corrected(record)
        signals = {name: record[name] for name in record} | {"y": y, "u": u}
        return Record(record.t, signals, record.units, record.meta)

    def _corrected(self, record: Record) -> tuple[Array, Array]:
        T, lag = self.bearing.sampling_time, self.bearing.sensor.lag
        late = 1 / -math.expm1(-T / lag) - lag / T
        acting = delayed(lagged(record["u"], T, self.current_lag), self.delay / T - late)
        offset = self.current_offset / self.bearing.amplifier.gain
        return record["y"] - self.position_offset, acting + offset

    def innovations(self, record: Record) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Run the filter along a record.

        Parameters
        ----------
        record : Record
            With ``y`` [m] and ``u`` [V], n samples.

        Returns
        -------
        innovation : ndarray (n,)
            Measurement less its prediction [m].
        variance : ndarray (n,)
            As the filter expects it [m^2].
        used : ndarray of bool (n,)
            Where the measurement was taken in.
        """
        y, u = self._corrected(record)
        kalman = self.kalman()
        known = y[np.isfinite(y)]
        first = float(known[0]) if known.size else 0.0
        std = list(kalman.default_std())
        std[2] = self.load_std
        kalman.reset([first / self.bearing.sensor.gain, 0.0, 0.0, first], std)
        out = kalman.core.run(y, u)
        return out["innovation"], out["variance"], out["status"] & NOT_USED == 0

    def replace(self, **changes: object) -> LoopModel:
        """Return the model with other values; ``magnet__air_gap=...`` goes to the bearing.

        Raises
        ------
        ConfigError
            The bearing would contradict itself.
        """
        own = {name: value for name, value in changes.items() if "__" not in name}
        of_bearing = {name: value for name, value in changes.items() if "__" in name}
        model = replace(self, **own) if own else self  # type: ignore[arg-type]
        if not of_bearing:
            return model
        if "magnet__magnet_constant" in of_bearing:
            # A constant from turns and pole area would contradict the one that was found.
            of_bearing |= {"magnet__turns": None, "magnet__pole_area": None}
        return replace(model, bearing=self.bearing.replace(**of_bearing))


NOT_USED = 1 | 2 | 16
"""Flags of :class:`ambkit.Status` with which a measurement was not taken in."""


def delayed(u: Array, samples: float) -> Array:
    """Return what acts in each sample where a held signal comes later, possibly by a fraction.

    Parameters
    ----------
    u : ndarray (n,)
        The signal; element k is held from sample k to k + 1. Before the first it is the first.
    samples : float
        Delay in samples; negative: the signal acts before the log says so.

    Raises
    ------
    AmbkitError
        The delay is longer than the signal.
    """
    if abs(samples) > u.size - 2:
        raise AmbkitError(f"a delay of {samples:.3g} samples is longer than the record, {u.size}")
    whole = math.floor(samples)
    part = samples - whole
    if whole == 0 and part == 0:
        return u
    last = u.size - 1
    now = u[np.clip(np.arange(u.size) - whole, 0, last)]
    if part == 0:  # and a missing value beside does no harm
        return now
    before = u[np.clip(np.arange(u.size) - whole - 1, 0, last)]
    return np.asarray((1 - part) * now + part * before)


def lagged(u: Array, T: float, lag: float) -> Array:
    """Return the mean over each sample of a held signal that has passed a first-order lag.

    Parameters
    ----------
    u : ndarray (n,)
        The signal, in its equilibrium at the start.
    T : float
        Sampling time [s].
    lag : float
        Time constant [s]; 0: none.
    """
    if lag < 1e-3 * T:
        return u
    from scipy.signal import lfilter

    good = np.where(np.isfinite(u), u, np.interp(np.arange(u.size), *_finite(u)))
    keep = math.exp(-T / lag)
    # State at the start of each sample: w[k] = keep w[k-1] + (1 - keep) u[k-1], w[0] = u[0].
    follow, _ = lfilter([0.0, 1 - keep], [1.0, -keep], good, zi=[good[0]])
    return np.asarray(good + (follow - good) * (lag / T) * (1 - keep))


def _finite(u: Array) -> tuple[Array, Array]:
    at = np.flatnonzero(np.isfinite(u))
    if not at.size:
        return np.zeros(1), np.zeros(1)
    return at.astype(float), u[at]
