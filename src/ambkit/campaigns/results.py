"""Machines of a campaign, read on demand: yield, figures, worst ones."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError, library
from ambkit.campaigns.distributions import ChoiceMarginal
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.store import RUNS, Folder, array_of
from ambkit.campaigns.study_tables import UNITS, ZONES
from ambkit.campaigns.worker import schema


class Share(NamedTuple):
    """A share of runs, and its confidence interval."""

    passed: int  #: Number that passed.
    of: int  #: Number of runs.
    low: float  #: Lower end [1].
    high: float  #: Upper end [1].

    def __str__(self) -> str:
        if not self.of:
            return "–"
        return f"{100 * self.value:.2f} % ({100 * self.low:.2f} to {100 * self.high:.2f} %)"

    @property
    def value(self) -> float:
        """The share itself [1]; NaN for no runs."""
        return self.passed / self.of if self.of else math.nan

    @property
    def width(self) -> float:
        """Width of the interval [1]."""
        return self.high - self.low


def clopper_pearson(count: int, of: int, confidence: float = 0.95) -> Share:
    """Return a share with the Clopper-Pearson interval (1934)."""
    # Its coverage is at least the confidence for any number of runs. For Sobol points or a Latin
    # hypercube it is conservative, because they cover more evenly than chance.
    from scipy.stats import binomtest

    ends = binomtest(count, of).proportion_ci(confidence) if of else (0.0, 1.0)
    return Share(count, of, *map(float, ends))


GROWTH = 1.25  #: Growth of a study between two tests of its stopping criterion.


def looks(parts: int, size: int, least: int) -> list[int]:
    """Return the numbers of parts at which the stopping criterion is tested; the last is all."""
    # They depend on the study only, so the end depends on neither order nor cluster.
    result, at = [], max(1, -(-least // size))
    while at < parts:
        result.append(at)
        at = max(at + 1, math.ceil(GROWTH * at))
    return [*result, parts]


class StoppingRule:
    """Passed runs in the parts of a folder."""

    def __init__(self, place: Folder) -> None:
        self.plan = place.plan
        self.passed: dict[int, int] = {}
        for part in sorted(place.done()):
            if part < place.plan.parts:
                self.add(part, place.column(part, "passed"))

    def add(self, part: int, passed: Any) -> None:
        """Add a part by its column (n,) of passed runs."""
        self.passed[part] = int(passed.sum())

    @property
    def runs(self) -> int:
        """Finished runs of all parts."""
        return sum(stop - first for first, stop in map(self.plan.span, self.passed))

    def share(self, parts: Iterable[int]) -> Share:
        """Return the yield in some parts."""
        spans = [(part, self.plan.span(part)) for part in parts]
        of = sum(stop - first for _, (first, stop) in spans)
        count = sum(self.passed[part] for part, _ in spans)
        return clopper_pearson(count, of, self.plan.study.confidence)

    def enough(self, end: int) -> bool:
        """Return whether the parts before one give an interval as narrow as required."""
        stop = self.plan.study.stop
        return stop is not None and self.share(range(end)).width <= stop.width

    @property
    def end(self) -> int | None:
        """Number of parts after which the study ended; None if it has not."""
        for end in interim_analyses(self.plan):
            if not all(part in self.passed for part in range(end)):
                return None
            if end == self.plan.parts or self.enough(end):
                return end
        return None

    def counting(self) -> tuple[int, ...]:
        """Return the evaluated parts: up to the end, or all of an unfinished campaign."""
        end = self.end
        return tuple(sorted(self.passed)) if end is None else tuple(range(end))


def interim_analyses(plan: Plan) -> list[int]:
    """Return the numbers of parts at which the stopping criterion is tested; the last is all."""
    stop = plan.study.stop
    return [plan.parts] if stop is None else looks(plan.parts, plan.study.part, stop.least)


SHOWN = ("peak_S", "f_d_rms", "x_rms", "tracking_peak", "displacement_peak", "recovery")
"""Figures in summaries, if they apply."""

QUANTILES = (0.05, 0.5, 0.95, 0.99)  #: Quantiles of each figure.
WORST = 5  #: Number of worst machines that are listed.


class Worst(NamedTuple):
    """One of the worst machines."""

    run: int  #: Number of the run.
    figure: str  #: Figure by which it is ranked.
    value: float  #: Its value, in SI.
    values: dict[str, Any]  #: Varied quantities, in SI.
    command: str  #: Command that replays it.


class Machines:
    """The runs of a study in their folder.

    Columns are read on demand: a million runs need not be in memory at once.
    """

    def __init__(self, folder: Path, plan: Plan, parts: tuple[int, ...]) -> None:
        self.folder, self.plan, self.parts = Path(folder), plan, parts
        self._read: dict[str, NDArray[Any]] = {}

    def __len__(self) -> int:
        spans = map(self.plan.span, self.parts)
        return sum(stop - first for first, stop in spans)

    @property
    def runs(self) -> Path:
        """The folder for pandas, polars and DuckDB."""
        return self.folder / RUNS

    @cached_property
    def _place(self) -> Folder:
        return Folder(self.folder, self.plan)

    def column(self, name: str) -> NDArray[Any]:
        """Return a column over all runs (n,), in its SI unit.

        Parameters
        ----------
        name : str
            Name of a varied quantity or a figure.

        Raises
        ------
        AmbkitError
            The column does not exist.
        """
        if name not in self.columns:
            raise AmbkitError(f"there is no column {name}; there are {', '.join(self.columns)}")
        if name not in self._read:
            # Columns of summaries are read together, because a file is opened for all of its
            # columns.
            usual = {"run", "passed", "fails", "zone", "touched", *SHOWN, *self.plan.names}
            names = [item for item in self.columns if item in usual] if name in usual else [name]
            tables = [self._place.table(part, names) for part in self.parts]
            for item in names:
                parts = [array_of(table.column(item)) for table in tables]
                self._read[item] = np.concatenate(parts) if parts else np.zeros(0)
        return self._read[name]

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns."""
        return tuple(schema(self.plan).names)

    @cached_property
    def good(self) -> Share:
        """Yield: the share of machines that pass, with its interval."""
        passed = self.column("passed")
        return clopper_pearson(int(passed.sum()), len(passed), self.plan.study.confidence)

    @cached_property
    def by_choice(self) -> dict[str, dict[str, Share]]:
        """Yield for each value of each choice."""
        passed, result = self.column("passed"), {}
        for name, of, key in zip(self.plan.names, self.plan.marginals, self.plan.keys, strict=True):
            if not isinstance(of, ChoiceMarginal):
                continue
            column = self.column(name)
            shares = {}
            for value in of.values:
                these = passed[column == value]
                text = f"{value} {key.unit}".rstrip() if key.unit not in ("", "1") else str(value)
                shares[text] = clopper_pearson(
                    int(these.sum()), len(these), self.plan.study.confidence
                )
            result[name] = shares
        return result

    @cached_property
    def fails(self) -> dict[str, int]:
        """Number of machines that fail each criterion; one may fail several."""
        results: dict[str, int] = {}
        reasons, counts = np.unique(self.column("fails").astype(str), return_counts=True)
        for reason, count in zip(reasons, counts, strict=True):
            for entry in filter(None, reason.split(",")):
                results[entry] = results.get(entry, 0) + int(count)
        return dict(sorted(results.items(), key=lambda item: -item[1]))

    @cached_property
    def zones(self) -> dict[str, int]:
        """Number of machines in each zone of ISO 14839-3; empty without margins."""
        if "zone" not in self.columns:
            return {}
        names, counts = np.unique(self.column("zone").astype(str), return_counts=True)
        known = dict(zip(names.tolist(), counts.tolist(), strict=True))
        return {name: known[name] for name in (*ZONES, "unstable", "") if name in known}

    @cached_property
    def quantiles(self) -> dict[str, dict[float, float]]:
        """Quantiles of figures, by name; infinite where too few values are finite."""
        results = {}
        for name in self.names_shown:
            values = np.sort(self.column(name))
            values = values[~np.isnan(values)]
            # Without interpolation, which is undefined between a finite and an infinite value.
            at = {q: float(values[min(int(q * values.size), values.size - 1)]) for q in QUANTILES}
            results[name] = at
        return results

    @cached_property
    def names_shown(self) -> tuple[str, ...]:
        """Figures in summaries that apply to at least one run."""
        names = [name for name in SHOWN if name in self.columns]
        names += [name for name in self.plan.study.passes.at_most if name not in names]
        return tuple(name for name in names if not np.isnan(self.column(name)).all())

    def worst(self, by: str | None = None, count: int = WORST) -> list[Worst]:
        """Return the worst machines, worst first.

        Parameters
        ----------
        by : str, optional
            A figure; by default the sensitivity peak, or without margins the largest control error.
        count : int
            Number of machines.

        Raises
        ------
        AmbkitError
            The figure does not exist.
        """
        by = by or ("peak_S" if "peak_S" in self.columns else "tracking_peak")
        if by not in UNITS:
            raise AmbkitError(f"there is no figure {by}; there are {', '.join(UNITS)}")
        values = self.column(by)
        valid = ~np.isnan(self.column("touched"))  # an impossible machine was not
        order = np.argsort(-np.where(np.isnan(values) | ~valid, -np.inf, values), kind="stable")
        indices = [int(at) for at in order[:count] if valid[at] and not np.isnan(values[at])]
        run, folder = self.column("run"), shlex.quote(str(self.folder))
        varied = {name: self.column(name) for name in self.plan.names}
        return [
            Worst(
                int(run[at]), by, float(values[at]),
                {name: column[at : at + 1].tolist()[0] for name, column in varied.items()},
                f"ambkit campaign replay {folder} {run[at]} --out run-{run[at]}.csv",
            )
            for at in indices
        ]  # fmt: skip

    def frame(self, columns: Sequence[str] | None = None) -> Any:
        """Return the rows as a pandas DataFrame.

        Parameters
        ----------
        columns : sequence of str, optional
            Names; by default all.

        Raises
        ------
        AmbkitError
            pandas is not installed.
        """
        import pyarrow as pa

        column_names = None if columns is None else list(columns)
        tables = [self._place.table(part, column_names) for part in self.parts]
        library("pandas", "frame", "pandas")
        return pa.concat_tables(tables).to_pandas()
