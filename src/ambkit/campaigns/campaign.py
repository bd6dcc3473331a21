"""Results of a campaign: yield, worst machines, drivers, and replayed runs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.campaigns import figures as pictures
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.results import Machines, Share, StoppingRule, Worst
from ambkit.campaigns.sobol_indices import Indices, indices
from ambkit.campaigns.store import Folder
from ambkit.campaigns.study_tables import UNITS
from ambkit.campaigns.subset_simulation import results_text
from ambkit.campaigns.worker import compute
from ambkit.data.record import Record
from ambkit.machine.machine import Machine
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Part, Row, Section, put
from ambkit.simulation.plans import Planned
from ambkit.simulation.run import Run
from ambkit.simulation.run_figure import simulation_figure


@dataclass(frozen=True, eq=False, repr=False)
class Replayed(Result):
    """A replayed run of a study."""

    plan: Plan  #: The study.
    number: int  #: Number of the run.
    values: Mapping[str, Any]  #: Varied quantities, in SI.
    planned: Planned  #: Plant, run and estimator.
    run: Run  #: Record with truth, and estimate.
    row: Mapping[str, Any]  #: Figures and verdict, as in the campaign's rows.

    @property
    def plant(self) -> Machine:
        """The sampled machine."""
        return self.planned.machine

    TITLE = "{0.plan.study.name}, run {0.number}"

    @property
    def finding(self) -> str:
        fails = self.row["fails"]
        return f"{self.title}: {f'fails by {fails}' if fails else 'passes'}."

    @property
    def rows(self) -> list[Row]:
        keys = (key.unit for key in self.plan.keys)
        units = dict(zip(self.plan.names, keys, strict=True)) | UNITS
        return [
            Row(name, name, int(of) if isinstance(of, float) and of.is_integer() else of,
                units.get(name) or "1", section=("row",), detail=name.startswith("samples"))
            for name, of in self.row.items()
        ]  # fmt: skip

    SECTIONS = {("row",): Section("Parameters and results")}

    @property
    def series(self) -> dict[str, Any]:
        return {"run": self.number}

    def file(self) -> Record:
        return self.run.record

    def save_product(self, what: str, path: Path, beside: Mapping[str, Path]) -> None:
        """Write the estimates, or the sampled machine."""
        if what == "machine":
            self.plant.save(path)
        elif self.run.estimate is None:
            raise AmbkitError(f"run {self.number} has no filter, so there are no estimates")
        else:
            self.run.estimate.save(path)

    def figures(self) -> list[Figure]:
        return [simulation_figure(self.run)]


def replay(plan: Plan, number: int) -> Replayed:
    """Simulate a run of a study again, with all its samples."""
    if not 0 <= number < plan.runs:
        raise AmbkitError(f"there is no run {number}; the study has runs 0 to {plan.runs - 1}")
    points, noise = plan.points(number, number + 1), plan.noise(number, number + 1)
    (sample,) = plan.machines(points, noise, number)
    if sample.wrong:
        raise AmbkitError(f"run {number}: not a valid machine: {sample.wrong}")
    (row,) = compute(plan, number, number + 1).runs.to_pylist()
    return Replayed(plan, number, sample.values, sample.planned, sample.planned.simulated(), row)


DRIVEN = 3  #: Figures with sensitivity analysis.


class Campaign(Result, Machines):
    """Simulated machines of a study.

    Parameters
    ----------
    folder : Path
        Folder of the campaign.
    plan : Plan
        The study.
    parts : tuple of int
        Parts that are included.
    """

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Campaign:
        """Return the campaign in a folder, finished or not.

        Parameters
        ----------
        folder : path
            Folder written by ``ambkit campaign``.

        Raises
        ------
        AmbkitError
            The folder has no campaign, or one of another version of ambkit.
        """
        place = Folder.existing(folder)
        return cls(place.path, place.plan, StoppingRule(place).counting())

    def replay(self, run: int) -> Replayed:
        """Simulate a run again, with all its samples.

        Parameters
        ----------
        run : int
            Number of the run.

        Raises
        ------
        AmbkitError
            The run does not exist, or its machine is not physical.
        """
        return replay(self.plan, run)

    def indices(self, figure: str | None = None) -> Indices:
        """Return the share of each quantity in a figure's variance, see `Indices`.

        Parameters
        ----------
        figure : str, optional
            By default as in `worst`.

        Raises
        ------
        AmbkitError
            SALib is not installed, the figure does not exist, or it cannot be estimated.
        """
        return indices(self, figure or ("peak_S" if "peak_S" in self.columns else "tracking_peak"))

    @property
    def title(self) -> str:
        return f"{self.plan.study.name}: {len(self):,} machines"

    @property
    def finding(self) -> str:
        if not len(self):
            return f"{self.folder}: no part has finished yet."
        return f"{self.title}; {self.good} pass."

    @property
    def rows(self) -> list[Row]:
        result = put(_of_share(self.good), section=("yield",))
        for name, shares in self.by_choice.items():
            for value, of in shares.items():
                result += put(_of_share(of), section=("by_choice", name), of=value)
        result += [Row(n, n, count, section=("fails",)) for n, count in self.fails.items()]
        result += [
            Row(n, n or "unknown", count, section=("zones",)) for n, count in self.zones.items()
        ]
        for name, at in self.quantiles.items():
            result += [
                Row(f"{q:g}", f"{100 * q:g} %", value, UNITS[name], section=("quantiles",), of=name)
                for q, value in at.items()
            ]  # fmt: skip
        for place, name in enumerate(self.names_shown[:DRIVEN]):
            for item in self.worst(name):
                result += put(self._of_worst(item, place > 0), section=("worst_by", name),
                             of=str(item.run))  # fmt: skip
        return result

    def _of_worst(self, of: Worst, detail: bool) -> list[Row]:
        return [
            Row(of.figure, of.figure, of.value, UNITS[of.figure], detail=detail),
            *(Row(name, name, of.values[name], key.unit or "1", detail=True)
              for name, key in zip(self.plan.names, self.plan.keys, strict=True)),
            Row("command", "replay", of.command, detail=detail),
        ]  # fmt: skip

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        level = f"{100 * self.plan.study.confidence:g} %"
        results: dict[tuple[str, ...], Section] = {
            ("yield",): Section(f"Yield, with its {level} interval"),
            ("fails",): Section("Machines that fail by"),
            ("zones",): Section("Machines in each zone of ISO 14839-3, by their linear loops"),
            ("quantiles",): Section("Quantiles", across=True),
        }
        results |= {("by_choice", n): Section(f"Yield by {n}", True) for n in self.by_choice}
        return results | {("worst_by", n): Section(f"Worst by {n}", True) for n in self.names_shown}

    @property
    def chapters(self) -> list[Part]:
        if not len(self):
            raise AmbkitError(f"{self.folder}: no part has finished yet")
        cannot, figures = list[str](), [pictures.parallel(self)] if self.plan.names else []
        for name in self.names_shown[:DRIVEN] if self.plan.names else ():
            figures.append(pictures.tornado(self, name))
            try:
                figures.append(pictures.indices(self.indices(name)))
            except AmbkitError as error:
                cannot.append(f"No indices of {markdown(name)}: {markdown(str(error))}")
        lead = "Each command simulates the machine again, with every sample."
        drives = [Part("Sensitivities", "\n\n".join(cannot), None, figures)] if figures else []
        return [*drives, Part("The worst machines", lead, ("worst_by",))]

    @property
    def facts(self) -> dict[str, str]:
        study = self.plan.study
        return {
            "machine": self.plan.nominal.name,
            "runs": f"{len(self):,} of {self.plan.runs:,}",
            "sampling": study.sampling,
            "seed": str(study.seed),
            "rows": str(self.runs),
        }

    @property
    def notes(self) -> list[str]:
        passes = self.plan.study.passes
        criteria = [] if passes.zone is None else [f"zone {passes.zone} or better"]
        criteria += [] if passes.contact else ["no contact"]
        criteria += [f"{name} at most {limit}" for name, limit in passes.at_most.items()]
        good = (
            f"A machine passes with {'; '.join(criteria)}. Intervals by Clopper and Pearson."
            if criteria
            else "Every machine passes: the study has no criterion."
        )
        about = self.plan.study.description
        return [*([about] if about else []), good, *results_text(self.folder)]

    @property
    def series(self) -> dict[str, Any]:
        return {
            "study": self.plan.study.name,
            "machine": self.plan.nominal.name,
            "folder": str(self.folder),
            **{name: {} for name in ("by_choice", "fails", "zones", "quantiles")},
            "runs": len(self),
            "confidence": self.plan.study.confidence,
            "worst": [item._asdict() for item in self.worst()],
        }

    def figures(self) -> list[Figure]:
        """Return the figures' cumulative curves."""
        return [pictures.cumulative(self)]


def _of_share(of: Share) -> list[Row]:
    return [
        Row("share", "yield", of.value, "%"),
        Row("low", "lower bound", of.low, "%"),
        Row("high", "upper bound", of.high, "%"),
        Row("passed", "passed", of.passed, detail=True),
        Row("of", "machines", of.of),
    ]
