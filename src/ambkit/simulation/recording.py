"""The record of a run, and its noise."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.pickling import own_version
from ambkit.control.control import WITH_CURRENT
from ambkit.data.record import Record
from ambkit.data.signals import ON, signal
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module
from ambkit.models.declaration import Plan
from ambkit.models.parts import SENSOR_NOISE
from ambkit.models.parts.typical_sizes import Typical
from ambkit.simulation.fields import InLoops, StraightLine
from ambkit.simulation.scenario import Scenario, by_axis

CONTROL, SENSOR = 0, 1
"""Streams of an axis and its reading: of the control signal, and of the sensor from here on."""

STREAMS = 64  #: Streams per axis and reading.


@dataclass(frozen=True)
class Stream:
    """One stream of random numbers."""

    seed: int  #: From 0 to below 2^64.
    run: int = 0
    number: int = 0  #: Of the stream.

    def next(self, by: int = 1) -> Stream:
        """Return the stream with an offset."""
        return replace(self, number=self.number + by)

    def normal(self, std: float, n: int) -> Array:
        """Return the first n normal numbers with a standard deviation."""
        return np.asarray(std * core_module().normal_noise(self.seed, self.run, self.number, n))

    def share(self) -> float:
        """Return one number from 0 to below 1."""
        low, high = (item % 2**32 for item in (self.run, self.run >> 32))
        key = [self.seed % 2**32, self.seed >> 32]
        return int(core_module().philox([0, self.number, low, high], key)[0]) / 2**32


def noise_samples(machine: Machine, scenario: Scenario, n: int) -> tuple[Array, Array]:
    """Return the noise on the control signals (n, p) [V] and on the readings (n, m) [m]."""
    axes, readings, T = machine.axes, machine.readings, machine.sampling_time
    noise_u, noise_y = np.zeros((n, len(axes))), np.zeros((n, len(readings)))
    if not scenario.noise:
        return noise_u, noise_y
    stream = Stream(scenario.seed, scenario.run, CONTROL)
    for k, axis in enumerate(axes):
        std = math.sqrt(axis.bearing.amplifier.noise_variance)
        noise_u[:, k] = stream.next(STREAMS * k).normal(std, n)
    others = _not_white(machine)
    for k, reading in enumerate(readings):
        own = stream.next(STREAMS * k + SENSOR)
        noise_y[:, k] = own.normal(math.sqrt(reading.sensor.noise_variance), n)
        for number, part in others:
            if part.measurement == signal("y", reading.name):
                draw = part.draw if hasattr(part, "draw") else partial(by_equations, part)
                noise_y[:, k] += draw(T, n, own.next(number))
    return noise_u, noise_y


def white(machine: Machine, scenario: Scenario) -> tuple[list[float], list[float]] | None:
    """Return the standard deviations of the noise on control signals [V] and readings [m]."""
    # They describe `noise_samples` completely; None for a sensor with noise that is not white.
    axes, sensors = machine.axes, [reading.sensor for reading in machine.readings]
    if not scenario.noise:
        return [0.0] * len(axes), [0.0] * len(sensors)
    if _not_white(machine):
        return None
    of_axes = [math.sqrt(axis.bearing.amplifier.noise_variance) for axis in axes]
    return of_axes, [math.sqrt(sensor.noise_variance) for sensor in sensors]


def _not_white(machine: Machine) -> list[tuple[int, Any]]:
    """Return the noise parts of sensors, each with its stream."""
    # Of a reading's streams, the first kind has one, the second those from there on, and others
    # eight each from the last one down.
    sizes, numbered = [Typical(1.0, 1.0, 1.0, 1.0)] * len(machine.axes), []  # they scale a filter
    for place, kind in enumerate(SENSOR_NOISE):
        first = 1 + place if place < 2 else STREAMS - 8 * (place - 1)
        numbers: Counter[str] = Counter()
        for part in kind.of(machine, sizes):
            numbered.append((first + numbers[part.measurement], part))
            numbers[part.measurement] += 1
    return numbered


def by_equations(part: Any, T: float, n: int, stream: Stream) -> Array:
    """Return n samples of the output of a part with states [m], exact at every T."""
    # Stationary if possible, else from zero.
    plan = Plan(T)
    plan.measure(part.measurement, "m", 1.0, {})
    plan.add(part)
    names = [state.name for state in plan.states]
    A = np.array([[plan.rates.get((at, by), 0.0) for by in names] for at in names])
    intensity = np.array([
        [noise.size**2 * of.get(at, 0.0) for at in names]
        for noise, (of, _) in zip(plan.noises, plan.sources, strict=True)
    ])  # fmt: skip
    decay = -float(np.linalg.eigvals(A).real.max())
    core = core_module()
    begin = core.process_noise(A, intensity, 40 / decay) if decay > 0 else np.zeros((1, *A.shape))
    Phi, step = core.transition(A, T), _root(core.process_noise(A, intensity, T))
    z = stream.normal(1.0, n * len(names)).reshape(n, -1)
    z[0] = _root(begin) @ z[0]
    for k in range(1, n):
        z[k] = Phi @ z[k - 1] + step @ z[k]
    return np.asarray(z @ [plan.readings[0].get(name, 0.0) for name in names])


def _root(covariances: Array) -> Array:
    """Return a square root of the sum of covariances (k, n, n)."""
    values, vectors = np.linalg.eigh(covariances.sum(axis=0))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


UNITS = {
    "r": "m", "y": "m", "u": "V",
    "x": "m", "v": "m/s", "f_d": "N", "x_m": "m", "iu": "A", "f_mag": "N",
}  # fmt: skip
"""Signals of a single axis, in their order."""


def recorded(
    form: StraightLine | InLoops, t: Array, out: dict[str, Any], series: dict[str, Array],
    begin: int,
) -> Record:  # fmt: skip
    """Return the record of C's results, from a sample on."""
    machine, scenario = form.machine, form.scenario
    axes = machine.axis_names
    force = form.force(out["force"])
    names = ("X", "iu", "y", "u")
    out = out | {name: np.asarray(out[name], float) for name in names}
    if "on" in series:
        bias = [axis.bearing.magnet.bias_current for axis in machine.axes]
        out["iu"] = np.where(series["on"][:, None] > 0, out["iu"], np.negative(bias))
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
    if "angle" in series and machine.angle is not None:
        name, unit = machine.angle.channel
        signals[name] = series["angle"], unit
    if moved is None:
        signals = {name: signals[name] for name in UNITS}
    for name, _ in by_axis(scenario, "injection", axes[0]):
        signals[signal("injected", name)] = series["injected"][:, axes.index(name)], "m"
    # Just after the sample, if the voltage is limited: that of a coil, and of a pair's other.
    for name in ("u_coil", "u_coil_2"):
        if name in out:
            signals[name] = np.asarray(out[name], float), "V"
    if scenario.sequence is not None:
        signals["mode"] = out["mode"].astype(float), "1"
        series[ON] = series.get(ON, np.ones(t.size)) * np.isin(out["mode"], WITH_CURRENT)
    if ON in series:
        signals[ON] = series[ON], "1"
    touched = np.flatnonzero(out["at_stop"])
    for way in {item.direction for item in scenario.base}:
        signals[f"base_{way}"] = series["base"][:, "xyz".index(way)], "m/s^2"
    return Record(
        t,
        {name: values for name, (values, _) in signals.items()},
        {name: unit for name, (_, unit) in signals.items()},
        meta={
            "bearing" if moved is None else "machine": _toml_text(machine),
            "scenario": scenario.model_dump(mode="json"),
            "seed": scenario.seed,
            "run": scenario.run,
            "version": own_version(),
            "stop_touched": len(touched),
            "first_contact": begin + int(touched[0]) if len(touched) else None,
        },
    )


@lru_cache(maxsize=64)
def _toml_text(machine: Machine) -> str:
    """Return a machine as text, shared by many of its runs."""
    return machine.to_toml()
