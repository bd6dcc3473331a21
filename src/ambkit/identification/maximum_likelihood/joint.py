"""Joint identification of coil and loop, from current and position.

In closed loop the control signal responds to the position, which depends on the current: fitted to
control signal and current only, the gain of a coil is 0.4 % too small and its lag 0.8 % too long,
ten standard errors in 60 records of a low-noise loop. The likelihood of both signals, that of the
current given its past and the control signal, times that of the position given the current, has no
such bias. Coil and loop are therefore fitted jointly (Gauss-Newton), and the errors of all
parameters include the uncertainty of both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import ConfigError
from ambkit.data.record import Record
from ambkit.data.signals import CONTROL
from ambkit.identification.maximum_likelihood.current_state import Coil, CurrentState, propagate
from ambkit.identification.maximum_likelihood.likelihood import (
    Data,
    Likelihood,
    Local,
    between_blocks,
    scores_of,
)
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import Coordinates, Parameter

ROUNDS, HALVINGS = 10, 6
"""Maximum number of steps, and of halvings of a step that does not ascend."""

ENOUGH = 0.02
"""Newton's decrement, or the gain of a step, that ends it: a seventh of a standard error. Over the
delay the likelihood has kinks at whole samples, between which it would oscillate.
"""

STEP = 1e-2
"""Steps of the differences over the coil: of logarithms and samples, and of the sensor's noise."""


@dataclass(frozen=True, eq=False)
class Joint:
    """Records with a measured current, a coil, and the loop."""

    measured: Sequence[Record]  #: With ``u``, a measured current, and ``control``.
    current: CurrentState  #: Smoothed current.
    model: LoopModel  #: Model of the loop.
    parameters: list[Parameter]  #: Its p free parameters.
    settling: float  #: Initial time of each record that does not count for the position [s].
    settled: int  #: Initial samples that do not count for the current.

    @property
    def value(self) -> float:
        """Log likelihood of both signals, for the most likely noise of the current sensor."""
        variance, count = self._variance(self._of_current(self.current.coil))
        of_position = self._likelihood(self.current).value(np.zeros(len(self.parameters)))
        return of_position - 0.5 * count * math.log(variance)

    def maximised(self) -> Joint:
        """Return coil and loop of maximum likelihood."""
        at, value = self, self.value
        for _ in range(ROUNDS):
            information, scores, known = at.slopes()
            slope = scores.sum(axis=1)
            slope[: known.size] += known
            step = np.linalg.solve(information, slope)
            if float(slope @ step) < ENOUGH:
                break
            for halved in range(HALVINGS):
                there = at.moved(step / 2**halved)
                if there is not None and (reached := there.value) > value:
                    break
            else:
                break
            gained, at, value = reached - value, there, reached
            if gained < ENOUGH:
                break
        return at

    def local(self, local: Local) -> Local:
        """Return the likelihood of the loop with an unknown coil."""
        information, scores, _ = self.slopes()
        p = len(self.parameters)
        own = np.linalg.inv(information[p:, p:])
        shared = information[:p, p:] @ own
        lost = shared @ information[p:, :p]
        left = scores[:p] - shared @ scores[p:]
        known = local.information - local.record_information
        return Local(
            local.value,
            local.score,
            local.information - lost,
            between_blocks(left, self.model.isolated) + known,
            local.record_information - lost,
        )

    def moved(self, step: Array) -> Joint | None:
        """Return coil and loop after a step; None if that is impossible."""
        # step (p + 5,)
        p = len(self.parameters)
        current = self._through(Coil.at(self.current.coil.theta + step[p:]))
        try:
            model = Coordinates(self._driven(current), self.parameters).model_at(step[:p])
        except ConfigError:
            return None
        return replace(self, current=current, model=model)

    def _through(self, coil: Coil) -> CurrentState:
        return propagate(coil, self.measured, self.current.amplifier_gain)

    def _driven(self, current: CurrentState) -> LoopModel:
        """Return a model with the deviation of another current."""
        if any(p.name == "control_noise" for p in self.parameters):
            return self.model.replace(memory=current.memory)
        return current.driving(self.model)

    def _likelihood(self, current: CurrentState) -> Likelihood:
        """Return the likelihood of the position for a current."""
        data = Data(current.records, self.settling)
        return data.likelihood(self._driven(current), self.parameters)

    def _of_current(self, coil: Coil) -> Array:
        """Return the innovations of all measured currents [V]; 0 where they do not count."""
        parts = []
        for record in self.measured:
            e = coil.predicted(record["u"], record[CONTROL])[1]
            e[: self.settled] = 0.0
            parts.append(e)
        return np.concatenate(parts)

    def _variance(self, e: Array) -> tuple[float, int]:
        """Return the variance [V^2] of the counted innovations of the current, and their number."""
        count = sum(max(len(record) - self.settled, 0) for record in self.measured)
        return float(np.sum(e**2)) / count, count

    def slopes(self) -> tuple[Array, Array, Array]:
        """Return derivatives of the likelihood of both signals, by central differences."""
        # information (q, q); scores (q, n); known (p,)
        p = len(self.parameters)
        likelihood = self._likelihood(self.current)
        e, S, by_e, by_S, used = likelihood.slopes(np.zeros(p))
        coil, zero = self.current.coil, np.zeros(p)
        i = self._of_current(coil)
        variance, _ = self._variance(i)
        control = np.concatenate([record[CONTROL] for record in self.measured])
        unit = STEP * math.sqrt(variance)
        size = np.array([STEP, STEP, unit / max(float(np.std(control)), 1e-300), unit, STEP])
        of_current, more_e, more_S = [], [], []
        for step in np.diag(size):
            length = 2 * float(step.max())
            up, down = (Coil.at(coil.theta + side * step) for side in (1, -1))
            of_current.append((self._of_current(up) - self._of_current(down)) / length)
            (e_up, S_up, _), (e_down, S_down, _) = (
                self._likelihood(self._through(beside)).innovations(zero) for beside in (up, down)
            )
            more_e.append(((e_up - e_down)[used] / length) / np.sqrt(S))
            more_S.append(((S_up - S_down)[used] / length) / S)
        by_i = np.array(of_current) / math.sqrt(variance)
        counted, information = scores_of(e, S, np.vstack([by_e, more_e]), np.vstack([by_S, more_S]))
        scores = np.zeros((len(counted), used.size))
        scores[:, used] = counted
        scores[p:] -= by_i * i / math.sqrt(variance)
        information[p:, p:] += by_i @ by_i.T
        slope, known = likelihood.priors(likelihood.coordinates.model)
        information[:p, :p] += known
        return information, scores, slope
