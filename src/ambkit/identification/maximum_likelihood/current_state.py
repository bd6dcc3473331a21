"""The current as a state that is measured and driven, for a noisy current sensor.

The noise of a current sensor moves no rotor: if it were taken for current, a low-noise loop would
seem to have a weaker magnet. If a record has the control signal too, the current is estimated from
both::

    i+ = a i + (1 - a) (G (u - u0)) + w,      a = exp(-T/tau),      i_m = i + v

by the stationary Kalman filter with maximum likelihood parameters, and smoothed (Rauch, Tung and
Striebel 1965). Given the control signal, it depends on ``w`` only, and is independent of the
position's noise. The remaining uncertainty, a first-order process with `CurrentState.memory`, is a
state of the position's filter, so the likelihood of both signals is exact for a constant tau. In a
loop the control signal depends on ``w`` through the rotor: coil and loop are then estimated jointly
(`joint`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.data.signals import CONTROL
from ambkit.identification.maximum_likelihood.loop_model import LoopModel

LAGS, DELAYS = (3.0, 10.0, 30.0, 100.0), (-0.5, 0.3, 1.5, 2.5, 3.5, 5.5)
"""Lags in samples from which the search starts."""

LEAST_STRAY = math.log(1e-4)
"""Variance of the current's deviation per sample, over that of the sensor: no coil is exact."""

LONGEST_TIME = 2000
"""Time constant of a coil in samples beyond which its control drives no current."""

LEAST_SAMPLES = 500  #: Minimum number of samples of all records for the identification of a coil.
FIGURES = 3  #: Parameters of a control beyond the current's own past: gain, zero and delay.

INSUFFICIENT_EXCITATION = (
    "the noise of the measured current is a good part of what the current does: it passes for a "
    "delay below zero and biases the magnet; with the signal that drives the current, control in "
    "the channel map, what flows could be told"
)

QUIET = 0.1
"""Rms noise of a current, over its change within the plant's time constant, that is acceptable."""


def is_interpolated(record: Record) -> bool:
    """Return whether the control signal of a record is a measured current."""
    # Its channel map states it, or the record also has the current's control signal.
    return "u" in record.meta.get("measured", ()) or CONTROL in record


@dataclass(frozen=True, eq=False)
class CurrentState:
    """Smoothed current from control signals and measured currents."""

    records: Sequence[Record]  #: Records with the smoothed current in place of the measured one.
    gain: float  #: Static gain G: current per unit of the control signal [A].
    zero: float  #: ``-G u0``: control current at a control signal of zero [A].
    lag: float  #: tau, time constant of the coil [s].
    delay: float  #: Dead time from the control signal to the current [s].
    noise: float  #: Of the current's sensor, standard deviation [A].
    unknown: float  #: Standard deviation of the smoothed current [A].
    memory: float  #: Correlation time of a deviation [s].
    #: Amplifier gain of the machine: control current per control signal of the record [A/V].
    amplifier_gain: float
    coil: Coil  #: The coil in samples and volts.

    @property
    def text(self) -> str:
        """Result, as a sentence."""
        return (
            f"the measured current has a noise of {engineering(self.noise, 'A', 2)}; with the "
            f"control signal, which the coil follows with a lag of "
            f"{engineering(self.lag, 's', 3)} after {engineering(self.delay, 's', 2)}, it is "
            f"estimated to {engineering(self.unknown, 'A', 2)}"
        )

    def driving(self, model: LoopModel) -> LoopModel:
        """Return a model whose filter has the true current as a state."""
        T = model.isolated.sampling_time
        return model.replace(memory=self.memory, amplifier__noise_variance=self._is_implausible(T))

    def measuring(self, model: LoopModel) -> LoopModel:
        """Return a model for the measured current, with all of its noise."""
        result, T = model.isolated.amplifier.noise_variance, model.isolated.sampling_time
        sensor = (self.noise / self.amplifier_gain) ** 2
        noise = max(sensor + result - self._is_implausible(T), 0.1 * sensor)
        return model.replace(memory=0.0, amplifier__noise_variance=noise)

    def _is_implausible(self, T: float) -> float:
        """Return the variance of the deviation from the control in each sample of T [s], [V^2]."""
        # Behind the lag `memory` the deviation is `unknown`.
        keep = math.exp(-T / self.memory)
        return (self.unknown / self.amplifier_gain) ** 2 * (1 + keep) / (1 - keep)

    def to_dict(self) -> dict[str, float]:
        """Return the figures as plain data, SI."""
        names = ("gain", "zero", "lag", "delay", "noise", "unknown", "memory")
        return {name: float(getattr(self, name)) for name in names}


def insufficient_excitation(records: Sequence[Record], own_time: float) -> bool:
    """Return whether noise is much of the current's change in the plant's time constant."""
    changes, noise = [], []
    for record in records:
        u = record["u"][np.isfinite(record["u"])]
        ahead = max(2, round(own_time / record.sampling_time))
        if u.size > 2 * ahead:
            changes.append(u[ahead:] - u[:-ahead])
            noise.append(np.diff(u, 3))
    if not noise:
        return False
    white = float(np.mean(np.concatenate(noise) ** 2)) / 20
    return white > QUIET**2 * float(np.var(np.concatenate(changes)))


def smooth_current(records: Sequence[Record], amplifier_gain: float = 1.0) -> CurrentState | None:
    """Smooth a measured current with its control signal."""
    is_complete = all(
        CONTROL in record and np.isfinite(record[CONTROL]).all() and np.isfinite(record["u"]).all()
        for record in records
    )
    if not is_complete or sum(len(record) for record in records) < LEAST_SAMPLES:
        return None
    pairs = [(record["u"], record[CONTROL]) for record in records]
    if not all(np.ptp(i) > 0 and np.ptp(u) > 0 for i, u in pairs):
        return None
    coil = _fitted(pairs)
    if coil is None or not _follows(coil, pairs):
        return None
    if sum(len(i) - coil.settled for i, _ in pairs) < LEAST_SAMPLES / 2:
        return None
    return propagate(coil, records, amplifier_gain)


def propagate(coil: Coil, records: Sequence[Record], amplifier_gain: float) -> CurrentState:
    """Return the current that follows the control through a coil."""
    T, scale, back = records[0].sampling_time, abs(amplifier_gain), coil.back
    innovations = [coil.predicted(r["u"], r[CONTROL])[1][coil.settled :] for r in records]
    sensor = float(np.mean(np.concatenate(innovations) ** 2)) / (coil.before + 1)
    unknown = (coil.before / (coil.before + 1) - back**2 * coil.before) / (1 - back**2)
    flows = [
        {name: r[name] for name in r} | {"u": coil.smoothed(r["u"], r[CONTROL])} for r in records
    ]
    return CurrentState(
        [Record(r.t, flow, r.units, r.meta) for r, flow in zip(records, flows, strict=True)],
        coil.gain * amplifier_gain, coil.zero * amplifier_gain, coil.lag * T, coil.delay * T,
        scale * math.sqrt(sensor), scale * math.sqrt(sensor * max(unknown, 0.0)),
        -T / math.log(max(back, 1e-300)), amplifier_gain, coil,
    )  # fmt: skip


@dataclass(frozen=True)
class Coil:
    """A coil with the stationary filter of its current, times in samples."""

    lag: float
    delay: float
    gain: float
    zero: float
    stray: float  #: Variance of w, over that of the sensor's noise.

    @classmethod
    def at(cls, theta: Array) -> Coil:
        """Return the coil at a point of the search."""
        lag, strays = np.exp(np.clip(theta[[0, 4]], [-20, LEAST_STRAY], 20)).tolist()
        delay, gain, zero = theta[1:4].tolist()  # below zero too, otherwise it would bias the lag
        return cls(min(lag, LONGEST_TIME), min(max(delay, -5.0), 50.0), gain, zero, strays)

    @property
    def theta(self) -> Array:
        """Coordinates of the search (5,): logarithms of lag and stray, delay, gain and zero."""
        return np.array(
            [math.log(self.lag), self.delay, self.gain, self.zero, math.log(self.stray)]
        )

    @property
    def settled(self) -> int:
        """Samples after which the initial current is forgotten."""
        return round(5 * self.lag)

    @property
    def keep(self) -> float:
        """Share of a deviation of the current that remains after a sample."""
        return math.exp(-1 / self.lag)

    @property
    def before(self) -> float:
        """Variance of the predicted current, over that of the sensor's noise."""
        # The root of ``P = a^2 P/(P + 1) + q``.
        half = 0.5 * (self.keep**2 + self.stray - 1)
        return half + math.sqrt(half**2 + self.stray)

    @property
    def gain_of_filter(self) -> float:
        """Gain of the stationary filter."""
        return self.before / (self.before + 1)

    @property
    def back(self) -> float:
        """Gain of the smoother, and remaining share of the current's deviation after a sample."""
        return self.keep / (self.before + 1)

    def predicted(self, measured: Array, control: Array) -> tuple[Array, Array]:
        """Predict a measured current (n,) from its past and its start; with the innovations."""
        from scipy.signal import lfilter

        a, K, integer_part = self.keep, self.gain_of_filter, math.floor(self.delay)
        part, k = self.delay - integer_part, np.arange(measured.size)
        now, earlier = (
            self.gain * control[np.clip(k - integer_part - more, 0, k[-1])] + self.zero
            for more in (0, 1)
        )
        first, then = math.exp(-part / self.lag), math.exp(-(1 - part) / self.lag)
        drive = then * (1 - first) * earlier + (1 - then) * now
        known = a * K * measured + drive
        predicted = np.empty(measured.size)
        predicted[0] = measured[0]
        start = [a * (1 - K) * measured[0]]
        predicted[1:], _ = lfilter([1.0], [1.0, -a * (1 - K)], known[:-1], zi=start)
        # Its start is not the first measurement, but the best fit of all.
        forgets = (a * (1 - K)) ** k
        predicted += forgets * (forgets @ (measured - predicted) / (forgets @ forgets))
        return predicted, measured - predicted

    def smoothed(self, measured: Array, control: Array) -> Array:
        """Return the current (n,) from all of its measurements."""
        from scipy.signal import lfilter

        predicted, innovation = self.predicted(measured, control)
        filtered = predicted + self.gain_of_filter * innovation
        back = self.back
        filtered[:-1] -= back * predicted[1:]
        last = predicted[-1] + self.gain_of_filter * innovation[-1]
        backwards, _ = lfilter([1.0], [1.0, -back], filtered[-2::-1], zi=[back * last])
        return np.append(backwards[::-1], last)


def _fitted(pairs: Sequence[tuple[Array, Array]]) -> Coil | None:
    """Return the coil whose filter predicts the measured currents best, or None."""
    from scipy.optimize import least_squares

    def misses(theta: Array) -> Array:
        one = Coil.at(theta)
        return np.concatenate([one.predicted(i, u)[1][1:] for i, u in pairs])

    def begin(lag: float, delay: float) -> Array:
        driven = Coil(lag, delay, 1.0, 0.0, 1e-9)  # by the control only
        current, unit = (
            np.concatenate(column)
            for column in zip(*((i, driven.predicted(i, u)[0]) for i, u in pairs), strict=True)
        )
        gain, zero = np.polyfit(unit, current, 1).tolist()
        return np.array([math.log(lag), delay, gain, zero, math.log(0.01)])

    begins = [theta for lag in LAGS for delay in DELAYS if (theta := begin(lag, delay))[2] > 0]
    if not begins:
        return None
    begins.sort(key=lambda theta: float(np.sum(misses(theta) ** 2)))
    # The delay is continuous within a sample; at whole samples there are kinks.
    others = [theta for theta in begins if math.floor(theta[1]) != math.floor(begins[0][1])]
    ends = [
        least_squares(
            misses,
            theta,
            x_scale=np.array([0.1, 0.3, *(0.1 * max(theta[2], abs(theta[3])),) * 2, 1.0]),
            diff_step=np.full(5, 1e-4),
            max_nfev=60,
        )
        for theta in (begins[0], *others[:1])
    ]
    result = min(ends, key=lambda one: one.cost)
    best = Coil.at(result.x)
    return best if best.gain > 0 and best.lag < 0.9 * LONGEST_TIME else None


def _follows(coil: Coil, pairs: Sequence[tuple[Array, Array]]) -> bool:
    """Return whether the control predicts the current better than its past (Schwarz 1978)."""
    from scipy.optimize import least_squares

    def misses(theta: Array) -> Array:
        lag, stray = np.exp(np.clip(theta[:2], -20, 20)).tolist()
        undriven_coil = replace(
            coil, lag=min(lag, LONGEST_TIME), gain=0.0, zero=theta[2], stray=stray
        )
        return np.concatenate([undriven_coil.predicted(i, u)[1][1:] for i, u in pairs])

    begin = np.array([math.log(coil.lag), math.log(coil.stray) + 3, float(np.mean(pairs[0][0]))])
    undriven = least_squares(misses, begin, diff_step=np.full(3, 1e-4), xtol=1e-4, ftol=1e-5)
    driven = np.concatenate([coil.predicted(i, u)[1][1:] for i, u in pairs])
    gained = 0.5 * driven.size * math.log(2 * undriven.cost / float(driven @ driven))
    return gained > FIGURES * math.log(driven.size)
