"""A machine with its controllers, and the linear loops of its filters."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import name_of
from ambkit.control.control import Control, as_control
from ambkit.control.controllers import Controllers, controllers_of, pids_of
from ambkit.control.default_control import ZONE_A as ZONE_A
from ambkit.control.default_control import ZONES as ZONES
from ambkit.control.default_control import default_control, is_default, settled
from ambkit.control.default_control import zone_of as zone_of
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_controller import compensator, controllers, fed
from ambkit.control.linear.linear_plant import OperatingPoint, plant
from ambkit.control.linear.steady_state_filter import estimator_at, tells
from ambkit.control.pid import PID
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.machine_model import View
from ambkit.judge.loop.capacity import HarmonicResponse, of_runout, of_unbalance
from ambkit.judge.loop.margins import axis_peaks
from ambkit.judge.loop.synthesis import LQG, Noise, block_diagonal, hinf, least_peaks
from ambkit.machine.axes import isolated_axes
from ambkit.machine.components import Unbalance
from ambkit.machine.machine import Machine
from ambkit.machine.rotors.modes import max_frequency
from ambkit.models.linear import LinearSystem, Signal
from ambkit.models.plant import Plant

PROMPT = 1e-12  #: Lag of an ideal sensor [s], below the resolution of the models.


@lru_cache(maxsize=4)
def _plant_of(machine: Machine) -> Plant:
    """Return the plant of a machine, cached over filters."""
    return Plant(machine)


class InfeasibleError(AmbkitError):
    """A filter cannot keep a limit on the sensitivity peak."""

    def __init__(self, message: str, nearest: Any = None) -> None:
        super().__init__(message)
        #: The filter closest to the limit (`ambkit.workflow.tune.Tuned`); None if there is none.
        self.nearest = nearest


def ideal_pieces(machine: Machine) -> dict[str, Machine]:
    """Return a machine with one element of its loop ideal, by the element's name."""
    results: dict[str, Machine] = {}

    def fast(amplifier: Any) -> Any:
        return amplifier.model_copy(update={"bandwidth": None, "voltage_limit": None})

    def prompt(sensor: Any) -> Any:
        return sensor.model_copy(update={"lag": PROMPT})

    if any(bearing.amplifier.bandwidth for bearing in machine.bearings):
        ideal = [at.model_copy(update={"amplifier": fast(at.amplifier)}) for at in machine.bearings]
        results["amplifier"] = machine.model_copy(update={"bearings": tuple(ideal)})
    if any(item.lag for item in machine.sensors):
        sensors = tuple(prompt(item) for item in machine.sensors)
        results["sensor"] = machine.model_copy(update={"sensors": sensors})
    if machine.delay:
        results["delay"] = machine.model_copy(update={"delay": None})
    return results


class LoopBuilder:
    """The loop of a machine at an operating point, for any filter."""

    def __init__(
        self,
        machine: Machine,
        controller: PID | None = None,
        x: float = 0.0,
        load: Any = None,
        *,
        point: OperatingPoint | None = None,
        law: Controllers | None = None,
    ) -> None:
        self.machine = machine
        self.isolated = isolated_axes(self.machine)
        self.control = Control() if controller is None else as_control(controller)
        self._law = law
        self.axes = tuple(axis.name or "x" for axis in self.machine.axes)
        self.point = point or OperatingPoint.of_machine(self.machine, load, x)
        self.measured = View(self.machine).measured
        self.added = np.asarray(np.linalg.pinv(self.measured), float)
        self.plant = plant(self.machine, self.point)
        self.top = max_frequency(self.machine.sampling_time, self.machine.speed)

    def harmonic_responses(self, loop: Loop) -> list[HarmonicResponse]:
        """Return the synchronous response of a stable loop: runout, and unbalance or the orbit."""
        result = of_runout(loop, self.machine)
        if self.point.orbit is not None:
            result.append(HarmonicResponse(self.point.orbit.x, self.point.orbit.demanded))
        elif self.machine.speed and self.machine.unbalance:
            result.append(of_unbalance(loop, self.machine, self.point))
        return result

    def least(self) -> tuple[float, float]:
        """Return the least peaks of S and T of any controller [1]; see `least_peaks`."""
        p, m = len(self.isolated), len(self.measured[0])
        u, y = ([at.name for at in of] for of in (self.plant.inputs[:p], self.plant.outputs[:m]))
        from_u = self.plant.select(y, u)
        names = tuple(Signal(axis, "m") for axis in self.axes)
        return least_peaks(
            replace(from_u, C=self.measured @ from_u.C, D=self.measured @ from_u.D, outputs=names)
        )

    def control_for(self, estimator: Any) -> Control:
        """Return the controllers, by default those for the given feedback."""
        return settled(self.machine, self.control, "estimate" if estimator else "measurement")

    def choice(self, estimator: Any) -> str | None:
        """Return the selection of default controllers for the given feedback, in a sentence."""
        if not self.machine.turns or self._law or not is_default(self.control):
            return None
        return default_control(self.machine, "estimate" if estimator else "measurement").summary

    def fed_by(self, estimator: Any) -> list[PID]:
        """Return the PIDs of the axes, fed by an estimator or, None, by the measurement."""
        feedback: Literal["measurement", "estimate"] = "estimate" if estimator else "measurement"
        return pids_of(self.machine, self.control_for(estimator), feedback)

    def controllers_with(
        self, estimator: Estimator | None, max_speed: float | None = None
    ) -> Controllers:
        """Return the controllers as simulated, fed by an estimator or the measurement."""
        if self._law is not None:
            return self._law
        if custom := self.control.custom:
            raise AmbkitError(
                f"controller.custom: {name_of(custom)} is Python, from which no margins follow; "
                '"ambkit assess sweep" measures them on the simulated loop'
            )
        control = self.control_for(estimator)
        return controllers_of(_plant_of(self.machine), control, estimator, fastest=max_speed)

    def plain(self, estimator: Estimator | None) -> str | None:
        """Return a sentence if unbalance control is off at the machine's speed."""
        if self.control.unbalance == "off":
            return None
        turn = self.controllers_with(estimator).unbalance_control
        if turn is None:
            return None
        speed = self.machine.speed
        return turn.for_unbalance_of(self.machine).sentence(self.control.unbalance, speed, speed)

    def pids(self, estimator: Estimator | None = None) -> dict[str, PID]:
        """Return the PIDs by axis, or by coordinate of the rotor."""
        # None for a regulator.
        control = self.control_for(estimator)
        if control.type == "lqg":
            return {}
        if control.type == "decentralised":
            return dict(zip(self.axes, self.fed_by(estimator), strict=True))
        result = self.controllers_with(estimator)
        return {
            name or "x": PID(
                kp=kp, ki=ki, kd=kd, derivative_filter=T_f, anti_windup=aw, setpoint_weight=b
            )
            for name, (kp, ki, kd, T_f, aw, b, *_) in zip(result.names, result.pids, strict=True)
        }

    def with_plant(self, plant: Machine, estimator: Estimator | None) -> LoopBuilder:
        """Return the same controllers with estimate feedback and another plant."""
        control = self.control_for(estimator)
        return LoopBuilder(plant, control, point=self.point, law=self.controllers_with(estimator))

    def at(self, point: OperatingPoint) -> LoopBuilder:
        """Return the same loop at another operating point."""
        moved = copy(self)
        moved.point, moved.plant = point, plant(self.machine, point)
        return moved

    def at_speed(
        self, speed: float, fed_by: Estimator | None
    ) -> tuple[LoopBuilder, Estimator | None]:
        """Return the same controllers and filter at another speed [rad/s]."""
        machine = self.machine.model_copy(update={"speed": speed})
        of = LoopBuilder(machine, self.control, point=self.point, law=self._law)
        return of, None if fed_by is None else fed_by.nominal.for_machine(machine)

    def with_controllers(self, fed_by: Estimator | None, max_speed: float) -> LoopBuilder:
        """Return the same loop with its controllers selected up to a speed [rad/s]."""
        moved = copy(self)
        moved._law = self.controllers_with(fed_by, max_speed)
        return moved

    def with_unbalance(self, scale: float) -> LoopBuilder:
        """Return the same loop of a machine whose unbalance is larger by a factor."""
        planes = tuple(
            Unbalance(place=place, amount=scale * amount, angle=angle)
            for place, amount, angle in self.machine.unbalances()
        )
        moved = copy(self)
        moved.machine = self.machine.model_copy(update={"unbalance": planes})
        return moved

    def loop(self, estimator: Estimator | None = None) -> Loop:
        """Return the loop with an estimator, or with the measurement, feeding the controllers."""
        m = len(self.measured[0])
        inner, control, transform = self._by_states(estimator)
        K = compensator(control, inner, transform, self.plant.outputs[:m])
        return self.around(K)

    def around(self, compensator: LinearSystem) -> Loop:
        """Return the loop with another compensator, from the measurements to u."""
        return Loop(self.plant, compensator, len(self.measured[0]), self.measured, self.added)

    def _by_states(
        self, estimator: Estimator | None
    ) -> tuple[LinearSystem | None, LinearSystem, Array]:
        """Return estimator, controllers, and the controllers' inputs by the readings (q, m)."""
        control_law = self.controllers_with(estimator)
        control = controllers(control_law, self.machine, measured=estimator is None)
        transform = control_law.measured
        if estimator is None:
            return None, control, transform
        if control_law.unbalance_control is not None:
            control_law = replace(
                control_law,
                unbalance_control=control_law.unbalance_control.for_unbalance_of(self.machine),
            )
        rows = fed(control_law, len(estimator.states), self.machine.speed)
        inner = estimator_at(estimator, self.point, (rows, control.inputs[: len(rows)]))
        return inner, control, transform

    def static_compliance(self, estimator: Estimator | None = None) -> float | None:
        """Return the largest static deflection by a load, without integral action [m/N]."""
        # None if the loop were unstable then, and for a regulator, which has none.
        if self.control.needs_estimate or self.control_for(estimator).type == "lqg":
            return None
        control_law = self.controllers_with(estimator)
        pids = control_law.pids_at(self.machine.speed)
        without = [[kp, 0.0, *rest] for kp, _ki, *rest in pids]
        control_law = replace(control_law, pids=without, schedule=None)
        loop = LoopBuilder(self.machine, self.control, point=self.point, law=control_law).loop(
            estimator
        )
        if not loop.is_stable:
            return None
        return float(np.abs(np.diagonal(loop.compliance([0.0])[0])).max())

    def lqg(self) -> Loop:
        """Return the loop of the minimum-effort linear-quadratic-Gaussian controller."""
        # Its states and disturbances are from a Kalman filter of this plant, with the noise of
        # sensors and amplifiers and the default process noise.
        variances = KalmanFilter(self.machine).variances
        sensors, amplifiers = self.noise()
        noise = Noise(sensors, amplifiers, tuple(np.atleast_1d(variances.disturbance)))
        return self.around(LQG(self.plant, noise).compensator())

    def hinf(self) -> Loop:
        """Return the loop of H-infinity controllers, one for each isolated axis."""
        parts = []
        for b in self.isolated:
            of = self if len(self.isolated) == 1 else LoopBuilder(b)
            result = hinf(of.plant.select([of.plant.outputs[0].name], [of.plant.inputs[0].name]))
            gain = b.sensor.gain  # fed by the position
            parts.append(replace(result, B=gain * result.B, D=gain * result.D))
        K = block_diagonal(parts, self.measured, self.machine.axis_names)
        K = replace(
            K, inputs=(*self.plant.outputs[: len(self.measured[0])], *K.inputs[-len(parts) :])
        )
        return self.around(K)

    def noise(self) -> tuple[list[float], list[float]]:
        """Return the variances of the measurements [m^2] and of the control signals [V^2]."""
        return (
            [r.sensor.noise_variance for r in self.machine.readings],
            [b.amplifier.noise_variance for b in self.isolated],
        )

    def peak(self, estimator: Estimator | None = None) -> float:
        """Return the peak of abs(S) within the standard's range [1]."""
        # Infinite if the loop is unstable or the estimator has no steady-state gain.
        try:
            loop = self.loop(estimator)
        except AmbkitError:
            return math.inf
        if not loop.is_stable:
            return math.inf
        return float(axis_peaks(loop, self.top).max())

    def check(self, estimator: Estimator, peak_limit: float) -> None:
        """Reject a limit on the peak of abs(S) that this filter cannot keep."""
        if not tells(estimator):
            raise InfeasibleError(
                f"{estimator.name}: it has no steady-state gain, so the sensitivity "
                "peak is not defined"
            )
        least = self.least()[0]
        if not (math.isfinite(peak_limit) and peak_limit > least):
            raise InfeasibleError(
                f"max_sensitivity must be above {least:.4g}, below which no linear controller "
                f"brings the peak of |S| of {self.machine.name}; is {peak_limit:g}"
            )
