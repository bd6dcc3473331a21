"""A filter tuned on records or on simulated runs, and what that gained on what it did not see."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ambkit.base.asked import all_of_type, of_type
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.showing import Shown
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.data.rig_units import Inputs
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.registry import KINDS, learned_magnet
from ambkit.judge.comparison.cases import CASES, Trial, trials
from ambkit.judge.comparison.contenders import Contender, Range, contender_of_kind
from ambkit.judge.comparison.tuning import SIGNALS, Tried, errors, search
from ambkit.judge.evaluation import evaluate
from ambkit.machine.bearing import GRAVITY, Bearing
from ambkit.machine.magnets import own_time
from ambkit.workflow.tuning import MUCH_LESS_LIKELY, log_likelihood

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.magnets import MagnetModel
    from ambkit.show.report.figure import Figure

By = Literal["likelihood", "truth"]

NOISE = ("noise.measurement", "noise.disturbance")
"""What a record tells of a filter's noise; that of the control signal is hardly in it."""

BUDGET = 60
"""Evaluations where nobody says it."""

RUNS = 8
"""Simulated runs to tune on, and as many others to judge by, where nobody says it."""

SETTLING = 5.0
"""Time at the start of a record that does not count, in the plant's own."""

UNSEEN = 0.5
"""Share of each record, its end, that is kept to judge by where there are no other records."""

AT_THE_END = 0.02
"""Share of the range, in its logarithm, within which a value has run into its end."""

HALVINGS = 8
"""Of the range above the likeliest growth of the load, in which the largest likely one is found."""

TOO_LARGE = 2.0
"""Innovations over what the filter expects, root mean square, that no noise explains."""


@dataclass(frozen=True, eq=False)
class Tuned(Shown):
    """A filter, what it was tuned by, and what that gained.

    Attributes
    ----------
    estimator : Estimator
        The filter to take: tuned, or as it was where that fits the unseen data better.
    kind : str
        Of the filter.
    by : {"likelihood", "truth"}
        What was made large or small: the likelihood of records, or the errors against simulated
        truth.
    free : tuple of Range
        What was free, and within which bounds.
    trace : tuple of Tried
        All that was tried, in its order: values, and their cost. By likelihood that is minus the
        mean log likelihood of a sample; by truth the mean error over the untuned linear filter's.
    values : mapping of str to float
        What tuning found, by name, in SI. By likelihood the growth of the load is the largest that
        the records do not rule out: where the load rests, they like any small one as well.
    unseen : mapping of str to (float, float)
        Figures on data that it was not tuned on, untuned and tuned; smaller is better, but for
        ``nis``, which is 1 where model and noise are right.
    kept : bool
        Whether `estimator` is the tuned one.
    warnings : tuple of str
        What is odd about the result.
    """

    _card_by = "workflow.cards:tuned"

    estimator: Estimator
    kind: str
    by: By
    free: tuple[Range, ...]
    trace: tuple[Tried, ...]
    values: Mapping[str, float]
    unseen: Mapping[str, tuple[float, float]]
    kept: bool
    warnings: tuple[str, ...] = field(default=())

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        bearing: str | os.PathLike[str] | None = None,
        magnet: str | os.PathLike[str] | None = None,
    ) -> None:
        """Write the filter; see :meth:`ambkit.Estimator.save`.

        Parameters
        ----------
        path, bearing, magnet : path
            As there.
        """
        self.estimator.save(path, bearing=bearing, magnet=magnet)

    @property
    def outcome(self) -> str:
        """What became of it, in a sentence."""
        return f"The {'tuned' if self.kept else 'untuned'} filter is taken."

    def figure(self) -> Figure:
        """Return the picture of all that was tried."""
        from ambkit.show.plots.tuning import tuning_figure

        cost = {
            "likelihood": "minus log likelihood a sample",
            "truth": "error over the untuned linear filter's",
        }[self.by]
        title = f"Tuning of the {self.estimator.name} for {markdown(self.estimator.bearing.name)}"
        return tuning_figure(title, self.free, self.trace, self.values, cost, self.outcome)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        return {
            "bearing": self.estimator.bearing.name,
            "kind": self.kind,
            "by": self.by,
            "kept": self.kept,
            "values": dict(self.values),
            "bounds": {r.name: {"low": r.low, "high": r.high, "default": r.default,
                                "unit": r.unit} for r in self.free},
            "unseen": {name: {"untuned": a, "tuned": b} for name, (a, b) in self.unseen.items()},
            "trace": [{"cost": each.cost} | dict(each.values) for each in self.trace],
            "warnings": list(self.warnings),
        }  # fmt: skip


def tune(
    bearing: Bearing,
    records: Record | Sequence[Record] = (),
    kind: str = "extended",
    *,
    validate: Sequence[Record] = (),
    free: Iterable[str] | None = None,
    magnet: MagnetModel | None = None,
    inputs: Inputs | None = None,
    source: str = "",
    runs: int = RUNS,
    budget: int = BUDGET,
    seed: int = 0,
    done: Callable[[], None] = lambda: None,
) -> Tuned:
    """Tune a filter: by the likelihood of records, or without any by simulated truth.

    By likelihood (Schweppe 1965) the first half of each record is used, and its second half, or the
    records of `validate`, judge; the tuned filter is taken only where these are more likely with
    it. By truth the case "paper" is simulated, and other seeds judge.

    Parameters
    ----------
    bearing : Bearing
        What is filtered.
    records : Record or sequence of Record, optional
        With ``y`` [m] and ``u`` [V].
    kind : str
        One of :data:`ambkit.estimate.registry.KINDS`.
    validate : sequence of Record, optional
        Others, to judge by.
    free : iterable of str, optional
        What may change, by the names of the kind's tunables, such as ``noise.disturbance``; by
        default what the records tell, or with simulated runs all.
    magnet : optional
        What the filter knows of its magnet; by default what its kind does.
    inputs : Inputs, optional
        What the controller reads, for the filter's file.
    source : str
        What the records are called, for the filter's file.
    runs, budget, seed : int
        Simulated runs to tune on, evaluations, and the seed of all that is drawn.
    done : callable
        Called after each evaluation.

    Returns
    -------
    Tuned
        The filter, and what speaks for it.

    Raises
    ------
    AmbkitError
        There is no such kind or tunable; or the kind has no likelihood, as a low-pass.
    TypeError
        `bearing` is no bearing, or one of `records` no record.

    Examples
    --------
    >>> from ambkit import Bearing, tune
    >>> tuned = tune(Bearing.preset("zittau_axial"), kind="linear", budget=1, runs=1)
    >>> tuned.kept, tuned.estimator.name
    (False, 'linear Kalman filter')
    """
    of_type(Bearing, bearing=bearing)
    if kind not in KINDS:
        raise AmbkitError(f'there is no estimator "{kind}"; known: {", ".join(KINDS)}')
    given = all_of_type(Record, records=records)
    validate = all_of_type(Record, validate=validate)
    magnet = learned_magnet(kind, bearing) if magnet is None else magnet
    contender = contender_of_kind(kind, bearing, magnet, whole=True)
    task = _OfRecords(bearing, given, validate) if given else _OfTruth(bearing, runs, seed)

    def build(values: Mapping[str, float]) -> Estimator:
        made: Estimator = contender.build(**values)
        return made

    task.check(build({}), kind)
    chosen = _chosen(contender, task.usual(contender) if free is None else tuple(free))

    def cost(values: Mapping[str, float]) -> float:
        return task.cost(lambda: build(values))

    found = search(chosen, cost, budget, seed, done)
    best = task.cautious(found.best, chosen, cost)
    before = task.figures(lambda: build({}))
    after = task.figures(lambda: build(best.values))
    kept = (
        bool(best.values) and best is not found.tried[0] and after[task.judge] < before[task.judge]
    )
    estimator = build(best.values if kept else {})
    if inputs is not None:
        estimator.inputs = inputs
    if kept:
        said = f"{task.said(source)}; ambkit tune {_version()}"
        estimator.origin = dict.fromkeys(best.values, said)
    warnings = [*_at_an_end(chosen, best.values), *task.warnings(estimator, kept, after)]
    unseen = {name: (before[name], after[name]) for name in before}
    return Tuned(
        estimator,
        kind,
        task.by,
        chosen,
        tuple(found.tried),
        best.values,
        unseen,
        kept,
        tuple(warnings),
    )


class _OfRecords:
    """Tuning by the likelihood of records."""

    by: By = "likelihood"
    judge = "minus log likelihood a sample"

    def __init__(
        self, bearing: Bearing, records: Sequence[Record], validate: Sequence[Record]
    ) -> None:
        self.bearing = bearing
        self.settling = SETTLING * own_time(bearing)
        spans = [float(each.t[-1] - each.t[0]) for each in records]
        shortest = 4 * self.settling
        if min(spans) < shortest:
            raise AmbkitError(
                f"a record to tune on must be {engineering(shortest, 's', digits=3)} long at "
                f"least, twenty times what the rotor takes to fall; one has "
                f"{engineering(min(spans), 's', digits=3)}"
            )
        self.seen, self.unseen = list(records), list(validate)
        if not validate:
            ends = [each.t[0] + UNSEEN * span for each, span in zip(records, spans, strict=True)]
            self.seen = [r.between(None, end) for r, end in zip(records, ends, strict=True)]
            self.unseen = [r.between(end, None) for r, end in zip(records, ends, strict=True)]

    def usual(self, contender: Contender) -> tuple[str, ...]:
        own = [each.name for each in contender.tunable if not each.name.startswith("noise.")]
        return (*NOISE, *own)

    def cautious(
        self, best: Tried, free: Sequence[Range], cost: Callable[[Mapping[str, float]], float]
    ) -> Tried:
        """Take the fastest load that the records do not rule out (Edwards 1972).

        A record in which the load rests likes any small growth as well, and a filter with such a
        one follows no load that comes later.
        """
        growth = next((each for each in free if each.name == "noise.disturbance"), None)
        if growth is None:
            return best
        samples = sum(len(each) for each in self.seen)
        allowed = best.cost + MUCH_LESS_LIKELY / samples
        low, high = math.log(best.values[growth.name]), math.log(growth.high)
        taken = best
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            values = {**best.values, growth.name: math.exp(middle)}
            at = cost(values)
            if at < allowed:
                low, taken = middle, Tried(values, at)
            else:
                high = middle
        return taken

    def check(self, estimator: Estimator, kind: str) -> None:
        variance = estimator.run(self.seen[0]).innovation_variance
        if not (np.isfinite(variance) & (variance > 0)).any():
            raise AmbkitError(
                f"the {kind} filter has no idea of its innovations, so that no record is the more "
                "likely for its values: tune it on simulated runs, without records"
            )

    def cost(self, build: Callable[[], Estimator]) -> float:
        return self._unlikely(build, self.seen)

    def _unlikely(self, build: Callable[[], Estimator], records: Sequence[Record]) -> float:
        total, samples = 0.0, 0
        for record in records:
            first = min(round(self.settling / self.bearing.sampling_time), len(record) // 2)
            total -= log_likelihood(build().run(record), first)
            samples += len(record) - first
        return total / samples if math.isfinite(total) else math.inf

    def figures(self, build: Callable[[], Estimator]) -> dict[str, float]:
        each = [evaluate(build(), r, settling=self.settling) for r in self.unseen]

        def pooled(values: Iterable[float]) -> float:
            return float(np.sqrt(np.mean(np.square(list(values)))))

        found = {
            self.judge: self._unlikely(build, self.unseen),
            "nis": float(np.mean([e.nis for e in each])),
            "error 1 step ahead [m]": pooled(e.prediction[1] for e in each),
            "error 10 steps ahead [m]": pooled(e.prediction[10] for e in each),
        }
        for name in each[0].rmse:
            if all(name in e.rmse for e in each):
                found[f"error of {name}"] = pooled(e.rmse[name] for e in each)
        return found

    def said(self, source: str) -> str:
        return f"likelihood of {source or f'{len(self.seen)} records'}"

    def warnings(
        self, estimator: Estimator, kept: bool, after: Mapping[str, float]
    ) -> Iterable[str]:
        if not kept:
            yield (
                "the data that it was not tuned on is no more likely with the tuned values: the "
                "untuned filter is taken"
            )
        if kept and after["nis"] > TOO_LARGE**2:
            yield (
                f"the innovations are {math.sqrt(after['nis']):.1f} times what the filter expects, "
                "on data that it was not tuned on: is the record of this bearing?"
            )
        yield from _in_the_loop(self.bearing, estimator, kept)


class _OfTruth:
    """Tuning by the errors against simulated truth."""

    by: By = "truth"
    judge = "error over the untuned linear filter's"

    def __init__(self, bearing: Bearing, runs: int, seed: int) -> None:
        self.bearing, self.runs = bearing, runs
        self.first = round(SETTLING * own_time(bearing) / bearing.sampling_time)
        self.seen = self._trials(2 * seed + 1)
        self.unseen = self._trials(2 * seed + 2)
        if not (self.seen and self.unseen):
            raise AmbkitError(f"{bearing.name}: the rotor met a stop in all simulated runs")
        self.reference = errors(lambda: KalmanFilter(bearing), self.seen, self.first).mean(axis=0)

    def _trials(self, seed: int) -> list[Trial]:
        made = trials(CASES["paper"], self.bearing, self.runs, seed)
        return [each for each in made if not each.lost]

    def usual(self, contender: Contender) -> tuple[str, ...]:
        names = [each.name for each in contender.tunable]
        # Gains depend on the ratios of the variances alone: one of them is left as it is.
        given = {"noise.control", "noise.disturbance"} <= set(names)
        return tuple(name for name in names if not (given and name == "noise.measurement"))

    def cautious(self, best: Tried, _free: Any, _cost: Any) -> Tried:
        return best

    def check(self, estimator: Estimator, kind: str) -> None:
        """There is nothing that could not be tuned so."""

    def cost(self, build: Callable[[], Estimator]) -> float:
        return self._share(errors(build, self.seen, self.first))

    def _share(self, found: Any) -> float:
        shares = found.mean(axis=0) / self.reference
        known = shares[~np.isnan(shares)]
        return float(known.mean()) if known.size else math.inf

    def figures(self, build: Callable[[], Estimator]) -> dict[str, float]:
        found = errors(build, self.unseen, self.first)
        by_signal = dict(zip(SIGNALS, found.mean(axis=0).tolist(), strict=True))
        return {self.judge: self._share(found)} | {
            f"error of {name}": value for name, value in by_signal.items()
        }

    def said(self, source: str) -> str:
        return f"errors in {len(self.seen)} simulated runs of {self.bearing.name}"

    def warnings(
        self, estimator: Estimator, kept: bool, after: Mapping[str, float]
    ) -> Iterable[str]:
        raw = float(np.mean([
            np.sqrt(np.mean((t.record["y"] / self.bearing.sensor.gain - t.record["x"])[self.first:]
                            ** 2)) for t in self.unseen
        ]))  # fmt: skip
        if not after["error of x"] < raw:
            yield (
                f"its position errs by {engineering(after['error of x'], 'm', digits=3)}, and the "
                f"raw sensor by {engineering(raw, 'm', digits=3)}"
            )
        if not kept:
            yield "runs that it was not tuned on have no smaller errors: the untuned is taken"


def _chosen(contender: Contender, names: tuple[str, ...]) -> tuple[Range, ...]:
    known = {each.name: each for each in contender.tunable}
    for name in names:
        if name not in known:
            raise AmbkitError(
                f'the {contender.name} filter has no tunable "{name}"; it has: {", ".join(known)}'
            )
    return tuple(known[name] for name in names)


def _at_an_end(free: Sequence[Range], values: Mapping[str, float]) -> Iterable[str]:
    """Tell which values have run into a bound."""
    for each in free:
        if each.name not in values:
            continue
        share = math.log(values[each.name] / each.low) / math.log(each.high / each.low)
        if not AT_THE_END < share < 1 - AT_THE_END:
            bound = each.low if share < 0.5 else each.high
            yield f"{each.name} ran into the end of its range, {bound:.3g} {each.unit}"


def _in_the_loop(bearing: Bearing, estimator: Estimator, kept: bool) -> Iterable[str]:
    """Tell where a filter that a record likes best is worse in a simulated loop."""
    from ambkit.simulation.run import simulate_run
    from ambkit.workflow.simulating import scenario_for

    if not kept:
        return
    load = 0.3 * bearing.rotor.mass * GRAVITY * (-1 if bearing.rotor.gravity == "+x" else 1)
    scenario = scenario_for(bearing, step=0.1 * bearing.rotor.travel_limit, load=load)
    found = {}
    for name, one in (("untuned", None), ("tuned", estimator)):
        filter_ = one or KalmanFilter(bearing)
        run = simulate_run(bearing, scenario, estimator=filter_)
        if run.record.meta["stop_touched"]:
            found[name] = math.inf
        else:
            off = run.record["x"] - scenario.reference.sample(run.record.t)
            found[name] = float(np.sqrt(np.mean(off**2)))
    if found["tuned"] > 1.25 * found["untuned"]:
        worse = found["tuned"] / found["untuned"]
        what = "loses the rotor" if math.isinf(worse) else f"errs {worse:.2f} times as much"
        yield (
            f"in a simulated loop with the default controller it {what} as with the untuned linear "
            "filter: the likelihood knows nothing of the loop"
        )


def _version() -> str:
    from importlib.metadata import version

    return version("ambkit")
