"""The controllers that a design writes down, and what speaks against the loop with them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.control.default_control import default_control
from ambkit.control.pid import GAINS, PID
from ambkit.estimate.kalman import KalmanFilter
from ambkit.judge.loop.loop_of import LoopOf, zone_of
from ambkit.machine.machine import Machine

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ambkit.assessment.loop import AssessedLoop

DIGITS = 3
"""Of the gains that are written down."""


def control_for(bearing: Machine) -> Control:
    """The default controllers of a machine that an estimate feeds, as they are written down."""
    machine = bearing.long
    result = default_control(machine, "estimate")
    if not result.held:
        raise AmbkitError(result.summary)
    control = result.chosen.control
    plain = control.type == "decentralised" and not control.pid
    estimator = KalmanFilter(machine)
    parts = LoopOf(machine, None if plain else control).pids(estimator)
    pids = {
        name: PID(**{key: float(f"{getattr(pid, key):.{DIGITS}g}") for key in GAINS})  # type: ignore[arg-type]
        for name, pid in parts.items()
    }
    written = control.model_copy(update={"pid": pids, "feedback": "estimate"})
    return written.completed(machine.isolated_axis("")) if bearing.single else written


def objections_to_loop(loop: AssessedLoop, peak_limit: float | None) -> Sequence[str]:
    """Return what speaks against flying a loop."""
    if not loop.stable:
        return ["the loop is not stable"]
    if zone_of(loop.peak) != "A":
        return [f"the peak of |S| is {loop.peak:.3g}, zone {zone_of(loop.peak)} of ISO 14839-3"]
    if peak_limit is not None and loop.peak >= peak_limit:
        return [f"the peak of |S| is {loop.peak:.3g}, and is to be below {peak_limit:g}"]
    return []
