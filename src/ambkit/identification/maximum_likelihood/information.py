"""Fisher information, profile and restricted likelihood: the uncertainty of parameters.

With a correct model the innovations e of a Kalman filter are white, with the expected variance S,
and no unbiased estimate scatters less than the inverse of the information (Cramer and Rao; for
predictions in closed loop Ljung, System Identification, 1999, ch. 7 and 13). A simulated record
therefore predicts how accurately the real one would identify.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import ConfigError
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.likelihood import Data, Likelihood, Local
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import (
    ALIKE,
    DESCRIBED,
    NOISES,
    Coordinates,
    Parameter,
    identifiable,
    named,
    priors_of,
    uncertain,
)
from ambkit.identification.maximum_likelihood.result import CONFIDENCE
from ambkit.identification.maximum_likelihood.search import LONGEST_STEP, maximise
from ambkit.machine.magnets import own_time

NEAR = 0.35
"""Relative difference of the loss from a parabola that is acceptable."""

SAME_END = 0.15
"""Relative distance of an end from 1.96 standard errors that is acceptable."""

NEARLY = 1.1  #: Tolerance of the loss at an end of the interval.
FARTHEST = 50.0  #: Maximum end of an interval, in e-folds: not bounded by the records.
ROUNDS = 6  #: Secant steps, each a search over all other parameters.

ENOUGH = 0.1
"""Newton's decrement that ends such a search: the remaining loss is added, to second order."""


def intervals(
    data: Data, model: LoopModel, parameters: list[Parameter], covariance: Array, larger: Array
) -> dict[str, tuple[float, float]]:
    """Return the ends of the intervals for which standard errors are insufficient."""
    # covariance (p, p); larger (p,)
    likelihood = data.likelihood(model, parameters)
    top = likelihood.value(np.zeros(len(parameters)))
    errors, least = np.sqrt(np.diag(covariance)), 0.5 * CONFIDENCE**2
    along = covariance / errors  # column k: displacement of all along k for a quadratic likelihood

    def parabolic(at: int) -> bool:
        ends = [likelihood.value(side * CONFIDENCE * along[:, at]) for side in (-1, 1)]
        # A larger loss than for a parabola: the other parameters may reduce it.
        return all(abs(top - end - least) <= NEAR * least for end in ends)

    bent = [at for at in range(len(parameters)) if not parabolic(at)]
    ends = np.outer(CONFIDENCE * errors, [-1, 1])
    seen: list[tuple[float, LoopModel]] = []
    for at in bent:
        ends[at] = [_end(likelihood, at, side * along[:, at], top, seen) for side in (-1, 1)]
    # Along a bend others move too: points as likely as the ends are within the intervals of all.
    likely = [likelihood.coordinates.of(there) for lost, there in seen if lost <= NEARLY * least]
    low = np.min([ends[:, 0], *likely], axis=0) * larger
    high = np.max([ends[:, 1], *likely], axis=0) * larger
    usual = CONFIDENCE * errors * larger
    results = {}
    for at, parameter in enumerate(parameters):
        if at not in bent and np.allclose((-low[at], high[at]), usual[at], rtol=SAME_END):
            continue
        value, step = parameter.of(model), parameter.coarse(model)
        results[parameter.name] = (
            (value * math.exp(low[at]), value * math.exp(min(high[at], FARTHEST)))
            if parameter.positive
            else (value + step * float(low[at]), value + step * float(high[at]))
        )
    return results


def _end(
    likelihood: Likelihood, at: int, along: Array, top: float, seen: list[tuple[float, LoopModel]]
) -> float:
    """Return the end of one coordinate at which the profile has lost the 95 % limit; by secants."""
    # The root of the loss is linear for a parabola, and distance over root nearly linear in the
    # distance, so that few secants suffice; if it is too steep, no distance may be enough. Each
    # search over the others starts on the parabola that leaves the maximum like a standard error
    # `along` and goes through the last end. Losses and their places are appended to `seen`.
    data, coordinates = likelihood.data, likelihood.coordinates
    parameter = coordinates.parameters[at]
    rest = [p for p in coordinates.parameters if p is not parameter]
    error, tangent = float(along[at]), along / along[at]
    far, past, ratio, ended, bend = CONFIDENCE * error, 0.0, error, 0 * along, 0 * along
    for _ in range(ROUNDS):
        step = tangent * far + bend * far**2 - ended
        far = past + (far - past) * min(1.0, LONGEST_STEP / np.max(np.abs(step)))
        try:
            begin = coordinates.model_at(tangent * far + bend * far**2)
            maximised = maximise(data, begin, rest, ENOUGH)
        except (ConfigError, OverflowError):  # impossible parameters: the interval ends before
            far = 0.5 * (past + far)
            continue
        ended = coordinates.of(maximised.model)
        bend = (ended - tangent * far) / far**2
        seen.append((top - maximised.value, maximised.model))
        root = math.sqrt(2 * max(top - maximised.value, 1e-9))
        if abs(0.5 * root**2 - 0.5 * CONFIDENCE**2) < (NEARLY - 1) * 0.5 * CONFIDENCE**2:
            break
        slope = (far / root - ratio) / (far - past)
        past, ratio = far, far / root
        left = 1 - CONFIDENCE * slope
        end = abs(CONFIDENCE * (ratio - slope * past) / left) if left > 0 else math.inf
        far = math.copysign(min(end, 3 * abs(past)), error)
    return far


SHIFT = 0.02
"""Step of the noises, in e-folds: the others' information is smooth over many of these."""

LONGEST = 0.5
"""Maximum change of a noise, in e-folds: beyond it was hardly identifiable."""


def restricted(
    data: Data, model: LoopModel, local: Local, parameters: list[Parameter]
) -> LoopModel:
    """Return the model of maximum restricted likelihood."""
    # One Newton step from the maximum of the likelihood: the two maxima are much closer than a
    # standard error.
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
            _known(data, coordinates.model_at(z), [parameters[at] for at in others])
            for z in (-along, along)
        ]
        slope[noise] = -0.5 * (known[1] - known[0]) / (2 * SHIFT)
    step = np.linalg.solve(information, slope)
    return coordinates.model_at(step * min(1.0, LONGEST / max(np.max(np.abs(step)), 1e-9)))


def _known(data: Data, model: LoopModel, parameters: list[Parameter]) -> float:
    """Return the logarithm of the determinant of the information on some parameters."""
    return float(np.linalg.slogdet(data.local(model, parameters, rough=True).information)[1])


LEAST_EIGENVALUE = 1e-5
"""Eigenvalue of the scaled information below which parameters are indistinguishable."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """Expected information of a record on p parameters, if its model is right."""

    model: LoopModel  #: Assumed model.
    parameters: list[Parameter]  #: Identifiable parameters.
    errors: Array  #: (p,) Least standard error of each while all are unknown, SI.
    correlation: Array  #: (p, p) Of the estimates.
    held: Mapping[str, str]  #: Unidentifiable parameters, with reasons.
    #: ``ln det(1 + information)`` over all requested parameters, each in the scale of its search:
    #: the objective of a design (D-optimality). Half of it is the number of e-folds by which the
    #: record reduces the uncertainty.
    certainty: float
    #: (p, n) Derivative of each measurement's innovation by each parameter, in standard deviations
    #: of the innovation per SI unit; zero for measurements that do not count.
    sensitivity: Array

    def __getitem__(self, name: str) -> float:
        """Return the standard error of a parameter [SI]; infinite if it is unidentifiable."""
        for at, parameter in enumerate(self.parameters):
            if parameter.name == name:
                return float(self.errors[at])
        return np.inf

    def to_dict(self) -> dict[str, Any]:
        """Return everything besides the parameters and their errors as plain data."""
        return {
            "parameters": {p.name: {"unit": p.unit} for p in self.parameters},
            "correlation": self.correlation.tolist(),
            "held": dict(self.held),
            "certainty": self.certainty,
        }


def expect(record: Record, model: LoopModel, free: Sequence[str]) -> Expectation:
    """Return the expected accuracy of parameters from a record of the model."""
    # Priors, and parameters held one by one, are those of `maximum_likelihood`.
    parameters, held = identifiable(named(free), model)
    model = model.replace(known=priors_of(model, [p.name for p in parameters]))
    likelihood = Data([record], own_time(model.isolated)).likelihood(model, parameters)
    slopes = likelihood.slopes(np.zeros(len(parameters)))
    everything, (_, _, by_e, _, used) = likelihood.of_slopes(model, slopes), slopes
    _, certainty = np.linalg.slogdet(np.eye(len(parameters)) + everything.record_information)

    kept, left_out = list(range(len(parameters))), dict[int, float]()
    while True:
        information = everything.beside(kept, left_out).information
        worst = weakly_identified(information, [parameters[at] for at in kept], model)
        if worst is None:
            break
        parameter, why = worst
        held[parameter.name] = why
        kept.remove(parameters.index(parameter))
        for one in uncertain([parameter]):
            left_out[parameters.index(one)] = 1 / one.range(model) ** 2
    kept_parameters = [parameters[at] for at in kept]
    unit = np.array([(p.of(model) if p.positive else p.coarse(model)) for p in kept_parameters])
    covariance = np.linalg.inv(information) * np.outer(unit, unit)
    errors = np.sqrt(np.diag(covariance))
    sensitivity = np.zeros((len(kept), used.size))
    sensitivity[:, used] = by_e[kept] / unit[:, None]
    return Expectation(
        model, kept_parameters, errors, covariance / np.outer(errors, errors), held,
        float(certainty), sensitivity,
    )  # fmt: skip


def correlated(information: Array) -> list[int]:
    """Return the indices of indistinguishable parameters; empty if there are none."""
    root = np.sqrt(np.maximum(np.diag(information), 1e-300))
    eigenvalues, vectors = np.linalg.eigh(information / np.outer(root, root))
    if eigenvalues[0] >= LEAST_EIGENVALUE:
        return []
    return [i for i in range(root.size) if abs(vectors[i, 0]) > 0.25]


def weakly_identified(
    information: Array, parameters: Sequence[Parameter], model: LoopModel
) -> tuple[Parameter, str] | None:
    """Return a parameter that records do not determine, with the reason; None if there is none."""
    # information (p, p), with the priors. A parameter of the log with a prior is kept, however
    # little the records say of it; of one of the machine they must say more than its description.
    of_log = np.array([p.name in model.known and p.name not in DESCRIBED for p in parameters])
    prior = np.array([float(p.name in model.known and p.name in DESCRIBED) for p in parameters])
    plausible = np.array([p.range(model) for p in parameters])
    root = np.sqrt(np.diag(information)) * plausible
    for at in reversed(np.flatnonzero(~of_log).tolist()):
        if not root[at] ** 2 > 1.0 + prior[at]:  # even with all others known
            return parameters[at], "the records do not depend on it"
    if not parameters:
        return None
    alike = correlated(information)
    if alike:
        names = " and ".join(parameters[i].name for i in alike)
        return parameters[alike[-1]], f"{names} {ALIKE}"
    errors = np.sqrt(np.diag(np.linalg.inv(information)) * (1.0 + prior)) / plausible
    errors[of_log] = 0.0
    worst = int(np.argmax(errors))
    if errors[worst] > 1.0:
        return parameters[worst], "its standard error exceeds its plausible range"
    return None
