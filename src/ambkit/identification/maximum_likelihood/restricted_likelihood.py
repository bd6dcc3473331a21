"""Noises by the restricted likelihood: as if the other parameters had not been fitted.

What is fitted to a record follows part of its noise. The restricted likelihood (Patterson and
Thompson 1971; as an adjusted profile likelihood Cox and Reid 1987) takes half the logarithm of the
others' information off: its maximum over the noises is without that bias, to first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ambkit.identification.maximum_likelihood.likelihood import Likelihood, Local
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import NOISES, Coordinates, Parameter

if TYPE_CHECKING:
    from ambkit.data.record import Record


SHIFT = 0.02
"""Of the noises, in e-folds: what is known of the others changes smoothly over many of these."""

LONGEST = 0.5
"""That noises are moved at most, in e-folds: one that needs more was hardly told at all."""


def restricted(
    records: Sequence[Record],
    model: LoopModel,
    local: Local,
    parameters: list[Parameter],
    settling: float,
) -> LoopModel:
    """Return the model that the restricted likelihood prefers to the most likely one."""
    # One step of Newton's, from the maximum of the likelihood: the two maxima are much closer than
    # a standard error.
    noises = [at for at, p in enumerate(parameters) if p.name in NOISES]
    others = [at for at, p in enumerate(parameters) if p.name not in NOISES]
    if not noises or not others:
        return model
    coordinates = Coordinates(model, parameters)
    information = local.information
    among_others = np.linalg.inv(information[np.ix_(others, others)])
    slope = np.zeros(len(parameters))
    for noise in noises:
        along = np.zeros(len(parameters))
        along[noise] = SHIFT
        along[others] = -SHIFT * among_others @ information[others, noise]  # the others follow
        known = [
            _known(records, coordinates.model_at(z), [parameters[at] for at in others], settling)
            for z in (-along, along)
        ]
        slope[noise] = -0.5 * (known[1] - known[0]) / (2 * SHIFT)
    step = np.linalg.solve(information, slope)
    return coordinates.model_at(step * min(1.0, LONGEST / max(np.max(np.abs(step)), 1e-9)))


def _known(
    records: Sequence[Record], model: LoopModel, parameters: list[Parameter], settling: float
) -> float:
    """Logarithm of the determinant of the information about some parameters."""
    likelihood = Likelihood(records, Coordinates(model, parameters), settling)
    return float(np.linalg.slogdet(likelihood.local(np.zeros(len(parameters))).information)[1])
