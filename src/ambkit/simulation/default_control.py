"""The default controllers of a machine that turns, chosen on the margins over its speed range."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.estimate.kalman import KalmanFilter
from ambkit.machine.rotors.whirl import end_of_range
from ambkit.models.linear import LinearSystem, Signal
from ambkit.simulation.controllers import Control, Controllers, controllers_of
from ambkit.simulation.gains import two_digits, weight_of
from ambkit.simulation.holding import ENOUGH
from ambkit.simulation.holding_margins import shown_along_axes
from ambkit.simulation.linear.closed import Loop
from ambkit.simulation.linear.control import compensator, controllers, fed
from ambkit.simulation.linear.pieces import WorkPoint, plant
from ambkit.simulation.linear.settled import estimator_at
from ambkit.simulation.plant import Plant
from ambkit.simulation.scenario import GAINS, PID

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.machine import Machine
    from ambkit.simulation.flight import Flight

Array = NDArray[np.float64]
Feedback = Literal["measurement", "estimate"]

FACTOR = 1.5
"""The measurement feeds the controllers while their peak of abs(S) is at most so many times that of
the linear-quadratic regulator, which needs an estimate."""
AS_GOOD = 1.1
"""Where no peak is at most `ENOUGH`, the simplest is taken whose peak is within this factor of the
lowest."""
SPEEDS = 9
"""Speeds of rotation at which loops are looked at, from rest to the machine's own."""
IN_ORDER = ("kp", "ki", "kd", "derivative_filter", "anti_windup", "setpoint_weight")
"""Of a PID as it flies, in their order."""
LOWEST, GRID, NEAR = 1e-4, 200, np.linspace(-4, 4, 25)
"""Of the frequencies: start as a share of the range, count, and places about each pole, in its
rate of decay: beside a zero the peak of one that is hardly damped is not at its own frequency."""

LEAST = math.exp(-1)
"""Of the poles in z about which a peak is looked for."""

PIDS = Control(type="decentralised"), Control(type="translation and tilt")
CROSSED = tuple(each.model_copy(update={"cross_feedback": 0.5}) for each in PIDS)
REGULATORS = Control(type="lqg"), Control(type="lqg", gain_scheduling=True)
INTEGRAL = (0.5, 0.25, 0.1)
"""Shares of the integral gains that are tried: an integral excites the precession, which is the
slower the faster a rotor turns."""
PROPORTIONAL, DERIVATIVE, FILTER = (1.0, 0.7), (1.0, 1.5, 2.0), (1.0, 0.5, 0.25)
"""Shares of the other gains and of the derivative filter, tried with each of these."""
ERRORS = (0.1, 0.05, 0.02, 0.01)
"""Errors of the polar inertia that a regulator is tried with."""


class Tried(NamedTuple):
    """A structure of controllers, and what it comes to over the speed range."""

    control: Control  #: The structure.
    feedback: Feedback  #: What feeds it.
    peak: float  #: Greatest of abs(S) of an axis with all others closed [1]; infinite: unstable.
    speed: float  #: Where that is, or a speed at which it is unstable [rad/s].
    #: Of a regulator, error of the polar inertia with which its peak is at most twice as high [1].
    bears: float = math.inf

    def __str__(self) -> str:
        worst = f"peak {self.peak:.3g}" if self.stable else "unstable"
        return f"{name_of(self.control)} ({worst})"

    @property
    def stable(self) -> bool:
        """Whether it holds the rotor at each speed."""
        return math.isfinite(self.peak)


@dataclass(frozen=True)
class DefaultControl:
    """The default controllers of a machine."""

    machine: str  #: Its name.
    fastest: float  #: Its speed of rotation [rad/s].
    #: What is flown; where nothing that was tried holds the rotor, decentralised control.
    chosen: Tried
    #: All that was looked at, in turn; empty of a machine that does not turn.
    tried: tuple[Tried, ...] = ()

    @property
    def held(self) -> bool:
        """Whether the rotor is held over the speed range, as far as that was looked at."""
        return not self.tried or self.chosen.stable

    @property
    def why(self) -> str:
        """What was chosen and its peak, or that nothing was found and what was tried."""
        span = f"from 0 to {_rpm(self.fastest)}"
        if not self.tried:
            return f"default controller: {name_of(self.chosen.control)}"
        if self.held:
            others = [each for each in self.tried if each is not self.chosen]
            beside = f"; also tried{_listed(others)}" if others else ""
            return (
                f"default controller: {name_of(self.chosen.control)}, fed by the "
                f"{self.chosen.feedback}, with a peak of |S| of {self.chosen.peak:.3g} {span}"
                f"{self._bears}{beside}"
            )
        return (
            f"no default controller was found that holds the rotor of {self.machine} {span}; "
            f"tried{_listed(self.tried)}; lower the speed, the dead time or the "
            "sampling time, or give another controller in [control]"
        )

    @property
    def _bears(self) -> str:
        error = self.chosen.bears
        if error >= ERRORS[0]:
            return ""
        known = f"within {100 * error:g} %" if error else f"to better than {100 * ERRORS[-1]:g} %"
        return f" if the polar inertia is known {known}"


def _listed(tried: Iterable[Tried]) -> str:
    """Return what was tried, by what fed it."""
    groups = itertools.groupby(tried, key=lambda each: each.feedback)
    each = (f", fed by the {fed_by}: {', '.join(map(str, of))}" for fed_by, of in groups)
    return ";".join(each).replace(";,", ";")


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


def default_control(machine: Machine, feedback: Feedback | None = None) -> DefaultControl:
    """Return the controllers that a machine has where nothing else is given."""
    # A machine that does not turn has decentralised PIDs. Of one that turns the structures are
    # tried in turn, from simple to linear-quadratic, on the peak of abs(S) of its worst axis with
    # all others closed, from rest to its speed, gyroscopics, dead time and the linear Kalman filter
    # with its default noise in the loop: the first whose peak is at most `ENOUGH`, or the simplest
    # within a factor `AS_GOOD` of the lowest.
    if not machine.speed:
        fed_by = feedback or "measurement"
        return DefaultControl(machine.name, 0.0, Tried(PIDS[0], fed_by, math.nan, 0.0))
    return _chosen(machine.model_copy(update={"unbalance": ()}), feedback)


def is_default(control: Control) -> bool:
    """Whether the structure of controllers is left to be chosen."""
    return control.type is None and not control.pid and not control.cross_feedback


def settled(machine: Machine, control: Control, feedback: Feedback | None) -> Control:
    """Return controllers with their type, chosen where it is not given; held or not."""
    if control.type is not None:
        return control
    if not is_default(control):
        return control.model_copy(update={"type": "decentralised"})
    chosen = default_control(machine, feedback).chosen.control
    keys = ("type", "cross_feedback", "gain_scheduling", "pid")
    return control.model_copy(update={key: getattr(chosen, key) for key in keys})


def feedback_of(machine: Machine, flight: Flight) -> Feedback:
    """Return what feeds the controllers of a flight, chosen where it is not given."""
    control = flight.control
    if flight.feedback is not None:
        return flight.feedback
    if not is_default(control) or control.needs_estimate:
        return "measurement"
    return default_control(machine).chosen.feedback


def settled_flight(machine: Machine, flight: Flight) -> Flight:
    """Return a flight with controllers and feedback chosen where they are not given."""
    feedback = feedback_of(machine, flight)
    control = settled(machine, flight.control, feedback)
    if is_default(flight.control):
        found = default_control(machine, flight.feedback)
        if not found.held:
            raise AmbkitError(found.why)
    return flight.model_copy(update={"control": control, "feedback": feedback})


@lru_cache(maxsize=64)
def _chosen(machine: Machine, feedback: Feedback | None) -> DefaultControl:
    try:
        loops = _Loops(machine)
    except AmbkitError:  # nothing holds the rotor in the middle
        nothing = Tried(PIDS[0], feedback or "measurement", math.nan, 0.0)
        return DefaultControl(machine.name, machine.speed, nothing)
    found: list[Tried] = []
    if feedback != "estimate":
        found = loops.in_turn("measurement")
        best = _simplest(found)
        bound = math.inf
        if feedback is None and not best.peak <= ENOUGH:
            lowest = min(loops.peaks(each, "estimate").peak for each in REGULATORS)
            if not math.isfinite(lowest):
                lowest = min(each.peak for each in loops.in_turn("estimate"))
            bound = FACTOR * lowest
        if feedback is not None or (best.peak <= max(ENOUGH, bound) and best.stable):
            return DefaultControl(machine.name, machine.speed, best, tuple(found))
    others = loops.in_turn("estimate")
    found += others
    best = _simplest(others if any(each.stable for each in others) else found)
    return DefaultControl(machine.name, machine.speed, best, tuple(found))


def _simplest(tried: Iterable[Tried]) -> Tried:
    """Return the first that is as good as the best; of those that hold nothing the first."""
    found = list(tried)
    lowest = min(each.peak for each in found)
    return next(each for each in found if each.peak <= max(ENOUGH, AS_GOOD * lowest))


class _Loops:
    """A machine's loops at speeds from rest to its own."""

    def __init__(self, machine: Machine) -> None:
        self.plant, self.machine = Plant(machine), machine
        point = WorkPoint.of_machine(machine)
        speeds = np.linspace(0.0, machine.speed, SPEEDS)
        self.at = [_AtSpeed(machine, point, float(speed)) for speed in speeds]
        self._known: dict[tuple[Control, Feedback], Tried] = {}

    @cached_property
    def estimator(self) -> KalmanFilter:
        """That feeds the controllers: the linear one, with its default noise."""
        return KalmanFilter(self.machine)

    def in_turn(self, feedback: Feedback) -> list[Tried]:
        """Return what was tried up to the first whose peak is at most `ENOUGH`."""
        found = []
        for each in self._structures(feedback):
            found.append(each)
            if each.peak <= ENOUGH:
                break
        return found

    def _structures(self, feedback: Feedback) -> Iterator[Tried]:
        """Yield what is tried, from simple to linear-quadratic."""
        yield from (self.peaks(control, feedback) for control in PIDS)
        yield from (self._tuned(control, feedback) for control in PIDS)
        if feedback == "estimate":
            yield from (self.peaks(control, feedback) for control in (*CROSSED, *REGULATORS))

    def _tuned(self, control: Control, feedback: Feedback) -> Tried:
        """Return the PIDs with the greatest integral gain whose peak is at most `ENOUGH`."""
        # Or of the lowest peak. Only those are changed that the gyroscopics act on.
        filters = FILTER if feedback == "measurement" else FILTER[:1]
        best = Tried(control.model_copy(update={"pid": self._usual(control)}), feedback, math.inf,
                     self.machine.speed)  # fmt: skip
        usual = self._usual(control)
        of_axes = {
            axis.name: b for axis, b in zip(self.machine.axes, self.plant.alone, strict=True)
        }
        for integral in INTEGRAL:
            for p, d, f in itertools.product(PROPORTIONAL, DERIVATIVE, filters):
                pids = {
                    name: _changed(pid, of_axes.get(name), (p, integral * p, d, f))
                    for name, pid in usual.items() if self._turns(control, name)
                }  # fmt: skip
                tried = control.model_copy(update={"pid": usual | pids})
                found = self._peaks(tried, feedback, best.peak)
                best = found if found.peak < best.peak else best
            if best.peak <= ENOUGH:
                break
        return best

    def _usual(self, control: Control) -> dict[str, PID]:
        """Return the PIDs that are tuned to axes or coordinates alone."""
        if control.type == "decentralised":
            each = zip(self.machine.axes, map(PID.for_bearing, self.plant.alone), strict=True)
            return {
                axis.name: PID(**{key: getattr(pid, key) for key in GAINS}) for axis, pid in each
            }
        flown = controllers_of(self.plant, control, None)
        gains = zip(flown.names, flown.pids, strict=True)
        return {
            name: PID.model_validate(dict(zip(IN_ORDER, pid, strict=False))) for name, pid in gains
        }

    def _turns(self, control: Control, name: str) -> bool:
        """Whether gyroscopics act on an axis or a coordinate."""
        if control.type != "decentralised":
            return name.startswith("th")
        return any(
            axis.name == name and axis.bearing.type == "radial" for axis in self.machine.axes
        )

    def peaks(self, control: Control, feedback: Feedback) -> Tried:
        """Return what controllers come to over the speeds."""
        key = control, feedback
        if key not in self._known:
            self._known[key] = self._peaks(control, feedback)
        return self._known[key]

    def _peaks(self, control: Control, feedback: Feedback, least: float = math.inf) -> Tried:
        """Return what controllers come to; infinite where the peak is not below the least."""
        highest, where, bears = 0.0, 0.0, math.inf
        try:
            estimator = self.estimator if feedback == "estimate" else None
            flown = controllers_of(self.plant, control, estimator)
            for at in reversed(self.at):
                peak = at.peak(flown, feedback)
                if peak > highest:
                    highest, where = peak, at.machine.speed
                if peak >= least:
                    return Tried(control, feedback, math.inf, where)
            if control.type == "lqg":
                bears = self._bears(flown, highest)
        except (AmbkitError, ValueError):  # no regulator, no gain, or too many states for a filter
            return Tried(control, feedback, math.inf, self.machine.speed)
        return Tried(control, feedback, highest, where, bears)

    def _bears(self, flown: Controllers, peak: float) -> float:
        """Return with which error of the polar inertia the peak is at most twice as high [1]."""
        last, speed = self.at[-1], self.machine.speed
        for error in ERRORS:
            # A rotor of another polar inertia turns as one of another speed.
            others = [last.plant_at(speed * (1 + way * error)) for way in (-1, 1)]
            if all(last.peak(flown, "estimate", other) <= 2 * peak for other in others):
                return error
        return 0.0


class _AtSpeed:
    """A machine's loops at one speed."""

    def __init__(self, machine: Machine, point: WorkPoint, speed: float) -> None:
        self.machine, self.point = machine.model_copy(update={"speed": speed}), point
        self.system = plant(self.machine, point)
        self.shown = shown_along_axes(machine)
        self.added = np.asarray(np.linalg.pinv(self.shown))

    @cached_property
    def estimate(self) -> LinearSystem:
        """The Kalman filter, which shows all of its states."""
        estimator = KalmanFilter(self.machine)
        states = [Signal(state.name, state.unit) for state in estimator.states]
        return estimator_at(estimator, self.point, (np.eye(len(states)), states))

    def plant_at(self, speed: float) -> LinearSystem:
        """Return the plant with the gyroscopics of another speed."""
        return plant(self.machine.model_copy(update={"speed": speed}), self.point)

    def peak(
        self, flown: Controllers, feedback: Feedback, system: LinearSystem | None = None
    ) -> float:
        """Return the peak of abs(S) of the worst axis [1]; infinite where it is unstable."""
        system = self.system if system is None else system
        control = controllers(flown, self.machine, measured=feedback == "measurement")
        shown, inner = flown.of_axes @ self.shown, None
        if feedback == "estimate":
            E = self.estimate
            rows = fed(flown, len(E.outputs), self.machine.speed)
            outputs = control.inputs[: len(rows)]
            inner = replace(E, C=rows @ E.C, D=rows @ E.D, outputs=outputs)
        m = len(self.machine.readings)
        K = compensator(control, inner, shown, system.outputs[:m])
        loop = Loop(system, K, m, self.shown, self.added)
        return _highest(loop, end_of_range(loop.T, self.machine.speed))


def _highest(loop: Loop, top: float) -> float:
    """Return the peak of abs(S) of the axes up to a frequency [Hz], by the closed loop's poles."""
    closed, m = loop.closed, loop.measurements
    poles, V = np.linalg.eig(closed.A)
    if not (np.abs(poles) < 1).all():
        return math.inf
    of: Any = loop.shown
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


def _changed(pid: PID, alone: Bearing | None, shares: tuple[float, ...]) -> PID:
    """Return a PID with shares of kp, ki, kd and derivative filter; of an axis its weight too."""
    keys = ("kp", "ki", "kd", "derivative_filter")
    gains = {
        key: two_digits(share * getattr(pid, key)) for key, share in zip(keys, shares, strict=True)
    }
    if alone is not None:
        weight = weight_of(alone, gains["kp"], gains["ki"], gains["kd"])
        gains["setpoint_weight"] = two_digits(weight)
    return PID.model_validate(gains | {"anti_windup": pid.anti_windup})


def _rpm(speed: float) -> str:
    return f"{abs(speed) * 30 / math.pi:,.0f} rpm"
