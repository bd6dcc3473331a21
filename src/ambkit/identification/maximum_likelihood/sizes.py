"""Sizes of the structures that a model lacks, by maximum likelihood beside its parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.identification.maximum_likelihood.alternatives import Alternative, Motion
from ambkit.identification.maximum_likelihood.likelihood import Data, between_blocks
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import named, usual
from ambkit.identification.maximum_likelihood.refits import Departure
from ambkit.identification.maximum_likelihood.score import one_more, sizes_of, tests_of
from ambkit.identification.maximum_likelihood.search import Optimum, maximise

REFITS = 6  #: Searches of the parameters with the structures, which determine their sizes.
STEP = 0.7  #: Share of a step of the sizes, which overshoots.
SHORTER = 0.4  #: Share of a step that does not raise the likelihood, to try instead.
LEAST = 2.0  #: Standard errors below which a size is none, beside other structures.
BIAS = 0.4  #: Share by which the size of a score alone may be too large.


def refined(
    selected: Sequence[tuple[Departure, Alternative]], model: LoopModel, data: Data
) -> list[Departure]:
    """Return structures with their most likely sizes, beside all parameters."""
    # The score is of a model whose process noise explains the structures too: its sizes are a third
    # too large. Steps of the sizes alternate with searches of all parameters beside them.
    departures, chosen = [d for d, _ in selected], [one for _, one in selected]
    if all(d.kind.innocent for d in departures):
        return departures
    value = data.log_likelihood(model)
    factors, step = np.zeros(len(chosen)), STEP * np.array([d.size / s.scale for d, s in selected])
    variances = np.zeros(len(chosen))
    for _ in range(REFITS):
        resized, sizes = _resized(chosen, factors + step)
        optimum = optimum_beside(model, data, resized, sizes)
        if optimum is None or not optimum.value > value:
            step = SHORTER * step
            continue
        model, value, factors = optimum.model, optimum.value, sizes
        tests = tests_of(model, data, resized)
        chosen = tests.kinds
        left = one_more(tests, [])[0]
        own = np.linalg.inv(left @ tests.by_structures.T)
        robust = own @ between_blocks(left * tests.r, model.isolated) @ own
        step = STEP * sizes_of(tests, range(len(chosen)))
        variances = np.maximum(np.diag(own), np.diag(robust))
    if not factors.any():
        return [replace(d, error=math.hypot(d.error, BIAS * d.size)) for d in departures]
    errors = np.sqrt(variances + step**2)
    sized = [
        replace(d, size=float(factor * one.scale), error=math.hypot(error * one.scale, one.bias))
        for d, one, factor, error in zip(departures, chosen, factors, errors, strict=True)
    ]
    # The others may explain one that was selected before them.
    return [d for d in sized if abs(d.size) > LEAST * d.error or d is max(sized, key=_statistic)]


def _statistic(departure: Departure) -> float:
    return departure.statistic


def _resized(chosen: Sequence[Alternative], factors: Array) -> tuple[list[Alternative], Array]:
    """Return structures of other sizes: lags and widths change their signal, not its factor."""
    of_signal = np.array([one.scale != 1 for one in chosen])
    scales = np.where(of_signal, np.maximum(factors, 0.1), 1.0).tolist()
    changed = [replace(one, scale=one.scale * by) for one, by in zip(chosen, scales, strict=True)]
    return changed, np.where(of_signal, 1.0, factors)


def optimum_beside(
    model: LoopModel, data: Data, chosen: Sequence[Alternative], factors: Array
) -> Optimum | None:
    """Return the most likely parameters beside structures; None if no filter follows them."""
    effects: dict[int, tuple[Array, Array]] = {}
    for number, record in enumerate(data.records):
        motion, reading, control = Motion.of(model, record), np.array(0.0), np.array(0.0)
        for kind, factor in zip(chosen, factors.tolist(), strict=True):
            for one in kind.along(motion, number):
                of_reading, of_control = one.effect(factor)
                reading, control = reading + of_reading, control + of_control
        effects[id(record)] = reading, control
    with suppress(AmbkitError):
        return maximise(data, model.replace(structures=effects), named(usual(model)))
    return None
