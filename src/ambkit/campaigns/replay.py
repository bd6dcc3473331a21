"""One run of a study simulated again, with all its samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.campaigns.study_tables import UNITS
from ambkit.result.result import Result
from ambkit.result.row import Row
from ambkit.result.sections import Section
from ambkit.simulation.run_figure import simulation_figure

if TYPE_CHECKING:
    from pathlib import Path

    from ambkit.campaigns.plan import Plan
    from ambkit.data.record import Record
    from ambkit.machine.machine import Machine
    from ambkit.result.report.figure import Figure
    from ambkit.simulation.many import Planned
    from ambkit.simulation.run import Run


@dataclass(frozen=True, eq=False, repr=False)
class Replayed(Result):
    """A run of a study."""

    plan: Plan  #: The study.
    number: int  #: Its number.
    values: Mapping[str, Any]  #: What varied, in SI.
    planned: Planned  #: Plant, run and estimator.
    run: Run  #: Record, with truth, and estimate.
    row: Mapping[str, Any]  #: Figures and verdict, as they stand in the campaign's rows.

    @property
    def plant(self) -> Machine:
        """The bearing, or the machine, that was drawn."""
        return self.planned.bearing

    TITLE = "{0.plan.study.name}, run {0.number}"

    @property
    def finding(self) -> str:
        """Whether it is good."""
        fails = self.row["fails"]
        return f"{self.title}: {f'it fails by {fails}' if fails else 'it is good'}."

    @property
    def rows(self) -> list[Row]:
        """What varied, and the figures."""
        keys = (key.unit for key in self.plan.keys)
        units = dict(zip(self.plan.names, keys, strict=True)) | UNITS
        return [
            Row(name, name, int(of) if isinstance(of, float) and of.is_integer() else of,
                units.get(name) or "1", section=("row",), detail=name.startswith("samples"))
            for name, of in self.row.items()
        ]  # fmt: skip

    SECTIONS = {("row",): Section("What varied, and what came of it")}

    @property
    def series(self) -> dict[str, Any]:
        """Its number."""
        return {"run": self.number}

    def file(self) -> Record:
        """Return the record, which is what is written as ``.csv`` and ``.parquet``."""
        return self.run.record

    def save_product(self, what: str, path: Path, beside: Mapping[str, Path]) -> None:
        """Write the estimates, or the machine that was drawn."""
        if what == "machine":
            self.plant.save(path)
        elif self.run.estimate is None:
            raise AmbkitError(f"run {self.number} has no filter, so there are no estimates")
        else:
            self.run.estimate.save(path)

    def figures(self) -> list[Figure]:
        """Return the run."""
        return [simulation_figure(self.run)]


def replay(plan: Plan, number: int) -> Replayed:
    """Simulate a run of a study again, with all its samples."""
    from ambkit.campaigns.worker import compute

    if not 0 <= number < plan.runs:
        raise AmbkitError(f"there is no run {number}; the study has runs 0 to {plan.runs - 1}")
    points, noise = plan.points(number, number + 1), plan.noise(number, number + 1)
    (sample,) = plan.machines(points, noise, number)
    if sample.wrong:
        raise AmbkitError(f"run {number}: there can be no such machine: {sample.wrong}")
    (row,) = compute(plan, number, number + 1).runs.to_pylist()
    return Replayed(plan, number, sample.values, sample.planned, sample.planned.simulated(), row)
