"""Probability of rare failures: subset simulation (Au and Beck 2001)."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ambkit.base import files
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import json_text
from ambkit.base.own_class import MARK, load_class
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.base.units import engineering
from ambkit.campaigns import sampling
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.store import Folder
from ambkit.campaigns.study_tables import UNITS
from ambkit.campaigns.worker import fly
from ambkit.result.result import Statement

Limit = Callable[[Array], Array]

SHARE = 0.1  #: Share of a level's samples from which the next one starts.
REPETITIONS = 5  #: Independent repetitions, which share the runs of a level.
ALIKE = 0.2  #: Cosine between the mean failure points of two repetitions below which modes differ.
REACH = 1.0  #: Maximum step of a component, in its standard deviations.
MOST_LEVELS = 20  #: Maximum number of levels, for probabilities down to about 1e-20.
NOISE_FROM = 1 << 40  #: Start of the noise numbers of these runs, beyond those of any study.


class Rare(NamedTuple):
    """Probability of a rare failure."""

    probability: float  #: Probability that the figure reaches the limit [1].
    low: float  #: Confidence interval [1], from independent repetitions.
    high: float
    variation: float  #: Coefficient of variation of the estimate [1].
    thresholds: tuple[float, ...]  #: Levels of the first repetition, ending with the limit.
    runs: int  #: Number of simulated runs.
    repetitions: int = 1
    several_modes: bool = False  #: Whether repetitions failed in different directions.


class _Repetition(NamedTuple):
    """One subset simulation."""

    probability: float
    thresholds: tuple[float, ...]
    runs: int
    failed: Array  #: Mean of the failed points (d,).


def subset(
    limit: Limit,
    dimensions: int,
    above: float,
    *,
    runs: int = 1000,
    seed: int = 0,
    confidence: float = 0.95,
    done: Callable[..., None] = lambda text="", steps=1: None,
) -> Rare:
    """Return the probability that a function of standard normal numbers reaches a limit."""
    # Within a repetition the levels are dependent, and all chains start from a few points: it
    # cannot indicate a failure mode that it missed. Hence the interval is that of independent
    # repetitions, whose results are nearly lognormal: Cox's, with Student's quantile (Olsson,
    # Confidence intervals for the mean of a log-normal distribution, J. Stat. Educ. 2005).
    from scipy.special import stdtrit

    count = REPETITIONS
    streams = np.random.SeedSequence(seed).spawn(count)
    repetitions = [
        _repetition(limit, dimensions, above, math.ceil(runs / count), stream, done)
        for stream in streams
    ]
    probabilities = np.array([one.probability for one in repetitions])
    logarithms = np.log(probabilities)
    square, mean = float(logarithms.var(ddof=1)), float(probabilities.mean())
    centre = float(logarithms.mean()) + square / 2
    spread = float(stdtrit(count - 1, 0.5 + confidence / 2)) * math.sqrt(
        square / count + square**2 / (2 * (count - 1))
    )
    directions = np.array([one.failed / np.linalg.norm(one.failed) for one in repetitions])
    return Rare(
        mean,
        min(mean, math.exp(centre - spread)),
        min(1.0, max(mean, math.exp(centre + spread))),
        float(probabilities.std(ddof=1)) / mean / math.sqrt(count),
        repetitions[0].thresholds,
        sum(one.runs for one in repetitions),
        count,
        bool((directions @ directions.T < ALIKE).any()),
    )


def _repetition(
    limit: Limit,
    dimensions: int,
    above: float,
    runs: int,
    stream: np.random.SeedSequence,
    done: Callable[..., None],
) -> _Repetition:
    # The failure is reached over levels, each with a probability of a tenth of the one before;
    # within a level chains walk by the modified Metropolis algorithm, component by component.
    # Au, Beck, Estimation of small failure probabilities in high dimensions by subset simulation,
    # Probabilistic Engineering Mechanics 16 (2001).
    rng = np.random.Generator(np.random.Philox(stream))
    chains = max(2, round(SHARE * runs))
    length = math.ceil(runs / chains)
    u = rng.standard_normal((chains * length, dimensions))
    g = _known(limit(u))
    done("", steps=len(g))
    spent, probability = len(g), 1.0
    thresholds: list[float] = []
    while True:
        rank = np.argsort(-g, kind="stable")
        # Between the last sample that continues and the first that does not.
        ends = g[rank[chains - 1]], g[rank[chains]]
        b = float(ends[0] if not np.isfinite(ends).all() else 0.5 * (ends[0] + ends[1]))
        last = b >= above
        b = above if last else b
        share = float(np.mean(g >= b))
        probability *= share
        thresholds.append(b)
        if last:
            break
        if len(thresholds) >= MOST_LEVELS or (len(thresholds) > 1 and b <= thresholds[-2]) or (
            share > 0.5
        ):  # fmt: skip
            raise AmbkitError(
                f"after {spent} runs the levels do not approach {above:g}, the last is at "
                f"{b:g}: the figure does not measure the distance from failure, or failure is "
                "too rare"
            )
        seeds = rank[:chains]
        u, g = _walk(limit, u[seeds], g[seeds], b, length, rng, done)
        spent += chains * (length - 1)
    return _Repetition(probability, tuple(thresholds), spent, u[g >= above].mean(axis=0))


def _known(g: Array) -> Array:
    """Return values with NaN replaced by the smallest value."""
    return np.where(np.isnan(g), -np.inf, g)


def _walk(
    limit: Limit,
    u: Array,
    g: Array,
    b: float,
    length: int,
    rng: np.random.Generator,
    done: Callable[..., None],
) -> tuple[Array, Array]:
    """Move chains (c, k) within a level; return their points and values."""
    points, values = [u], [g]
    for _ in range(length - 1):
        step = rng.uniform(-REACH, REACH, u.shape)
        ratio = np.exp(-(u + 0.5 * step) * step)  # of the normal densities
        moved = np.where(rng.random(u.shape) < ratio, u + step, u)
        seen = _known(limit(moved))
        done("", steps=len(seen))
        stays = seen < b
        u, g = np.where(stays[:, None], u, moved), np.where(stays, g, seen)
        points.append(u)
        values.append(g)
    return np.concatenate(points), np.concatenate(values)


def rare_failure(
    plan: Plan,
    figure: str,
    above: float,
    *,
    runs: int = 1000,
    seed: int = 0,
    threads: int | None = None,
    done: Callable[..., None] = lambda text="", steps=1: None,
) -> Rare:
    """Return the probability that a machine of a study reaches a limit of a figure."""
    # Each candidate of a chain has its own noise: the chain walks over machines and noise. An
    # impossible machine fails.
    from scipy.special import ndtr

    own = load_class(figure)[1] if MARK in figure else None
    recorded = figure in UNITS and (figure != "peak_S" or plan.study.record.margins)
    if own is None and not recorded:
        raise AmbkitError(f"there is no figure {figure} in this study")
    if plan.study.sampling == "grid":
        raise AmbkitError('a grid has no probabilities: take sampling = "random"')
    run_count = 0

    def limit(u: Array) -> Array:
        nonlocal run_count
        noise = NOISE_FROM + run_count + np.arange(len(u), dtype=np.uint64)
        run_count += len(u)
        sampled = sampling.values(plan, np.asarray(ndtr(u)))
        result = fly(plan, sampled, noise, threads=threads)
        wrong = np.array([bool(item) for item in result.wrong])
        values = result.columns[figure] if own is None else _own(figure, own, result.columns | {
            name: np.array([row[k] for row in sampled]) for k, name in enumerate(plan.names)
        })  # fmt: skip
        return np.where(wrong, np.inf, values)

    if not plan.names:
        raise AmbkitError(f"{plan.study.name}: nothing varies")
    return subset(
        limit,
        len(plan.names),
        above,
        runs=runs,
        seed=seed,
        confidence=plan.study.confidence,
        done=done,
    )


def _own(name: str, limit: Callable[..., Any], columns: dict[str, Array]) -> Array:
    """Return a user's limit state over runs (n,), from figures and quantities by name."""
    try:
        values = np.asarray(limit(columns), float)
    except Exception as error:
        raise AmbkitError(
            f"{name}: {type(error).__name__}: {error}; its argument has {', '.join(columns)}"
        ) from error
    count = len(next(iter(columns.values())))
    if values.shape != (count,):
        raise AmbkitError(f"{name}: must return {count} numbers, returned shape {values.shape}")
    return values


def rare_in_folder(
    folder: str | os.PathLike[str], figure: str, above: QuantityLike, **options: Any
) -> Statement:
    """Estimate a rare failure of a campaign's machines, and store it in its folder."""
    place = Folder.existing(folder)
    if figure not in UNITS and MARK not in figure:
        raise AmbkitError(f"there is no figure {figure}; there are {', '.join(UNITS)}")
    limit = in_si("above", above, UNITS.get(figure, "1"))
    result = rare_failure(place.plan, figure, limit, **options)
    data = {"figure": figure, "above": limit} | result._asdict()
    name = figure.rpartition(":")[2]
    files.write_text(place.path / f"rare-{name}.json", json_text(data, indent=2) + "\n")
    return Statement(sentence(figure, limit, result), data)


def results_text(folder: Path) -> list[str]:
    """Return the results of rare failures, in sentences."""
    results = []
    for path in sorted(folder.glob("rare-*.json")):
        try:
            data = json.loads(files.read_text(path))
            rare = Rare(**{name: data[name] for name in Rare._fields if name in data})
            results.append(sentence(data["figure"], data["above"], rare))
        except (ValueError, KeyError, TypeError) as error:
            raise AmbkitError(f"{path}: is damaged: {error}") from None
    return results


def sentence(figure: str, above: float, result: Rare) -> str:
    """Return the probability of a failure in words."""
    unit, levels = UNITS.get(figure, "1"), len(result.thresholds)
    limit = f"{above:g}" if unit == "1" else engineering(above, unit)
    times = f", {result.repetitions} times" if result.repetitions > 1 else ""
    modes = (
        " It may fail in several modes: repetitions ended in different directions from the nominal "
        "machine, and further modes of failure are not in the interval."
    )
    return (
        f"{figure} is at or above {limit} with a probability of {result.probability:.3g} "
        f"({result.low:.2g} to {result.high:.2g}), by subset simulation over "
        f"{levels} level{'s' * (levels > 1)}{times}, {result.runs:,} runs."
        f"{modes if result.several_modes else ''}"
    )
