"""A billion steps of the filter on a factor, in single precision, without losing definiteness.

    python -m benchmarks.long_run                  # 1e9 steps, some minutes
    python -m benchmarks.long_run --steps 1e8
    python -m benchmarks.long_run --kind extended  # the plain covariance beside it

Ten seconds of a swinging rotor are filtered again and again, from C, ten thousand steps a call. The
sensor is as sharp as 0.1 micrometre and fails for 0.3 s in every ten, such that the covariance goes
from what a float holds to what it hardly holds, and back. After each call, and when the sensor has
just come back, the factor and the smallest eigenvalue of the correlations are looked at. Interrupt
it, and it says how far it came. Ends with status 1 where definiteness was lost.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

import ambkit
from ambkit.base.progress import progress
from ambkit.estimate.registry import KINDS

PERIOD, CALL, GAP = 100_000, 10_000, 1_500  # samples; the gap is on either side of the seam
SENSOR = 1e-7  # m


@dataclass
class Seen:
    """What a run has shown.

    Attributes
    ----------
    steps : int
        How many were made.
    seconds : float
        In the filter.
    kept : bool
        Whether the covariance was positive definite and the mean finite, whenever looked at.
    least_eigenvalue : float
        Of the correlations, whenever looked at.
    lost : int
        Steps after which rounding had eaten the covariance (``Status.BAD_VARIANCE``).
    off : float
        How far the last mean is from that of the same filter in double, standard deviations.
    """

    steps: int = 0
    seconds: float = 0.0
    kept: bool = True
    least_eigenvalue: float = np.inf
    lost: int = 0
    off: float = np.nan


def run(steps: int, kind: str = "ud", *, show: bool = True) -> Seen:
    """Run `steps` steps, in whole periods of `PERIOD`; an interruption ends it early."""
    bearing, y, u = _record()
    double = KINDS[kind].make(bearing).core
    single = KINDS[kind].make(bearing, precision="float32").core
    ends = sorted({*range(0, PERIOD + 1, CALL), GAP + 1, GAP + 3, PERIOD - GAP})
    calls = [(y[a:b], u[a:b]) for a, b in pairwise(ends)]
    narrow = [(a.astype(np.float32), b.astype(np.float32)) for a, b in calls]
    seen = Seen()
    periods = max(1, round(steps / PERIOD))
    try:
        with _bar(periods, show) as done:
            for _ in range(periods):
                for part in narrow:
                    begin = time.perf_counter()
                    history = single.run(*part)
                    seen.seconds += time.perf_counter() - begin
                    _look(seen, single, history["status"])
                seen.steps += PERIOD
                done(f"{seen.steps:,} steps")
    except KeyboardInterrupt:
        print(f"interrupted after {seen.steps:,} steps", file=sys.stderr)
        return seen
    # The double filter forgets where it started in less than a period.
    for part in calls:
        double.run(*part)
    sigma = np.sqrt(np.diag(double.covariance))
    seen.off = float(np.max(np.abs(single.mean - double.mean) / sigma))
    return seen


def _record() -> tuple[ambkit.Machine, np.ndarray, np.ndarray]:
    """Return what is filtered; it ends where it began, within a gap of the sensor."""
    bearing = ambkit.preset("zittau_axial").replace(sensor__noise_variance=SENSOR**2)
    swing = ambkit.Sine(amplitude=3e-4, frequency=2.0)
    T = bearing.sampling_time
    scenario = ambkit.Scenario(duration=1.0 + PERIOD * T, reference=swing)
    record = ambkit.simulate(bearing, scenario).record
    y, u = record["y"][-PERIOD:].copy(), record["u"][-PERIOD:].copy()
    y[:GAP] = y[-GAP:] = np.nan
    return bearing, y, u


def _look(seen: Seen, core: Any, status: np.ndarray) -> None:
    if hasattr(core, "factor"):  # in double, or it is the product's rounding that is seen
        U, D = (a.astype(float) for a in core.factor)
        P = (U * D) @ U.T
    else:
        P = core.covariance.astype(float)
        D = np.diag(P)
    scale = np.sqrt(np.abs(np.diag(P)))
    least = float(np.linalg.eigvalsh(P / np.outer(scale, scale))[0])
    seen.least_eigenvalue = min(seen.least_eigenvalue, least)
    seen.kept &= bool(least > 0 and (D > 0).all() and np.isfinite(core.mean).all())
    seen.lost += int(np.count_nonzero(status & ambkit.Status.BAD_VARIANCE))


def _bar(total: int, show: bool) -> Any:
    from contextlib import nullcontext

    return progress("filtering", total) if show else nullcontext(lambda _text="": None)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, and print what was seen; see the module."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.long_run",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--steps", type=float, default=1e9, help="how many; default 1e9")
    parser.add_argument("--kind", choices=("ud", "extended"), default="ud", help="which filter")
    options = parser.parse_args(arguments)
    if not 1 <= options.steps <= 1e12:
        parser.error(f"--steps must be from 1 to 1e12, is {options.steps:g}")
    seen = run(int(options.steps), options.kind)
    if not seen.steps:
        return 130
    rate = seen.seconds / seen.steps * 1e9
    print(f"{seen.steps:,} steps in {seen.seconds:.0f} s, {rate:.0f} ns each")
    print(f"definite and finite: {'yes' if seen.kept else 'NO'}; covariance lost: {seen.lost}")
    print(f"least eigenvalue of the correlations: {seen.least_eigenvalue:.2e}")
    print(f"from the same filter in double: {seen.off:.2g} standard deviations")
    return 0 if seen.kept and not seen.lost else 1


if __name__ == "__main__":
    sys.exit(main())
