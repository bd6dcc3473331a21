"""Variation from run to run: tolerances of the plant, and the disturbance force."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ambkit.base.arrays import Array, period_of
from ambkit.machine.machine import Machine
from ambkit.simulation.scenario import Scenario


@dataclass(frozen=True)
class Spread:
    """Tolerance of each quantity relative to its nominal value: 0.2 is +-20 %."""

    # The plant takes the varied value; the estimators keep the nominal one.

    #: Of the plant. A force map includes its gap: only its constant varies.
    magnet_constant: float = 0.0
    mass: float = 0.0
    air_gap: float = 0.0
    noise: float = 0.0  #: Standard deviation and time constant of the sensor's noise.
    lag: float = 0.0
    load: float = 0.0  #: Disturbance.

    @classmethod
    def all(cls, share: float) -> Spread:
        """Return the same tolerance for each quantity."""
        return cls(*(share for _ in fields(cls)))

    def factors(self, runs: int, seed: int) -> list[Spread]:
        """Draw the factors on the nominal values: scrambled Sobol points (Owen 1998)."""
        from scipy.stats import qmc

        shares = np.array([getattr(self, field.name) for field in fields(self)])
        sobol = qmc.Sobol(shares.size, scramble=True, rng=np.random.default_rng([seed, 2]))
        points = sobol.random_base2(max(0, int(np.ceil(np.log2(runs)))))[:runs]
        return [Spread(*map(float, row)) for row in 1 + shares * (2 * points - 1)]

    def plant(self, nominal: Machine) -> Machine:
        """Return the machine with its values times these factors, the same for all axes."""
        rotor = nominal.rotor
        mass = {"rotor__mass": rotor.mass * self.mass} if "mass" in dict(rotor) else {}
        sensors = [
            item.model_copy(update={"noise_variance": item.noise_variance * self.noise**2,
                                    "lag": item.lag * self.lag})
            for item in nominal.sensors
        ]  # fmt: skip
        bearings = []
        for item in nominal.bearings:
            old = item.magnet
            own = old.with_constant(old.magnet_constant * self.magnet_constant)
            values = {name.removeprefix("magnet__"): value for name, value in own.items()}
            magnet = old.model_copy(update=values | {"air_gap": old.air_gap * self.air_gap})
            # A narrower gap may limit the clearance.
            changes = {"magnet": magnet, "clearance": min(item.clearance, 0.95 * magnet.air_gap)}
            bearings.append(item.model_copy(update=changes))
        return nominal.replace(bearing=bearings, sensor=sensors, **mass)


CERTAIN = Spread()  #: No variation.
ALIKE = 0.05  #: Relative power in which periods of a disturbance may differ.


class Load:
    """A disturbance force, prepared for the correlation with its estimates."""

    # spread, still (furthest + 1,) Root of its variance in the window of each lag, and where that
    # is rounding only. signal (n,) The disturbance force [N].

    def __init__(self, signal: Array) -> None:
        from scipy.fft import next_fast_len, rfft

        n, deviation = signal.size, signal - signal.mean()
        self.furthest = min(n // 8, (period_of(signal, ALIKE) or n) // 2)
        self.moves = bool(np.ptp(signal) > 0)
        self.transform_size = next_fast_len(n, real=True)
        self.transform = rfft(deviation, self.transform_size)
        sums, squares = (np.concatenate([[0.0], np.cumsum(deviation**k)]) for k in (1, 2))
        starts = self.furthest - np.arange(self.furthest + 1)
        length = n - self.furthest
        mean = (sums[starts + length] - sums[starts]) / length
        variance = (squares[starts + length] - squares[starts]) / length - mean**2
        self.still = variance <= 1e-9 * variance.max()
        self.spread = np.sqrt(np.where(self.still, 1.0, variance))


def random_walk(rng: np.random.Generator, variance: float, n: int) -> tuple[Array, Array]:
    """Return a random walk's means over the samples, and its values at them (n,)."""
    steps, within = rng.normal(0.0, math.sqrt(variance), (2, n))
    walk = np.cumsum(steps) - steps
    return walk + 0.5 * steps + within / math.sqrt(12), walk  # mean of a Brownian bridge


def coloured_noise(rng: np.random.Generator, correlation: float, std: list[float], n: int) -> Array:
    """Return coloured noise (n, m): correlation time in samples, standard deviations (m,)."""
    from scipy.signal import lfilter

    # First order, with the variance of the white noise, from its stationary state.
    pole = math.exp(-1 / correlation)
    white = rng.normal(0.0, std, (n, len(std)))
    white[1:] *= math.sqrt(1 - pole**2)
    return np.asarray(lfilter([1.0], [1.0, -pole], white, axis=0))


def rotating(machine: Machine, synchronous: tuple[str, ...]) -> Machine:
    """Return a machine without the unbalance and the runout that filters do not estimate."""
    if "unbalance" not in synchronous:
        machine = machine.model_copy(update={"unbalance": ()})
    if "runout" not in synchronous:
        sensors = tuple(sensor.model_copy(update={"runout": ()}) for sensor in machine.sensors)
        machine = machine.model_copy(update={"sensor": sensors})
    return machine


def turned(plant: Machine, seed: int) -> Machine:
    """Return a plant with its unbalance and runout at random angles, which no filter knows."""
    rng = np.random.default_rng([seed, 4])

    def at_random(items: Iterable[Any], angle: str) -> tuple[Any, ...]:
        return tuple(at.model_copy(update={angle: 2 * math.pi * rng.random()}) for at in items)

    unbalance = at_random(plant.unbalance, "angle")
    sensors = tuple(
        sensor.model_copy(update={"runout": at_random(sensor.runout, "phase")})
        for sensor in plant.sensors
    )
    return plant.model_copy(update={"unbalance": unbalance, "sensor": sensors})


def streams(scenario: Scenario) -> list[np.random.Generator]:
    """Return the random generators of a run's disturbance and sensors."""
    seeds = np.random.SeedSequence([scenario.seed, 3]).spawn(2)
    return [np.random.default_rng(seed) for seed in seeds]
