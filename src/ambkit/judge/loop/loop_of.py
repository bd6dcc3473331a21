"""A bearing or a machine with its controllers, and the linear loop that a filter makes of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.estimate.base import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.view import View
from ambkit.judge.loop.bounds import least_peaks
from ambkit.judge.loop.demands import Turned, of_runout, of_unbalance
from ambkit.judge.loop.hinf import beside_each_other, hinf
from ambkit.judge.loop.lqg import LQG, Noise
from ambkit.judge.loop.margins import grid, highest
from ambkit.machine.bank import alone_of
from ambkit.machine.bearing import Bearing
from ambkit.machine.machine import Machine
from ambkit.machine.placed import Unbalance
from ambkit.machine.rotors.whirl import end_of_range
from ambkit.models.linear import LinearSystem, Signal
from ambkit.models.model import Array
from ambkit.simulation.control import Controller, needs_states
from ambkit.simulation.controllers import Control, Controllers, controllers_of, pids_of
from ambkit.simulation.default_control import (
    default_control,
    is_default,
    settled,
)
from ambkit.simulation.linear.closed import Loop
from ambkit.simulation.linear.control import compensator, controllers, fed
from ambkit.simulation.linear.control import controller as controller_of
from ambkit.simulation.linear.pieces import WorkPoint, plant
from ambkit.simulation.linear.settled import estimator_at, tells
from ambkit.simulation.plant import Plant
from ambkit.simulation.scenario import PID

ZONES = (("A", 3.0), ("B", 4.0), ("C", 5.0))
"""Zones of ISO 14839-3, and the peaks of abs(S) below which they are; D is beyond."""

ZONE_A = ZONES[0][1]
"""Peak of abs(S) at which zone A ends."""

PROMPT = 1e-12
"""Lag of an ideal sensor [s]: what is shorter than models tell from none."""

COARSE = 500
"""Points of a grid that finds a peak, where nothing else is asked."""


class OutOfReachError(AmbkitError):
    """A filter cannot be held to a ceiling on the peak of the sensitivity."""


def zone_of(peak: float) -> str:
    """Return the zone of a peak of abs(S) [1], A to D; ``"unstable"`` of an infinite one."""
    if math.isinf(peak):
        return "unstable"
    return next((name for name, limit in ZONES if peak < limit), "D")


def ideal_pieces(bearing: Bearing | Machine) -> dict[str, Any]:
    """Return a bearing or a machine with one piece of its loop ideal, by the piece's name."""
    found: dict[str, Any] = {}

    def fast(amplifier: Any) -> Any:
        return amplifier.model_copy(update={"bandwidth": None, "voltage_limit": None})

    def prompt(sensor: Any) -> Any:
        return sensor.model_copy(update={"lag": PROMPT})

    if isinstance(bearing, Machine):
        placed = bearing.bearing
        if any(each.amplifier.bandwidth for each in placed):
            ideal = [at.model_copy(update={"amplifier": fast(at.amplifier)}) for at in placed]
            found["amplifier"] = bearing.model_copy(update={"bearing": tuple(ideal)})
        if any(each.lag for each in bearing.sensor):
            sensors = tuple(prompt(each) for each in bearing.sensor)
            found["sensor"] = bearing.model_copy(update={"sensor": sensors})
    else:
        if bearing.amplifier.bandwidth:
            found["amplifier"] = bearing.model_copy(update={"amplifier": fast(bearing.amplifier)})
        if bearing.sensor.lag:
            found["sensor"] = bearing.model_copy(update={"sensor": prompt(bearing.sensor)})
    if bearing.delay:
        found["delay"] = bearing.model_copy(update={"delay": None})
    return found


class LoopOf:
    """The loop of a bearing or a machine at a work point, with one filter or another."""

    def __init__(
        self,
        bearing: Bearing | Machine,
        controller: PID | Sequence[PID] | Control | None = None,
        x: float = 0.0,
        load: Any = None,
        *,
        point: WorkPoint | None = None,
        flown: Controllers | None = None,
    ) -> None:
        self.bearing: Any = bearing
        self.machine = bearing if isinstance(bearing, Machine) else None
        self.alone = alone_of(bearing)
        self.control = controller if isinstance(controller, Control) else Control()
        if controller is not None and not isinstance(controller, Control):
            self.control = Control(type="decentralised")
        if isinstance(controller, Control) and self.machine is None:
            raise AmbkitError(
                f"{bearing.name} is a bearing of one axis: its controller is a PID, and "
                f'"{controller.type}" is of whole machines'
            )
        self._given = None if isinstance(controller, Control) else controller
        self._flown = flown
        self.axes: tuple[str, ...] = ("x",)
        self.added: Array | None = None
        if isinstance(bearing, Machine):
            self.point = point or WorkPoint.of_machine(bearing, load)
            whole = View(bearing)
            self.shown = whole.H @ whole.shown
            self.added = np.asarray(np.linalg.pinv(self.shown), float)
            self.axes = tuple(axis.name for axis in bearing.axes)
        else:
            self.point = point or WorkPoint.hovering(bearing, x, load or 0.0)
            self.shown = np.array([[1 / bearing.sensor.gain]])
        self.plant = plant(bearing, self.point)
        self.top = end_of_range(bearing.sampling_time, bearing.speed)

    def turned(self, loop: Loop) -> list[Turned]:
        """Return what turns with the rotor in a stable loop: runout, and unbalance or the orbit."""
        found = of_runout(loop, self.bearing)
        if self.point.orbit is not None:
            found.append(Turned(self.point.orbit.x, self.point.orbit.demanded))
        elif self.machine is not None and self.machine.speed and self.machine.unbalance:
            found.append(of_unbalance(loop, self.machine, self.point))
        return found

    def least(self) -> tuple[float, float]:
        """Return the peaks of S and T that no controller can be below [1]; see `least_peaks`."""
        p, m = len(self.alone), len(self.shown[0])
        u, y = ([at.name for at in of] for of in (self.plant.inputs[:p], self.plant.outputs[:m]))
        from_u = self.plant.select(y, u)
        names = tuple(Signal(axis, "m") for axis in self.axes)
        return least_peaks(
            replace(from_u, C=self.shown @ from_u.C, D=self.shown @ from_u.D, outputs=names)
        )

    @property
    def needs_estimate(self) -> bool:
        """Whether the controllers cannot be fed by the measurement."""
        if self.machine is None:
            return needs_states(self.fed_by(None)[0])
        return self.control.needs_estimate

    def control_for(self, estimator: Any) -> Control:
        """Return how the machine is controlled, the default for what feeds it where not given."""
        if self.machine is None:
            return self.control
        return settled(self.machine, self.control, "estimate" if estimator else "measurement")

    def choice(self, estimator: Any) -> str | None:
        """Return what default controllers were chosen for what feeds them, in a sentence."""
        machine = self.machine
        if machine is None or not machine.speed or self._flown or not is_default(self.control):
            return None
        return default_control(machine, "estimate" if estimator else "measurement").summary

    def fed_by(self, estimator: Any) -> list[PID]:
        """Return the PIDs of the axes as an estimator feeds them or, None, the measurement."""
        feedback: Literal["measurement", "estimate"] = "estimate" if estimator else "measurement"
        given = self._given
        if given is None and self.machine is not None:
            found = pids_of(self.machine, self.control_for(estimator), feedback)
        else:
            each = given if isinstance(given, Sequence) else [given or PID()] * len(self.alone)
            found = [pid.completed(b) for pid, b in zip(each, self.alone, strict=True)]
        return [one.model_copy(update={"feedback": feedback}) for one in found]

    def flown_by(self, estimator: Estimator | None, fastest: float | None = None) -> Controllers:
        """Return the controllers as they fly, fed by an estimator or the measurement."""
        if self._flown is not None:
            return self._flown
        if self.machine is None:
            if estimator is None:
                raise AmbkitError(f"{self.bearing.name}: its controller is fed by an estimate")
            return Controller(self.bearing, estimator, self.fed_by(estimator)[0]).law
        control = self.control_for(estimator)
        pids = self.fed_by(estimator) if control.type == "decentralised" else None
        return controllers_of(Plant(self.machine), control, estimator, pids, fastest)

    def plain(self, estimator: Estimator | None) -> str | None:
        """Return a sentence where unbalance control is plain control at the machine's speed."""
        if self.machine is None or self.control.unbalance == "fought":
            return None
        turn = self.flown_by(estimator).let_turn
        if turn is None:
            return None
        speed = self.machine.speed
        return turn.for_unbalance_of(self.machine).sentence(self.control.unbalance, speed, speed)

    def pids(self, estimator: Estimator | None = None) -> dict[str, PID]:
        """Return the PIDs by what each is of: an axis, or a coordinate of the rotor."""
        # None of a regulator.
        if self.machine is None:
            return dict(zip(self.axes, self.fed_by(estimator), strict=True))
        if self.control_for(estimator).type == "lqg":
            return {}
        found = self.flown_by(estimator)
        return {
            name: PID(kp=kp, ki=ki, kd=kd, derivative_filter=T_f, anti_windup=aw, setpoint_weight=b)
            for name, (kp, ki, kd, T_f, aw, b, *_) in zip(found.names, found.pids, strict=True)
        }

    def with_plant(self, plant: Bearing | Machine, estimator: Estimator | None) -> LoopOf:
        """Return the same controllers, as an estimator feeds them, with another plant."""
        if self.machine is None:
            return LoopOf(plant, self.fed_by(estimator), point=self.point)
        control = self.control_for(estimator)
        return LoopOf(plant, control, point=self.point, flown=self.flown_by(estimator))

    def at(self, point: WorkPoint) -> LoopOf:
        """Return the same loop at another work point."""
        moved = copy(self)
        moved.point, moved.plant = point, plant(self.bearing, point)
        return moved

    def with_unbalance(self, scale: float) -> LoopOf:
        """Return the same loop of a machine whose unbalance is larger by a factor."""
        assert self.machine is not None
        planes = tuple(
            Unbalance(place=place, amount=scale * amount, angle=angle)
            for place, amount, angle in self.machine.unbalances()
        )
        moved = copy(self)
        moved.bearing = moved.machine = self.machine.model_copy(update={"unbalance": planes})
        return moved

    def loop(self, estimator: Estimator | None = None) -> Loop:
        """Return the loop whose controllers are fed by an estimator, or by the measurement."""
        m = len(self.shown[0])
        pid = None if self.machine is not None else self.fed_by(estimator)[0]
        if pid is not None and not needs_states(pid):
            inner = None if estimator is None else estimator_at(estimator, self.point)
            control, shown = controller_of(pid, self.bearing), self.shown
        else:
            inner, control, shown = self._by_states(estimator)
        K = compensator(control, inner, shown, self.plant.outputs[:m])
        return Loop(self.plant, K, m, *self._summing())

    def _by_states(
        self, estimator: Estimator | None
    ) -> tuple[LinearSystem | None, LinearSystem, Array]:
        """Return estimator, controllers, and what these look at by the readings (q, m)."""
        flown = self.flown_by(estimator)
        control = controllers(flown, self.bearing, measured=estimator is None)
        shown = flown.of_axes @ self.shown
        if estimator is None:
            return None, control, shown
        if self.machine is not None and flown.let_turn is not None:
            flown = replace(flown, let_turn=flown.let_turn.for_unbalance_of(self.machine))
        rows = fed(flown, len(estimator.states), self.bearing.speed or 0.0)
        return (
            estimator_at(estimator, self.point, (rows, control.inputs[: len(rows)])),
            control,
            shown,
        )

    def static_compliance(self, estimator: Estimator | None = None) -> float | None:
        """Return the greatest deflection by a load at rest, if there were no integral [m/N]."""
        # None where the loop would be unstable then, and of a regulator, which has none.
        if self.needs_estimate or self.control_for(estimator).type == "lqg":
            return None
        if self.machine is None:
            pids = [pid.model_copy(update={"ki": 0.0}) for pid in self.pids().values()]
            loop = LoopOf(self.bearing, pids, point=self.point).loop()
        else:
            flown = self.flown_by(estimator)
            without = [[kp, 0.0, *rest] for kp, _ki, *rest in flown.pids]
            flown = replace(flown, pids=without)
            loop = LoopOf(self.machine, self.control, point=self.point, flown=flown).loop(estimator)
        if not loop.is_stable:
            return None
        return float(np.abs(np.diagonal(loop.compliance([0.0])[0])).max())

    def lqg(self) -> Loop:
        """Return the loop of the linear-quadratic-Gaussian controller that needs least control."""
        # It has state and loads from a Kalman filter of this very plant, told of the noise of
        # sensors and amplifiers and the usual growth of the loads.
        told = KalmanFilter(self.bearing).variances
        sensors, amplifiers = self.noise()
        noise = Noise(sensors, amplifiers, told.disturbance)
        K = LQG(self.plant, noise).compensator()
        return Loop(self.plant, K, len(sensors), *self._summing())

    def hinf(self) -> Loop:
        """Return the loop of H-infinity controllers, of each axis one for the axis alone."""
        each = []
        for b in self.alone:
            of = self if self.machine is None else LoopOf(b)
            found = hinf(of.plant.select(["y"], ["u"]))
            gain = b.sensor.gain  # it is fed by the position
            each.append(replace(found, B=gain * found.B, D=gain * found.D))
        names = [] if self.machine is None else list(self.axes)
        K = beside_each_other(each, self.shown, names)
        K = replace(K, inputs=(*self.plant.outputs[: len(self.shown[0])], *K.inputs[-len(each) :]))
        return Loop(self.plant, K, len(self.shown[0]), *self._summing())

    def noise(self) -> tuple[list[float], list[float]]:
        """Return the variances of the measurements [m^2] and of the control signals [V^2]."""
        if self.machine is None:
            sensors = [self.bearing.sensor]
        else:
            sensors = [r.sensor for r in self.machine.readings]
        return (
            [each.noise_variance for each in sensors],
            [b.amplifier.noise_variance for b in self.alone],
        )

    def _summing(self) -> tuple[Array | None, Array | None]:
        """Return how axes are seen and shaken by the measurements; of one axis as they are."""
        return (None, None) if self.added is None else (self.shown, self.added)

    def peak(self, estimator: Estimator | None = None) -> float:
        """Return the peak of abs(S) within the standard's range [1]."""
        # Infinite where the loop is unstable or the estimator has no gain that it could be told of.
        try:
            loop = self.loop(estimator)
        except AmbkitError:
            return math.inf
        if not loop.is_stable:
            return math.inf
        f = grid(loop, COARSE)
        within = np.append(f[f < self.top], self.top)
        return max(highest(partial(loop.of_axis, k), within)[0] for k in range(loop.axes))

    def check(self, estimator: Estimator, ceiling: float) -> None:
        """Refuse a ceiling on the peak of abs(S) that this filter cannot be held to."""
        if not tells(estimator):
            raise OutOfReachError(
                f"{estimator.name}: it does not settle to a gain, so that no peak of the "
                "sensitivity can be asked of it"
            )
        least = self.least()[0]
        if not (math.isfinite(ceiling) and ceiling > least):
            raise OutOfReachError(
                f"max_sensitivity must be above {least:.4g}, below which no linear controller "
                f"brings the peak of |S| of {self.bearing.name}; is {ceiling:g}"
            )
