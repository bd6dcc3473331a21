"""Rotors pressed on their touch-down bearings: filters judged by truth beside the raw sensor.

    uv run python -m benchmarks.contact [RUNS [NAME ...]]

Each axis has a random walk of its disturbance force, as the filters assume, so strong that the
rotor lies on its stops for much of a run; or a weak one, and the rotor drops, as the power fails
after a quarter of the run. The last axes and machines are random ones. A row: the
share of the time in contact; the error of the position in um rms of the raw sensor, the
constant-velocity, the extended and the contact filter, the latter two with the unbalance of a
machine that has one; of the contact filter the share of samples
within the 95 % region of x, v and f_d, and the error of the contact force over a sample relative to
that force, both rms; how late contact is flagged and released in 99 of 100 cases [ms].
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import ambkit
from ambkit import FilterNoise, Machine, Record, Recorded, Scenario, Status
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.estimate.contact import ContactKalmanFilter
from ambkit.estimate.machine_model import View
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison.comparison import raw_error
from ambkit.judge.comparison.criteria import errors_along, nees, true_signal
from ambkit.machine.accessories import Stop
from ambkit.machine.axes import load_capacity
from ambkit.machine.magnets import magnet_of
from benchmarks.defaults import random_machine
from benchmarks.sensors import drawn

WALK = {True: 4.0, False: 1.0}
"""Of the disturbance force at the end of a run, rms [load capacities of the axis], of a machine
with one axis and with several: each presses the rotor on a stop for about half of the time."""
WEAK = 0.1  #: The same where the rotor drops.
SAMPLES = 5000  #: Of a run.
SETTLED = 200  #: Judged from this sample on.
STICKS = 1e-3  #: Slip up to which friction is in proportion to it (sim/parts.h) [m/s].
FINE = 16  #: Parts of a sample over which a true contact force is averaged.


def with_stop(machine: Machine, stiffness: float, damping: float = 0.3, **more: float) -> Machine:
    """Return a machine whose every bearing has a stop, one with friction where it has a ring."""
    stops = {False: Stop(stiffness=stiffness, damping=damping)}
    stops[True] = Stop(stiffness=stiffness, damping=damping, **more)
    return machine.model_copy(update={"bearings": tuple(
        b.model_copy(update={"stop": stops[b.type == "radial"]}) for b in machine.bearings
    )})  # fmt: skip


def walks(
    machine: Machine, seed: int, duration: float, off: float | None = None
) -> tuple[Record, FilterNoise]:
    """Return a run under random walks, in the loop of the measurement, and how strong they are."""
    # off: when the power fails [s]; None: never
    T = machine.sampling_time
    t = T * np.arange(round(duration / T) + 1)
    strength = WALK[machine.single] if off is None else WEAK
    capacities = strength * np.array(load_capacity(machine))
    random = np.random.default_rng(1000 + seed)
    steps = random.normal(0, 1, (len(capacities), t.size)) * np.sqrt(T / duration)
    loads = [Recorded.of(t, load) for load in np.cumsum(capacities[:, None] * steps, axis=1)]
    disturbance = loads[0] if machine.single else [
        {"axis": axis.name, "force": load} for axis, load in zip(machine.axes, loads, strict=True)
    ]  # fmt: skip
    scenario = Scenario(
        duration=duration,
        seed=seed,
        off=off,
        disturbance=disturbance,
        controller={"feedback": "measurement"},
    )
    record = ambkit.simulate(machine, scenario).record
    return record, FilterNoise(disturbance=tuple(capacities**2 / duration))


@dataclass
class Judged:
    """What runs gave, an item each."""

    contact: list[float] = field(default_factory=list)  #: Share of the time in contact.
    errors: dict[str, list[float]] = field(default_factory=dict)  #: Of the position [m^2].
    nees: list[float] = field(default_factory=list)
    force: list[float] = field(default_factory=list)  #: Squared error of the contact force [N^2]
    of: list[float] = field(default_factory=list)  #: ... and its square, both sums over contact.
    flagged: list[float] = field(default_factory=list)  #: How late contact is, each time [s] ...
    released: list[float] = field(default_factory=list)  #: ... and its end.

    def rms(self, name: str) -> float:
        """Root mean square error of the position by a kind, or raw [m]."""
        return float(np.sqrt(np.mean(self.errors[name])))

    def add(self, kind: str, error: float) -> None:
        """Add what a kind has in a run."""
        self.errors.setdefault(kind, []).append(error)

    @property
    def off(self) -> float:
        """Error of the contact force relative to it, both rms."""
        return float(np.sqrt(sum(self.force) / max(sum(self.of), 1e-300)))


def judge(
    machine: Machine, seeds: Iterable[int], *, samples: int = SAMPLES, drops: bool = False
) -> Judged:
    """Run filters along touchdowns, and judge them by truth."""
    T, view, result = machine.sampling_time, View(machine), Judged()
    turning = {"synchronous": ("unbalance",)} if machine.unbalance else {}
    for seed in seeds:
        record, noise = walks(machine, seed, samples * T, samples * T / 4 if drops else None)
        result.add("raw", raw_error(machine, [record], SETTLED) ** 2)
        for name in ("constant-velocity", "extended", "contact"):
            known = {} if name == "constant-velocity" else {"noise": noise, **turning}
            filter: Any = KINDS[name].make(machine, **known)
            estimate = filter.run(record, covariance=True)
            error = errors_along(estimate, record, view)["x"][:, SETTLED:]
            result.add(name, float(np.mean(error**2)))
        force, estimated = true_forces(filter, record), filter.contact_forces(estimate, record)
        touching = (force != 0).any(axis=1) & (np.arange(len(force)) >= SETTLED)
        result.contact.append(float(np.mean(touching[SETTLED:])))
        result.nees.append(nees(estimate, record, SETTLED, view))
        result.force.append(float(np.sum((estimated - force)[touching] ** 2)))
        result.of.append(float(np.sum(force[touching] ** 2)))
        flags = (np.asarray(estimate.status) & int(Status.CONTACT)) != 0
        for start, end in episodes(touching):
            if end - start >= 1e-3 / T:
                result.flagged.append(float(np.argmax(flags[start:]) * T))
            if end < len(force) - 50 and not touching[end : end + 20].any():
                result.released.append(float(np.argmin(flags[end:]) * T))
    return result


def episodes(mask: Array) -> Iterator[tuple[int, int]]:
    """Yield where true stretches begin and end."""
    edges = np.flatnonzero(np.diff(np.r_[0, mask.astype(int), 0]))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def true_forces(filter: ContactKalmanFilter, record: Record) -> Array:
    """Return the true contact force along each axis (n, p) [N], its mean until the next sample."""
    # Displacements along the axes between samples go by the cubic through both ends.
    T = record.sampling_time
    truth = [true_signal(record, state.name) for state in filter.states]
    states = np.array([np.zeros(len(record)) if one is None else one for one in truth])
    here, moving = (rows @ states for rows in filter.view.along_axes(filter.states))
    ahead, moving_on = (np.column_stack([rows[:, 1:], rows[:, -1:]]) for rows in (here, moving))
    result = np.zeros(here.shape)
    for part in (np.arange(FINE) + 0.5) / FINE:
        h = part**2 * (3 - 2 * part), 6 * part * (1 - part)
        there = here + h[0] * (ahead - here)
        there += T * part * (1 - part) * ((1 - part) * moving - part * moving_on)
        rate = h[1] * (ahead - here) / T
        rate += (1 - part) * (1 - 3 * part) * moving - part * (2 - 3 * part) * moving_on
        result += stop_forces(filter.machine, there, rate) / FINE
    return result.T


def stop_forces(machine: Machine, s: Array, v: Array) -> Array:
    """Return the contact forces along the axes, at displacements and velocities along them."""
    # s, v, result (p, n) [m], [m/s], [N]
    result, at = np.zeros(s.shape), 0
    for bearing in machine.bearings:
        of, stop = slice(at, at := at + 1 + (bearing.type == "radial")), bearing.stop
        if stop is None:
            continue
        far = np.linalg.norm(s[of], axis=0)
        way = s[of] / np.maximum(far, 1e-12)
        depth = np.maximum(far - bearing.clearance, 0)
        give = np.maximum(1 + 1.5 * stop.damping * (way * v[of]).sum(axis=0), 0)
        result[of] -= (normal := stop.stiffness * depth**1.5 * give) * way
        if stop.friction:
            across = np.array([-way[1], way[0]])
            slip = (across * v[of]).sum(axis=0) + stop.radius * machine.speed
            result[of] -= stop.friction * normal * np.clip(slip / STICKS, -1, 1) * across
    return result


def bound(machine: Machine, seed: int, particles: int = 4000, samples: int = 2500) -> list[float]:
    """Return how far off the contact force of an axis is at least, and the filter's, as shares.

    The mean of its distribution given all readings until then, the best there is, by a particle
    filter (Gordon, Salmond & Smith 1993) whose particles fly the plant in steps of T / 8.
    """
    T, steps, random = machine.sampling_time, 8, np.random.default_rng(seed)
    record, noise = walks(machine, seed, samples * T)
    filter = ContactKalmanFilter(machine, noise=noise)
    truth, law, stop = true_forces(filter, record)[:, 0], magnet_of(machine), machine.stop
    (growth,), h, mass, n = noise.disturbance, T / steps, machine.rotor.mass, particles
    start = [record[name][0] for name in ("x", "v", "x_m", "f_d")]
    spread = np.array([2e-6, 2e-3, 2e-6, 0.1 * load_capacity(machine)[0]])
    x, v, x_m, f_d = (start + spread * random.normal(size=(n, 4))).T
    most, best = 0.9 * machine.magnet.air_gap, np.zeros(len(record))
    for k, (y, u) in enumerate(zip(record["y"], record["u"], strict=True)):
        fit = (y - machine.sensor.gain * x_m) ** 2 / (2 * filter.variances.measurement)
        weight = np.exp(fit.min() - fit)
        chosen = np.searchsorted(np.cumsum(weight / weight.sum()), (np.arange(n) + 0.5) / n)
        kept = np.array([x, v, x_m, f_d])[:, chosen.clip(0, n - 1)]
        x, v, x_m, f_d = kept + 0.02 * kept.std(axis=1)[:, None] * random.normal(size=(4, n))
        amplifier = machine.amplifier
        u = u + np.sqrt(amplifier.noise_variance) * random.normal(size=n)
        iu = np.clip(amplifier.gain * u, machine.current_min, machine.current_max)
        wander = np.sqrt(growth * T) * random.normal(size=n)
        for part in range(steps):
            load, force = f_d + wander * (part + 0.5) / steps, []
            there, rate = x, v
            for ahead in (h / 2, h):
                side, far = np.sign(there), np.abs(there)
                depth = np.maximum(far - machine.clearance, 0)
                give = np.maximum(1 + 1.5 * stop.damping * side * rate, 0)
                force.append(-side * stop.stiffness * depth**1.5 * give)
                pulled = law.force(iu, np.clip(there, -most, most))
                a = (pulled + law.bias_force + machine.weight + load + force[-1]) / mass
                there, rate, at = x + ahead * rate, v + ahead * a, there
            x, v = there, rate
            x_m = x_m + (at - x_m) * -np.expm1(-h / machine.sensor.lag)
            best[k] += force[-1].mean() / steps
        f_d = f_d + wander
    touching = (truth != 0) & (np.arange(len(truth)) >= SETTLED)
    estimated = filter.contact_forces(filter.run(record), record)[:, 0]
    off = [one[touching] - truth[touching] for one in (best, estimated)]
    return [float(np.sqrt(np.mean(one**2) / np.mean(truth[touching] ** 2))) for one in off]


def paper(noise: float, stiffness: float, **changes: Any) -> Machine:
    """Return the paper's rig with a sensor of so many um, and a stop."""
    changes |= {"sensor__noise_variance": f"{noise**2} um^2"}
    return with_stop(Machine.preset("zittau_axial").replace(**changes), stiffness)


def random(seed: int, machine: Machine) -> Machine:
    """Return a machine with a stop that its load capacity presses in by 1 to 10 % of the way."""
    mass, capacity = machine.rotor.mass, float(np.median(load_capacity(machine)))
    clearance, random = machine.bearings[0].clearance, np.random.default_rng([seed, 77])
    depth, impact = 0.01 * 10 ** random.uniform(0, 1), np.sqrt(capacity * clearance / mass)
    stiffness = capacity / (depth * clearance) ** 1.5
    return with_stop(machine, stiffness, random.uniform(0, 0.6) / impact)


def resolution(machine: Machine) -> float:
    """Return k T^2 / mass of the stop under load capacity [1], of the first axis."""
    stop = machine.bearings[0].stop
    depth = (load_capacity(machine)[0] / stop.stiffness) ** (2 / 3)
    k = 1.5 * stop.stiffness * np.sqrt(depth)
    return float(k * machine.sampling_time**2 / machine.rotor.mass)


def preset(name: str, **friction: float) -> Machine:
    """Return a machine with unbalance that turns, or without both."""
    machine = Machine.preset(name)
    return with_stop(machine if machine.single else machine.replace(unbalance=[]), 1e9, **friction)


MACHINES: dict[str, Callable[[], Machine]] = {
    "5.8 um, 1e8": lambda: paper(5.8, 1e8),
    "1 um, 1e9": lambda: paper(1.0, 1e9, sensor__lag="20 us"),
    "3 um, 1e9, 20 kHz": lambda: paper(3.0, 1e9, sensor__lag="50 us", sampling_time="50 us"),
    "5.8 um, 3e9": lambda: paper(5.8, 3e9),
    "1 um, 3e9": lambda: paper(1.0, 3e9),
    "ufu_rig": lambda: preset("ufu_rig"),
    "tum_mlps": lambda: preset("tum_mlps"),
    "ufu_rig, friction": lambda: preset("ufu_rig", friction=0.1, radius=0.02),
    "tum_mlps, friction": lambda: preset("tum_mlps", friction=0.1, radius=0.02),
    **{
        f"{name}, drop": lambda name=name: preset(name, friction=0.05, radius=0.02)
        for name in ("zittau_axial", "ufu_rig", "tum_mlps", "hindawi_2011")
    },
}


def main() -> None:
    """Print a line for each machine that is named, or all, and for random ones."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    cases = {name: (make, runs) for name, make in MACHINES.items()}
    for seed in range(24):
        cases[f"axis {seed}"] = (lambda seed=seed: random(seed, drawn(seed)), 4)
    for seed in range(300, 330):
        cases[f"machine {seed}"] = (lambda seed=seed: random(seed, random_machine(seed)), 4)
    print(f"{'':20} k T^2/m contact    raw   c.v.    ext contact   NEES force  bound late  on/off")
    for name in sys.argv[2:] or cases:
        try:
            make, count = cases[name]
            machine = make()
            result = judge(machine, range(11000, 11000 + count), drops=name.endswith("drop"))
        except (AmbkitError, ValueError):
            continue  # it cannot carry its rotor
        limits = [bound(machine, 11000 + k) for k in range(4)] if name in list(MACHINES)[:5] else []
        share = f"{np.nanmean(limits, axis=0)[0]:6.3f}" if limits else " " * 6
        errors = "".join(f"{1e6 * result.rms(kind):7.2f}" for kind in result.errors)
        late = [
            1e3 * np.quantile(x, 0.99) if x else np.nan for x in (result.flagged, result.released)
        ]
        print(
            f"{name:20} {resolution(machine):7.3f} {np.mean(result.contact):7.2f}{errors}"
            f"{np.nanmean(result.nees):8.3f}{result.off:6.3f} {share} {late[0]:5.2f}{late[1]:5.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
