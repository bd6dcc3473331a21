"""Right at any sensor speed? Every Kalman filter against the bound, the raw sensor and a naive one.

``python -m benchmarks.sensors bound`` judges the extended filter by the Cramer-Rao bound on the
paper's bearing with six sensors. ``python -m benchmarks.sensors random [bearings] [first]`` draws
sensible bearings at random, and compares the position of each kind of Kalman filter with the
raw sensor and with a constant-velocity Kalman filter that knows no magnet. What each assumes of its
process noise is tuned alike: one figure, against the true position, on runs of their own.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ambkit import FilterNoise, Machine, Record
from ambkit.base.errors import AmbkitError
from ambkit.estimate.constant_velocity import tune as constant_velocity
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison.cases import CASES, trials
from ambkit.judge.comparison.comparison import bench
from ambkit.judge.comparison.tuning import candidates
from ambkit.machine.magnets import own_time

Array = NDArray[np.float64]

SENSORS = (
    (1e-6, 0.5e-6), (20e-6, 0.5e-6), (20e-6, 0.1e-6), (0.2e-3, 0.5e-6), (0.2e-3, 9.1e-6),
    (1e-3, 2e-6),
)  # fmt: skip
"""Lag [s] and standard deviation of the noise [m]."""

KALMAN = (
    "linear", "steady-state", "closed-law", "extended", "ud", "augmented",
    "multiple-model", "unscented", "linear-adaptive-noise", "extended-adaptive-noise",
)  # fmt: skip
"""All kinds but the expert's, whose law is the closed one here, and what is no Kalman
filter."""

RAW, NAIVE = "raw sensor", "constant velocity"
RUNS = 3
"""Judged, after as many others that are tuned on."""

DECADES = 4.0
"""How far tuning goes from the default growth of the load, to either side."""

SETTLING = 12
"""Of the bearing's time constants, which do not count."""


def efficiency(lag: float, noise: float, runs: int = 200, seed: int = 1) -> dict[str, float]:
    """Judge the extended filter, which knows the true law, on the paper's bearing.

    Parameters
    ----------
    lag, noise : float
        Of the sensor: time constant [s], standard deviation [m].
    runs, seed : int
        Of the case in which all is as the filters' model says.

    Returns
    -------
    dict
        Limit over root mean square error of ``x``, ``v``, ``f_d``; ``nees``, the share of samples
        within the 95 % bound, and ``nees_error``, the standard error of that; ``nis``.
    """
    bearing = Machine.preset("zittau_axial").replace(
        sensor__lag=lag, sensor__noise_variance=noise**2
    )
    result = bench(bearing, CASES["model"], candidates(["extended"], bearing), runs=runs, seed=seed)
    figures = result.default["extended"].figures
    return {name: result.efficiency("extended", name) for name in ("x", "v", "f_d")} | {
        "nees": float(figures["nees"].mean()),
        "nees_error": float(figures["nees"].std(ddof=1) / math.sqrt(runs)),
        "nis": float(figures["nis"].mean()),
    }


def drawn(seed: int) -> Machine:
    """Draw a sensible bearing: the loop's own pole is slow beside sampling and sensor."""
    random = np.random.default_rng([seed, 11])

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** random.random())

    gap, i0, mass = between(0.2e-3, 10e-3), between(0.5, 8.0), between(0.05, 50.0)
    travel = gap * between(0.25, 0.5)
    T = between(20e-6, 1e-3)
    lag = T * between(0.01, 30.0)
    two_sided = bool(random.random() < 0.6)
    if two_sided:
        pole = between(15.0, 500.0)
        k = pole**2 * mass * gap**3 / (4 * i0**2)
        gravity = str(random.choice(["none", "-x", "+x"]))
    else:  # the magnet carries the rotor at its bias current
        k = mass * 9.81 * gap**2 / i0**2
        gravity = "-x"
    return Machine.model_validate({
        "name": f"drawn_{seed}",
        "sampling_time": T,
        "magnet": {
            "type": "two-sided" if two_sided else "one-sided", "magnet_constant": k,
            "air_gap": gap, "bias_current": i0,
        },
        "rotor": {"mass": mass, "gravity": gravity, "clearance": travel},
        "amplifier": {
            "gain": between(0.1, 10.0), "current_limit": i0,
            "noise_variance": (i0 * between(1e-4, 1e-2)) ** 2,
        },
        "sensor": {"gain": between(0.5, 2.0), "lag": lag,
                   "noise_variance": between(0.05e-6, 20e-6) ** 2},
    })  # fmt: skip


@dataclass(frozen=True)
class Judged:
    """Errors of the position on one bearing [m], rms over the runs that it was not tuned on."""

    bearing: Machine
    errors: dict[str, float]

    def ratio(self, name: str) -> float:
        """Error of a filter over that of the better of raw sensor and naive filter."""
        return self.errors[name] / min(self.errors[RAW], self.errors[NAIVE])


def judged(seed: int) -> Judged | None:
    """Tune and judge all filters on a drawn bearing; None where its loop does not hold it."""
    try:
        bearing = drawn(seed)
        made = trials(CASES["paper"], bearing, 2 * RUNS, seed)
    except (AmbkitError, ValueError):
        return None  # it cannot carry its rotor
    if any(trial.lost for trial in made):
        return None
    records = [trial.record for trial in made]
    training, rest = records[:RUNS], records[RUNS:]
    first = round(SETTLING * own_time(bearing) / bearing.sampling_time)
    gain = bearing.sensor.gain
    naive = constant_velocity(
        [r["y"] / gain for r in training],
        bearing.sampling_time,
        truth=[r["x"] for r in training],
        first=first,
    )
    errors = {
        RAW: _error((r["y"] / gain - r["x"] for r in rest), first),
        NAIVE: _error((naive.run(r["y"] / gain)[0] - r["x"] for r in rest), first),
    }
    for name in KALMAN:
        kalman = _tuned(name, bearing, training, first)
        errors[name] = _error((kalman.run(r).x - r["x"] for r in rest), first)
    return Judged(bearing, errors)


def _tuned(name: str, bearing: Machine, training: Sequence[Record], first: int) -> Any:
    """Return a filter whose growth of the load makes the error on the training runs least."""

    def made(decade: float) -> Any:
        default = KINDS["linear"].make(bearing).variances.disturbance
        noise = FilterNoise(disturbance=default * 10**decade)
        return KINDS[name].make(bearing, noise=noise)

    def cost(decade: float) -> float:
        return _error((made(decade).run(r).x - r["x"] for r in training), first)

    grid = np.arange(-DECADES, DECADES + 0.5)
    costs = [cost(float(decade)) for decade in grid]
    best = float(grid[int(np.argmin(costs))])
    result = minimize_scalar(cost, bounds=(best - 1, best + 1), method="bounded",
                            options={"xatol": 0.02})  # fmt: skip
    return made(best if min(costs) <= result.fun else float(result.x))


def _error(errors: Iterable[Array], first: int) -> float:
    return math.sqrt(np.mean([np.mean(error[first:] ** 2) for error in errors]))


def bearings(count: int, first: int = 0) -> Iterator[Judged]:
    """Judge so many bearings whose loops hold them."""
    seed = first
    while count > 0:
        result = judged(seed)
        seed += 1
        if result is not None:
            count -= 1
            yield result


def main() -> None:
    """Print one of the tables."""
    if sys.argv[1:2] == ["bound"]:
        print(f"{'lag':>9} {'noise':>9} {'x':>7} {'v':>7} {'f_d':>7} {'NEES':>16} {'NIS':>7}")
        for lag, noise in SENSORS:
            row = efficiency(lag, noise)
            share = f"{100 * row['nees']:.1f} ± {200 * row['nees_error']:.1f} %"
            print(f"{1e6 * lag:6.0f} µs {1e6 * noise:6.1f} µm {row['x']:7.3f} {row['v']:7.3f} "
                  f"{row['f_d']:7.3f} {share:>16} {row['nis']:7.3f}")  # fmt: skip
        return
    count, first = (int(a) for a in [*sys.argv[2:], *("300", "0")[len(sys.argv) - 2 :]])
    results = []
    for bearing in bearings(count, first):
        results.append(bearing)
        worst = max(KALMAN, key=bearing.ratio)
        print(f"{bearing.bearing.name}: worst {worst} {bearing.ratio(worst):.3f}", file=sys.stderr)
    print(f"{'filter':25} {'median':>8} {'95 %':>8} {'worst':>8}  worst case")
    for name in KALMAN:
        ratios = np.array([item.ratio(name) for item in results])
        worst_one = results[int(np.argmax(ratios))].bearing.name
        print(f"{name:25} {np.median(ratios):8.3f} {np.quantile(ratios, 0.95):8.3f} "
              f"{ratios.max():8.3f}  {worst_one}")  # fmt: skip


if __name__ == "__main__":
    main()
