"""Line noise of the measured position, such as mains hum: detected, and modelled if significant.

The innovations of a model without line noise are white except for the lines, which stand out of the
periodogram. Each line is an oscillator of two states with slowly varying amplitude and phase
(`ambkit.machine.accessories.Hum`), fitted by the likelihood. A superfluous oscillator would take
the rotor's motion for noise, so a line is added only if the likelihood increases by more than three
parameters do by chance (Schwarz 1978), and none is sought at frequencies of the rotor's own motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import ConfigError
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.likelihood import Data
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import Parameter
from ambkit.identification.maximum_likelihood.search import maximise
from ambkit.machine.accessories import Hum
from ambkit.machine.magnets import own_time

MOST = 4  #: Maximum number of lines.
LONGEST = 16384  #: Samples of a periodogram; those of longer records are averaged.
BY_CHANCE = 1e-3  #: Probability of a false line in noise.

ENOUGH = 0.1
"""Newton's decrement that ends a search for a line; a final search follows."""

FIGURES = 3  #: Parameters of a line: frequency, amplitude, bandwidth.
SLOWEST = 2.0  #: Minimum frequency of a line, over the inverse of the plant's time constant.

NARROWEST = 0.001
"""Share of a record's inverse duration below which a bandwidth is not significant."""

AROUND = 101
"""Neighbouring frequencies whose median is the level without a line."""


def with_lines(
    data: Data,
    model: LoopModel,
    parameters: list[Parameter],
    note: Callable[[str], object] = lambda _: None,
) -> LoopModel:
    """Return a model with the lines of records, and all other parameters fitted again."""
    for _ in range(MOST):
        e, S, used = data.likelihood(model, []).innovations(np.zeros(0))
        before = -0.5 * float(np.sum(np.log(2 * np.pi * S[used]) + e[used] ** 2 / S[used]))
        line = _candidate(data.records, model)
        if line is None:
            break
        note(f"a line at {engineering(line.frequency, 'Hz', 3)}?")
        candidate_model = _fitted(data, model, line)
        if candidate_model is None:
            break
        if parameters:
            candidate_model = maximise(data, candidate_model, parameters, ENOUGH).model
            *others, last = candidate_model.isolated.sensor.hum
            others_model = candidate_model.replace(sensor__hum=tuple(others))
            candidate_model = _fitted(data, others_model, last) or candidate_model
        gain = data.log_likelihood(candidate_model) - before
        if gain < FIGURES / 2 * math.log(max(int(used.sum()), 2)):
            break
        model = candidate_model
    return model


def _candidate(records: Sequence[Record], model: LoopModel) -> Hum | None:
    """Return the most significant peak in the periodogram of the residuals, or None."""
    from scipy.ndimage import median_filter
    from scipy.stats import gamma

    T = model.isolated.sampling_time
    length = min(LONGEST, *(len(record) - 1 for record in records))
    if length < 4 * AROUND:
        return None
    power, count, size = np.zeros(length // 2 + 1), 0, 0.0
    for record in records:
        e, S, used = model.innovations(record)
        r = np.where(used, e / np.sqrt(S), 0.0)[1:]
        size = math.sqrt(float(np.mean(S)))
        for at in range(0, r.size - length + 1, length):
            power += np.abs(np.fft.rfft(r[at : at + length])) ** 2 / length
            count += 1
    power /= count
    # Below, the rotor itself moves; at the other end noise has no phase.
    lowest = math.ceil(SLOWEST * length * T / (2 * math.pi * own_time(model.isolated)))
    inner = slice(max(lowest, 3), math.floor(0.98 * power.size))
    if inner.stop - inner.start < AROUND:
        return None
    floor = median_filter(power, AROUND, mode="nearest") / _median(count)
    over = power[inner] / np.maximum(floor[inner], 1e-12)
    at = int(np.argmax(over))
    if over[at] < gamma.isf(BY_CHANCE / over.size, count) / count:
        return None
    at += inner.start
    amplitude = size * math.sqrt(4 * float(power[at]) / length)
    return Hum(frequency=at / (length * T), amplitude=amplitude, bandwidth=0.3 / (length * T))


def _median(count: int) -> float:
    """Return the median of a mean of periodograms of white noise, over its mean."""
    from scipy.stats import gamma

    return float(gamma.median(count)) / count


def _fitted(data: Data, model: LoopModel, line: Hum) -> LoopModel | None:
    """Return the model with one more line, with parameters of maximum likelihood."""
    from scipy.optimize import minimize

    T = model.isolated.sampling_time
    longest = T * max(len(record) for record in data.records)

    def at(z: Array) -> LoopModel:
        bandwidth = line.bandwidth * math.exp(min(float(z[2]), 50.0))
        one = Hum(
            frequency=line.frequency + float(z[0]) / longest,
            amplitude=line.amplitude * math.exp(float(z[1])),
            bandwidth=float(np.clip(bandwidth, NARROWEST / longest, 0.1 * line.frequency)),
        )
        return model.replace(sensor__hum=(*model.isolated.sensor.hum, one))

    def cost(z: Array) -> float:
        try:
            return -data.log_likelihood(at(z))
        except ConfigError:
            return math.inf

    begin = np.zeros(FIGURES)
    simplex = np.vstack([begin, 0.7 * np.eye(FIGURES) * [1.0, 1.0, 3.0]])
    result = minimize(
        cost, begin, method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.02, "fatol": 0.05, "maxfev": 60},
    )  # fmt: skip
    if not math.isfinite(result.fun):
        return None
    return _as_large_as_it_is(data.records, at(result.x))


def _as_large_as_it_is(records: Sequence[Record], model: LoopModel) -> LoopModel:
    """Return the model with the amplitude of its last line as estimated by the filter."""
    # For a narrow line a record is one realisation, and its likelihood nearly flat.
    squares = []
    for record in records:
        parts = model.states(record)
        number = len(model.isolated.sensor.hum)
        name = f"hum{number}" if number > 1 else "hum"
        both = parts[f"{name}_c"] ** 2 + parts[f"{name}_s"] ** 2
        squares.append(both[both.size // 4 :])
    *others, last = model.isolated.sensor.hum
    amplitude = math.sqrt(float(np.mean(np.concatenate(squares))))
    if not amplitude > 0:
        return model
    return model.replace(sensor__hum=(*others, last.model_copy(update={"amplitude": amplitude})))
