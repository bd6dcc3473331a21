"""Evaluation of a controller and a filter on the machines of a study."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.errors import AmbkitError, library
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.study import load
from ambkit.campaigns.worker import fly
from ambkit.control.control import Control
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import KINDS, learned_magnet, split_name
from ambkit.judge.comparison.tuning import Range, candidate_of_kind

VALIDATION = 1 << 32  #: Offset of the validation machines' seed from the study's.

GAINS = {"controller.kp": "A/m", "controller.ki": "A/(m s)", "controller.kd": "A s/m"}
"""Tunable gains and their units."""

FACTOR = 2.5  #: Search range, as a factor of the tuned gain in both directions.
RULES = "expert.rules"  #: Size of an expert: rules along current and displacement.

SIZES = (3, 5, 7)

WORST = 1e3  #: Replaces an infinite peak, and an infinite error over that of the untuned design.


class Evaluated(NamedTuple):
    """Evaluation of a controller with its filter."""

    values: Mapping[str, float]  #: Values of the tunables, in SI.
    error: float  #: Quantile of the error of the disturbance force, rms [N].
    peak: float  #: Quantile of the peak of abs(S) [1].
    touched: float  #: Share of the machines that touch a stop, or are impossible [1].
    allowed: bool
    """Whether the peak is below its limit, and contact not more frequent than before."""
    kind: str  #: Kind of filter.


def suggested(trial: Any, kind: str, ranges: Sequence[Range]) -> dict[str, float]:
    """Return the values of an Optuna trial; kinds share the controller's gains only."""
    return {
        of.name: float(
            trial.suggest_categorical(of.name, list(SIZES)) if of.name == RULES
            else trial.suggest_float(
                of.name if of.name in GAINS else f"{kind} {of.name}", of.low, of.high, log=True
            )
        )
        for of in ranges
    }  # fmt: skip


class Task:
    """Machines on which controllers and filters are evaluated."""

    def __init__(
        self, study: Any, filters: Sequence[str], quantile: float, max_sensitivity: float
    ) -> None:
        self.optuna = library("optuna", "tune robust", "campaign")
        plan = Plan(load(study))
        plan.check()
        study = plan.study
        if not 0 < quantile < 1:
            raise AmbkitError(f"quantile must be between 0 and 1, is {quantile:g}")
        if not study.record.margins:
            raise AmbkitError(f"{study.name}: the search needs record.margins = true")
        self.kinds = tuple(dict.fromkeys((plan.filter, *filters)))
        for kind in self.kinds:
            if split_name(kind)[0] not in KINDS:
                raise AmbkitError(
                    f"{study.name}: the filter that is tuned must be a kind, {', '.join(KINDS)}, "
                    f"is {kind}"
                )
        for what in ("estimator", "controller"):
            if what in plan.names:
                raise AmbkitError(f"{study.name}: {what} varies, and is what is to be tuned")
        if any(name.startswith("scenario.controller") for name in plan.names):
            raise AmbkitError(f"{study.name}: gains vary, and are what is to be tuned")
        self.plan, self.several = plan, plan.several
        self.quantile, self.max_sensitivity = quantile, max_sensitivity
        self.points, self.noise = plan.points(0, plan.runs), plan.noise(0, plan.runs)
        self._magnets = lru_cache(maxsize=None)(self._magnet)

    def chosen(self, free: Sequence[str] | None) -> dict[str, tuple[Range, ...]]:
        """Return the tunables of each kind and its controller, with their ranges."""
        known = {kind: self._known(kind) for kind in self.kinds}
        names = list(dict.fromkeys(name for ranges in known.values() for name in ranges))
        for name in free or ():
            if self.several and name in GAINS:
                raise AmbkitError(
                    f"free: {name} is of a bearing; a machine's controllers are those that its "
                    "scenario says, made for the nominal machine: the search is for the filter"
                )
            if name not in names:
                raise AmbkitError(f"free: there is no {name}; there are {', '.join(names)}")
        return {
            kind: tuple(ranges[name] for name in (free or ranges) if name in ranges)
            for kind, ranges in known.items()
        }

    def _known(self, kind: str) -> dict[str, Range]:
        known = {}
        for name, unit in {} if self.several else GAINS.items():
            gain = getattr(self.plan.scenario.controller, name.partition(".")[2])
            if gain > 0:
                known[name] = Range(name, unit, gain, gain / FACTOR, gain * FACTOR)
        candidate = candidate_of_kind(kind, self.plan.nominal, self._magnets(kind, 5))
        known |= {item.name: item for item in candidate.tunable}
        if kind == "adaptive" and not self.several:
            known[RULES] = Range(RULES, "1", 5.0, float(SIZES[0]), float(SIZES[-1]))
        return known

    def _magnet(self, kind: str, rules: int) -> Any:
        """Return the magnet model of the filter: an expert with so many rules, or its kind's."""
        if kind != "adaptive" or self.several:
            return learned_magnet(kind, self.plan.nominal)
        from ambkit.workflow.training import train_on_law

        return train_on_law(self.plan.nominal, (rules, rules)).expert

    def design(self, kind: str, values: Mapping[str, float]) -> tuple[Estimator, Control | None]:
        """Return filter and controller with given values; None for the controllers of a machine."""
        magnet = self._magnets(kind, int(values.get(RULES, 5)))
        of_filter = {
            name: value for name, value in values.items() if name not in GAINS and name != RULES
        }
        estimator = candidate_of_kind(kind, self.plan.nominal, magnet).build(**of_filter)
        if self.several:
            return estimator, None
        gains = {name.partition(".")[2]: values[name] for name in values if name in GAINS}
        return estimator, self.plan.scenario.controller.model_copy(update=gains)

    def judged(self, designs: Sequence[Evaluated]) -> tuple[Evaluated, ...]:
        """Evaluate on as many validation machines; a grid has none."""
        study = self.plan.study
        if study.sampling == "grid":
            return ()
        other = Plan(study.model_copy(update={"seed": (study.seed + VALIDATION) % 2**63}))
        self.points, self.noise = other.points(0, other.runs), other.noise(0, other.runs)
        return tuple(self.evaluate(one.kind, one.values) for one in designs)

    def evaluate(self, kind: str, values: Mapping[str, float]) -> Evaluated:
        """Simulate all machines with a controller and a filter."""
        estimator, controller = self.design(kind, values)
        designed = self.plan.with_design(estimator, controller)
        result = fly(designed, self.points, self.noise).columns
        error = min(_quantile(result["f_d_rms"], self.quantile), WORST)
        peak = min(_quantile(result["peak_S"], self.quantile), WORST)
        touched = float(np.mean(~(np.asarray(result["touched"]) == 0)))
        allowed = peak < self.max_sensitivity and touched <= 1 - self.quantile
        return Evaluated(dict(values), error, peak, touched, allowed, kind)


def _quantile(values: Any, share: float) -> float:
    """Return the quantile of values; infinity if there are none."""
    at = np.sort(np.where(np.isnan(values), np.inf, values))
    return float(at[min(max(math.ceil(share * at.size) - 1, 0), at.size - 1)])
