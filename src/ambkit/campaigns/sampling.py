"""Sample points: each a pure function of the study's seed and the run's number.

Runs can therefore be computed in any order, on any machine.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.campaigns.distributions import LEAST, MOST

_WORDS = 4  # Philox words per value of its counter (Salmon et al. 2011)
_RANDOM, _STRATA = 1, 2  # streams of a seed


def uniforms(plan: Any, first: int, stop: int) -> Array:
    """Return the points of runs in the unit cube, before the distributions."""
    # plan: `Plan`; returns (stop - first, k)
    way, k, seed = plan.study.sampling, len(plan.marginals), plan.study.seed
    if k == 0:
        return np.zeros((stop - first, 0))
    if way == "random":
        return counted(seed, k, first, stop)
    if way == "latin-hypercube":
        strata = np.column_stack([s[first:stop] for s in _strata(seed, k, plan.runs)])
        return np.asarray((strata + counted(seed, k, first, stop)) / plan.runs)
    if way == "sobol":
        return _sobol(seed, k, first, stop)
    if way == "saltelli":
        return _saltelli(seed, k, first, stop)
    return _grid(plan, first, stop)


def counted(seed: int, k: int, first: int, stop: int) -> Array:
    """Return uniform random numbers (stop - first, k) of runs, by their numbers (Philox)."""
    blocks = -(-k // _WORDS)
    philox = np.random.Philox(key=np.array([seed, _RANDOM], np.uint64)).advance(first * blocks)
    numbers = np.random.Generator(philox).random((stop - first, blocks * _WORDS))
    return np.ascontiguousarray(numbers[:, :k])


@lru_cache(maxsize=1)
def _strata(seed: int, k: int, runs: int) -> list[NDArray[np.uint32]]:
    """Return the stratum of each run in each dimension (McKay, Beckman, Conover 1979)."""
    rng = np.random.Generator(np.random.Philox(key=np.array([seed, _STRATA], np.uint64)))
    return [rng.permutation(np.arange(runs, dtype=np.uint32)) for _ in range(k)]


def _sobol(seed: int, k: int, first: int, stop: int) -> Array:
    """Return scrambled Sobol points (Owen 1998)."""
    from scipy.stats import qmc

    points = qmc.Sobol(k, scramble=True, rng=np.random.default_rng([seed, 2]))
    if first:
        points.fast_forward(first)
        return np.asarray(points.random(stop - first), float)
    # SciPy warns of a first piece whose length is no power of 2, although it continues.
    return np.asarray(points.random_base2(max(0, (stop - 1).bit_length()))[:stop], float)


def _saltelli(seed: int, k: int, first: int, stop: int) -> Array:
    """Return points for Sobol indices, in groups of k + 2 (Saltelli et al. 2010)."""
    # The first point of each group is A, then A with one coordinate at a time from a point B, and
    # finally B: as in ``SALib.sample.sobol`` without second order.
    group, place = np.divmod(np.arange(first, stop), k + 2)
    both = _sobol(seed, 2 * k, int(group[0]), int(group[-1]) + 1)[group - group[0]]
    A, B = both[:, :k], both[:, k:]
    from_B = (place[:, None] - 1 == np.arange(k)) | (place == k + 1)[:, None]
    return np.asarray(np.where(from_B, B, A), float)


def _grid(plan: Any, first: int, stop: int) -> Array:
    """Return the levels of a full grid as shares of their number, the last dimension fastest."""
    levels = np.array(plan.levels)
    at = np.unravel_index(np.arange(first, stop) // plan.study.repeats, levels)
    return np.asarray(np.column_stack(at) / np.maximum(levels - 1, 1))


def values(plan: Any, u: Array) -> Array:
    """Return the values of each quantity in some runs: in SI, for a choice its index."""
    # u (n, k); returns (n, k)
    from scipy.special import ndtr, ndtri

    result = np.empty_like(u)
    if plan.study.sampling == "grid":
        for place, marginal in enumerate(plan.marginals):
            result[:, place] = marginal.level(u[:, place])
        return result
    u = np.clip(u, LEAST, MOST)
    if plan.correlation is not None:
        scores = ndtri(u)
        mixed = np.zeros_like(scores)
        for j, column in enumerate(np.linalg.cholesky(plan.correlation).T):
            mixed += scores[:, [j]] * column  # in this order for any number of rows
        u = np.where(
            (plan.correlation != np.eye(len(plan.correlation))).any(axis=1), ndtr(mixed), u
        )
    for place, marginal in enumerate(plan.marginals):
        result[:, place] = marginal.quantile(u[:, place])
    return result
