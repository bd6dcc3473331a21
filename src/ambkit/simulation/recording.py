"""The record of a run, and the noise that is drawn for it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.pickling import own_version
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.machine.accessories import ColouredNoise, Hum
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module
from ambkit.machine.parts import Sensor
from ambkit.simulation.fields import InLoops, StraightLine
from ambkit.simulation.scenario import Scenario, by_axis

CONTROL, SENSOR = 0, 1
"""Streams of an axis and its reading: of the control signal, and of the sensor from here on."""

STREAMS = 64
"""Of each axis and its reading."""


@dataclass(frozen=True)
class Stream:
    """One stream of random numbers."""

    seed: int  #: From 0 to below 2^64.
    run: int = 0
    number: int = 0  #: Of the stream.

    def next(self, by: int = 1) -> Stream:
        """Return the stream that is so many farther."""
        return replace(self, number=self.number + by)

    def normal(self, std: float, n: int) -> Array:
        """Return the first n normal numbers of this standard deviation."""
        return np.asarray(std * core_module().normal_noise(self.seed, self.run, self.number, n))

    def share(self) -> float:
        """Return one number from 0 to below 1."""
        low, high = (item % 2**32 for item in (self.run, self.run >> 32))
        key = [self.seed % 2**32, self.seed >> 32]
        return int(core_module().philox([0, self.number, low, high], key)[0]) / 2**32


def drawn(machine: Machine, scenario: Scenario, n: int) -> tuple[Array, Array]:
    """Return the noise on the control signals (n, p) [V] and on the readings (n, m) [m]."""
    axes, readings = machine.axes, machine.readings
    noise_u, noise_y = np.zeros((n, len(axes))), np.zeros((n, len(readings)))
    if not scenario.noise:
        return noise_u, noise_y
    stream = Stream(scenario.seed, scenario.run, CONTROL)
    for k, axis in enumerate(axes):
        std = math.sqrt(axis.bearing.amplifier.noise_variance)
        noise_u[:, k] = stream.next(STREAMS * k).normal(std, n)
    for k, reading in enumerate(readings):
        own = stream.next(STREAMS * k + SENSOR)
        noise_y[:, k] = of_sensor(reading.sensor, machine.sampling_time, n, own)
    return noise_u, noise_y


def white(machine: Machine, scenario: Scenario) -> tuple[list[float], list[float]] | None:
    """Return the standard deviations of the noise on control signals [V] and readings [m]."""
    # They are all that there is to know of `drawn`; None where a sensor has noise that is not
    # white.
    axes, sensors = machine.axes, [reading.sensor for reading in machine.readings]
    if not scenario.noise:
        return [0.0] * len(axes), [0.0] * len(sensors)
    if any(sensor.coloured_noise is not None or sensor.hum for sensor in sensors):
        return None
    of_axes = [math.sqrt(axis.bearing.amplifier.noise_variance) for axis in axes]
    return of_axes, [math.sqrt(sensor.noise_variance) for sensor in sensors]


def of_sensor(sensor: Sensor, T: float, n: int, stream: Stream) -> Array:
    """Return n samples of the noise of a sensor [m]."""
    noise = stream.normal(math.sqrt(sensor.noise_variance), n)
    if sensor.coloured_noise is not None:
        noise += coloured(sensor.coloured_noise, T, n, stream.next())
    for place, line in enumerate(sensor.hum):
        noise += hum(line, T, n, stream.next(2 + place))
    return noise


def coloured(noise: ColouredNoise, T: float, n: int, stream: Stream) -> Array:
    """Return n samples of stationary first-order noise, exact at every T [m]."""
    # ``z(k+1) = a z(k) + sqrt((1 - a^2) variance) w(k)`` with ``a = exp(-2 pi bandwidth T)``.
    white = stream.normal(math.sqrt(noise.variance), n)
    rate = 2 * math.pi * noise.bandwidth * T
    white[1:] *= math.sqrt(-math.expm1(-2 * rate))
    return _first_order(math.exp(-rate), white)


def hum(line: Hum, T: float, n: int, stream: Stream) -> Array:
    """Return n samples of a narrow line [m]."""
    # Without a bandwidth, a sine of random phase. Else a phasor ``z(k+1) = exp((j omega - alpha) T)
    # z(k) + noise`` with ``alpha = 2 pi bandwidth``, stationary and of the same power.
    phase_step = 2j * math.pi * line.frequency * T
    if line.bandwidth == 0:
        phase = 2 * math.pi * stream.share()
        return np.asarray(line.amplitude * np.cos(phase_step.imag * np.arange(n) + phase))
    pairs = stream.normal(line.amplitude / math.sqrt(2), 2 * n)
    white = pairs[0::2] + 1j * pairs[1::2]
    rate = 2 * math.pi * line.bandwidth * T
    white[1:] *= math.sqrt(-math.expm1(-2 * rate))
    return _first_order(np.exp(phase_step - rate), white).real


def _first_order(pole: complex, white: NDArray[Any]) -> NDArray[Any]:
    """Return ``z(k) = pole z(k-1) + white(k)``."""
    from scipy.signal import lfilter  # most of what a start of ambkit would take, and rarely needed

    return np.asarray(lfilter([1.0], [1.0, -pole], white))


UNITS = {
    "r": "m", "y": "m", "u": "V",
    "x": "m", "v": "m/s", "f_d": "N", "x_m": "m", "iu": "A", "f_mag": "N",
}  # fmt: skip
"""Signals of a single axis, in their order."""


def recorded(
    form: StraightLine | InLoops, t: Array, out: dict[str, Any], series: dict[str, Array],
    begin: int,
) -> Record:  # fmt: skip
    """Return the record of what C says, from a sample on."""
    machine, scenario = form.machine, form.scenario
    axes = [axis.name for axis in machine.axes]
    force = form.force(out["force"])
    told = ("X", "iu", "y", "u")
    out = out | {name: np.asarray(out[name], float) for name in told}
    if scenario.off is not None:
        bias = [axis.bearing.magnet.bias_current for axis in machine.axes]
        out["iu"] = np.where((t < scenario.off)[:, None], out["iu"], np.negative(bias))
    signals: dict[str, tuple[Array, str]] = {}
    for k, reading in enumerate(machine.readings):
        signals[signal("y", reading.name)] = out["y"][:, k], "m"
    for k, axis in enumerate(machine.axes):
        unit = axis.bearing.amplifier.control_unit
        signals[signal("u", axis.name)] = out["u"][:, k], unit
    moved = form.moved(out["X"])
    of_axes = {
        "r": (series["r"], "m"), **({} if moved is None else {"s": (moved, "m")}),
        "iu": (out["iu"], "A"), "f_mag": (force, "N"),
        "f_d": (series["f_d"], "N"),
    }  # fmt: skip
    for name, (values, unit) in of_axes.items():
        signals |= {signal(name, axis): (values[:, k], unit) for k, axis in enumerate(axes)}
    signals |= {name: (out["X"][k], unit) for name, (k, unit) in form.states.items()}
    if "speed" in series:
        signals["speed"] = series["speed"], "rad/s"
    if moved is None:
        signals = {name: signals[name] for name in UNITS}
    for name, _ in by_axis(scenario, "injection", axes[0]):
        signals[signal("injected", name)] = series["injected"][:, axes.index(name)], "m"
    # Just after the sample, where the voltage is limited: that of a coil, and of a pair's other.
    for name in ("u_coil", "u_coil_2"):
        if name in out:
            signals[name] = np.asarray(out[name], float), "V"
    if scenario.sequence is not None:
        signals["mode"] = out["mode"].astype(float), "1"
    for way in {item.direction for item in scenario.base}:
        signals[f"base_{way}"] = series["base"][:, "xyz".index(way)], "m/s^2"
    return Record(
        t,
        {name: values for name, (values, _) in signals.items()},
        {name: unit for name, (_, unit) in signals.items()},
        meta={
            "bearing" if moved is None else "machine": _said(machine),
            "scenario": scenario.model_dump(mode="json"),
            "seed": scenario.seed,
            "run": scenario.run,
            "version": own_version(),
            "stop_touched": int(out["touched"]),
            "first_touch": begin + int(out["first"]) if out["touched"] else None,
        },
    )


@lru_cache(maxsize=64)
def _said(machine: Machine) -> str:
    """Return a machine as text, which many runs of it share."""
    return machine.to_toml()
