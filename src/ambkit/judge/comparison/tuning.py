"""Candidates of a comparison, each tuned with the same number of evaluations."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.arrays import Array, rms
from ambkit.base.errors import AmbkitError
from ambkit.estimate.batch import run_many
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.machine_model import View
from ambkit.estimate.named import FromFile, expanded, factories
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import KINDS, default_name, get_kind, make_filter, split_name
from ambkit.estimate.user_filter import OwnEstimator
from ambkit.judge.comparison.cases import Trial
from ambkit.judge.comparison.criteria import errors_along
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel


@dataclass(frozen=True)
class Range:
    """Range of a tunable on a logarithmic scale."""

    name: str  #: Name, as in the kind: ``noise.disturbance``, ``bandwidth``.
    unit: str  #: SI unit.
    default: float  #: Greater than 0.
    low: float
    high: float


@dataclass(frozen=True)
class Candidate:
    """An estimator in a comparison."""

    name: str  #: Name.
    label: str  #: Label in figures.
    #: ``build(**values)`` makes a new one, with values of its tunables.
    build: Callable[..., Any]
    tunable: tuple[Range, ...] = ()  #: Its tunables.
    #: Whether it can run in the simulated loop, which is C; one in Python runs beside it.
    in_loop: bool = True

    @property
    def defaults(self) -> dict[str, float]:
        """Default values of the tunables."""
        return {item.name: item.default for item in self.tunable}


def candidates(
    names: Sequence[str],
    machine: Machine,
    magnets: Mapping[str, MagnetModel] | None = None,
    custom: Mapping[str, Any] | None = None,
) -> dict[str, Candidate]:
    """Return the candidates by name."""
    results = {}
    for name in names:
        kind, _, file = split_name(name)
        if kind in KINDS and not file:
            magnet = (magnets or {}).get(name, (magnets or {}).get(kind))
            results[name] = candidate_of_kind(name, machine, magnet)
            continue
        (build,) = factories([name], machine).values()
        if isinstance(build, FromFile):
            label = f"{KINDS[build.file.kind].label} ({Path(name).stem})"
            results[name] = Candidate(name, label, build)
        else:
            own_name = name.rpartition(":")[2]
            results[own_name] = Candidate(own_name, own_name, build, in_loop=False)
    for own_name, build in factories(custom or {}, machine).items():
        in_core = not isinstance(build(), OwnEstimator)
        results[own_name] = Candidate(own_name, own_name, build, in_loop=in_core)
    return results


def suited(names: Sequence[str], machine: Machine) -> list[str]:
    """Return the names; ``all``: the kinds that take a machine, with what rotates by its file."""
    if not set(KINDS) <= set(names):
        return list(names)
    taken = [name for name in names if name not in KINDS or KINDS[name].estimator.takes(machine)]
    known = [default_name(machine, name) if name in KINDS else name for name in taken]
    return list(dict.fromkeys(known))


def expand(text: str) -> list[str]:
    """Split a list of names, such as ``linear,my.py:MyFilter``; ``all`` means every kind."""
    results = expanded(filter(None, map(str.strip, text.split(","))))
    if not results:
        raise AmbkitError(f"no filter is named; known: all, {', '.join(KINDS)}")
    return results


def candidate_of_kind(
    name: str, machine: Machine, magnet: MagnetModel | None = None, *, all_noise: bool = False
) -> Candidate:
    """Return a kind of filter, with its synchronous states, as a candidate."""
    kind = get_kind(name)

    def build(**values: float) -> Any:
        noise: dict[str, Any] = {
            key.removeprefix("noise."): v for key, v in values.items() if "noise." in key
        }
        own = KalmanFilter(machine).variances._asdict() if noise else {}
        for key, item in own.items():  # scales all axes alike
            if key in noise and isinstance(item, tuple):
                scale = noise[key] / defaults[f"noise.{key}"]
                noise[key] = tuple(scale * variance for variance in item)
        rest = {key: value for key, value in values.items() if "noise." not in key}
        return make_filter(name, machine, magnet, noise=FilterNoise(**noise), **rest)

    free = {t.name: t for t in kind.tunable}
    if not all_noise and {"noise.control", "noise.disturbance"} <= free.keys():
        free.pop("noise.measurement", None)
    try:
        defaults = {name: tunable.default(machine) for name, tunable in free.items()}
    except ValueError as error:  # not every kind takes several axes
        raise AmbkitError(str(error)) from error
    ranges = tuple(
        Range(t.name, t.unit, at, at / 10**t.decades, at * 10**t.decades)
        for t, at in zip(free.values(), defaults.values(), strict=True)
    )
    return Candidate(name, kind.label, build, ranges)


SIGNALS = ("x", "v", "f_d")
WORST = 10.0  #: Cost of a run in which it diverges; the untuned linear filter's is 1.


@dataclass(frozen=True)
class Tuning:
    """Result of a tuning."""

    values: Mapping[str, float]  #: Values of the tunables.
    #: Mean over x, v and f_d of the RMSE on the training runs, relative to the untuned linear
    #: filter's: tuned, and with the defaults.
    objective: float
    default: float
    evaluations: int  #: Number of evaluations.


def errors(build: Callable[[], Any], training: Sequence[Trial], first: int) -> Array:
    """Return the RMSE of x, v, f_d on each training run, (runs, 3); infinite if it diverges."""
    records = [trial.record for trial in training]
    built = build()
    if isinstance(built, Estimator) and built.view.single and records:
        y, u, *truth = (np.array([r[name] for r in records]) for name in ("y", "u", *SIGNALS))
        many = run_many(
            built, y, u, truth=np.stack(truth, axis=-1), skip=first, history=(), threads=1
        )
        result = np.asarray(many.rmse, float)
    else:  # several axes, or the user's class in Python
        result = np.empty((len(records), len(SIGNALS)))
        view = View(built.machine)
        for row, record in zip(result, records, strict=True):
            made = built if isinstance(built, Estimator) else build()
            wrong = errors_along(made.run(record), record, view)
            row[:] = [rms(wrong[name][:, first:]) for name in SIGNALS]
    result[~np.isfinite(result[:, 0])] = math.inf
    return result


def tune(
    candidate: Candidate,
    training: Sequence[Trial],
    reference: Array,
    budget: int,
    first: int,
    seed: int = 0,
) -> Tuning:
    """Tune an estimator with a fixed number of evaluations."""
    # The first evaluation is that of the defaults; up to half are scrambled Sobol points over the
    # complete range; the rest go to a simplex from the best of these (Nelder and Mead 1965).
    # reference (3,)

    def cost(values: Mapping[str, float]) -> float:
        result = errors(lambda: candidate.build(**values), training, first) / reference
        with np.errstate(invalid="ignore"):
            # Signals that it does not estimate are not in the mean.
            finite_costs = [
                float(np.minimum(c, WORST).mean()) for c in result.T if not np.isnan(c).any()
            ]
        return float(np.mean(finite_costs)) if finite_costs else WORST

    done = search(candidate.tunable, cost, budget, seed)
    best = done.best
    return Tuning(best.values, best.cost, done.points[0].cost, len(done.points))


class Costed(NamedTuple):
    """Values of the tunables, and their cost."""

    values: Mapping[str, float]
    cost: float


class Search(NamedTuple):
    """All evaluations in order; the defaults first."""

    points: Sequence[Costed]

    @property
    def best(self) -> Costed:
        """The least cost; the first of equals, so the defaults if nothing is better."""
        return min(self.points, key=lambda item: item.cost)


def check_budget(budget: int) -> None:
    """Reject a search without evaluations."""
    if budget < 1:
        raise AmbkitError(f"budget must be at least 1, is {budget}")


def search(
    tunable: Sequence[Range],
    cost: Callable[[Mapping[str, float]], float],
    budget: int,
    seed: int = 0,
    done: Callable[[], None] = lambda: None,
) -> Search:
    """Return the values of least cost, with a fixed number of evaluations."""
    # See `tune` for the method.
    check_budget(budget)
    trials: list[Costed] = []

    def at(point: Array) -> float:
        values = {
            item.name: item.low * (item.high / item.low) ** share if trials else item.default
            for item, share in zip(tunable, np.clip(point, 0, 1).tolist(), strict=True)
        }
        trials.append(Costed(values, cost(values)))
        done()
        return trials[-1].cost

    points = [np.array([math.log(t.default / t.low) / math.log(t.high / t.low) for t in tunable])]
    at(points[0])
    if not tunable or budget <= 1:
        return Search(trials)
    from scipy.optimize import minimize
    from scipy.stats import qmc

    count = max(1, budget // 2 - 1)
    sobol = qmc.Sobol(len(tunable), scramble=True, rng=np.random.default_rng([seed, 4]))
    for point in sobol.random_base2(math.ceil(math.log2(count)))[:count]:
        if len(trials) < budget:
            points.append(point)
            at(point)
    best = points[int(np.argmin([trial.cost for trial in trials]))]
    towards_middle = np.diag(np.where(best < 0.5, 0.15, -0.15))
    corners = np.vstack([best, best + towards_middle])
    if budget > len(trials):
        minimize(at, best, method="Nelder-Mead", bounds=[(0.0, 1.0)] * best.size,
                 options={"maxfev": budget - len(trials), "initial_simplex": corners,
                          "xatol": 1e-4, "fatol": 1e-6})  # fmt: skip
    return Search(trials)
