"""Tuning a filter by the likelihood of a record, where there is no truth to tune by."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.data.reading.faults import spike_free
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.estimate import Estimate, Status
from ambkit.estimate.estimator import Estimator
from ambkit.machine.force_laws import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.parts import GRAVITY

DECADES = (-8.0, 1.0)  #: Range of the search, in decades around ``(2 m g)^2`` a second.

MUCH_LESS_LIKELY = 2.0
"""Loss of log likelihood with which a value counts as ruled out (Edwards 1972)."""

AT_THE_END = 0.1  #: Decades from the end of the range within which the search has run into it.


TOO_LARGE = 2.0
"""Innovations over what the filter expects, root mean square, that no load explains."""


def check_signals(machine: Machine, record: Record) -> None:
    """Refuse a record without a reading or a control signal of a machine."""
    needed = [signal("y", r.name) for r in machine.readings]
    needed += [signal("u", axis.name) for axis in machine.axes]
    lacking = [name for name in needed if name not in record]
    if lacking:
        raise AmbkitError(f"the record has no {', '.join(lacking)}, which {machine.name} gives")


def default_disturbance(machine: Machine) -> Any:
    """Process noise intensity of f_d of an untuned filter, of each axis [N^2/s]."""
    return _times([(2 * b.rotor.mass * GRAVITY) ** 2 for b in isolated_axes(machine)], 1.0)


def _times(own: Any, factor: float) -> Any:
    parts = tuple(factor * float(one) for one in np.atleast_1d(own))
    return parts if len(parts) > 1 else parts[0]


def in_units(intensity: Any) -> str:
    """Return a process noise intensity of the disturbance force, of each axis, as text."""
    parts = dict.fromkeys(f"{one:.3g}" for one in np.atleast_1d(intensity))
    return f"{' and '.join(parts)} N^2/s"


def log_likelihood(
    estimate: Estimate, first: int = 1, counts: NDArray[np.bool_] | None = None
) -> float:
    """Log likelihood of a filter's measurements (Schweppe 1965), up to a constant."""
    # ``-1/2 sum(ln S + e^2/S)`` over the innovations e and the variances S that the filter
    # expected; the first sample, which the filter starts from, does not count, nor what is before
    # sample `first` or not in `counts` (n,). An outlier does: a filter that leaves out what it did
    # not expect is not the more likely for it. What a filter has no idea of, as a low-pass, does
    # not count.
    used_mask = _taken(estimate) & (True if counts is None else counts)
    used_mask[: max(1, first)] = False
    # Of several readings one after another, each given those before.
    e, S = estimate.innovation[used_mask], estimate.innovation_variance[used_mask]
    valid = S > 0
    return float(-0.5 * np.sum(np.log(S[valid]) + e[valid] ** 2 / S[valid]))


@dataclass(frozen=True)
class TunedDisturbance:
    """What a stretch of a record says of how fast the load wanders."""

    #: Process noise intensity of the disturbance force to be used [N^2/s], of several axes of each.
    intensity: Any
    why: str = ""  #: Why it is that, where the stretch does not single one out; else empty.


def tune_disturbance(
    machine: Machine, record: Record, make: Callable[[Any], Estimator]
) -> TunedDisturbance:
    """Find the process noise of the disturbance force under which a record is most likely."""
    # The paper leaves it to experiment. Too small, and the filter is sure of a wrong force; too
    # large, and it takes the noise of the sensor for forces. Not every record tells: the untuned
    # intensity is kept where it is as likely as the best, and where something else is wrong, for
    # then the search runs to its upper end or to a chance summit. Where the load hardly wanders,
    # and any small intensity is as likely, the largest of these is taken.
    from scipy.optimize import brentq, minimize_scalar

    own = default_disturbance(machine)
    low, high = DECADES
    record, _ = spike_free(record)

    @cache
    def cost(decade: float) -> float:
        return -log_likelihood(make(_times(own, 10**decade)).run(record))

    # The likelihood can have a flat or second hill: look everywhere first, then go up the highest.
    grid = np.arange(low, high + 0.5)
    best = float(min(grid, key=cost))
    if cost(best) == max(map(cost, grid)):  # it assumes no load noise, as a low-pass
        return TunedDisturbance(own)
    around = (max(low, best - 1), min(high, best + 1))
    result = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 0.02})
    at = min(best, float(result.x), key=cost)

    def ruled_out(decade: float) -> float:
        return cost(decade) - cost(at) - MUCH_LESS_LIKELY

    larger = _innovations_over_expected(make(_times(own, 10**at)).run(record))
    if at > high - AT_THE_END or larger > TOO_LARGE:
        return TunedDisturbance(
            own,
            "no load explains this stretch: with the likeliest load noise, "
            f"{in_units(_times(own, 10**at))}, the innovations are {larger:.1f} times what the "
            "filter expects. Is the noise of the sensor as large as the bearing says "
            f"(--measurement-noise)? The untuned load noise is kept, {in_units(own)}",
        )
    if ruled_out(0.0) < 0:
        return TunedDisturbance(own, "this stretch does not tell how fast the load wanders, so the "
                                     f"untuned load noise is kept, {in_units(own)}")  # fmt: skip
    if ruled_out(low) < 0:
        beyond = next((float(d) for d in grid if d > at and ruled_out(float(d)) > 0), at)
        most = _times(own, 10**at)
        if beyond > at:
            most = _times(own, 10 ** brentq(ruled_out, at, beyond, xtol=0.02))
        return TunedDisturbance(
            most,
            "the load hardly wanders in this stretch: any load noise up to "
            f"{in_units(most)} is as likely, and this one is used",
        )
    return TunedDisturbance(_times(own, 10**at))


def _innovations_over_expected(estimate: Estimate) -> float:
    """Root mean square of the normalised innovations; 0 where the filter has no idea of them."""
    nis = estimate.nis[_taken(estimate)][1:]
    known = nis[np.isfinite(nis)]
    return math.sqrt(float(known.mean())) if known.size else 0.0


def _taken(estimate: Estimate) -> NDArray[np.bool_]:
    """Where a filter took a measurement in, or left it out for being too far off."""
    outlier = (estimate.status & np.uint16(Status.OUTLIER)) != 0
    return np.asarray(estimate.used | outlier)
