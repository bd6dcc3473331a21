"""The injected faults, declared once, scaled by the machine.

Lengths are in clearances, forces in maximum magnet forces, times in time constants of the plant,
``sqrt(m/k_s)``, or in samples or seconds for faults that are defined by them; each is thus
equivalent on any machine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ambkit.base.arrays import Array
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, Precision, own_time
from ambkit.simulation.external_inputs import Faults


@dataclass(eq=False)
class Channel:
    """Destination of the faults of a run of n samples."""

    machine: Machine  #: Machine that scales them.
    n: int  #: Number of samples.
    #: Precision of the estimator: it determines huge and denormal numbers.
    precision: Precision = "float64"
    beside: bool = False  #: Whether the true measurement feeds the controller.
    seed: int = 0  #: Seed of random faults.
    faults: Faults = field(init=False)
    force: Array = field(init=False)
    place: float | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.faults = Faults.none(self.n, beside=self.beside)
        self.force = np.zeros(self.n)
        self.draw = np.random.default_rng([self.seed, self.n])
        self.real = np.finfo(self.precision)

    @property
    def own(self) -> float:
        """Time constant of the plant [samples]."""
        return own_time(self.machine) / self.machine.sampling_time

    @property
    def travel(self) -> float:
        """Clearance as measured [m]."""
        return float(self.machine.sensor.gain * self.machine.clearance)

    @property
    def greatest(self) -> float:
        """Force by the linear law at the current limit and a stop [N]."""
        machine, k = self.machine, ConstantStiffness.of(self.machine)
        return float(k.k_i * machine.current_max + k.k_s * machine.clearance)

    def read(self, window: slice, y: float | Array) -> None:
        """Replace the measurement by y [m]."""
        self.faults.y_times[window] = 0.0
        self.faults.y_plus[window] = y

    def tell(self, window: slice, u: float) -> None:
        """Report the control signal u [V] to the estimator in place of the controller's."""
        self.faults.u_times[window] = 0.0
        self.faults.u_plus[window] = u


@dataclass(frozen=True)
class Fault:
    """An injected fault."""

    name: str  #: Name.
    about: str  #: Short description.
    #: ``put(channel, window)`` writes it into the samples of the window.
    put: Callable[[Channel, slice], None]
    #: Length of the window, the sum of time constants of the plant, seconds and samples.
    own: float = 0.0
    seconds: float = 0.0
    samples: int = 0
    #: Whether it is injected in closed loop too, not only in open loop.
    in_loop: bool = True

    def length(self, machine: Machine) -> int:
        """Length of its window [samples]."""
        span = self.own * own_time(machine) + self.seconds
        return self.samples + round(span / machine.sampling_time)


def _lift_off(channel: Channel, _window: slice) -> None:
    side = -1.0 if channel.machine.weight < 0 else 1.0
    channel.place = side * channel.machine.clearance


def _force(times: float) -> Callable[[Channel, slice], None]:
    def put(channel: Channel, window: slice) -> None:
        channel.force[window] = times * channel.greatest * channel.draw.choice([-1.0, 1.0])

    return put


def _set(series: str, value: float) -> Callable[[Channel, slice], None]:
    def put(channel: Channel, window: slice) -> None:
        getattr(channel.faults, series)[window] = value

    return put


_knock, _overload, _missing = _force(2), _force(1.5), _set("y_plus", np.nan)


def _bursts(channel: Channel, window: slice) -> None:
    at = window.start
    while at < window.stop:
        length, gap = channel.draw.integers(1, 20, 2)
        channel.faults.y_plus[at : min(at + length, window.stop)] = np.nan
        at += length + gap


def _stuck(channel: Channel, window: slice) -> None:
    channel.faults.late[window] = 1.0 + np.arange(window.stop - window.start)


def _spikes(channel: Channel, window: slice) -> None:
    size = window.stop - window.start
    there = channel.draw.random(size) < 0.1
    channel.faults.y_plus[window] += there * channel.draw.uniform(-9, 9, size) * channel.travel


def _offset(channel: Channel, window: slice) -> None:
    channel.faults.y_plus[window] += 0.3 * channel.travel * channel.draw.choice([-1.0, 1.0])


def _rail(channel: Channel, window: slice) -> None:
    sigma = float(np.sqrt(channel.machine.sensor.noise_variance))
    noise = sigma * channel.draw.standard_normal(window.stop - window.start)
    channel.read(window, channel.travel * channel.draw.choice([-1.0, 1.0]) + noise)


def _reads(y: Callable[[np.finfo], float]) -> Callable[[Channel, slice], None]:
    def put(channel: Channel, window: slice) -> None:
        signs = channel.draw.choice([-1.0, 1.0], window.stop - window.start)
        channel.read(window, signs * y(channel.real))

    return put


def _set_control(u: Callable[[np.finfo], float]) -> Callable[[Channel, slice], None]:
    return lambda channel, window: channel.tell(window, u(channel.real))


def _overdriven(channel: Channel, window: slice) -> None:
    limit = channel.machine.current_max / channel.machine.amplifier.gain
    channel.tell(window, 100 * limit * channel.draw.choice([-1.0, 1.0]))


_LONGEST = 2.0  # the longest that a loop may survive, in time constants

CLEAN = Fault("clean", "no fault", lambda _channel, _window: None)

FAULTS = {
    fault.name: fault
    for fault in (
        Fault("lift-off", "the filter does not know that the rotor starts on a stop", _lift_off),
        Fault("knock", "an impulse throws the rotor against a stop", _knock, own=1),
        Fault("overload", "a load beyond the magnet for one time constant", _overload, own=1),
        Fault("long-overload", "a load beyond the magnet: rotor on a stop, current at its limit",
              _overload, own=60),
        Fault("weak-amplifier", "a tenth of the current remains", _set("current", 0.1), own=0.5),
        Fault("nan-bursts", "bursts of 1 to 19 missing samples", _bursts, own=5),
        Fault("outage-1ms", "no measurement", _missing, seconds=1e-3),
        Fault("outage-10ms", "no measurement", _missing, seconds=1e-2),
        Fault("outage-100ms", "no measurement", _missing, seconds=0.1, in_loop=False),
        Fault("outage-1s", "no measurement", _missing, seconds=1, in_loop=False),
        Fault("outage-10s", "no measurement", _missing, seconds=10, in_loop=False),
        Fault("stuck", "the sensor repeats its last value", _stuck, own=0.5),
        Fault("long-stuck", "the sensor repeats its last value", _stuck, own=30, in_loop=False),
        Fault("spikes", "one sample in ten is off by up to nine clearances", _spikes, own=20),
        Fault("offset", "the sensor is off by 0.3 clearances", _offset, own=_LONGEST),
        Fault("rail", "the sensor reads the end of its range, with noise, for 100 samples", _rail,
              samples=100, in_loop=False),
        Fault("long-rail", "the sensor reads the end of its range", _rail, own=60, in_loop=False),
        Fault("late-0.5", "the measurement is half a sample late", _set("late", 0.5), own=20),
        Fault("late-1", "the measurement is one sample late", _set("late", 1), own=20),
        Fault("late-3", "the measurement is three samples late", _set("late", 3), own=20),
        Fault("huge-y", "the sensor reads ±1e30 m", _reads(lambda _: 1e30), own=0.5),
        Fault("greatest-y", "the sensor reads the largest number",
              _reads(lambda real: float(real.max)), own=0.5),
        Fault("infinite-y", "the sensor reads infinity", _reads(lambda _: np.inf), own=0.5),
        Fault("denormal-y", "the sensor reads the smallest number",
              _reads(lambda real: float(real.smallest_subnormal)), own=0.5),
        Fault("nan-u", "the control signal is NaN", _set_control(lambda _: np.nan), own=_LONGEST),
        Fault("infinite-u", "the control signal is infinite", _set_control(lambda _: np.inf),
              own=_LONGEST),
        Fault("greatest-u", "the control signal is the largest number",
              _set_control(lambda real: float(real.max)), own=_LONGEST),
        Fault("overdriven", "the filter receives 100 times the current limit", _overdriven,
              own=_LONGEST),
        Fault("long-saturation", "the filter receives 20 times the control signal",
              _set("u_times", 20.0), own=120, in_loop=False),
        Fault("long-overdriven", "the filter receives 100 times the current limit",
              _overdriven, own=120, in_loop=False),
    )
}  # fmt: skip
"""All faults by name, each at one point of a run."""

_MIXED = ("knock", "weak-amplifier", "nan-bursts", "outage-1ms", "stuck", "spikes", "offset",
          "rail", "late-1", "late-3", "huge-y", "greatest-y", "infinite-y", "denormal-y", "nan-u",
          "infinite-u", "greatest-u", "overdriven")  # fmt: skip


def mixture(channel: Channel, start: int, quiet: int, shortest: int, longest: int) -> list[slice]:
    """Draw mixtures of one to three simultaneous faults, until the run ends."""
    draw, at = channel.draw, start
    windows: list[slice] = []
    while True:
        length = round(np.exp(draw.uniform(np.log(shortest), np.log(longest))))
        if at + length + quiet > channel.n:
            return windows
        window = slice(at, at + length)
        for name in draw.choice(_MIXED, draw.integers(1, 4), replace=False):
            if name == "knock":  # a longer one would be no shock
                _knock(channel, slice(at, at + min(length, max(1, round(channel.own)))))
            else:
                FAULTS[name].put(channel, window)
        windows.append(window)
        at += length + quiet
