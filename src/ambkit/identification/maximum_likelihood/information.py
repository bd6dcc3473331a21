"""How surely a record would tell parameters, known before any search: their Fisher information.

Where a Kalman filter's model is right, its innovations e are white, with the variance S that it
expects, and no unbiased estimate scatters less than the inverse of the information says (Cramer and
Rao; for predictions in closed loop Ljung, System Identification, 1999, ch. 7 and 13). So a record
that was only simulated tells how well the real one would identify.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.likelihood import Likelihood, settling_time
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import (
    ALIKE,
    Coordinates,
    Parameter,
    identifiable,
    named,
)

LEAST_EIGENVALUE = 1e-5
"""Of the information, scaled to a diagonal of ones: below it, some parameters look like others."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """What a record would tell about p parameters, if its model is right."""

    model: LoopModel  #: The model that the record was taken to come from.
    parameters: list[Parameter]  #: What the record tells.
    errors: Array  #: (p,) Least standard error of each while all are unknown, SI.
    correlation: Array  #: (p, p) Of the estimates.
    held: Mapping[str, str]  #: Parameters that were asked for and cannot be told, with the reason.
    #: ``ln det(1 + information)`` over all that were asked for, each in the scale of its search:
    #: what a design is to make large (D-optimality). Half of it is by how many e-fold steps the
    #: record narrows down what is unknown.
    certainty: float
    #: (p, n) How each measurement's innovation moves with each parameter, in standard deviations of
    #: the innovation by SI; zero where a measurement does not count.
    sensitivity: Array

    def __getitem__(self, name: str) -> float:
        """Return the standard error of a parameter [SI]; infinite where it cannot be told."""
        for at, parameter in enumerate(self.parameters):
            if parameter.name == name:
                return float(self.errors[at])
        return np.inf

    def to_dict(self) -> dict[str, Any]:
        """Return what is beside the parameters and their errors as plain data."""
        return {
            "parameters": {p.name: {"unit": p.unit} for p in self.parameters},
            "correlation": self.correlation.tolist(),
            "held": dict(self.held),
            "certainty": self.certainty,
        }


def expect(
    record: Record, model: LoopModel, free: Sequence[str], *, settling: float | None = None
) -> Expectation:
    """Say how surely a record would tell parameters of the model that it comes from."""
    # Parameters that cannot be told are held one by one, as `maximum_likelihood` does.
    parameters, held = identifiable(named(free), model)
    if settling is None:
        settling = settling_time(model.bearing)
    coordinates = Coordinates(model, parameters)
    likelihood = Likelihood([record], coordinates, settling)
    _, _, by_e, by_S, used = likelihood.slopes(np.zeros(len(parameters)))
    information = by_e @ by_e.T + 0.5 * by_S @ by_S.T
    _, certainty = np.linalg.slogdet(np.eye(len(parameters)) + information)

    indices = list(range(len(parameters)))
    while indices:
        worst = weakly_identified(
            information[np.ix_(indices, indices)], [parameters[at] for at in indices]
        )
        if worst is None:
            break
        parameter, why = worst
        held[parameter.name] = why
        indices = [at for at in indices if parameters[at] is not parameter]
    kept_parameters = [parameters[at] for at in indices]
    unit = np.array([(p.of(model) if p.positive else p.coarse(model)) for p in kept_parameters])
    covariance = np.linalg.inv(information[np.ix_(indices, indices)]) * np.outer(unit, unit)
    errors = np.sqrt(np.diag(covariance))
    sensitivity = np.zeros((len(kept_parameters), used.size))
    sensitivity[:, used] = by_e[indices] / unit[:, None]
    return Expectation(
        model, kept_parameters, errors, covariance / np.outer(errors, errors), held,
        float(certainty), sensitivity,
    )  # fmt: skip


def correlated(information: Array) -> list[int]:
    """Places of parameters that the records cannot tell apart; empty where they can."""
    root = np.sqrt(np.maximum(np.diag(information), 1e-300))
    eigenvalues, vectors = np.linalg.eigh(information / np.outer(root, root))
    if eigenvalues[0] >= LEAST_EIGENVALUE:
        return []
    return [i for i in range(root.size) if abs(vectors[i, 0]) > 0.25]


def weakly_identified(
    information: Array, parameters: Sequence[Parameter]
) -> tuple[Parameter, str] | None:
    """Name a parameter that records do not tell, and why; None where they tell all."""
    # information (p, p)
    root = np.sqrt(np.diag(information))
    for at in reversed(range(root.size)):
        if not root[at] > 1.0:  # alone, with all others known, its error would be its coarse one
            return parameters[at], "the records do not depend on it"
    alike = correlated(information)
    if alike:
        names = " and ".join(parameters[i].name for i in alike)
        return parameters[alike[-1]], f"{names} {ALIKE}"
    errors = np.sqrt(np.diag(np.linalg.inv(information)))
    worst = int(np.argmax(errors))
    if errors[worst] > 1.0:
        return parameters[worst], "its error is as large as all that it could be"
    return None
