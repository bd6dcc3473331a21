"""What the filter's finite steps bias, taken off.

The paper's discretisation lets the rotor's position at the start of a step pull throughout it
(eq. 15, 16). The error falls with the step: half as long ones move the estimates by half of it, and
as far again is where endless short ones would lead (Richardson 1911). It is nothing where noise is
large; on a quiet rig a sensor's lag would come out too long by a fifth of a step, many standard
errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ambkit.identification.maximum_likelihood.likelihood import Likelihood
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import Coordinates, Parameter

if TYPE_CHECKING:
    from ambkit.record import Record

MATTERS = 0.5
"""Standard errors of bias from which on the model keeps the shorter steps, too."""


def without_step_bias(
    records: Sequence[Record], model: LoopModel, parameters: list[Parameter], settling: float
) -> LoopModel:
    """Return the model that endless short steps of the filter would have found.

    Parameters
    ----------
    records : sequence of Record
        With ``y`` [m] and ``u`` [V].
    model : LoopModel
        Found with its `substeps`.
    parameters : list of Parameter
        What was found. The delay stays: over it the likelihood has an edge at each step.
    settling : float
        Time at the start of each record that does not count [s].
    """
    smooth = [p for p in parameters if p.name != "delay"]
    if not smooth:
        return model
    zero = np.zeros(len(smooth))
    finer = model.replace(substeps=2 * model.substeps)
    coarse, fine = (
        Likelihood(records, Coordinates(m, smooth), settling).local(zero) for m in (model, finer)
    )
    shift = 2 * np.linalg.solve(fine.information, fine.score - coarse.score)
    errors = np.sqrt(np.diag(np.linalg.inv(fine.information)))
    kept = finer if np.any(np.abs(shift) > MATTERS * errors) else model
    return Coordinates(kept, smooth).model_at(np.asarray(shift))
