"""Every kind with a covariance from starts drawn at random: how many do not come back.

``python -m benchmarks.starts [STARTS]``: STARTS for each kind and precision (10,000), a third on
each sensor; a table, and the worst cases. A few minutes for 10,000.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import ambkit
from ambkit import Machine, Record, Status
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import KINDS
from ambkit.machine.magnets import Precision, own_time

Array = NDArray[np.float64]

WITHIN = 0.05
"""Time for it [s]."""
SENSORS = {"slow": (1e-3, 2e-6), "ordinary": (2e-4, 9.1e-6), "fast": (2e-5, 5e-7)}
"""Lag [s] and noise [m]."""
WITHOUT = ("low-pass", "observer", "steady-state", "constant-velocity")
"""Kinds whose gain is constant, and one with other states."""
LINEAR = ("linear", "linear-adaptive-noise")
NEAR = 4.0
"""How many times a variance may be off that of a long run, up or down."""


def kinds() -> list[str]:
    """Return the kinds with a covariance that need nothing but a bearing."""
    return [k for k, kind in KINDS.items() if k not in WITHOUT and kind.magnet is not None]


class Course(NamedTuple):
    """A record with its truth (n, 4), and where a filter is in the middle of it."""

    bearing: Machine
    y: Array
    u: Array
    truth: Array


def course(sensor: str, kind: str, seed: int = 1) -> Course:
    """Simulate one; small motions for what knows the middle only."""
    lag, noise = SENSORS[sensor]
    bearing = Machine.preset("zittau_axial").replace(
        sensor__lag=lag, sensor__noise_variance=noise**2
    )
    amplitude = 1e-5 if kind in LINEAR else 3e-4
    record = ambkit.simulate(
        bearing,
        ambkit.Scenario(
            duration=1.0,
            seed=seed,
            reference=ambkit.Sine(amplitude=amplitude, frequency=3.0),
            disturbance=ambkit.Sine(amplitude=0.5, frequency=2.0),
        ),
    ).record
    truth = np.column_stack([record[name] for name in ("x", "v", "f_d", "x_m")])
    return Course(bearing, record["y"], record["u"], truth)


def drawn(bearing: Machine, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a mean (4,) and standard deviations (4,).

    The mean is zero, anywhere within the stops, or anything; each standard deviation from 1e-12 to
    1e12 of its state's scale, or near that.
    """
    travel = bearing.clearance
    weight = bearing.rotor.mass * 9.81
    scale = np.array([travel, travel / own_time(bearing), weight, bearing.sensor.gain * travel])
    mean = np.zeros(4)
    which = rng.integers(3)
    if which == 1:
        mean = scale * rng.uniform(-1, 1, 4)
    elif which == 2:
        mean = scale * rng.choice([-1, 1], 4) * 10 ** rng.uniform(-12, 12, 4)
    decades = rng.choice([1, 12])
    return mean, scale * 10 ** rng.uniform(-decades, decades, 4)


class Found(NamedTuple):
    """What became of one start."""

    off: float  # greatest error over its standard deviation
    ratio: float  # greatest ratio of a variance to that of the long run, or its inverse
    status: int  # of the last sample

    @property
    def good(self) -> bool:
        """Whether the filter is back."""
        held = self.status & (Status.HELD | Status.RESTARTED)
        return self.off <= 5 and self.ratio <= NEAR and not held


def tried(kf: Estimator, c: Course, long: Array, start: tuple[Array, Array], at: int) -> Found:
    """Run a filter from a start at sample `at`; `long` (n, 10): covariances of a long run.

    What learns its noise takes ten times as long for that: its long run is one that learns nothing.
    """
    n = round(WITHIN / c.bearing.sampling_time)
    kf.reset(*start)
    part = slice(at, at + n)
    real = np.dtype(kf.precision)
    out = kf.core.run(c.y[part].astype(real), c.u[part].astype(real), covariance=True)
    end = at + n - 1
    variance = out["covariance"][-1][[0, 4, 7, 9]].astype(float)
    settled = long[end][[0, 4, 7, 9]].astype(float)
    off = np.abs(out["mean"][-1] - c.truth[end]) / np.sqrt(variance)
    ratio = np.maximum(variance / settled, settled / variance)
    return Found(float(off.max()), float(ratio.max()), int(out["status"][-1]))


def campaign(kind: str, precision: Precision, starts: int, seed: int = 0) -> list[str]:
    """Try one kind; return a line for each start from which it did not come back."""
    rng = np.random.default_rng(seed)
    lost = []
    for sensor in SENSORS:
        c = course(sensor, kind)
        kf = KINDS[kind].make(c.bearing, precision=precision)
        settled = getattr(kf, "inner", kf)
        whole = Record(np.arange(len(c.y)) * c.bearing.sampling_time, {"y": c.y, "u": c.u})
        long = settled.run(whole, covariance=True).covariance
        assert long is not None
        last = len(c.y) - round(WITHIN / c.bearing.sampling_time)
        for _ in range(-(-starts // len(SENSORS))):
            start, at = drawn(c.bearing, rng), int(rng.integers(last // 5, last))
            result = tried(kf, c, long, start, at)
            if not result.good:
                lost.append(f"{kind} {precision} {sensor}: {result}, from {start} at {at}")
    return lost


def main(starts: int = 10_000) -> int:
    """Print a table, then the lost ones; return how many those are."""
    all_lost = []
    print(f"{'kind':26}{'float64':>10}{'float32':>10}   lost of {starts}")
    for kind in kinds():
        counts = []
        precisions: tuple[Precision, Precision] = ("float64", "float32")
        for precision in precisions:
            lost = campaign(kind, precision, starts)
            counts.append(len(lost))
            all_lost += lost
        print(f"{kind:26}{counts[0]:10}{counts[1]:10}", flush=True)
    print("\n".join(all_lost[:20]))
    return len(all_lost)


if __name__ == "__main__":
    sys.exit(1 if main(*map(int, sys.argv[1:])) else 0)
