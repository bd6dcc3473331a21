"""Score statistics of structures that a model lacks, beside all its parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.record import Record
from ambkit.estimate.batch import run_many
from ambkit.identification.maximum_likelihood.alternatives import (
    JUMPS,
    ONCE,
    Alternative,
    Motion,
    alternatives,
    beginning,
)
from ambkit.identification.maximum_likelihood.likelihood import Data
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import named, usual
from ambkit.machine.magnets import own_time

SMALL = 1e-4  #: Excluded shares of the bias current and of the sensor's noise as divisors.
SETTLED = 20.0  #: Time constants of the plant after which a jump has no effect.
CHANCE = 0.01  #: Probability that any of the tests exceeds its limit by chance.


@dataclass(frozen=True, eq=False)
class Tests:
    """Normalised residuals of n samples, and their derivatives by p parameters and c structures."""

    r: Array  #: (n,)
    by_parameters: Array  #: (p, n)
    scores: Array  #: (p, n)
    information: Array  #: (p, p) And the score (p,) of the priors.
    pull: Array
    kinds: list[Alternative]
    by_structures: Array  #: (c, n)
    limits: Array  #: (c,)


def tests_of(model: LoopModel, data: Data, chosen: Sequence[Alternative] | None) -> Tests:
    """Run the filter with some alternatives along all records; None: with each."""
    parameters, records = named(usual(model)), data.records
    likelihood = data.likelihood(model, parameters)
    e, S, by_e, by_S, used = likelihood.slopes(np.zeros(len(parameters)), rough=True)
    r = e / np.sqrt(S)
    pull, known = likelihood.priors(model)
    own = own_time(model.isolated) / model.isolated.sampling_time
    everything: list[tuple[list[Alternative], Array]] = []
    edges = np.cumsum([0, *(len(record) for record in records)])
    for number, record in enumerate(records):
        first, last = edges[number : number + 2]
        here = used[first:last]
        motion = Motion.of(model, record)
        at = np.count_nonzero(used[:first])
        scale = 1 / np.sqrt(S[at : at + np.count_nonzero(here)])
        mine = r[at : at + scale.size]
        places = np.flatnonzero(here)
        if not places.size:
            continue
        kinds = [one for kind in chosen or () for one in kind.along(motion, number)]
        if chosen is None:
            half = places.size // 2
            middle = [beginning(motion, kind, int(places[half])) for kind in JUMPS]
            of_middle = _responses(motion, record, middle)[:, here] * scale
            kinds = list(alternatives(motion))
            for kind, response in zip(JUMPS, of_middle, strict=True):
                shape = response[half : half + round(SETTLED * own)]
                sample = int(places[_likeliest(mine, shape)])
                also = ["change"] * (kind == "load jump")
                kinds += [beginning(motion, name, sample) for name in (kind, *also)]
        by_e_here = _responses(motion, record, kinds)[:, here] * scale
        everything.append((kinds, by_e_here))
    return Tests(
        r=r,
        by_parameters=by_e,
        scores=-(by_e * r + 0.5 * by_S * (1 - r**2)),
        information=by_e @ by_e.T + 0.5 * by_S @ by_S.T + known + 1e-9 * np.eye(len(pull)),
        pull=pull,
        **_of_all_records(everything),
    )


def _of_all_records(parts: Sequence[tuple[list[Alternative], Array]]) -> dict[str, Any]:
    """Join records: permanent structures are common to all, jumps belong to one."""
    from scipy.special import chdtri

    n = sum(responses.shape[1] for _, responses in parts)
    kinds: list[Alternative] = []
    rows: list[Array] = []
    at = 0
    common: dict[tuple[str, str, float], int] = {}
    for number, (of_record, responses) in enumerate(parts):
        columns = slice(at, at + responses.shape[1])
        at = columns.stop
        for one, response in zip(of_record, responses, strict=True):
            key = one.kind.name, one.where, one.scale
            if one.kind.name not in ONCE and key in common:
                rows[common[key]][columns] = response
                continue
            common[key] = len(rows)
            kinds.append(replace(one, record=number))
            rows.append(np.zeros(n))
            rows[-1][columns] = response
    # By Bonferroni's inequality: a jump may be at any sample.
    places = [n if one.kind.name in JUMPS else len(kinds) for one in kinds]
    limits = chdtri(1, CHANCE / np.array(places))
    return {"kinds": kinds, "by_structures": np.array(rows), "limits": limits}


def _likeliest(r: Array, shape: Array) -> int:
    """Return the sample at which a response of some shape most likely begins."""
    from scipy.signal import fftconvolve

    length, n = shape.size, r.size
    correlation = fftconvolve(r, shape[::-1])[length - 1 :][:n]
    energy = np.cumsum(shape**2)[np.minimum(n - np.arange(n), length) - 1]
    enough = energy > 0.5 * energy[0]
    gain = np.where(enough, correlation**2 / np.where(enough, energy, 1.0), 0.0)
    return int(np.argmax(gain))


def _responses(motion: Motion, record: Record, kinds: Sequence[Alternative]) -> Array:
    """Return the derivatives (c, samples) of the innovations [m] by the factors of alternatives."""
    model, b = motion.model, motion.model.isolated
    y, u = model.acting_signals(record)
    kalman = model.kalman()
    start = model.begin(kalman, y, record["u"][:1])
    k_i = float(np.median(np.abs(motion.k_i)))
    of_force = SMALL * b.magnet.bias_current * k_i
    of_reading = SMALL * math.sqrt(b.sensor.noise_variance)
    rows, steps = [(y, u)], []
    for one in kinds:
        size = float(np.sqrt(np.mean(one.signal**2))) or 1.0
        steps.append((of_reading if one.kind.of_reading else of_force) / size)
        rows.append(model.moved(y, u, *one.effect(steps[-1])))
    if kalman.machine.single:
        ys, us = (np.array(side) for side in zip(*rows, strict=True))
        e = run_many(kalman, ys, us, start=start, history=("innovation",)).innovation
        assert e is not None
    else:
        runs = []
        for reading, control in rows:
            kalman.reset(*start)
            runs.append(kalman.core.run(reading, control)["innovation"][:, model.reading])
        e = np.array(runs)
    e = e[:, :: model.substeps]
    return np.asarray(np.nan_to_num((e[1:] - e[0]) / np.array(steps)[:, None]))


def one_more(tests: Tests, taken: Sequence[int]) -> tuple[Array, Array, Array]:
    """Return a structure's contribution to selected ones (c, n), score (c,), precision (c,)."""
    d, p = tests.by_structures, len(tests.information)
    J = np.vstack([tests.by_parameters, d[taken]])
    information = J @ J.T
    information[:p, :p] = tests.information
    score = np.concatenate([tests.scores.sum(axis=1) + tests.pull, -d[taken] @ tests.r])
    along = np.linalg.solve(information, J @ d.T).T  # (c, p + taken)
    own = np.sum(d * d, axis=1)
    precision = own - np.sum(along * (d @ J.T), axis=1)
    return d - along @ J, -d @ tests.r - along @ score, np.maximum(precision, 1e-9 * own + 1e-300)


def sizes_of(tests: Tests, taken: Sequence[int]) -> Array:
    """Return the most likely sizes (c,) of some structures together."""
    left, slope, _ = one_more(tests, [])
    own = left[taken]
    return np.asarray(np.linalg.solve(own @ tests.by_structures[taken].T, slope[taken]))
