"""A machine with its controllers, and the linear loop that a filter makes of them."""

from __future__ import annotations

import math
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
from ambkit.machine.machine import Machine
from ambkit.machine.placed import Unbalance
from ambkit.machine.rotors.whirl import end_of_range
from ambkit.models.linear import LinearSystem, Signal
from ambkit.models.model import Array
from ambkit.simulation.controllers import Controllers, controllers_of, pids_of
from ambkit.simulation.default_control import (
    default_control,
    is_default,
    settled,
)
from ambkit.simulation.linear.closed import Loop
from ambkit.simulation.linear.control import compensator, controllers, fed
from ambkit.simulation.linear.pieces import WorkPoint, plant
from ambkit.simulation.linear.settled import estimator_at, tells
from ambkit.simulation.plant import Plant
from ambkit.simulation.scenario import PID, Control, as_control

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


def ideal_pieces(machine: Machine) -> dict[str, Machine]:
    """Return a machine with one piece of its loop ideal, by the piece's name."""
    found: dict[str, Machine] = {}

    def fast(amplifier: Any) -> Any:
        return amplifier.model_copy(update={"bandwidth": None, "voltage_limit": None})

    def prompt(sensor: Any) -> Any:
        return sensor.model_copy(update={"lag": PROMPT})

    if any(each.amplifier.bandwidth for each in machine.bearings):
        ideal = [at.model_copy(update={"amplifier": fast(at.amplifier)}) for at in machine.bearings]
        found["amplifier"] = machine.model_copy(update={"bearing": tuple(ideal)})
    if any(each.lag for each in machine.sensors):
        sensors = tuple(prompt(each) for each in machine.sensors)
        found["sensor"] = machine.model_copy(update={"sensor": sensors})
    if machine.delay:
        found["delay"] = machine.model_copy(update={"delay": None})
    return found


class LoopOf:
    """The loop of a machine at a work point, with one filter or another."""

    def __init__(
        self,
        bearing: Machine,
        controller: PID | None = None,
        x: float = 0.0,
        load: Any = None,
        *,
        point: WorkPoint | None = None,
        flown: Controllers | None = None,
    ) -> None:
        self.machine = bearing.long
        self.alone = alone_of(self.machine)
        self.control = Control() if controller is None else as_control(controller)
        self._flown = flown
        self.axes = tuple(axis.name or "x" for axis in self.machine.axes)
        self.point = point or WorkPoint.of_machine(self.machine, load, x)
        view = View(self.machine)
        self.shown = view.H @ view.shown
        self.added = np.asarray(np.linalg.pinv(self.shown), float)
        self.plant = plant(self.machine, self.point)
        self.top = end_of_range(self.machine.sampling_time, self.machine.speed)

    def turned(self, loop: Loop) -> list[Turned]:
        """Return what turns with the rotor in a stable loop: runout, and unbalance or the orbit."""
        found = of_runout(loop, self.machine)
        if self.point.orbit is not None:
            found.append(Turned(self.point.orbit.x, self.point.orbit.demanded))
        elif self.machine.speed and self.machine.unbalance:
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
        return self.control.needs_estimate

    def control_for(self, estimator: Any) -> Control:
        """Return how the machine is controlled, the default for what feeds it where not given."""
        return settled(self.machine, self.control, "estimate" if estimator else "measurement")

    def choice(self, estimator: Any) -> str | None:
        """Return what default controllers were chosen for what feeds them, in a sentence."""
        if not self.machine.turns or self._flown or not is_default(self.control):
            return None
        return default_control(self.machine, "estimate" if estimator else "measurement").summary

    def fed_by(self, estimator: Any) -> list[PID]:
        """Return the PIDs of the axes as an estimator feeds them or, None, the measurement."""
        feedback: Literal["measurement", "estimate"] = "estimate" if estimator else "measurement"
        return pids_of(self.machine, self.control_for(estimator), feedback)

    def flown_by(self, estimator: Estimator | None, fastest: float | None = None) -> Controllers:
        """Return the controllers as they fly, fed by an estimator or the measurement."""
        if self._flown is not None:
            return self._flown
        control = self.control_for(estimator)
        return controllers_of(Plant(self.machine), control, estimator, fastest=fastest)

    def plain(self, estimator: Estimator | None) -> str | None:
        """Return a sentence where unbalance control is plain control at the machine's speed."""
        if self.control.unbalance == "fought":
            return None
        turn = self.flown_by(estimator).let_turn
        if turn is None:
            return None
        speed = self.machine.speed
        return turn.for_unbalance_of(self.machine).sentence(self.control.unbalance, speed, speed)

    def pids(self, estimator: Estimator | None = None) -> dict[str, PID]:
        """Return the PIDs by what each is of: an axis, or a coordinate of the rotor."""
        # None of a regulator.
        control = self.control_for(estimator)
        if control.type == "lqg":
            return {}
        if control.type == "decentralised":
            return dict(zip(self.axes, self.fed_by(estimator), strict=True))
        found = self.flown_by(estimator)
        return {
            name or "x": PID(
                kp=kp, ki=ki, kd=kd, derivative_filter=T_f, anti_windup=aw, setpoint_weight=b
            )
            for name, (kp, ki, kd, T_f, aw, b, *_) in zip(found.names, found.pids, strict=True)
        }

    def with_plant(self, plant: Machine, estimator: Estimator | None) -> LoopOf:
        """Return the same controllers, as an estimator feeds them, with another plant."""
        control = self.control_for(estimator)
        return LoopOf(plant, control, point=self.point, flown=self.flown_by(estimator))

    def at(self, point: WorkPoint) -> LoopOf:
        """Return the same loop at another work point."""
        moved = copy(self)
        moved.point, moved.plant = point, plant(self.machine, point)
        return moved

    def with_unbalance(self, scale: float) -> LoopOf:
        """Return the same loop of a machine whose unbalance is larger by a factor."""
        planes = tuple(
            Unbalance(place=place, amount=scale * amount, angle=angle)
            for place, amount, angle in self.machine.unbalances()
        )
        moved = copy(self)
        moved.machine = self.machine.model_copy(update={"unbalance": planes})
        return moved

    def loop(self, estimator: Estimator | None = None) -> Loop:
        """Return the loop whose controllers are fed by an estimator, or by the measurement."""
        m = len(self.shown[0])
        inner, control, shown = self._by_states(estimator)
        K = compensator(control, inner, shown, self.plant.outputs[:m])
        return Loop(self.plant, K, m, self.shown, self.added)

    def _by_states(
        self, estimator: Estimator | None
    ) -> tuple[LinearSystem | None, LinearSystem, Array]:
        """Return estimator, controllers, and what these look at by the readings (q, m)."""
        flown = self.flown_by(estimator)
        control = controllers(flown, self.machine, measured=estimator is None)
        shown = flown.shown
        if estimator is None:
            return None, control, shown
        if flown.let_turn is not None:
            flown = replace(flown, let_turn=flown.let_turn.for_unbalance_of(self.machine))
        rows = fed(flown, len(estimator.states), self.machine.speed)
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
        flown = self.flown_by(estimator)
        flown = replace(flown, pids=[[kp, 0.0, *rest] for kp, _ki, *rest in flown.pids])
        loop = LoopOf(self.machine, self.control, point=self.point, flown=flown).loop(estimator)
        if not loop.is_stable:
            return None
        return float(np.abs(np.diagonal(loop.compliance([0.0])[0])).max())

    def lqg(self) -> Loop:
        """Return the loop of the linear-quadratic-Gaussian controller that needs least control."""
        # It has state and loads from a Kalman filter of this very plant, told of the noise of
        # sensors and amplifiers and the usual growth of the loads.
        told = KalmanFilter(self.machine).variances
        sensors, amplifiers = self.noise()
        noise = Noise(sensors, amplifiers, tuple(np.atleast_1d(told.disturbance)))
        K = LQG(self.plant, noise).compensator()
        return Loop(self.plant, K, len(sensors), self.shown, self.added)

    def hinf(self) -> Loop:
        """Return the loop of H-infinity controllers, of each axis one for the axis alone."""
        each = []
        for b in self.alone:
            of = self if len(self.alone) == 1 else LoopOf(b)
            found = hinf(of.plant.select([of.plant.outputs[0].name], [of.plant.inputs[0].name]))
            gain = b.sensor.gain  # it is fed by the position
            each.append(replace(found, B=gain * found.B, D=gain * found.D))
        K = beside_each_other(each, self.shown, [axis.name for axis in self.machine.axes])
        K = replace(K, inputs=(*self.plant.outputs[: len(self.shown[0])], *K.inputs[-len(each) :]))
        return Loop(self.plant, K, len(self.shown[0]), self.shown, self.added)

    def noise(self) -> tuple[list[float], list[float]]:
        """Return the variances of the measurements [m^2] and of the control signals [V^2]."""
        return (
            [r.sensor.noise_variance for r in self.machine.readings],
            [b.amplifier.noise_variance for b in self.alone],
        )

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
                f"brings the peak of |S| of {self.machine.name}; is {ceiling:g}"
            )
