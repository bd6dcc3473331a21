"""Scores of estimators in a case."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.units import figure, percent
from ambkit.data.files.tables import Table
from ambkit.judge.comparison.cases import Case
from ambkit.judge.comparison.criteria import CRITERIA, EVALUATED, per_run
from ambkit.judge.comparison.figures import cases_figure, cost_figure, matrix_figure
from ambkit.judge.comparison.tuning import Tuning
from ambkit.machine.machine import Machine
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Part, Row, Section, put

SHOWN = ("x", "v", "f_d", "nees", "nis", "lost")
"""Criteria in the main table; the others are details."""


@dataclass(frozen=True)
class Score:
    """Score of one estimator with one set of parameters."""

    name: str  #: Name of the estimator.
    label: str
    values: Mapping[str, float]  #: Values of its tunables.
    #: (runs,) By the names of :data:`ambkit.judge.comparison.criteria.CRITERIA`, in SI; NaN where a
    #: criterion does not apply to a run.
    figures: dict[str, Array]
    tuning: Tuning | None = None  #: Result of the tuning; None for the defaults.

    def mean(self, criterion: str) -> float:
        """Mean over the runs in which it applies; NaN if it never does."""
        return mean(self.figures[criterion])

    def spread(self, criterion: str) -> float:
        """Standard deviation over the runs; 0 for a single one."""
        values = self.figures[criterion]
        return float(values.std(ddof=1)) if values.size > 1 else 0.0

    def half_width(self, criterion: str) -> float:
        """Half width of the 95 % confidence interval of the mean (Student's t)."""
        return half_width(self.figures[criterion])

    def rows(self) -> list[Row]:
        """Return the mean of each criterion, with its 95 % interval."""
        return [
            Row(name, of.label, self.mean(name), of.si, 3, error=self.half_width(name),
                error_key="half_width", detail=name not in SHOWN)
            for name, of in CRITERIA.items() if name in self.figures
        ]  # fmt: skip


@dataclass(frozen=True, repr=False)
class Comparison(Result):
    """Comparison in one case."""

    machine: Machine  #: Machine assumed by the estimators.
    case: Case  #: The case.
    runs: int  #: Number of runs, and of those excluded because of contact.
    stopped: int
    seed: int  #: First seed; evaluations of the tuning, 0 if not tuned.
    budget: int
    #: Scores by estimator; `tuned` is empty without tuning.
    default: Mapping[str, Score]
    tuned: Mapping[str, Score] = field(default_factory=dict)
    #: Bound on the RMSE of x, v, f_d over the axes, for a single axis of x_m too; empty if the
    #: truth differs from the filters' model, because no bound is known then.
    limit: Mapping[str, float] = field(default_factory=dict)
    raw: float = float("nan")  #: Root mean square error of the raw sensors along the axes [m].
    #: (mapping of str to str) By estimator, the unit of each tunable.
    units: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @property
    def best(self) -> Mapping[str, Score]:
        """The tuned scores, or the default ones without tuning."""
        return self.tuned or self.default

    def efficiency(self, name: str, signal: str) -> float:
        """Bound over root mean square error of a state; at most 1."""
        return self.limit[signal] / math.sqrt(mean(self.best[name].figures[signal] ** 2))

    TITLE = "{0.machine.name}, case {0.case.name}: {0.case.title}"

    @property
    def finding(self) -> str:
        raw = figure(self.raw, "m", 3)
        rows = [row for name, of in self.best.items() for row in put(of.rows(), of=name)]
        return f"{self.title}. {least(rows)}; error of the raw sensors {raw}."

    @property
    def rows(self) -> list[Row]:
        results: list[Row] = []
        for name, of in self.tuned.items():
            results += put(of.rows(), section=("tuned",), of=name)
        for name, of in self.default.items():
            own = put(of.rows(), section=("default",), of=name)
            results += put(own, detail=True) if self.tuned else own
        results += [
            Row(name, name, least, EVALUATED.get(name, "m"), 3, section=("limit",),
                detail=name not in EVALUATED)
            for name, least in self.limit.items()
        ]  # fmt: skip
        for name, of in self.tuned.items():
            if of.tuning is not None:
                results += put(self._tuning(of, of.tuning), section=("tuning",), of=name)
        return results

    def _tuning(self, of: Score, result: Tuning) -> list[Row]:
        units = self.units.get(of.name, {})
        return [
            Row("default", "objective, untuned", result.default),
            Row("tuned", "objective, tuned", result.objective),
            Row("evaluations", "evaluations", result.evaluations),
            *(Row(key, key.removeprefix("noise."), value, units.get(key, "1"), detail=True)
              for key, value in of.values.items()),
        ]  # fmt: skip

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        runs = f"{self.runs} run{'s' * (self.runs > 1)}"
        return {
            ("default",): Section(f"With their defaults, {runs}", across=True),
            ("tuned",): Section(f"Tuned alike, {runs}", across=True),
            ("limit",): Section("Cramér-Rao bound on the errors"),
            ("tuning",): Section("Tuned parameters"),
        }

    @property
    def facts(self) -> dict[str, str]:
        return {
            "machine": self.machine.name,
            "runs": f"{self.runs}, {self.stopped} left out" if self.stopped else str(self.runs),
            "first seed": str(self.seed),
            "tuning": f"{self.budget} evaluations each" if self.budget else "defaults",
        }

    @property
    def notes(self) -> list[str]:
        notes = [f"{self.stopped} runs left out: contact with a stop."] if self.stopped else []
        return [*notes, *self._alike()]

    def _alike(self) -> list[str]:
        """Return whose error is not significantly above the least one: paired over the runs."""
        from scipy.stats import ttest_rel

        errors = {n: of.figures["f_d"] for n, of in self.best.items()}
        errors = {n: error for n, error in errors.items() if np.isfinite(error).any()}
        if len(errors) < 2:
            return []
        first = min(errors, key=lambda n: float(np.nanmean(errors[n])))
        alike, tested = [], False
        for name, other in errors.items():
            both = np.isfinite(other) & np.isfinite(errors[first])
            if name == first or both.sum() < 3:
                continue
            tested, a, b = True, other[both], errors[first][both]
            if np.ptp(a - b) == 0 or ttest_rel(a, b).pvalue > 0.05:
                alike.append(name)
        if alike:
            return [f"No significant difference in f_d from {first} (paired t test, 5 %): "
                    f"{', '.join(alike)}."]  # fmt: skip
        if not tested:
            return []
        return [f"In f_d {first} is significantly better than all others (paired t test, "
                "5 %)."]  # fmt: skip

    @property
    def series(self) -> dict[str, Any]:
        scores_by_tuning = {"default": self.default, "tuned": self.tuned}
        return {
            "machine": self.machine.name,
            "case": self.case.name,
            "runs": self.runs,
            "stopped": self.stopped,
            "seed": self.seed,
            "budget": self.budget,
            "raw_sensor": self.raw,
            "limit": dict(self.limit),
        } | {
            how: {n: {"label": s.label, "values": dict(s.values)} for n, s in of.items()}
            for how, of in scores_by_tuning.items() if of
        }  # fmt: skip

    def figures(self) -> list[Figure]:
        return [matrix_figure(self), cost_figure(self)]


class ComparisonSet(Result, dict[str, Comparison]):
    """The comparison in several cases, by name."""

    @property
    def _first(self) -> Comparison:
        return next(iter(self.values()))

    def file(self) -> Table:
        return per_run(self)

    @property
    def title(self) -> str:
        return f"{self._first.machine.name}: estimators compared in {len(self)} cases"

    @property
    def finding(self) -> str:
        best: dict[str, int] = {}
        for bench in self.values():
            errors = {n: of.mean("f_d") for n, of in bench.best.items()}
            errors = {n: error for n, error in errors.items() if math.isfinite(error)}
            if errors:
                first = min(errors, key=errors.__getitem__)
                best[first] = best.get(first, 0) + 1
        if not best:
            return f"{self.title}: none has finished a run."
        first = max(best, key=best.__getitem__)
        return f"{self.title}: {first} estimates the disturbance force best in {best[first]}."

    @property
    def rows(self) -> list[Row]:
        overview = [
            Row(case, case, bench.best[name].mean("f_d"), "N", 3, of=name, section=("f_d",))
            for name in self._first.best for case, bench in self.items()
        ]  # fmt: skip
        return overview + [
            replace(row, section=("cases", case, *row.section), detail=True)
            for case, bench in self.items() for row in bench.rows
        ]  # fmt: skip

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        how = "tuned alike" if self._first.tuned else "with their defaults"
        runs = f"{self._first.runs} run{'s' * (self._first.runs > 1)} each"
        results = {("f_d",): Section(f"Error of f_d, {runs}, {how}", across=True)}
        return results | {
            ("cases", case, *name): Section(f"{case}: {of.title}", of.across)
            for case, bench in self.items() for name, of in bench.sections.items()
        }  # fmt: skip

    @property
    def chapters(self) -> list[Part]:
        return [
            Part(f"{case}: {bench.case.title}", bench.case.about, ("cases", case),
                 [matrix_figure(bench, f"matrix-{case}")])
            for case, bench in self.items()
        ]  # fmt: skip

    @property
    def facts(self) -> dict[str, str]:
        return self._first.facts

    @property
    def series(self) -> dict[str, Any]:
        return {
            "machine": self._first.machine.name,
            "cases": {case: bench.series for case, bench in self.items()},
        }

    def figures(self) -> list[Figure]:
        return [cases_figure(self)]


def least(rows: Sequence[Row]) -> str:
    """Return whose error of the disturbance force is least."""
    errors: dict[str, Any] = {r.of: r.value for r in rows if r.key == "f_d" and r.known}
    if not errors:
        return "no filter has finished a run"
    first = min(errors, key=errors.__getitem__)
    text = next(row.text() for row in rows if row.of == first and row.key == "f_d")
    text = f"{first} estimates the disturbance force best, to {text} rms"
    if "linear" in errors and first != "linear":
        text += f", {percent(errors[first] / errors['linear'])} of linear's"
    return text


def mean(values: Array) -> float:
    """Mean of the finite values; NaN if there are none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def half_width(values: Array) -> float:
    """Half of the 95 % confidence interval of that mean (Student's t); NaN for a single value."""
    from scipy.stats import t

    known = values[np.isfinite(values)]
    if known.size < 2:
        return math.nan
    return float(t.ppf(0.975, known.size - 1) * known.std(ddof=1) / np.sqrt(known.size))
