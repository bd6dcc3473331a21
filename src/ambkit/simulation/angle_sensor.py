"""Readings of the angle sensor along a run."""

from __future__ import annotations

import math

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.machine.accessories import AngleSensor
from ambkit.machine.machine import Machine
from ambkit.simulation.recording import STREAMS, Stream
from ambkit.simulation.scenario import Scenario

OWN = STREAMS * 1000  #: Streams of the angle sensor: after those of all axes.


def angles(speed: Array, T: float) -> Array:
    """Return the angle at samples (n,) for a speed that is linear in between (n,) [rad]."""
    return np.asarray(np.concatenate([[0.0], np.cumsum(T * (speed[:-1] + speed[1:]) / 2)]))


def angle_readings(machine: Machine, scenario: Scenario, speed: Array) -> Array:
    """Return the readings of the angle sensor at samples (n,); NaN where there are none."""
    sensor, T = machine.angle, machine.sampling_time
    assert sensor is not None  # callers have one
    stream = Stream(scenario.seed, scenario.run, OWN)
    on = 1.0 if scenario.noise else 0.0
    # The errors of latency and gain are drawn once for the run.
    late, gain = on * stream.normal(1.0, 2) * (sensor.latency_error, sensor.gain_error)
    white = on * stream.next().normal(1.0, len(speed))
    t, angle = T * np.arange(len(speed), dtype=float), angles(speed, T)
    latency = max(0.0, sensor.latency + float(late))
    if sensor.type == "speed":
        seen = np.interp(t - latency, t, speed)
        return np.asarray((1 + gain) * seen + sensor.speed_noise * white)
    if sensor.type == "encoder":
        step = 2 * math.pi / sensor.per_turn
        seen = np.interp(t - latency, t, angle) + sensor.angle_noise * white
        return np.asarray(step * np.floor(seen / step + 0.5))
    return _pulses(sensor, t, angle, latency, white)


def _pulses(sensor: AngleSensor, t: Array, angle: Array, latency: float, white: Array) -> Array:
    """Return the time since a pulse within the last sample (n,) [s]."""
    T = t[1]
    marks = angle * sensor.per_turn / (2 * math.pi)
    if np.abs(np.diff(marks)).max() > 1:
        raise AmbkitError(
            f"angle.per_turn: {sensor.per_turn} pulses a turn come more than one a sample; must be "
            'fewer, or of an "encoder"'
        )
    # A pulse occurs where the angle passes a mark with noise; segments of one direction begin where
    # the rotor reverses.
    way = np.sign(np.diff(angle))
    ends = np.flatnonzero(np.diff(way) != 0) + 1
    result, used = np.full(len(t), np.nan), 0
    for begin, end in zip([0, *ends], [*ends, len(t) - 1], strict=True):
        low, high = sorted((marks[begin], marks[end]))
        passed = np.arange(math.ceil(low), math.floor(high) + 1)
        noise = sensor.angle_noise * white[used : used + len(passed)]
        used += len(passed)
        moved = 2 * math.pi * passed / sensor.per_turn + noise
        stretch = slice(begin, end + 1)
        forward = 1 if marks[end] >= marks[begin] else -1
        at = np.interp(moved, angle[stretch][::forward], t[stretch][::forward], np.nan, np.nan)
        came = at[np.isfinite(at)] + latency
        sample = np.ceil(came / T - 1e-9).astype(int)
        inside = sample < len(t)
        result[sample[inside]] = np.clip(t[sample[inside]] - came[inside], 0.0, None)
    return result
