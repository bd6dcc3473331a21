"""All that learn a magnet constant sample by sample, along one record, and who agrees with whom."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base import late_binding
from ambkit.base.units import figure
from ambkit.identification.online.adaline import AdalineResult
from ambkit.identification.online.augmented import AugmentedResult
from ambkit.identification.online.magnet_constant import ONLINE
from ambkit.identification.online.result import CONFIDENCE, CONSTANT, OnlineResult, last_quarter
from ambkit.identification.online.rls import LeastSquaresResult
from ambkit.result.result import Result
from ambkit.result.row import Row, put
from ambkit.result.sections import Section

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.machine.machine import Bearing
    from ambkit.result.report.figure import Figure

NAMES = {
    "adaline": "ADALINE",
    "rls": "least squares",
    "augmented": "Kalman filter with k",
}
"""Who learns, in words."""

_THE = NAMES | {"augmented": "the Kalman filter with k"}

LEARNERS = ("learners",)  #: Section of its rows.

NEAR = 0.01
"""Part of itself by which two constants may differ, whatever their errors: what discretisation and
the noise in the regressor cost."""

COLOURED = 0.2
"""Correlation of an innovation with the next one from which on k bends to it.

Sensor noise that is correlated over a sample (a low-pass at a sixth of the sampling rate) makes
0.34, and moves the filter's k by a standard error or two."""


@dataclass(frozen=True, eq=False, repr=False)
class SideBySide(Result):
    """What each learned along one record, from one start."""

    bearing: Bearing  #: The one that was given.
    start: float  #: Magnet constant that all began with [N m^2/A^2].
    truth: float | None  #: The simulated bearing's [N m^2/A^2]; None for a measured record.
    results: Mapping[str, OnlineResult]  #: By the names of `NAMES`.

    @property
    def colour(self) -> float:
        """Correlation of the filter's innovations one sample apart; white ones have none."""
        # Of the second half of the record, where k has settled. NaN where there are too few.
        filtered = self.results["augmented"]
        assert isinstance(filtered, AugmentedResult)
        estimate = filtered.estimate
        late = slice(len(estimate.t) // 2, None)
        e = np.where(estimate.used, estimate.innovation, np.nan)[late]
        e = e / np.sqrt(np.where(estimate.used, estimate.innovation_variance, np.nan)[late])
        pairs = np.isfinite(e[1:]) & np.isfinite(e[:-1])
        if pairs.sum() < 100:
            return math.nan
        return float(np.corrcoef(e[1:][pairs], e[:-1][pairs])[0, 1])

    @property
    def coloured(self) -> bool:
        """Whether the filter's innovations have so much colour that its k is not to be trusted."""
        return abs(self.colour) > COLOURED

    def agree(self, one: str, other: str) -> bool:
        """Whether two constants differ by no more than their errors, or by hardly anything."""
        a, b = self.results[one], self.results[other]
        apart = abs(a.magnet_constant - b.magnet_constant)
        error = CONFIDENCE * math.hypot(a.standard_error, b.standard_error)
        error = 0.0 if math.isnan(error) else error
        return not apart > max(error, NEAR * abs(a.magnet_constant + b.magnet_constant) / 2)

    @property
    def agreement(self) -> str:
        """Who agrees with whom, in a sentence."""
        learned = [name for name, result in self.results.items() if not result.held.all()]
        idle = [_THE[name] for name in self.results if name not in learned]
        text = self._of(learned)
        if idle:
            who = _listed(idle)
            text += f"; {who} never learned" if learned else "Nobody learned"
            text += ": too little excitation, their k is the start."
        else:
            text += "."
        return text[0].upper() + text[1:]

    def _of(self, learned: list[str]) -> str:
        k = {name: self.results[name].magnet_constant for name in learned}
        if len(learned) < 2:
            return f"only {_THE[learned[0]]} learned" if learned else ""
        pairs = [pair for pair in combinations(learned, 2) if self.agree(*pair)]
        if len(pairs) == len(learned) * (len(learned) - 1) // 2:
            all_of = "all three" if len(learned) == 3 else " and ".join(_THE[n] for n in learned)
            return f"{all_of} agree within their errors"
        if not pairs:
            return "no two of them agree"
        if len(pairs) > 1:  # one is between the two others, and agrees with both
            odd = next(p for p in combinations(learned, 2) if p not in pairs)
            between = next(name for name in learned if name not in odd)
            return (
                f"the k of {_THE[between]} agrees with those of {_listed([_THE[n] for n in odd])}, "
                "which differ from each other"
            )
        one, other = pairs[0]
        odd_one = next(name for name in learned if name not in pairs[0])
        off = 100 * (k[odd_one] / ((k[one] + k[other]) / 2) - 1)
        return (
            f"{_THE[one]} and {_THE[other]} agree within their errors, the k of {_THE[odd_one]} is "
            f"{abs(off):.1f} % {'higher' if off > 0 else 'lower'}"
        )

    @property
    def notes(self) -> list[str]:
        """What speaks against the figures, a sentence each."""
        remarks = [
            f"{NAMES[name]}: k still drifts; a longer record may settle it"
            for name, result in self.results.items()
            if not result.settled
        ]
        load = self._load_for_the_magnet()
        if load is not None:
            remarks.append(
                f"ADALINE takes a load that it is not told for the magnet, and least squares find "
                f"one of {load:.2g} N: a known load belongs to --disturbance"
            )
        if self.coloured:
            remarks.append(
                f"the innovations have colour (one sample apart they correlate by "
                f"{self.colour:+.2f}): the noise of the sensor is not white, or the model misses "
                "something. The Kalman filter takes that for k, and its error does not hold; "
                "ADALINE and least squares look below it"
            )
        return remarks

    def _load_for_the_magnet(self) -> float | None:
        """Load that least squares find [N], where it explains why ADALINE differs from them."""
        adaline, rls = self.results["adaline"], self.results["rls"]
        if not (isinstance(rls, LeastSquaresResult) and isinstance(adaline, AdalineResult)):
            return None
        if rls.held.all() or adaline.held.all() or self.agree("adaline", "rls"):
            return None
        load = unknown_load(rls)
        carried = float(np.abs(rls.force[last_quarter(rls.k)]).mean())
        return load if load is not None and abs(load) > 0.02 * carried else None

    TITLE = "Magnet constant of {0.bearing.name}, learned online"

    @property
    def finding(self) -> str:
        """Who agrees with whom."""
        return f"{self.bearing.name}: {self.agreement}"

    @property
    def rows(self) -> list[Row]:
        """What each learned, and how sure it is."""
        results: list[Row] = []
        for name, one in self.results.items():
            k, truth = one.magnet_constant, self.truth
            against = f"against the true {figure(truth, CONSTANT)}"
            results += put([
                Row("start", "magnet constant, start", self.start, CONSTANT),
                *one.rows(),
                Row("change", "change from the start", k / self.start - 1, "%"),
                Row("off_truth", against, k / truth - 1 if truth else None, "%"),
                Row("load", "load that was not known", unknown_load(one), "N", 3),
            ], section=LEARNERS, of=name)  # fmt: skip
        return results

    SECTIONS = {LEARNERS: Section("{0.title}")}

    @property
    def series(self) -> dict[str, Any]:
        """Start, truth, and how white the filter's innovations are."""
        return {
            "bearing": self.bearing.name,
            "start": self.start,
            "truth": self.truth,
            "agreement": self.agreement,
            "innovation_correlation": self.colour,
            "coloured": self.coloured,
        }

    def figures(self) -> list[Figure]:
        """Return what was learned over the record."""
        return [late_binding.call("online_figure", self)]


def learn_online(
    record: Record,
    bearing: Bearing,
    *,
    start: float | None = None,
    disturbance: ArrayLike | None = None,
) -> SideBySide:
    """Learn the magnet constant along a record: ADALINE, least squares, and the Kalman filter."""
    # All from the same two signals and the same start, each with its defaults.
    # disturbance (n,) [N]
    from ambkit.estimate.estimator import check_sampling

    check_sampling(bearing, record)
    return SideBySide(
        bearing,
        bearing.magnet.magnet_constant if start is None else start,
        true_constant(record),
        {
            name: learner(bearing, start=start).run(record, disturbance=disturbance)
            for name, learner in ONLINE.items()
        },
    )


def true_constant(record: Record) -> float | None:
    """The magnet constant of the simulated bearing [N m^2/A^2]; None where it is measured."""
    from ambkit.machine.machine import Bearing

    text = record.meta.get("bearing")
    if not (record.has_truth and isinstance(text, str)):
        return None
    return Bearing.from_toml(text).magnet.magnet_constant


def unknown_load(result: OnlineResult) -> float | None:
    """Mean load over the last quarter beyond what was told [N]; None where it is not asked for."""
    if not isinstance(result, LeastSquaresResult | AugmentedResult):
        return None
    return float(result.load[last_quarter(result.k)].mean())


def _listed(names: list[str]) -> str:
    return " and ".join(names) if len(names) < 3 else f"{', '.join(names[:-1])} and {names[-1]}"
