"""How likely a failure is that hardly a machine has: subset simulation (Au and Beck 2001)."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base import files
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import json_text
from ambkit.base.quantity_arguments import Given, in_si
from ambkit.base.units import engineering
from ambkit.campaigns import sampling
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.store import Folder
from ambkit.campaigns.study_tables import UNITS
from ambkit.campaigns.worker import fly
from ambkit.result.result import Statement

Limit = Callable[[Array], Array]

SHARE = 0.1  #: Of the samples of a level, those that the next one begins from.
REACH = 1.0  #: How far a component steps at most, in its standard deviations.
MOST_LEVELS = 20  #: Levels: a probability of about 1e-20 is the least that is looked for.
NOISE_FROM = 1 << 40  #: Numbers of the noise of these runs begin here, beyond those of any study.


class Rare(NamedTuple):
    """The probability of a rare failure."""

    probability: float  #: That the figure is at or above the limit [1].
    low: float  #: Confidence interval [1], lognormal with `variation`.
    high: float
    variation: float  #: Coefficient of variation of the estimate [1].
    thresholds: tuple[float, ...]  #: Of the levels, the limit at last.
    runs: int  #: That were simulated.


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
    """Return how likely a function of standard normal numbers is at or above a limit."""
    # The failure is reached over levels, each with a probability of a tenth of the one before;
    # within a level chains walk by the modified Metropolis algorithm, component by component.
    # Au, Beck, Estimation of small failure probabilities in high dimensions by subset simulation,
    # Probabilistic Engineering Mechanics 16 (2001).
    from scipy.special import ndtri

    rng = np.random.Generator(np.random.Philox(seed))
    chains = max(2, round(SHARE * runs))
    length = math.ceil(runs / chains)
    u = rng.standard_normal((chains * length, dimensions))
    g = _known(limit(u))
    done("", steps=len(g))
    spent, squares, probability = len(g), 0.0, 1.0
    order: Array | None = None  # values by chain and step, of levels after the first
    thresholds: list[float] = []
    while True:
        rank = np.argsort(-g, kind="stable")
        # Between the last that goes on and the first that does not.
        ends = g[rank[chains - 1]], g[rank[chains]]
        b = float(ends[0] if not np.isfinite(ends).all() else 0.5 * (ends[0] + ends[1]))
        last = b >= above
        b = above if last else b
        share = float(np.mean(g >= b))
        probability *= share
        squares += _square(g >= b, share, None if order is None else order >= b)
        thresholds.append(b)
        if last:
            break
        if len(thresholds) >= MOST_LEVELS or (len(thresholds) > 1 and b <= thresholds[-2]) or (
            share > 0.5
        ):  # fmt: skip
            raise AmbkitError(
                f"after {spent} runs the levels do not come nearer to {above:g}, the last is at "
                f"{b:g}: the figure does not say how far a machine is from failing, or fails too "
                "rarely"
            )
        seeds = rank[:chains]
        u, g, order = _walk(limit, u[seeds], g[seeds], b, length, rng, done)
        spent += chains * (length - 1)
    if probability == 0:
        raise AmbkitError(f"none of {spent} runs comes to {above:g}: take more runs")
    variation = math.sqrt(squares)
    spread = float(ndtri(0.5 + confidence / 2)) * math.sqrt(math.log1p(squares))
    low, high = probability * math.exp(-spread), min(1.0, probability * math.exp(spread))
    return Rare(probability, low, high, variation, tuple(thresholds), spent)


def _known(g: Array) -> Array:
    """Return values with none for the least of all."""
    return np.where(np.isnan(g), -np.inf, g)


def _walk(
    limit: Limit,
    u: Array,
    g: Array,
    b: float,
    length: int,
    rng: np.random.Generator,
    done: Callable[..., None],
) -> tuple[Array, Array, Array]:
    """Let chains (c, k) walk within a level; return their points, values, and values by chain."""
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
    return np.concatenate(points), np.concatenate(values), np.column_stack(values)


def _square(failed: NDArray[np.bool_], share: float, chains: Any) -> float:
    """Return the squared variation of a level's share, with the correlation along its chains."""
    if share in (0.0, 1.0):
        return 0.0
    gamma = 0.0
    if chains is not None:
        length = chains.shape[1]
        deviation = chains - share
        variance = share * (1 - share)
        for lag in range(1, length):
            autocovariance = float((deviation[:, lag:] * deviation[:, :-lag]).mean())
            gamma += 2 * (1 - lag / length) * autocovariance / variance
    return max(0.0, (1 - share) / (share * failed.size) * (1 + gamma))


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
    """Return how likely a machine of a study has a figure at or above a limit."""
    # Each candidate of a chain has noise of its own: the walk is over the machines and their noise.
    # A machine that cannot be fails.
    from scipy.special import ndtr

    if figure not in UNITS or (figure == "peak_S" and not plan.study.record.margins):
        raise AmbkitError(f"there is no figure {figure} in this study")
    if plan.study.sampling == "grid":
        raise AmbkitError('a grid has no probabilities: take sampling = "random"')
    run_count = 0

    def limit(u: Array) -> Array:
        nonlocal run_count
        noise = NOISE_FROM + run_count + np.arange(len(u), dtype=np.uint64)
        run_count += len(u)
        result = fly(plan, sampling.values(plan, np.asarray(ndtr(u))), noise, threads=threads)
        wrong = np.array([bool(item) for item in result.wrong])
        return np.where(wrong, np.inf, result.columns[figure])

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


def rare_in_folder(
    folder: str | os.PathLike[str], figure: str, above: Given, **options: Any
) -> Statement:
    """Estimate a rare failure of a campaign's machines, and keep it in its folder."""
    place = Folder.existing(folder)
    if figure not in UNITS:
        raise AmbkitError(f"there is no figure {figure}; there are {', '.join(UNITS)}")
    limit = in_si("above", above, UNITS[figure])
    result = rare_failure(place.plan, figure, limit, **options)
    data = {"figure": figure, "above": limit} | result._asdict()
    files.write_text(place.path / f"rare-{figure}.json", json_text(data, indent=2) + "\n")
    return Statement(sentence(figure, limit, result), data)


def told(folder: Path) -> list[str]:
    """Return what was found of rare failures, in sentences."""
    results = []
    for path in sorted(folder.glob("rare-*.json")):
        try:
            data = json.loads(files.read_text(path))
            rare = Rare(**{name: data[name] for name in Rare._fields})
            results.append(sentence(data["figure"], data["above"], rare))
        except (ValueError, KeyError, TypeError) as error:
            raise AmbkitError(f"{path}: is damaged: {error}") from None
    return results


def sentence(figure: str, above: float, result: Rare) -> str:
    """Say how likely a failure is."""
    unit = UNITS[figure]
    limit = f"{above:g}" if unit == "1" else engineering(above, unit)
    return (
        f"{figure} is at or above {limit} with a probability of {result.probability:.3g} "
        f"({result.low:.2g} to {result.high:.2g}), by subset simulation over "
        f"{len(result.thresholds)} levels, {result.runs:,} runs."
    )
