"""Intervals by the profile of the likelihood, where its curvature at the maximum does not do.

A parameter is moved aside, and the others go to where the records are most likely then: at the ends
of the 95 % interval the log likelihood is less by 1.92 (Venzon and Moolgavkar 1988). Near a maximum
that is a parabola, and the ends are 1.96 standard errors away. Where it is not, as over a gap that
the records hardly tell, an interval by standard errors would be too short on one side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import ConfigError
from ambkit.identification.maximum_likelihood.likelihood import Likelihood, likelihood_at
from ambkit.identification.maximum_likelihood.parameters import Coordinates, Parameter
from ambkit.identification.maximum_likelihood.search import maximise

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.identification.maximum_likelihood.loop_model import LoopModel


ASIDE = 1.959964  #: Standard errors to the ends of a 95 % interval.

NEAR = 0.35
"""By which share the loss there may differ from that of a parabola, and still pass for one."""

ALIKE = 0.15
"""By which share an end may be elsewhere than 1.96 standard errors off, and still be there."""

NEARLY = 1.1  #: Of the loss at an end: where the secants stop.
FARTHEST = 50.0  #: End of an interval, in e-folds: what the records do not bound at all.
ROUNDS = 4  #: Of the secant's, each a search over all other parameters.

ENOUGH = 0.1
"""Newton's decrement that ends such a search: what is left of it is added, to second order."""


def intervals(
    records: Sequence[Record],
    model: LoopModel,
    parameters: list[Parameter],
    covariance: Array,
    larger: Array,
    settling: float,
) -> dict[str, tuple[float, float]]:
    """Return the ends of the intervals for which standard errors would not do."""
    # covariance (p, p); larger (p,)
    coordinates = Coordinates(model, parameters)
    likelihood = Likelihood(records, coordinates, settling)
    top = likelihood.value(np.zeros(len(parameters)))
    errors = np.sqrt(np.diag(covariance))
    along = covariance / errors  # column k: where all go with k, if all is quadratic

    def parabolic(at: int) -> bool:
        ends = [likelihood.value(side * ASIDE * along[:, at]) for side in (-1, 1)]
        least = 0.5 * ASIDE**2
        # More lost there than a parabola would: the others may go elsewhere yet, and lose less.
        return all(abs(top - end - least) <= NEAR * least for end in ends)

    bent = [at for at in range(len(parameters)) if not parabolic(at)]
    ends = np.outer(ASIDE * errors, [-1, 1])
    seen: list[tuple[float, LoopModel]] = []
    for at in bent:
        ends[at] = [
            _end(records, coordinates, at, side * along[:, at], top, settling, seen)
            for side in (-1, 1)
        ]
    # Where one goes far along a bend, others that seem well known go with it: what is as likely as
    # its end is within the intervals of all.
    likely = [coordinates.of(there) for lost, there in seen if lost <= NEARLY * 0.5 * ASIDE**2]
    low = np.min([ends[:, 0], *likely], axis=0) * larger
    high = np.max([ends[:, 1], *likely], axis=0) * larger
    usual = ASIDE * errors * larger
    results = {}
    for at, parameter in enumerate(parameters):
        if at not in bent and np.allclose((-low[at], high[at]), usual[at], rtol=ALIKE):
            continue
        value, step = parameter.of(model), parameter.coarse(model)
        results[parameter.name] = (
            (value * math.exp(low[at]), value * math.exp(min(high[at], FARTHEST)))
            if parameter.positive
            else (value + step * float(low[at]), value + step * float(high[at]))
        )
    return results


def _end(
    records: Sequence[Record],
    coordinates: Coordinates,
    at: int,
    along: Array,
    top: float,
    settling: float,
    seen: list[tuple[float, LoopModel]],
) -> float:
    """Return how far one coordinate goes until the profile has lost what 95 % may; by secants."""
    # Over the root of the loss a parabola is a line, and few steps suffice. Each search for the
    # others begins where they would be if all were quadratic, a standard error `along`. What is
    # lost, and where, is added to `seen`.
    parameter = coordinates.parameters[at]
    rest = [p for p in coordinates.parameters if p is not parameter]
    error, model, there = float(along[at]), coordinates.model, 0.0
    far = ASIDE * error
    past: tuple[float, float] = (0.0, 0.0)
    for _ in range(ROUNDS):
        try:
            moved = Coordinates(model, coordinates.parameters).model_at(
                along * ((far - there) / error)
            )
            maximised = maximise(records, moved, rest, settling, ENOUGH) if rest else None
        except (ConfigError, OverflowError):  # no bearing can be there: the interval ends before
            far = 0.5 * (past[0] + far)
            continue
        if maximised is None:
            value = likelihood_at(records, moved, settling)
        else:
            model, there = maximised.model, far
            value = maximised.local.value + 0.5 * maximised.local.left
        seen.append((top - value, moved if maximised is None else model))
        root = math.sqrt(2 * max(top - value, 0.0))
        if abs(0.5 * root**2 - 0.5 * ASIDE**2) < (NEARLY - 1) * 0.5 * ASIDE**2:
            break
        slope = (far - past[0]) / (root - past[1]) if root > past[1] else 2 * far / ASIDE
        past = (far, root)
        far = math.copysign(min(abs(far + slope * (ASIDE - root)), 3 * abs(far)), error)
    return far
