"""Faults by name: one and two at a time on random bearings, and false alarms.

``python -m benchmarks.isolation faults [bearings] [first]`` simulates each fault, and ``pairs`` two
at a time drawn at random, on random bearings; it compares what `ambkit diagnose` names with the
truth, where the distance of the innovations says that it can be (``isolation_bound``).
``healthy [bearings] [first] [samples] [rougher]`` counts false alarms, under a load so many times
as intense as the filter assumes. The plant of the first two is written here, and shares nothing
with the filter.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit import FilterNoise, Machine, Record
from ambkit.base.errors import AmbkitError
from ambkit.estimate.registry import KINDS
from ambkit.judge.isolation.isolation import LIMIT, MARGIN, FaultIsolation, Searches
from ambkit.machine.magnets import ConstantStiffness, own_time
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario
from ambkit.workflow.tuning import default_disturbance, tune_disturbance
from benchmarks.isolation_bound import SIZES, can_be_named, filtered
from benchmarks.sensors import drawn

Array = NDArray[np.float64]

SUBSTEPS = 6
TAIL = 24.0  #: Level from which on the tail of healthy runs is exponential.
PAIRS = 20  #: Rounds of two faults at random for every bearing; both coils are the magnet.

FAULTS: dict[str, float] = {
    "magnet": -0.3, "upper coil": -0.5, "lower coil": -0.5, "amplifier": -0.3, "gap": 0.15,
    "dead time": 3.0, "sensor gain": 0.3, "sensor offset": 0.1, "sensor lag": 5.0,
    "line noise": 0.05, "mass": 0.3, "clock": 0.1, "load": 0.5,
}  # fmt: skip
"""Sizes; offset and hum over the clearance, lag in samples, load over what the magnet bears at a
quarter of its current."""


@dataclass(eq=False)
class Plants:
    """Bearings side by side, k of them, with a fault each from a sample on."""

    machines: list[Machine]
    sizes: dict[str, Array]  #: (k,) By the names of faults.
    onset: int
    moving: bool
    walk: Array  #: (k,) Intensity of the load's random walk [N^2/s].

    def __post_init__(self) -> None:
        def of(get: Any) -> Array:
            return np.array([get(m) for m in self.machines], float)

        self.T, self.m, self.weight = (
            of(lambda m: m.sampling_time), of(lambda m: m.rotor.mass), of(lambda m: m.weight)
        )  # fmt: skip
        self.k, self.s0, self.i0 = (
            of(lambda m: m.magnet.magnet_constant), of(lambda m: m.magnet.air_gap),
            of(lambda m: m.magnet.bias_current),
        )  # fmt: skip
        self.two = of(lambda m: m.magnet.type == "two-sided")
        self.gain, self.c = of(lambda m: m.amplifier.gain), of(lambda m: m.clearance)
        self.limit_low, self.limit = of(lambda m: m.current_min), of(lambda m: m.current_max)
        self.var_u = of(lambda m: m.amplifier.noise_variance)
        self.K, self.lag = of(lambda m: m.sensor.gain), of(lambda m: m.lag_of(m.sensor))
        self.var_y = of(lambda m: m.sensor.noise_variance)
        self.own = of(own_time)
        k = [ConstantStiffness.of(m) for m in self.machines]
        self.k_i, self.k_s = np.array([(s.k_i, s.k_s) for s in k]).T

    def size(self, name: str, now: bool) -> Array:
        """Size of a fault in a sample."""
        none = np.zeros(len(self.machines))
        return self.sizes.get(name, none) if now else none

    def force(self, i: Array, x: Array, now: bool) -> Array:
        """Force of the magnet on the rotor [N]."""
        s0 = self.s0 * (1 + self.size("gap", now))
        up = self.k * ((self.i0 + i) / np.maximum(s0 - x, 0.1 * s0)) ** 2
        low = self.two * self.k * ((self.i0 - i) / np.maximum(s0 + x, 0.1 * s0)) ** 2
        up, low = up * (1 + self.size("upper coil", now)), low * (1 + self.size("lower coil", now))
        return (up - low) * (1 + self.size("magnet", now))

    def run(self, samples: int, seed: int) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return y [m], u [V] (samples, k), and who met a stop (k,)."""
        draw = np.random.default_rng(seed)
        k = len(self.machines)
        x, v, x_m = np.zeros(k), np.zeros(k), np.zeros(k)
        # A controller that knows x and v through noise, and finds loads by an integral.
        w = 2.0 / self.own
        hold = np.array([m.levitation_current for m in self.machines])
        past = np.repeat(hold[None], 4, axis=0)
        touched = np.zeros(k, bool)
        Y, U = np.empty((samples, k)), np.empty((samples, k))
        integral, slow, before = np.zeros(k), np.zeros(k), np.zeros(k)
        walk = np.zeros(k)
        for n in range(samples):
            now = n >= self.onset
            reading = x_m * (1 + self.size("sensor gain", now))
            reading = reading + self.size("sensor offset", now)
            hum = np.sin(2 * np.pi * 50 * n * self.T + 1)
            reading = reading + self.size("line noise", now) * hum
            y = reading + np.sqrt(self.var_y) * draw.standard_normal(k)
            r = 0.15 * self.c * np.sign(np.sin(2 * np.pi * n * self.T / (24 * self.own)))
            e = y / self.K - r * self.moving
            slow += 0.7 * (e - slow)
            rate = (slow - before) / self.T
            before = slow.copy()
            integral += e * self.T
            a = self.k_s * e + self.m * (w**2 * e + 1.6 * w * rate + 0.2 * w**3 * integral)
            command = np.clip(hold - a / self.k_i, self.limit_low, self.limit)
            u = command / self.gain
            Y[n], U[n] = y, u
            past = np.concatenate([command[None], past[:-1]])
            late = self.size("dead time", now)
            i = np.where(late > 0, past[3], command)
            i = i + self.gain * np.sqrt(self.var_u) * draw.standard_normal(k)
            i = np.clip(i, self.limit_low, self.limit) * (1 + self.size("amplifier", now))
            m = self.m * (1 + self.size("mass", now))
            weight = self.weight * (1 + self.size("mass", now))
            lag = self.lag + self.size("sensor lag", now)
            h = self.T * (1 + self.size("clock", now)) / SUBSTEPS
            walk = walk + np.sqrt(self.walk * self.T) * draw.standard_normal(k)
            load = walk + self.size("load", now)
            for _ in range(SUBSTEPS):
                middle = x + v * h / 2
                v = v + h / m * (self.force(i, middle, now) + weight + load)
                new = middle + v * h / 2
                slope = (new - x) / h
                x_m = self.K * (x + slope * (h - lag)) + (
                    x_m - self.K * (x - slope * lag)
                ) * np.exp(-h / lag)
                x = new
            touched |= np.abs(x) > self.c
            x = np.clip(x, -self.c, self.c)
        return Y, U, touched


def scaled(machine: Machine, name: str) -> float:
    """Return the size of a fault of a bearing in SI."""
    size = FAULTS[name]
    if name in ("sensor offset", "line noise"):
        return size * machine.clearance * machine.sensor.gain
    if name == "sensor lag":
        return size * machine.sampling_time
    if name == "load":
        return size * float(ConstantStiffness.of(machine).k_i) * machine.current_max / 4
    return size


def scales(machine: Machine) -> Array:
    """Return the sizes of the columns of the bound, for its steps."""
    return np.array([scaled(machine, name) for name in SIZES])


def sound(seed: int) -> Machine | None:
    """Return a random bearing that its loop can hold; None where it cannot."""
    try:
        machine = drawn(seed)
        ok = (
            abs(machine.levitation_current) < machine.current_max
            and own_time(machine) > 8 * machine.sampling_time
        )
    except (AmbkitError, ValueError):
        return None
    return machine if ok else None


def record_of(machine: Machine, y: Array, u: Array) -> Record:
    """Return a record of one bearing."""
    return Record(machine.sampling_time * np.arange(len(y)), {"y": y, "u": u}, {"y": "m", "u": "V"})


def columns_of(machine: Machine, name: str, size: float, start: int) -> Array:
    """Return the sizes of a fault's columns in a record from a sample on: the hum has its phase."""
    if name != "line noise":
        return np.array([size])
    phase = 2 * np.pi * 50 * machine.sampling_time * start + 1
    return size * np.array([np.cos(phase), np.sin(phase)])


def main() -> None:
    """Print one of the tables."""
    what, *numbers = sys.argv[1:]
    count, first, *rest = [*map(int, numbers), *(20, 0)[len(numbers) :]]
    if what == "healthy":
        samples, rougher = [*rest, *(33_000, 1)[len(rest) :]]
        healthy(count, first, samples, rougher)
        return
    machines = [m for m in map(sound, range(first, first + count)) if m is not None]
    for moving in (False, True):
        print("moving" if moving else "at rest")
        judge(machines, moving, rounds=PAIRS if what == "pairs" else 0)


def made(machine: Machine, intensity: Any) -> Any:
    """Return the extended filter for a load of an intensity [N^2/s]."""
    return KINDS["extended"].make(machine, noise=FilterNoise(disturbance=intensity))


def intensity_of(machine: Machine, record: Record) -> float:
    """Return the intensity of the load that a healthy record makes most likely [N^2/s]."""
    return float(tune_disturbance(machine, record, lambda at: made(machine, at)).intensity)


def walk_of(machine: Machine, seed: int) -> float:
    """Draw the intensity of a load [N^2/s]."""
    return float(
        default_disturbance(machine) * 10 ** np.random.default_rng([seed, 7]).uniform(-7, -3)
    )


def judge(machines: list[Machine], moving: bool, rounds: int) -> None:
    """Print how often the faults are named, or the two of so many rounds."""
    walk = np.array([walk_of(m, k) for k, m in enumerate(machines)])
    never = 1 << 30
    Y0, U0, lost = Plants(machines, {}, never, moving, walk).run(4000, 0)
    loads = [intensity_of(m, record_of(m, Y0[:, j], U0[:, j])) for j, m in enumerate(machines)]
    isolations = [FaultIsolation(made(m, at)) for m, at in zip(machines, loads, strict=True)]
    onset = max(i.window for i in isolations) + 100
    draw = np.random.default_rng(5)
    singles = [[(name,)] * len(machines) for name in FAULTS]
    pairs = [two for two in combinations(FAULTS, 2) if two != ("upper coil", "lower coil")]
    drawn_pairs = [[pairs[k] for k in draw.integers(len(pairs), size=len(machines))]
                   for _ in range(rounds)]  # fmt: skip
    counts: dict[str, Counter[str]] = {}
    for trial in drawn_pairs or singles:
        sizes = {
            name: np.array([scaled(m, name) if name in of else 0.0
                            for m, of in zip(machines, trial, strict=True)]) for name in FAULTS
        }  # fmt: skip
        plants = Plants(machines, sizes, onset, moving, walk)
        Y, U, touched = plants.run(2 * onset - 100, 1)
        for j, (machine, isolation, true) in enumerate(
            zip(machines, isolations, trial, strict=True)
        ):
            names = [s.name for s in isolation.signatures]
            if touched[j] or lost[j] or not set(true) <= set(names):
                continue
            stop = onset + isolation.span
            start = stop - (stop // isolation.every) * isolation.every
            s = isolation.run(record_of(machine, Y[start:stop, j], U[start:stop, j]))
            there = {name: columns_of(machine, name, float(sizes[name][j]), start) for name in true}
            family = {s.name: s.group for s in isolation.signatures}
            can = can_be_named(
                filtered(machine, Y[start:stop, j], U[start:stop, j], loads[j], scales(machine)),
                onset - start, there, family,
            )  # fmt: skip
            noticed = s.alarms[-1] or "load" in true
            said = verdict(s.groups(-1) if noticed else [], true, family)
            of_any = ["all", *true] if rounds else true
            for name in of_any:
                counts.setdefault(name, Counter()).update(
                    ["runs", "can" if can else "cannot", said if can else f"{said} without"]
                )
    for name, count in counts.items():
        print(f"{name:14}", "  ".join(f"{k} {n}" for k, n in sorted(count.items())), flush=True)


def verdict(groups: list[list[str]], true: tuple[str, ...], family: dict[str, int]) -> str:
    """Compare what is named with the truth: right up to the groups of faults that look alike."""
    if not groups:
        return "silent"
    if len(groups) == len(true) and all(
        any(name in group and all(other == name or 0 < family[other] == family[name]
                                  for other in group) for group in groups) for name in true
    ):  # fmt: skip
        return "right"
    listed = set().union(*groups)
    if len(groups) == len(true) and set(true) <= listed:
        return "listed"
    return "one listed" if len(true) > 1 and listed & set(true) else "wrong"


def healthy(count: int, first: int, samples: int, rougher: float) -> None:
    """Print false alarms under a load so many times as intense as the filter assumes."""
    total, alarms, levels = 0, 0, []
    for seed in range(first, first + count):
        machine = sound(seed)
        if machine is None:
            continue
        try:
            T = machine.sampling_time
            walk = np.random.default_rng([seed, 5]).normal(size=samples + 1)
            load = np.cumsum(walk) * np.sqrt(walk_of(machine, seed) * T)
            record = simulate_run(
                machine, Scenario(duration=samples * T, seed=seed),
                external_inputs=ExternalInputs(load),
            ).record  # fmt: skip
        except (AmbkitError, ValueError):
            continue
        if np.abs(record["x"]).max() > 0.99 * machine.clearance:
            continue
        tuned = intensity_of(machine, record.between(stop=record.t[min(8000, samples // 4)]))
        s = FaultIsolation(made(machine, tuned / rougher)).run(record)
        total += len(record)
        bad = np.flatnonzero(s.alarms)
        alarms += len(bad)
        levels.append(levels_of(s))
        if len(bad):
            print(seed, len(bad), s.groups(bad[0]), s.likelihood[bad].max(), flush=True)
    highest = np.quantile([level.max() for level in levels], [0.5, 0.9, 1.0])
    beyond = np.concatenate(levels) - TAIL
    beyond = beyond[beyond > 0]
    rate = len(beyond) / total * np.exp(-(LIMIT - TAIL) / beyond.mean())
    print(
        f"{alarms} false alarms in {total} samples of {len(levels)} bearings; greatest level: "
        f"median {highest[0]:.1f}, 90 % {highest[1]:.1f}, greatest {highest[2]:.1f}; {len(beyond)} "
        f"searches above {TAIL:g}, by {beyond.mean():.2f} in the mean: {rate:.1e} alarms a sample"
    )


def levels_of(searches: Searches) -> Array:
    """Return what reaches the limit in an alarm: l, and by how much more than a load explains."""
    load = [signature.load for signature in searches.signatures]
    most = searches.likelihood.max(axis=1)
    return np.minimum(most, most - searches.likelihood[:, load].max(axis=1) + LIMIT - MARGIN)


if __name__ == "__main__":
    main()
