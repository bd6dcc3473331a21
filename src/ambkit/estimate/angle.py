"""The rotor's angle from the readings of its sensor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.base.units import percent
from ambkit.data.record import Record
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.status import Status
from ambkit.machine.accessories import SENSORS, AngleSensor
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import Precision, core_module

LEVEL = "keyphasor"  #: Signal of a record whose level rises where a mark passes.


class AngleStatus(IntFlag):
    """What a step has to say of the angle."""

    OUTLIER = 1  #: A reading far from its prediction was left out.
    LOST = 2  #: The angle is not known to a sixth of the marks' distance.
    ASSUMED = 4  #: The direction is that of before: pulses do not tell it.
    RESTARTED = 8  #: Started afresh from the last readings.


@dataclass(frozen=True, eq=False)
class AngleEstimate:
    """Angle and speed of a rotor along a record, with their variances.

    Attributes
    ----------
    t : ndarray (n,)
        Time [s].
    angle : ndarray (n,)
        Relative to the first mark, from x towards y [rad], from -pi to pi.
    speed : ndarray (n,)
        Speed of rotation [rad/s].
    acceleration : ndarray (n,)
        Angular acceleration [rad/s^2].
    angle_variance, speed_variance : ndarray (n,)
        Of the angle [rad^2] and of the speed [rad^2/s^2].
    status : ndarray of uint8 (n,)
        Flags of :class:`AngleStatus` [1].
    rotation : ndarray (n, 11)
        Information for a filter, the fields of ``amb_rotation`` in ``core/include/ambkit/angle.h``
        [their SI units].

    Examples
    --------
    >>> machine = Machine.preset("ufu_rig").replace(angle={"type": "speed"})
    >>> estimate = AngleEstimate.of(machine, np.full(2000, 300.0))
    >>> round(float(estimate.speed[-1]))
    300
    """

    t: Array
    angle: Array
    speed: Array
    acceleration: Array
    angle_variance: Array
    speed_variance: Array
    status: NDArray[np.uint8]
    rotation: NDArray[Any]

    @classmethod
    def of(
        cls, machine: Machine, readings: ArrayLike, *, precision: Precision = "float64"
    ) -> AngleEstimate:
        """Estimate the angle from readings of the machine's sensor.

        Parameters
        ----------
        machine : Machine
            With ``[angle]``.
        readings : array_like (n,)
            Time since a pulse within the last sample [s], angle of an encoder [rad], or speed
            [rad/s]; NaN if missing.
        precision : {"float64", "float32"}
            Precision of the core.

        Raises
        ------
        AmbkitError
            The machine has no angle sensor.
        """
        values = np.ascontiguousarray(readings, precision)
        out = core_module(precision).run_angle(angle_settings(machine), values)
        mean, variance, speed_variance = (
            np.asarray(out[name], float) for name in ("mean", "variance", "speed_variance")
        )
        t = machine.sampling_time * np.arange(len(values), dtype=float)
        angle, speed, acceleration = mean.T
        status, rotation = np.asarray(out["status"]), np.asarray(out["rotation"])
        return cls(t, angle, speed, acceleration, variance, speed_variance, status, rotation)

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Where the angle is not known (n,)."""
        return np.asarray((self.status & AngleStatus.LOST) > 0)


def _sensor_of(machine: Machine) -> AngleSensor:
    """Return the sensor of a machine's angle; raise AmbkitError where there is none."""
    if machine.angle is None:
        raise AmbkitError(f"{machine.name} has no sensor of its angle: [angle] is missing")
    return machine.angle


def angle_settings(machine: Machine) -> dict[str, Any]:
    """Return the core's settings of the angle's sensor (``core/include/ambkit/angle.h``)."""
    sensor = _sensor_of(machine)
    return {
        "sensor": SENSORS.index(sensor.type),
        "per_turn": float(sensor.per_turn),
        "T": machine.sampling_time,
        "noise": sensor.speed_noise if sensor.type == "speed" else sensor.angle_noise,
        "latency": sensor.latency,
        "latency_error": sensor.latency_error,
        "gain_error": sensor.gain_error,
        "acceleration": sensor.acceleration,
        "max_speed": max(map(abs, sensor.range(machine.speed))),
        "reverses": sensor.reverses,
        "backwards": machine.speed < 0,
    }


def readings_of(machine: Machine, record: Record) -> Array:
    """Return the readings of the angle's sensor in a record (n,)."""
    name, unit = _sensor_of(machine).channel
    signals = dict(record.signals)
    if name == "pulse" and name not in signals and LEVEL in signals:
        return pulses_of(np.asarray(signals[LEVEL], float), machine.sampling_time)
    if name == "speed_reading" and name not in signals and "speed" in signals:
        name = "speed"  # of a rig's log, which has no other
    if name not in signals:
        raise RecordError(
            f"the record has no {name} [{unit}], which {machine.name} has by [angle]; without "
            "[angle] its speed is known exactly"
        )
    return np.asarray(signals[name], float)


def pulses_of(level: Array, T: float) -> Array:
    """Return the time since a level (n,) rose through its middle [s]; NaN where it did not."""
    # It must have been in its lowest quarter before, so that noise at the middle is one pulse; the
    # edge is on a straight line between two samples.
    ends = [np.nanmin(level), np.nanmax(level)] if np.isfinite(level).any() else [0.0, 0.0]
    if not ends[1] > ends[0]:
        raise RecordError(f"{LEVEL} shows no pulse: it has one level only")
    middle, low = np.interp([0.5, 0.25], [0, 1], ends)
    state = np.where(level >= middle, 1, np.where(level < low, -1, 0))
    clear = np.flatnonzero(state)
    rises = clear[1:][np.diff(state[clear]) == 2]
    result = np.full(len(level), np.nan)
    result[rises] = T * (level[rises] - middle) / (level[rises] - level[rises - 1])
    return result


def estimate_angle(machine: Machine, record: Record) -> AngleEstimate:
    """Estimate angle and speed of the rotor along a record.

    Parameters
    ----------
    machine : Machine
        With ``[angle]``.
    record : Record
        With ``pulse`` [s] or ``keyphasor``, ``angle_reading`` [rad] or ``speed_reading`` [rad/s],
        depending on the sensor.

    Raises
    ------
    AmbkitError
        The machine has no angle sensor, or the record has no readings of it.
    """
    estimate = AngleEstimate.of(machine, readings_of(machine, record))
    return replace(estimate, t=np.asarray(record.t))


def angle_notes(
    machine: Machine, record: Record, estimates: Mapping[str, Estimate]
) -> Iterator[str]:
    """Yield for how long the rotor's angle is lost, and which filters, by name, mirrored it."""
    if machine.angle is None:
        return
    for name, one in estimates.items():
        mirrored = (one.status & np.uint16(Status.MIRRORED)) > 0
        if mirrored.any():
            yield (
                f"{name}: the unbalance shows that the rotor spins against the direction in which "
                f"its pulses were read, in {percent(mirrored.mean())} of the samples, first at "
                f"{one.t[mirrored][0]:.4g} s; what rotates with it was estimated anew there"
            )
    if (lost := estimate_angle(machine, record).lost).any():
        yield (
            f"the rotor's angle is unknown in {percent(lost.mean())} of the samples, last at "
            f"{record.t[lost][-1]:.4g} s: unbalance control is off there"
        )
