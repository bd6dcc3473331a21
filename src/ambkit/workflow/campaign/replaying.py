"""One run of a study simulated again, with all its samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from ambkit.base.errors import AmbkitError

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine
    from ambkit.result.report.figure import Figure
    from ambkit.simulation.many import Planned
    from ambkit.simulation.run import Run
    from ambkit.workflow.campaign.plan import Plan


class Replayed(NamedTuple):
    """A run of a study."""

    number: int  #: Its number.
    values: Mapping[str, Any]  #: What varied, in SI.
    planned: Planned  #: Plant, run and estimator.
    run: Run  #: Record, with truth, and estimate.
    row: Mapping[str, Any]  #: Figures and verdict, as they stand in the campaign's rows.

    @property
    def plant(self) -> Machine:
        """The bearing, or the machine, that was drawn."""
        return self.planned.bearing

    def figure(self) -> Figure:
        """Return the run as a picture."""
        from ambkit.show import plots

        return plots.simulation_figure(self.run)


def replay(plan: Plan, number: int) -> Replayed:
    """Simulate a run of a study again, with all its samples."""
    from ambkit.workflow.campaign.compute import compute

    if not 0 <= number < plan.runs:
        raise AmbkitError(f"there is no run {number}; the study has runs 0 to {plan.runs - 1}")
    points, noise = plan.points(number, number + 1), plan.noise(number, number + 1)
    (drawn,) = plan.machines(points, noise, number)
    if drawn.wrong:
        raise AmbkitError(f"run {number}: there can be no such machine: {drawn.wrong}")
    (row,) = compute(plan, number, number + 1).runs.to_pylist()
    return Replayed(number, drawn.values, drawn.planned, drawn.planned.simulated(), row)
