"""Tuning of the process noise by the likelihood of a record."""

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
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.parts import GRAVITY

DECADES = (-8.0, 1.0)  #: Range of the search, in decades around ``(2 m g)^2`` per second.

MUCH_LESS_LIKELY = 2.0
"""Loss of log likelihood with which a value counts as ruled out (Edwards 1972)."""

#: Distance to the end of the range, in decades, within which the search has reached it.
AT_THE_END = 0.1


TOO_LARGE = 2.0
"""Innovations over what the filter expects, root mean square, that no load explains."""


def check_signals(machine: Machine, record: Record) -> None:
    """Reject a record without all readings and control signals of a machine."""
    needed = [signal("y", r.name) for r in machine.readings]
    needed += [signal("u", axis.name) for axis in machine.axes]
    lacking = [name for name in needed if name not in record]
    if lacking:
        raise AmbkitError(f"the record has no {', '.join(lacking)}, which {machine.name} gives")
    empty = [name for name in needed if not np.isfinite(record[name]).any()]
    if empty:
        raise AmbkitError(f"the record has no valid sample of {', '.join(empty)}")


def default_disturbance(machine: Machine) -> Any:
    """Return the default process noise intensity of f_d, of each axis [N^2/s]."""
    return _times([(2 * b.rotor.mass * GRAVITY) ** 2 for b in isolated_axes(machine)], 1.0)


def _times(own: Any, factor: float) -> Any:
    parts = tuple(factor * float(one) for one in np.atleast_1d(own))
    return parts if len(parts) > 1 else parts[0]


def in_units(intensity: Any) -> str:
    """Return process noise intensities of the disturbance force as text."""
    parts = dict.fromkeys(f"{one:.3g}" for one in np.atleast_1d(intensity))
    return f"{' and '.join(parts)} N^2/s"


def log_likelihood(
    estimate: Estimate, first: int = 1, counts: NDArray[np.bool_] | None = None
) -> float:
    """Log likelihood of a filter's measurements (Schweppe 1965), up to a constant."""
    # ``-1/2 sum(ln S + e^2/S)`` over the innovations e and their variances S. Excluded are the
    # first sample, which starts the filter, and samples before `first` or not in `counts` (n,).
    # Outliers count: a filter must not gain likelihood by rejecting samples. Filters without S,
    # such as a low-pass, have no likelihood.
    used_mask = _taken(estimate) & (True if counts is None else counts)
    used_mask[: max(1, first)] = False
    # Several readings are processed in sequence, each conditional on those before.
    e, S = estimate.innovation[used_mask], estimate.innovation_variance[used_mask]
    valid = S > 0
    return float(-0.5 * np.sum(np.log(S[valid]) + e[valid] ** 2 / S[valid]))


@dataclass(frozen=True)
class TunedDisturbance:
    """Process noise intensity by the likelihood of a part of a record."""

    #: Process noise intensity of the disturbance force to use, of each axis [N^2/s].
    intensity: Any
    why: str = ""  #: Reason for the choice if the likelihood does not determine it; else empty.


def tune_disturbance(
    machine: Machine, record: Record, make: Callable[[Any], Estimator]
) -> TunedDisturbance:
    """Return the process noise intensity that makes a record most likely."""
    # The paper leaves it to experiment. If it is too small, the filter is overconfident in a wrong
    # force; if too large, it takes sensor noise for forces. The default is kept if it is as likely
    # as the optimum, and if the search ends at the upper limit or an isolated maximum, because then
    # something else is wrong. With a nearly constant load the likelihood cannot bound the intensity
    # from below; the largest value consistent with the data is used.
    from scipy.optimize import brentq, minimize_scalar

    own = default_disturbance(machine)
    low, high = DECADES
    record, _ = spike_free(record)

    @cache
    def cost(decade: float) -> float:
        return -log_likelihood(make(_times(own, 10**decade)).run(record))

    # The likelihood may have flat regions and local maxima: search a grid, then refine its best
    # point.
    grid = np.arange(low, high + 0.5)
    best = float(min(grid, key=cost))
    if cost(best) == max(map(cost, grid)):  # no process noise, as in a low-pass
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
            "no process noise explains this interval: with the most likely one, "
            f"{in_units(_times(own, 10**at))}, the innovations are {larger:.1f} times what the "
            "filter expects. Check the sensor noise (--measurement-noise). The "
            f"untuned process noise is kept, {in_units(own)}",
        )
    if ruled_out(0.0) < 0:
        return TunedDisturbance(own, "this interval does not determine the process noise, so the "
                                     f"untuned one is kept, {in_units(own)}")  # fmt: skip
    if ruled_out(low) < 0:
        beyond = next((float(d) for d in grid if d > at and ruled_out(float(d)) > 0), at)
        most = _times(own, 10**at)
        if beyond > at:
            most = _times(own, 10 ** brentq(ruled_out, at, beyond, xtol=0.02))
        return TunedDisturbance(
            most,
            "the disturbance force is nearly constant in this interval: any process noise up to "
            f"{in_units(most)} is equally likely, and this one is used",
        )
    return TunedDisturbance(_times(own, 10**at))


def _innovations_over_expected(estimate: Estimate) -> float:
    """Return the rms of the normalised innovations; 0 for a filter without their variance."""
    nis = estimate.nis[_taken(estimate)][1:]
    known = nis[np.isfinite(nis)]
    return math.sqrt(float(known.mean())) if known.size else 0.0


def _taken(estimate: Estimate) -> NDArray[np.bool_]:
    """Return whether a filter used each measurement, rather than rejecting it as an outlier."""
    outlier = (estimate.status & np.uint16(Status.OUTLIER)) != 0
    return np.asarray(estimate.used | outlier)
