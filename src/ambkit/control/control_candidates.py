"""Candidates for the controllers of a machine that turns, and their margins over its speeds."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.control.controllers import Controllers, controllers_of
from ambkit.control.held_loop import Gains
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_controller import compensator, controllers, fed
from ambkit.control.linear.linear_plant import OperatingPoint, plant
from ambkit.control.linear.steady_state_filter import estimator_at
from ambkit.control.pid import GAINS, PID
from ambkit.control.stabilising_controller import ENOUGH, round_to_two_digits, weight_of
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.machine_model import View
from ambkit.machine.machine import Machine
from ambkit.machine.rotors.modes import max_frequency
from ambkit.models.linear import LinearSystem, Signal
from ambkit.models.plant import Plant

Feedback = Literal["measurement", "estimate"]

SPEEDS = 9  #: Speeds of rotation at which loops are looked at, from rest to the fastest.
LOWEST, GRID, NEAR = 1e-4, 200, np.linspace(-4, 4, 25)
"""Of the frequencies: start as a share of the range, count, and places about each pole, in its
rate of decay: beside a zero the peak of one that is hardly damped is not at its own frequency."""

LEAST = math.exp(-1)  #: Of the poles in z about which a peak is looked for.

PIDS = Control(type="decentralised"), Control(type="translation and tilt")
CROSSED = tuple(item.model_copy(update={"cross_feedback": 0.5}) for item in PIDS)
REGULATORS = Control(type="lqg"), Control(type="lqg", gain_scheduling=True)
INTEGRAL = (0.5, 0.25, 0.1)
"""Shares of the integral gains: an integral excites the precession, slow at high speed."""
PROPORTIONAL, DERIVATIVE, FILTER = (1.0, 0.7), (1.0, 1.5, 2.0), (1.0, 0.5, 0.25)
"""Shares of the other gains and of the derivative filter, tried with each of these."""
ERRORS = (0.1, 0.05, 0.02, 0.01)  #: Errors of the polar inertia that a regulator is tried with.


class Candidate(NamedTuple):
    """A structure of controllers, and its margins over the speed range."""

    control: Control  #: The structure.
    feedback: Feedback  #: What feeds it.
    peak: float  #: Greatest of abs(S) of an axis with all others closed [1]; infinite: unstable.
    speed: float  #: Where that is, or a speed at which it is unstable [rad/s].
    inertia_error: float = math.inf  #: Of lqg: error that doubles the peak [1].

    def __str__(self) -> str:
        worst = f"peak {self.peak:.3g}" if self.stable else "unstable"
        return f"{name_of(self.control)} ({worst})"

    @property
    def stable(self) -> bool:
        """Whether it holds the rotor at each speed."""
        return math.isfinite(self.peak)


def name_of(control: Control) -> str:
    """Return what controllers of a kind are called."""
    names = {None: "default", "decentralised": "decentralised PID", "lqg": "linear-quadratic"}
    name = names.get(control.type, str(control.type))
    if control.gain_scheduling:
        return f"{name} with gain scheduling"
    if control.pid:
        name += " tuned over the speed range"
    share = control.cross_feedback
    return f"{name} with cross feedback {share:g}" if share else name


class Candidates:
    """Controllers of a machine, and its loops with them at speeds from rest to the fastest."""

    def __init__(self, machine: Machine, max_speed: float) -> None:
        self.plant, self.machine = Plant(machine), machine
        self.fastest = math.copysign(max_speed, machine.speed)  # the way that the machine turns
        point = OperatingPoint.of_machine(machine)
        speeds = np.linspace(0.0, self.fastest, SPEEDS)
        self.at = [_AtSpeed(machine, point, float(speed)) for speed in speeds]
        self._known: dict[tuple[Control, Feedback], Candidate] = {}

    @cached_property
    def estimator(self) -> KalmanFilter:
        """That feeds the controllers: the linear one, with its default noise."""
        return KalmanFilter(self.machine)

    def in_turn(self, feedback: Feedback) -> list[Candidate]:
        """Return the candidates up to the first whose peak is at most `ENOUGH`."""
        results = []
        for structure in self._structures(feedback):
            results.append(structure)
            if structure.peak <= ENOUGH:
                break
        return results

    def _structures(self, feedback: Feedback) -> Iterator[Candidate]:
        """Yield all candidates, from simple to linear-quadratic."""
        yield from (self.peaks(control, feedback) for control in PIDS)
        yield from (self._tuned(control, feedback) for control in PIDS)
        if feedback == "estimate":  # gains are scheduled up to the machine's own speed
            regulators = REGULATORS if self.machine.speed else REGULATORS[:1]
            yield from (self.peaks(control, feedback) for control in (*CROSSED, *regulators))

    def _tuned(self, control: Control, feedback: Feedback) -> Candidate:
        """Return the PIDs with the greatest integral gain whose peak is at most `ENOUGH`."""
        # Or of the lowest peak. Only those are changed that the gyroscopics act on.
        filters = FILTER if feedback == "measurement" else FILTER[:1]
        usual = self._usual(control)
        full_control = control.model_copy(update={"pid": usual})
        best = Candidate(full_control, feedback, math.inf, self.fastest)
        of_axes = {
            axis.name: b for axis, b in zip(self.machine.axes, self.plant.isolated, strict=True)
        }
        for integral in INTEGRAL:
            for p, d, f in itertools.product(PROPORTIONAL, DERIVATIVE, filters):
                pids = {
                    name: _changed(pid, of_axes.get(name), (p, integral * p, d, f))
                    for name, pid in usual.items() if self._turns(control, name)
                }  # fmt: skip
                changed = control.model_copy(update={"pid": usual | pids})
                result = self._peaks(changed, feedback, best.peak)
                best = result if result.peak < best.peak else best
            if best.peak <= ENOUGH:
                break
        return best

    def _usual(self, control: Control) -> dict[str, PID]:
        """Return the PIDs that are tuned to axes or coordinates alone."""
        if control.type == "decentralised":
            parts = zip(self.machine.axes, map(PID.for_bearing, self.plant.isolated), strict=True)
            return {a.name: PID(**{key: getattr(pid, key) for key in GAINS}) for a, pid in parts}
        control_law = controllers_of(self.plant, control, None)
        gains = zip(control_law.names, control_law.pids, strict=True)
        return {
            name: PID.model_validate(dict(zip(Gains._fields, pid, strict=False)))
            for name, pid in gains
        }

    def _turns(self, control: Control, name: str) -> bool:
        """Whether gyroscopics act on an axis or a coordinate."""
        if control.type != "decentralised":
            return name.startswith("th")
        return any(a.name == name and a.bearing.type == "radial" for a in self.machine.axes)

    def peaks(self, control: Control, feedback: Feedback) -> Candidate:
        """Return the margins of controllers over the speeds."""
        key = control, feedback
        if key not in self._known:
            self._known[key] = self._peaks(control, feedback)
        return self._known[key]

    def _peaks(self, control: Control, feedback: Feedback, least: float = math.inf) -> Candidate:
        """Return the margins of controllers; infinite where the peak is not below the least."""
        highest, where, error = 0.0, 0.0, math.inf
        try:
            estimator = self.estimator if feedback == "estimate" else None
            control_law = controllers_of(self.plant, control, estimator)
            system = controllers(control_law, self.machine, measured=estimator is None)
            for at in reversed(self.at):
                peak = at.peak(control_law, system)
                if peak > highest:
                    highest, where = peak, at.machine.speed
                if peak >= least:
                    return Candidate(control, feedback, math.inf, where)
            if control.type == "lqg":
                error = self._inertia_error(control_law, system, highest)
        except (AmbkitError, ValueError):  # no regulator, no gain, or too many states for a filter
            return Candidate(control, feedback, math.inf, self.fastest)
        return Candidate(control, feedback, highest, where, error)

    def _inertia_error(self, control_law: Controllers, system: LinearSystem, peak: float) -> float:
        """Return with which error of the polar inertia the peak is at most twice as high [1]."""
        last, speed = self.at[-1], self.fastest
        for error in ERRORS:
            # A rotor of another polar inertia turns as one of another speed.
            speeds = ({"speed": speed * (1 + way * error)} for way in (-1, 1))
            others = [plant(last.machine.model_copy(update=at), last.point) for at in speeds]
            if all(last.peak(control_law, system, other) <= 2 * peak for other in others):
                return error
        return 0.0


class _AtSpeed:
    """A machine's loops at one speed."""

    def __init__(self, machine: Machine, point: OperatingPoint, speed: float) -> None:
        self.machine, self.point = machine.model_copy(update={"speed": speed}), point
        self.system = plant(self.machine, point)
        self.measured = View(machine).measured
        self.added = np.asarray(np.linalg.pinv(self.measured))

    @cached_property
    def estimate(self) -> LinearSystem:
        """The Kalman filter, which shows all of its states."""
        estimator = KalmanFilter(self.machine)
        states = [Signal(state.name, state.unit) for state in estimator.states]
        return estimator_at(estimator, self.point, (np.eye(len(states)), states))

    def peak(
        self, control_law: Controllers, control: LinearSystem, system: LinearSystem | None = None
    ) -> float:
        """Return the peak of abs(S) of the worst axis [1]; infinite where it is unstable."""
        system, inner = self.system if system is None else system, None
        if control_law.feedback:
            E = self.estimate
            rows = fed(control_law, len(E.outputs), self.machine.speed)
            outputs = control.inputs[: len(rows)]
            inner = replace(E, C=rows @ E.C, D=rows @ E.D, outputs=outputs)
        m = len(self.machine.readings)
        K = compensator(control, inner, control_law.measured, system.outputs[:m])
        loop = Loop(system, K, m, self.measured, self.added)
        return highest_sensitivity(loop, max_frequency(loop.T, self.machine.speed))


def highest_sensitivity(loop: Loop, top: float) -> float:
    """Return the peak of abs(S) of the axes up to a frequency [Hz], by the closed loop's poles."""
    closed, m = loop.closed, loop.measurements
    poles, V = np.linalg.eig(closed.A)
    if not (np.abs(poles) < 1).all():
        return math.inf
    of: Any = loop.measured
    to: Any = loop.added
    residues = (of @ closed.C[:m] @ V) * np.linalg.solve(V, closed.B[:, :m] @ to).T
    through = np.diag(of @ (np.eye(m) + closed.D[:m, :m]) @ to)
    rates = np.log(poles[(np.abs(poles) > LEAST) & (poles.imag >= 0)]) / (2 * np.pi * loop.T)
    about = rates.imag[:, None] + np.abs(rates.real)[:, None] * NEAR
    f = np.concatenate([np.geomspace(LOWEST * top, top, GRID), about.ravel()])
    f = np.unique(np.clip(f, LOWEST * top, top))
    z = np.exp(2j * np.pi * loop.T * f)
    S = through[:, None] + residues @ (1 / (z - poles[:, None]))
    return float(np.abs(S).max())


def _changed(pid: PID, isolated: Machine | None, shares: tuple[float, ...]) -> PID:
    """Return a PID with shares of kp, ki, kd and derivative filter; of an axis its weight too."""
    keys = ("kp", "ki", "kd", "derivative_filter")
    gains = {
        key: round_to_two_digits(share * getattr(pid, key))
        for key, share in zip(keys, shares, strict=True)
    }
    if isolated is not None:
        weight = weight_of(isolated, gains["kp"], gains["ki"], gains["kd"])
        gains["setpoint_weight"] = round_to_two_digits(weight)
    return PID.model_validate(gains | {"anti_windup": pid.anti_windup})
