"""Likelihood of records under a model, with score and information.

Innovations e with variances S give ``ln p = -1/2 sum(ln 2 pi S + e^2/S)`` (Schweppe 1965).
Predictions depend on the past only, for any controller, so the maximum is unbiased in closed loop
too (Ljung 1999, ch. 13).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from ambkit.base.arrays import Array, Bools
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.loop_model import (
    Filter,
    Innovations,
    LoopModel,
    innovations,
)
from ambkit.identification.maximum_likelihood.parameters import Coordinates, Parameter, log_prior
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import own_time

BLOCK = 20
"""Block length in time constants of the plant: half a second of a rig with 25 ms."""

FEWEST_BLOCKS = 30  #: Minimum number of blocks for a scatter; short records have shorter blocks.
#: Step of the differences, in the coordinates of the search: the error is quadratic in it.
STEP = 1e-4


Slopes = tuple[Array, Array, Array, Array, Bools]
"""Innovations [m], variances [m^2], derivatives of both, normalised, and which samples count."""


@dataclass(frozen=True, eq=False)
class Local:
    """Likelihood at one point of the search, with p coordinates."""

    value: float  #: Log likelihood, including priors.
    score: Array  #: (p,) Its gradient.
    #: (p, p) Fisher's information along the records, ``sum(e' e'^T / S + S' S'^T / (2 S^2))`` with
    #: the derivatives of innovation and variance (Gupta and Mehra 1974): the expected second
    #: derivatives, never indefinite. Includes priors.
    information: Array
    #: (p, p) Covariance of the scores, summed over blocks of `BLOCK` time constants of the plant,
    #: so that correlations within one are included (White 1982 for the form, Liang and Zeger 1986
    #: for the blocks). Equal to the information if the model is right.
    scatter: Array
    record_information: Array  #: (p, p) The information of the records alone.

    def beside(self, kept: Sequence[int], held: Mapping[int, float]) -> Local:
        """Return the likelihood of some parameters, with precisions of those that are held."""
        # A held parameter is not known: the errors of the others include that of its coarse range.
        coarse = np.diag([held.get(at, 0.0) for at in range(self.score.size)])
        information, scatter = self.information + coarse, self.scatter + coarse
        free = np.eye(self.score.size)[kept]
        rest = list(held)
        among = information[np.ix_(rest, kept)]
        free[:, rest] = -np.linalg.solve(information[np.ix_(rest, rest)], among).T
        return Local(
            self.value,
            self.score[kept],
            free @ information[:, kept],
            free @ scatter @ free.T,
            free @ self.record_information[:, kept],
        )

    @property
    def held(self) -> Array:
        """Information (p, p), with a weak prior of ten coarse errors for the undetermined."""
        return np.asarray(self.information + 0.01 * np.eye(self.score.size))

    @property
    def left(self) -> float:
        """Newton's decrement: the squared distance to the maximum in standard errors."""
        return float(self.score @ np.linalg.solve(self.held, self.score))


@dataclass(frozen=True, eq=False)
class Data:
    """Records of a fit."""

    records: Sequence[Record]
    settling: float  #: Initial time of each record that does not count [s].

    def likelihood(self, model: LoopModel, parameters: Sequence[Parameter]) -> Likelihood:
        """Return the likelihood in the coordinates around a model."""
        return Likelihood(self, Coordinates(model, list(parameters)))

    def log_likelihood(self, model: LoopModel) -> float:
        """Return the log likelihood of a model; minus infinity if no measurement counts."""
        return self.likelihood(model, []).value(np.zeros(0))

    def local(
        self, model: LoopModel, parameters: Sequence[Parameter], *, rough: bool = False
    ) -> Local:
        """Return value, score and information at a model."""
        return self.likelihood(model, parameters).local(np.zeros(len(parameters)), rough=rough)


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Log likelihood of records as a function of the coordinates of a search."""

    data: Data
    coordinates: Coordinates
    #: Innovations where `value` was last evaluated, reused by slopes.
    latest: dict[bytes, Innovations] = field(default_factory=dict)

    def innovations(self, z: Array) -> Innovations:
        """Return innovations [m], variances [m^2] and whether they count, of all records."""
        return self.latest.get(z.tobytes()) or self._of([self._filter(z)])[0]

    def _filter(self, z: Array, near: tuple[Array, Filter] | None = None) -> Filter:
        """Return the filter at z, shared with a nearby one if they are equal."""
        if near is None:
            model = self.coordinates.model_at(z)
            return model, model.kalman()
        at, (other, kalman) = near
        model = self.coordinates.model_at(z, (at, other))
        return model, kalman if model.has_filter_of(other) else model.kalman()

    def _of(self, filters: Sequence[Filter]) -> list[Innovations]:
        """The innovations of several models."""
        parts = []
        for record in self.data.records:
            parts.append(innovations(filters, record))
            for _, _, used in parts[-1]:
                used[: max(1, round(self.data.settling / record.sampling_time))] = False
        joined = (
            [np.concatenate(c) for c in zip(*own, strict=True)] for own in zip(*parts, strict=True)
        )
        return [(e, S, used) for e, S, used in joined]

    def value(self, z: Array) -> float:
        """Return the log likelihood; minus infinity for a contradictory model."""
        try:
            model, kalman = self._filter(z)
            e, S, used = self._of([(model, kalman)])[0]
        except (ConfigError, ValueError, OverflowError):
            return -math.inf
        self.latest.clear()
        self.latest[z.tobytes()] = e, S, used
        if not used.any():
            return -math.inf
        return _log_likelihood(e[used], S[used]) + log_prior(model)

    def slopes(self, z: Array, *, rough: bool = False) -> Slopes:
        """Return derivatives of the innovations, by central or roughly by one-sided differences."""
        # z (p,); e (n,) [m]; S (n,) [m^2]; by_e (p, n); by_S (p, n)
        steps, near = STEP * np.eye(z.size), (z, self._filter(z))
        aside = [self._beside(near, step, *([-step] if rough else [])) for step in steps]
        aside += [] if rough else [self._beside(near, -step) for step in steps]
        e, S, used = here = self.innovations(z)
        if not used.any():
            raise AmbkitError("the filter could take in no measurement: do bearing and record fit?")
        beside = self._of([kalman for kalman, _ in aside])
        sides = [(*run, length) for run, (_, length) in zip(beside, aside, strict=True)]
        sides += [(*here, 0.0)] * (2 * z.size - len(sides))
        slopes_e, slopes_S = [], []
        for (e_up, S_up, up, above), (e_down, S_down, down, below) in zip(
            sides[: z.size], sides[z.size :], strict=True
        ):
            used = used & up & down
            slopes_e.append((e_up - e_down) / (above - below or STEP))
            slopes_S.append((S_up - S_down) / (above - below or STEP))
        e, S = e[used], S[used]
        by_e = np.array([slope[used] for slope in slopes_e]).reshape(z.size, S.size) / np.sqrt(S)
        by_S = np.array([slope[used] for slope in slopes_S]).reshape(z.size, S.size) / S
        return e, S, by_e, by_S, used

    def _beside(self, near: tuple[Array, Filter], *steps: Array) -> tuple[Filter, float]:
        """Return the filter of the first possible step aside, and its length."""
        for step in steps:
            with suppress(ConfigError):
                return self._filter(near[0] + step, near), float(step.sum())
        return near[1], 0.0

    def local(self, z: Array, *, rough: bool = False) -> Local:
        """Return value, score and information, by differences of the innovations, see `slopes`."""
        return self.of_slopes(self.coordinates.model_at(z), self.slopes(z, rough=rough))

    def of_slopes(self, model: LoopModel, slopes: Slopes) -> Local:
        """Return value, score and information at a model, of the derivatives there."""
        e, S, by_e, by_S, _ = slopes
        scores, information = scores_of(e, S, by_e, by_S)
        slope, known = self.priors(model)
        return Local(
            _log_likelihood(e, S) + log_prior(model),
            scores.sum(axis=1) + slope,
            information + known,
            between_blocks(scores, model.isolated) + known,
            information,
        )

    def priors(self, model: LoopModel) -> tuple[Array, Array]:
        """Return score (p,) and information (p, p) of the priors."""
        unit = self.coordinates.unit_steps()
        slope, precision = np.zeros(unit.size), np.zeros(unit.size)
        for at, parameter in enumerate(self.coordinates.parameters):
            if parameter.name in model.known:
                value, std = model.known[parameter.name]
                step = (value if parameter.positive else unit[at]) / std
                slope[at], precision[at] = -step * parameter.from_prior(model), step**2
        return slope, np.diag(precision)


def scores_of(e: Array, S: Array, by_e: Array, by_S: Array) -> tuple[Array, Array]:
    """Return scores (p, n) and information (p, p) of the derivatives of the innovations."""
    r = e / np.sqrt(S)
    return -(by_e * r + 0.5 * by_S * (1 - r**2)), by_e @ by_e.T + 0.5 * by_S @ by_S.T


def _log_likelihood(e: Array, S: Array) -> float:
    return float(-0.5 * np.sum(np.log(2 * np.pi * S) + e**2 / S))


def between_blocks(scores: Array, machine: Machine) -> Array:
    """Return the covariance (p, p) of the sum of scores (p, n), by blocks of `BLOCK`."""
    n = scores.shape[1]
    length = round(BLOCK * own_time(machine) / machine.sampling_time)
    blocks = max(FEWEST_BLOCKS, n // max(length, 1))
    edges = np.linspace(0, n, min(blocks, n) + 1).astype(int)[:-1]
    sums = np.add.reduceat(scores, edges, axis=1)
    return np.asarray(sums @ sums.T)
