"""Signs of a record's channels and timing of its control signal, by model predictions.

A model with a reversed channel, or a shifted control signal, predicts a record worse.

The log likelihood of the innovations (Schweppe 1965) is valid in closed loop, for any controller:
predictions depend on the past only. Noise intensities are fitted for each hypothesis, so that the
likelihood ratio depends on the signs only.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ambkit.base.arrays import block_means, interpolated
from ambkit.base.errors import ConfigError
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.angle import estimate_angle
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.noise_model import FilterNoise
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import own_time

LEAST_TOTAL, LEAST_MEAN = 10.0, 0.02
"""Log-likelihood ratio, in total and per instant, above which the test is decisive. Records with
the right signs have at least 0.05 per instant, even with a step of 30 standard deviations.
"""

_BLOCK = 0.25
"""Length of the predicted means, in time constants of the rotor: faster dynamics of converters,
filters and amplifiers do not matter.
"""

_FEWEST = 200  # minimum number of means

_SHIFTS = (-1.0, -0.5, -0.25, 0.25, 0.5, 1.0)
"""Shift of the control signal that is tried, in time constants of the rotor."""

_BENDING, _RIGID = 600, 24000  # number of instants evaluated, the last ones

_INTENSITIES = (1e-3, 1.0, 1e3)  # of the disturbance force, relative to the default

_OUTLIER = 16.0  # squared normalised innovation beyond which a measurement is not informative

_MEDIAN = 0.455  # of chi-square with one degree of freedom


class SignTest(NamedTuple):
    """The channel whose reversed sign the model prefers most."""

    channel: str
    #: Log likelihood ratio of the record with it reversed to the record as logged.
    log_likelihood_ratio: float
    instants: int

    @property
    def decisive(self) -> bool:
        """Whether the test is decisive."""
        least = max(LEAST_TOTAL, LEAST_MEAN * self.instants)
        return abs(self.log_likelihood_ratio) > least

    @property
    def wrong(self) -> bool:
        """Whether the sign is wrong."""
        return self.decisive and self.log_likelihood_ratio > 0


def channels(machine: Machine) -> list[str]:
    """Return the names of all positions and control signals of a record of a machine."""
    positions = [signal("y", reading.name) for reading in machine.readings]
    return positions + [signal("u", axis.name) for axis in machine.axes]


def sign_test(record: Record, machine: Machine) -> SignTest | None:
    """Try each channel with its sign reversed; None if there is nothing to predict."""
    names = channels(machine)
    if any(name not in record or not np.ptp(interpolated(record[name])) for name in names):
        return None
    prediction = _Prediction(record, machine, names)
    if prediction.n < 20:
        return None
    as_it_is = prediction.best()
    # With one axis the model is invariant to reversing both.
    candidates = names[1:] if len(machine.axes) == 1 else names
    ratios = {name: prediction.best(name) - as_it_is for name in candidates}
    channel = max(ratios, key=lambda name: ratios[name])
    return SignTest(channel, ratios[channel], prediction.n)


class _Prediction:
    """Means of a record, predicted by the linear model of a machine."""

    def __init__(self, record: Record, machine: Machine, names: list[str]) -> None:
        rigid = machine.bending is None
        block = _BLOCK * min(map(own_time, isolated_axes(machine))) / machine.sampling_time
        block = min(block, len(record) / _FEWEST) if rigid else 1
        at_known_speed = machine.model_copy(update={"angle": None})
        self.filters, k = _filters(at_known_speed, max(1, round(block)))
        # Positions are averaged around the instant at which the control signal's mean begins to
        # act.
        columns = {
            name: block_means(record[name], k) if name[0] == "y"
            else block_means(interpolated(record[name]), k, k // 2)
            for name in names
        }  # fmt: skip
        if machine.angle is not None:
            columns["speed"] = block_means(estimate_angle(machine, record).speed, k)
        elif "speed" in record:
            columns["speed"] = block_means(interpolated(record["speed"]), k)
        self.n = min(map(len, columns.values()))
        last = _RIGID if rigid else _BENDING
        self.columns = {name: values[: self.n][-last:] for name, values in columns.items()}
        self.n = min(self.n, last)
        self.t = self.filters[0].machine.sampling_time * np.arange(self.n)
        self.units = {name: record.units.get(name, "rad/s") for name in columns}

    def best(self, reversed_channel: str = "") -> float:
        """Return the log likelihood with a channel reversed, for the best noise."""
        signals = dict(self.columns)
        if reversed_channel:
            signals[reversed_channel] = -signals[reversed_channel]
        record = Record(self.t, signals, self.units)
        return max(self._log_likelihood(one, record) for one in self.filters)

    def _log_likelihood(self, kalman: KalmanFilter, record: Record) -> float:
        """Return it for the best scale of all noise, with a limit on outliers."""
        estimate = kalman.run(record)
        e, S = estimate.innovation[self.n // 50 :], estimate.innovation_variance[self.n // 50 :]
        taken = (S > 0) & (e != 0) & np.isfinite(e)
        nis = e[taken] ** 2 / S[taken]
        if not nis.any():
            return -np.inf
        scale = float(np.median(nis)) / _MEDIAN
        for _ in range(10):
            scale *= float(np.minimum(nis / scale, _OUTLIER).mean())
        return -0.5 * float(np.sum(np.log(scale * S[taken]) + np.minimum(nis / scale, _OUTLIER)))


def _filters(machine: Machine, k: int) -> tuple[list[KalmanFilter], int]:
    """Return filters of means over k samples, or of single samples if modes are faster."""
    try:
        slow = machine.replace(sampling_time=k * machine.sampling_time)
    except ConfigError:
        slow, k = machine, 1
    usual = KalmanFilter(slow).variances
    steps = np.array([reading.sensor.quantisation or 0.0 for reading in machine.readings])
    # A mean has no quantisation step: its rounding is noise.
    R = np.array(usual.measurement) + steps**2 / 4
    return [
        KalmanFilter(
            slow,
            noise=FilterNoise(
                R.tolist(), usual.control, (factor * np.array(usual.disturbance)).tolist()
            ),
            gravity="disturbance",
            frozen_limit=0,
            synchronous=("unbalance", "runout") if machine.turns else (),
        )
        for factor in _INTENSITIES
    ], k


def judge_signs(record: Record, machine: Machine) -> Iterator[tuple[bool, str]]:
    """Yield the sentence on a wrong sign, or that a record does not determine it (False)."""
    result = sign_test(record, machine)
    if result is None:
        return
    if result.decisive and not result.wrong:
        yield from _timing(record, machine)
        return
    name = result.channel
    what = "y or of u" if len(machine.axes) == 1 else f"{name}, or of what belongs to its axis,"
    if result.wrong:
        yield (
            True,
            f"the sign of {what} is wrong: with {name} reversed the model predicts the record "
            f"better, by {result.log_likelihood_ratio:.0f} of log likelihood in "
            f"{result.instants} means",
        )
    elif result.instants > _FEWEST // 2:
        yield (
            False,
            f"the record does not determine the signs of y and u: the log-likelihood ratio of "
            f"{result.instants} means is {-result.log_likelihood_ratio:.1f}; is "
            "the rotor moved by this control signal?",
        )


def _timing(record: Record, machine: Machine) -> Iterator[tuple[bool, str]]:
    """Yield that the control signal of an isolated axis acts at another instant than logged."""
    if not machine.single:
        return
    names, u = channels(machine), interpolated(record["u"])
    as_it_is, own = _Prediction(record, machine, names), own_time(machine)
    best, shift = -np.inf, 0.0
    for samples in {round(share * own / record.sampling_time) for share in _SHIFTS} - {0}:
        shifted = u[np.clip(np.arange(u.size) - samples, 0, u.size - 1)]
        moved = replace(record, signals={**record.signals, "u": shifted})
        likelihood = _Prediction(moved, machine, names).best()
        best, shift = max((best, shift), (likelihood, samples * record.sampling_time))
    gain = best - as_it_is.best()
    if gain > max(LEAST_TOTAL, LEAST_MEAN * as_it_is.n):
        cause = "is the machine's delay longer, or u" if shift > 0 else "is u"
        yield (
            False,
            f"with u about {engineering(abs(shift), 's', digits=2)} "
            f"{'later' if shift > 0 else 'earlier'} the model predicts the record better, by "
            f"{gain:.0f} of log likelihood in {as_it_is.n} means: {cause} logged "
            f"{'early' if shift > 0 else 'late'}?",
        )
