"""External inputs of a run: forces, noise, faults, the angle, and the user's plant."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import OwnPart
from ambkit.machine.accessories import AngleSensor
from ambkit.machine.machine import Machine
from ambkit.simulation.recording import STREAMS, Stream
from ambkit.simulation.scenario import Scenario

NONE = {"late": 0.0, "y_times": 1.0, "y_plus": 0.0, "u_times": 1.0, "u_plus": 0.0, "current": 1.0}
"""Values of `Faults` without a fault."""


@dataclass(frozen=True, eq=False)
class Faults:
    """Faults of sensors, control signals and amplifiers, one value per sample, all (n,)."""

    # With several axes (n, readings) for measurements, and (n, axes) for the rest.

    #: Delay of the measurement in samples, at least 0, interpolated linearly. A delay that grows by
    #: 1 per sample is a stuck sensor [samples].
    late: Array
    #: Factor on the measurement [1], and offset [m].
    y_times: Array
    y_plus: Array
    #: The same for the control signal reported to the estimator [1], [V]; the amplifier gets the
    #: true one.
    u_times: Array
    u_plus: Array
    #: Remaining share of the amplifier's range, unknown to controller and estimator [1].
    current: Array
    #: Whether a controller with measurement feedback gets the true measurement.
    beside: bool = False

    @classmethod
    def none(cls, n: int, *, beside: bool = False) -> Faults:
        """Return n samples without a fault."""
        return cls(**{name: np.full(n, value) for name, value in NONE.items()}, beside=beside)

    def among(self, reading: int, readings: int, axis: int, axes: int) -> Faults:
        """Return the same faults for one of several readings, and for one of several axes."""
        if readings == axes == 1:
            return self
        results = {}
        for name, series in self.series.items():
            of_reading = name.startswith(("late", "y_"))
            k, columns = (reading, readings) if of_reading else (axis, axes)
            results[name] = np.full((len(series), columns), NONE[name])
            results[name][:, k] = series
        return Faults(**results, beside=self.beside)

    @property
    def series(self) -> dict[str, Array]:
        """All series by name."""
        return {name: item for name, item in vars(self).items() if name != "beside"}


@dataclass(frozen=True, eq=False)
class ExternalInputs:
    """External series of a run, one value per sample."""

    # With p axes and m readings; for a single axis each is (n,) or (n, 1).

    #: (n, p) Force on the rotor, added to the scenario's [N].
    disturbance: Array | None = None
    #: (n, m) Noise of the measured positions, in place of the sensors' own [m].
    sensor_noise: Array | None = None
    #: (n,) Factor on the force of the plant's magnets, such as a drifting magnet constant [1]. The
    #: initial equilibrium is that for a factor of 1.
    magnet_scale: Array | None = None
    #: Faults of sensors, control signals and amplifiers. The record's y and u are those of the
    #: estimator, with NaN for infinity.
    faults: Faults | None = None
    #: Initial position of the rotor [m], with several axes (p,). Controller and estimator start as
    #: in equilibrium at the reference.
    place: float | Array | None = None
    #: (n, m) Added to the measured positions [m]; NaN: lost.
    readings: Array | None = None
    #: (n, p) Added to the references after the start [m]; NaN: none.
    references: Array | None = None
    #: (n,) With a sequence, the command to levitate [1]; by default as in the sequence.
    fly: Array | None = None
    #: As in an export: fields of ``amb_control`` with values other than the sequence's, and an
    #: estimator that starts at its first readings.
    exported: dict[str, Any] | None = None


_OF_READINGS = ("sensor_noise", "readings", "fault late", "fault y_times", "fault y_plus")


def columns(name: str, axes: int, readings: int) -> int:
    """Return the number of columns of a series."""
    if name in ("magnet_scale", "fly"):
        return 1
    return readings if name in _OF_READINGS else axes


def as_series(external_inputs: ExternalInputs) -> Iterator[tuple[str, Array]]:
    """All series that must be finite, by name."""
    for name in ("disturbance", "sensor_noise", "magnet_scale", "readings", "references", "fly"):
        if getattr(external_inputs, name) is not None:
            yield name, getattr(external_inputs, name)
    if external_inputs.faults is not None:
        yield from (
            (f"fault {name}", values) for name, values in external_inputs.faults.series.items()
        )


@runtime_checkable
class PlantProtocol(Protocol):
    """Interface of the user's plant.

    The class is constructed with the machine, or without arguments, for each run. It is named as
    ``file.py:Class``; in Python the class itself is passed. Noise, quantisation and current limits
    are those of the described machine.
    """

    def step(self, iu: Any, f_d: Any) -> ArrayLike:
        """Move the rotor on to the next sample.

        Parameters
        ----------
        iu : float or ndarray (p,)
            Control current with noise and limits, held over the sample [A]; with several axes all.
        f_d : float or ndarray (p,)
            Disturbance force, held over the sample [N].

        Returns
        -------
        array_like (3,) or (2 q + m,)
            Displacement x [m], velocity v [m/s] and sensor output without noise x_m [m]; with
            several axes displacements and velocities of the rotor's coordinates,
            `Machine.positions`, and all sensor outputs. The run starts at the initial state of the
            described machine.
        """


class OwnPlant(OwnPart):
    """An object with ``step(iu, f_d)``, for the loop in C; see `PlantProtocol`."""

    def __init__(self, make: Any, machine: Machine) -> None:
        self._count = 2 * len(machine.positions) + len(machine.readings)
        super().__init__(
            make, machine, "step(iu, f_d)", f"{self._count} numbers, see PlantProtocol"
        )

    def __call__(self, iu: list[float], f_d: list[float], _: list[float]) -> list[float]:
        """Return displacements, velocities and readings, and that no stop was touched."""
        return [*self.numbers(self._count, self.plain(iu), self.plain(f_d)), 0.0]


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
