"""The whole controller of one axis, for ``core/include/ambkit/control.h``: flown and exported."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.errors import AmbkitError
from ambkit.machine.bank import alone_of
from ambkit.machine.hovering import hover_current
from ambkit.machine.magnets import ConstantStiffness, bias_force_of, magnet_of, own_time
from ambkit.simulation.controllers import FAR, Controllers, gains_of
from ambkit.simulation.regulator import regulator_of
from ambkit.simulation.scenario import PID
from ambkit.simulation.sequence import MOST_COUNTED, LiftOff

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.bearing import Bearing

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Controller:
    """Estimator, controller, lift-off and landing of one axis: what flies."""

    bearing: Bearing  #: What is held.
    estimator: Estimator  #: That feeds the controller, or looks after the sensor beside it.
    pid: PID  #: How it is controlled, complete.
    #: Lift-off and landing; without, it flies from the start and nobody looks after it.
    sequence: LiftOff | None = None

    def __post_init__(self) -> None:
        if not needs_states(self.pid):
            return
        roles = {state.role for state in self.estimator.states}
        for role in ("position", "velocity", "disturbance force"):
            if role not in roles:
                raise AmbkitError(
                    f"{self.estimator.name}: it has no {role} among its states, which "
                    f"{'feed_forward' if self.pid.type == 'pid' else 'an lqg'} controller needs"
                )

    @cached_property
    def law(self) -> Controllers:
        """The controllers, as those of a machine with one axis."""
        b, states = self.bearing, self.estimator.states
        limits, one, names = (b.current_min, b.current_max), np.eye(1), ("x",)
        if self.pid.feedback == "measurement":
            seen = {"position": one / b.sensor.gain}
        else:
            seen = {what: _row(states, what) for what in ("position", "velocity")}
        if self.pid.type == "lqg":
            K, ahead = regulator_of([b], self.estimator, _row(states, "position"))
            passed = [1.0, 0.0, 0.0, 0.0, 1.0, 1.0, -FAR, FAR]
            nothing = np.zeros((1, len(states)))
            fed: dict[str, Array] = {"fed_back": -K, "position": nothing, "velocity": nothing}
            return Controllers([passed], names, one, ahead, -np.ones(1), fed)
        if self.pid.feed_forward:
            k_i = ConstantStiffness.of(b).k_i
            seen["fed_back"] = -self.pid.feed_forward / k_i * _row(states, "disturbance force")
        unseen = np.array([self.pid.unseen(1.0)])
        return Controllers([gains_of(self.pid, *limits)], names, one, one, unseen, seen)

    def integral(self, current: float, x: float) -> float:
        """Return the integral with which a rotor is held at rest."""
        states = self.estimator.at_rest(x, current=current)
        states[[state.role == "disturbance force" for state in self.estimator.states]] = 0.0
        fed = states if self.pid.feedback == "estimate" else None
        return float(self.law.integrals(np.array([current]), np.array([x]), fed)[0])

    @property
    def coils(self) -> int:
        """How many coils there are: i0 + iu, and of a pair i0 - iu."""
        return 2 if self.bearing.magnet.type == "two-sided" else 1

    @property
    def down(self) -> float:
        """Where the rotor lies [m], see `lies_at`."""
        return lies_at(self.bearing)

    def held(self, x: float) -> float:
        """The current [A] that holds the rotor: in the middle, where it lies, and the line."""
        b, down = self.bearing, self.down
        law = magnet_of(b)
        balance = b.weight + bias_force_of(law, b)
        middle, lying = (hover_current(b, law, at, balance) for at in (0.0, down))
        return middle + (lying - middle) * x / down

    @property
    def fields(self) -> dict[str, Any]:
        """The fields of ``amb_control`` and of what it points to, by their names."""
        e, b = self.estimator, self.bearing
        told: dict[str, Any] = dict.fromkeys(
            (
                "reference",
                "velocity",
                "fed_back",
                "fed_back_by_speed",
                "fed_back_by_square",
                "let_turn_motion",
            )
        ) | {name: values.ravel().tolist() for name, values in self.law.feedback.items()}
        gain = b.sensor.gain
        at_zero = e.at_rest(0.0, 0.0)
        by_metre = e.at_rest(1 / gain, 1.0) - at_zero
        hold = self.integral(self.held(0.0), 0.0)
        sequence = self.sequence
        counts = {} if sequence is None else sequence.in_samples(b.sampling_time)
        return (
            told
            | counts
            | {
                "sequenced": sequence is not None,
                "feedback_estimate": self.pid.feedback == "estimate",
                "pid": self.law.pids,
                "spread": self.law.spread.ravel().tolist(),
                "iu_min": [b.current_min],
                "iu_max": [b.current_max],
                "settling": settling_of(e),
                "bound": bound_of(e),
                "std": list(e.default_std()),
                "start": at_zero.tolist(),
                "start_by": by_metre.tolist(),
                "place": _row(e.states, "position").ravel().tolist(),
                "down": [self.down],
                "hold": [hold],
                "hold_by": [self.integral(self.held(1.0), 1.0) - hold],
            }
        )

    def in_core(self, **other: Any) -> Any:
        """Return the core's controller, around the core's estimator."""
        return self.estimator.engine.core.Control(self.estimator.core, self.fields | other)

    def run(
        self, y: ArrayLike, r: ArrayLike, fly: ArrayLike, *, taken_over: float | None = None,
        other: dict[str, Any] | None = None,
    ) -> dict[str, NDArray[Any]]:  # fmt: skip
        """Run along readings from power-on, as the exported C does: to the last bit."""
        # y (n,) [m]; r (n,) [m]; fly (n,)
        number = np.dtype(self.estimator.precision).type
        position, _ = self.estimator.in_si(y, np.zeros(0))
        told: dict[str, Any] = self.in_core(**(other or {})).run(
            np.ascontiguousarray(position, number),
            np.ascontiguousarray(r, number),
            np.ascontiguousarray(fly, number),
            taken_over=None if taken_over is None else np.array([taken_over], number),
        )
        told["iu"], told["u"] = told["iu"].ravel(), told["u"].ravel()
        bias = number(self.bearing.magnet.bias_current)
        coils = [bias + told["iu"], bias - told["iu"]][: self.coils]
        return told | {"coil": np.where(told["on"][:, None] > 0, np.stack(coils, 1), number(0))}


def lies_at(bearing: Bearing) -> float:
    """Return where a rotor lies [m]: on the stop to which its weight pulls it."""
    travel = bearing.rotor.travel_limit
    return travel if bearing.weight > 0 else -travel


def needs_states(pid: PID) -> bool:
    """Say whether a controller feeds more back than position and velocity."""
    return pid.type == "lqg" or pid.feed_forward > 0


def settling_of(estimator: Estimator) -> int:
    """Return the plant's own time in samples, at least one, as many as 16 bits count."""
    alone = alone_of(estimator.bearing)
    samples = max(own_time(each) for each in alone) / alone[0].sampling_time
    return min(max(round(samples), 1), MOST_COUNTED)


def bound_of(estimator: Estimator) -> float:
    """Return how many caps a mean may be away: ten, or what an observer's transients reach."""
    far = estimator.core.own.get("far")
    if far is None:
        return 10.0
    return max(10.0, float((far / estimator.core.parameters["set"]["cap"]).max()))


def _row(states: Any, role: str) -> Array:
    """Return a row (1, n) with a one at the first state of a role, or zeros."""
    row = np.zeros((1, len(states)))
    for k, state in enumerate(states):
        if state.role == role:
            row[0, k] = 1.0
            break
    return row
