"""What filters make of an unbalance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ambkit.base.arrays import rms
from ambkit.base.units import percent
from ambkit.data.record import Record
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.machine_model import View
from ambkit.judge.comparison.comparison import raw_error
from ambkit.judge.comparison.criteria import errors_along, nees
from ambkit.judge.comparison.default_study import CONSISTENT, SETTLING
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import own_time

EXCESSIVE = 3.0  #: Amount from which a description is doubted, in standard deviations of the start.


def _beyond_description(name: str, estimate: Estimate) -> Iterator[str]:
    """Yield the synchronous quantities that are far above the machine's description."""
    at = [k for k, item in enumerate(estimate.states) if item.role in ("unbalance", "runout")]
    for first, second in zip(at[::2], at[1::2], strict=True):
        state = estimate.states[first]
        ratio = np.hypot(*estimate.mean[-1, [first, second]]) / (state.start * state.size)
        if ratio > EXCESSIVE:
            yield (
                f"{name}: the {state.role} {state.name.rsplit('_', 1)[0]} is {ratio:.1f} times the "
                "standard deviation expected from the machine's file, on which the covariance "
                "depends: correct the amount there"
            )


def unbalance_notes(
    machine: Machine, record: Record, estimates: Mapping[str, Estimate]
) -> Iterator[str]:
    """Yield which filters an unbalance makes inconsistent, or worse than the raw sensors."""
    for name, estimate in estimates.items():
        yield from _beyond_description(name, estimate)
    first = round(SETTLING * max(map(own_time, isolated_axes(machine))) / machine.sampling_time)
    if not (machine.unbalance and record.has_truth and first < len(record)):
        return
    for name, estimate in estimates.items():
        if estimate.covariance is None:
            continue
        share = nees(estimate, record, first, View(machine))
        x = errors_along(estimate, record, View(machine))["x"][:, first:]
        error = rms(x) / raw_error(machine, [record], first)
        if share < CONSISTENT[0] or error > 1 or not np.isfinite(error):
            advice = "" if estimate.states_with_role("unbalance") else (
                "; '+unbalance' after the kind adds the states that estimate it"
            )  # fmt: skip
            yield (
                f"{name}: with the unbalance, NEES is within its 95 % bound in {percent(share)} "
                f"of the samples, and the position error is {error:.2f} of the raw sensors'{advice}"
            )
