"""All online identifications of a magnet constant along one record, compared."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array, Bools, stretches
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.units import figure
from ambkit.data.record import Record
from ambkit.estimate.along_records import check_sampling
from ambkit.identification.online.adaline import (
    CONFIDENCE,
    CONSTANT,
    AdalineResult,
    OnlineResult,
    last_quarter,
)
from ambkit.identification.online.magnet_constant import (
    ONLINE,
    AugmentedResult,
    LeastSquaresResult,
    identified,
)
from ambkit.machine.axes import with_axis
from ambkit.machine.machine import Machine
from ambkit.result.report import Axis, Band, Figure, Item, Line, Panel, Points, Rule, Span
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put

NAMES = {"adaline": "ADALINE", "rls": "least squares", "augmented": "Kalman filter with k"}
"""Methods in words."""

_THE = NAMES | {"augmented": "the Kalman filter with k"}

LEARNERS = ("learners",)  #: Section of its rows.

NEAR = 0.01
"""Relative difference of two constants that is acceptable in any case: discretisation, and noise in
the regressor.
"""

COLOURED = 0.2
"""Correlation of successive innovations above which k is biased.

Sensor noise that is correlated over a sample (a low-pass at a sixth of the sampling rate) makes
0.34, and moves the filter's k by a standard error or two."""


@dataclass(frozen=True, eq=False, repr=False)
class OnlineComparison(Result):
    """Online identification of one record by all methods, and the machine of one of them."""

    known: Machine  #: Prior machine, or the isolated axis of one.
    start: float  #: Initial magnet constant of all methods [N m^2/A^2].
    truth: float | None  #: That of the simulated machine [N m^2/A^2]; None for a measured record.
    results: Mapping[str, OnlineResult]  #: Results by the names of `NAMES`.
    method: str = "all"  #: Method of the resulting machine.
    several: Machine | None = None  #: Machine of several axes.

    @property
    def machine(self) -> Machine:
        """The machine with the constant of the method."""
        if self.method == "all":
            raise AmbkitError(f"a machine is of one method: method={', '.join(ONLINE)}")
        learned = identified(self.known, self.results[self.method])
        if self.several is None:
            return learned
        return with_axis(self.several, self.known.name, learned)

    def save_toml(self, path: str | os.PathLike[str]) -> None:
        self.machine.save(path)

    @property
    def colour(self) -> float:
        """Autocorrelation of the filter's innovations at one sample; zero for white ones."""
        # Over the second half of the record, where k has settled. NaN if there are too few.
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
        """Whether the filter's innovations are too coloured for a reliable k."""
        return abs(self.colour) > COLOURED

    def agree(self, one: str, other: str) -> bool:
        """Return whether two constants agree within their errors, or nearly."""
        a, b = self.results[one], self.results[other]
        apart = abs(a.magnet_constant - b.magnet_constant)
        error = CONFIDENCE * math.hypot(a.standard_error, b.standard_error)
        error = 0.0 if math.isnan(error) else error
        return not apart > max(error, NEAR * abs(a.magnet_constant + b.magnet_constant) / 2)

    @property
    def agreement(self) -> str:
        """Agreement of the methods, in a sentence."""
        learned = [name for name, result in self.results.items() if not result.held.all()]
        idle = [name for name in self.results if name not in learned]
        text = self._of(learned) if learned else "nobody learned"
        if idle:
            text += f"; {_listed(idle)} never learned" if learned else ""
            text += ": too little excitation, their k is the start"
        return f"{text[0].upper()}{text[1:]}."

    def _of(self, learned: list[str]) -> str:
        if len(learned) == 1:
            return f"only {_THE[learned[0]]} learned"
        pairs = list(combinations(learned, 2))
        apart = [pair for pair in pairs if not self.agree(*pair)]
        if not apart:
            who = "all three" if len(learned) == 3 else _listed(learned)
            return f"{who} agree within their errors"
        if apart == pairs:
            return "no two of them agree"
        if len(apart) == 1:
            (between,) = set(learned).difference(*apart)
            return (
                f"the k of {_THE[between]} agrees with those of {_listed(apart[0])}, which differ "
                "from each other"
            )
        (odd,) = set.intersection(*map(set, apart))
        rest = [name for name in learned if name != odd]
        mean = sum(self.results[name].magnet_constant for name in rest) / 2
        off = 100 * (self.results[odd].magnet_constant / mean - 1)
        return (
            f"{_listed(rest)} agree within their errors, the k of {_THE[odd]} is "
            f"{abs(off):.1f} % {'higher' if off > 0 else 'lower'}"
        )

    @property
    def notes(self) -> list[str]:
        remarks = [
            f"{NAMES[name]}: k still drifts; a longer record may settle it"
            for name, result in self.results.items()
            if not result.settled
        ]
        load = self._disturbance_bias()
        if load is not None:
            remarks.append(
                f"ADALINE attributes an unknown disturbance force to the magnet, and least squares "
                f"find one of {load:.2g} N: state a known force by --disturbance"
            )
        if self.coloured:
            remarks.append(
                f"the innovations are not white (correlation {self.colour:+.2f} at one sample): "
                "the sensor's noise is coloured, or the model is incomplete. This biases k of the "
                "Kalman filter, whose error does not hold; ADALINE and least squares average it"
            )
        return remarks

    def _disturbance_bias(self) -> float | None:
        """Return the disturbance of least squares [N], if it explains the difference of ADALINE."""
        adaline, rls = self.results["adaline"], self.results["rls"]
        if not (isinstance(rls, LeastSquaresResult) and isinstance(adaline, AdalineResult)):
            return None
        if rls.held.all() or adaline.held.all() or self.agree("adaline", "rls"):
            return None
        load = unknown_disturbance(rls)
        carried = float(np.abs(rls.force[last_quarter(rls.k)]).mean())
        return load if load is not None and abs(load) > 0.02 * carried else None

    TITLE = "Magnet constant of {0.known.name}, learned online"

    @property
    def finding(self) -> str:
        return f"{self.known.name}: {self.agreement}"

    @property
    def rows(self) -> list[Row]:
        results: list[Row] = []
        for name, one in self.results.items():
            k, truth = one.magnet_constant, self.truth
            against = f"against the true {figure(truth, CONSTANT)}"
            results += put([
                Row("start", "initial magnet constant", self.start, CONSTANT),
                *one.rows(),
                Row("change", "change", k / self.start - 1, "%"),
                Row("off_truth", against, k / truth - 1 if truth else None, "%"),
                Row("load", "unknown disturbance force", unknown_disturbance(one), "N", 3),
            ], section=LEARNERS, of=name)  # fmt: skip
        return results

    SECTIONS = {LEARNERS: Section("{0.title}")}

    @property
    def series(self) -> dict[str, Any]:
        return {row.key: row.value for row in self.rows if row.of == self.method} | {
            "method": self.method,
            "machine": self.known.name,
            "start": self.start,
            "truth": self.truth,
            "agreement": self.agreement,
            "innovation_correlation": self.colour,
            "coloured": self.coloured,
        }

    def figures(self) -> list[Figure]:
        return [online_figure(self)]


def compare_online(
    record: Record,
    machine: Machine,
    *,
    start: float | None = None,
    disturbance: ArrayLike | None = None,
    method: str = "all",
) -> OnlineComparison:
    """Identify the magnet constant along a record: ADALINE, least squares, and Kalman filter."""
    # All with the same signals and the same start, each with its defaults. disturbance (n,) [N]
    if method not in ("all", *ONLINE):
        raise AmbkitError(f'there is no method "{method}"; known: all, {", ".join(ONLINE)}')
    check_sampling(machine, record)
    return OnlineComparison(
        machine,
        machine.magnet.magnet_constant if start is None else start,
        true_constant(record),
        {
            name: learner(machine, start=start).run(record, disturbance=disturbance)
            for name, learner in ONLINE.items()
        },
        method,
    )


def true_constant(record: Record) -> float | None:
    """Return the simulated machine's magnet constant [N m^2/A^2]; None if measured."""
    text = record.meta.get("bearing")
    if not (record.has_truth and isinstance(text, str)):
        return None
    return Machine.from_toml(text).magnet.magnet_constant


def unknown_disturbance(result: OnlineResult) -> float | None:
    """Return the mean unknown disturbance in the last quarter [N]; None if it is unavailable."""
    if not isinstance(result, LeastSquaresResult | AugmentedResult):
        return None
    return float(result.load[last_quarter(result.k)].mean())


def _listed(names: Iterable[str]) -> str:
    """Return one or two methods in words."""
    return " and ".join(_THE[name] for name in names)


STYLES = {"adaline": "series 2", "rls": "series 3", "augmented": "series 1"}
TIME = Axis("time", "s")
LEAST = 0.02  #: Default excitation below which ADALINE and least squares hold k [1].
JOINED = 0.004  #: Share of the record up to which gaps between intervals are closed in the figure.
#: Position of the results at the right of the curves, as shares of the record.
ENDS = (1.03, 1.05, 1.07)


def online_figure(learned: OnlineComparison) -> Figure:
    """Plot k over time with its errors, and the excitation of each method."""
    t = next(iter(learned.results.values())).t
    right = t[0] + 1.09 * np.ptp(t)
    time = Axis(TIME.label, TIME.unit, limits=(float(t[0]), float(right)))
    return Figure(
        id="online",
        title=f"Magnet constant of {markdown(learned.known.name)}, learned online",
        caption=f"{learned.agreement} On the right the results with 95 % intervals; ADALINE's and "
        "that of least squares are the means over the last quarter, their intervals from the "
        "scatter there. Band: 95 % by the Kalman filter. Shaded: k is held for lack of "
        "excitation.",
        panels=[
            Panel(time, _limits(learned), _constants(learned)),
            *(_monitor(name, one, time) for name, one in learned.results.items()),
        ],
    )


def _constants(learned: OnlineComparison) -> list[Item]:
    items: list[Item] = [Rule(learned.start, signal="reference", label="start")]
    if learned.truth is not None:
        items.append(Rule(learned.truth, signal="truth"))
    for (name, one), place in zip(learned.results.items(), ENDS, strict=True):
        style = STYLES[name]
        learned_some = not one.held.all()
        if isinstance(one, AugmentedResult) and learned_some:
            half = CONFIDENCE * one.error
            half[: int(np.argmin(one.held))] = np.nan  # the initial value is no result
            items.append(Band(one.t, one.k - half, one.k + half, signal=style, label=""))
        items.append(Line(one.t, one.k, signal=style, label=NAMES[name]))
        if not learned_some:
            continue
        end = np.array([one.t[0] + place * np.ptp(one.t)])
        error = np.nan_to_num([CONFIDENCE * one.standard_error])
        items.append(Points(end, np.array([one.magnet_constant]), error, signal=style, label=""))
    return items


def _limits(learned: OnlineComparison) -> Axis:
    """Return the axis of k without extreme initial values."""
    values = [learned.start] if learned.truth is None else [learned.start, learned.truth]
    for one in learned.results.values():
        half = np.nan_to_num(CONFIDENCE * one.standard_error)
        values += [one.magnet_constant - half, one.magnet_constant + half]
        values += np.quantile(one.k, (0.02, 0.98)).tolist()
    margin = 0.06 * (max(values) - min(values))
    return Axis("magnet constant $k$", "N mm²/A²", 1e6,
                limits=(min(values) - margin, max(values) + margin))  # fmt: skip


def _monitor(name: str, one: OnlineResult, time: Axis) -> Panel:
    held: list[Item] = [
        Span(a, b, signal="limit", label="unexcited: k is held")
        for a, b in _stretches(one.t, one.held)
    ]
    style = STYLES[name]
    if isinstance(one, AugmentedResult):
        # While learning its error decreases, otherwise it grows with the random walk of k.
        error = Line(one.t, one.error / one.k, signal=style, label="")
        return Panel(time, Axis("error of $k$, filter", "%", 100.0), [*held, error])
    assert isinstance(one, AdalineResult)
    line = Line(one.t, one.excitation, signal=style, label="")
    least = Rule(LEAST, signal="bound", text="minimum", label="")
    return Panel(time, Axis(f"excitation, {NAMES[name]}"), [*held, line, least])


def _stretches(t: Array, where: Bools) -> list[tuple[float, float]]:
    """Return the intervals [s] in which something holds, with small gaps closed."""
    least = JOINED * float(t[-1] - t[0])
    joined: list[tuple[float, float]] = []
    for a, b in stretches(where):
        start, stop = float(t[a]), float(t[b - 1])
        if joined and start - joined[-1][1] < least:
            joined[-1] = joined[-1][0], stop
        else:
            joined.append((start, stop))
    return joined
