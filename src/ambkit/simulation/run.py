"""Simulation of a machine in a scenario: the closed loop in one call into C (``sim/``)."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from types import ModuleType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, real
from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import OwnStep
from ambkit.base.quantity_arguments import of_type
from ambkit.base.units import engineering
from ambkit.control.controller_states import OwnController
from ambkit.control.controllers import Controllers
from ambkit.control.pid import PID
from ambkit.data.record import Record
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.machine_model import View
from ambkit.estimate.registry import default_filter
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, core_module
from ambkit.simulation.angle_sensor import angle_readings
from ambkit.simulation.external_inputs import ExternalInputs, Faults, OwnPlant, as_series, columns
from ambkit.simulation.fields import InLoops, StraightLine
from ambkit.simulation.recording import noise_samples, recorded, white
from ambkit.simulation.scenario import (
    AXES,
    Scenario,
    along,
    check_for,
    energised,
    feedback_of,
    fly_command,
    settled_scenario,
)
from ambkit.simulation.simulated import Run as Run


def samples(machine: Machine, scenario: Scenario) -> int:
    """Return the number of samples of a run."""
    T, most = machine.sampling_time, _memory() // _BYTES
    if scenario.duration / T > most:
        raise AmbkitError(
            f"duration must be at most {engineering(most * T, 's', 3)} with a sampling_time of "
            f"{engineering(T, 's')}: this machine's memory holds {most:.3g} samples; is "
            f"{engineering(scenario.duration, 's')}"
        )
    return max(2, round(scenario.duration / T) + 1)


_BYTES = 400  # of memory per sample, including derived data


def _memory() -> int:
    """Return the memory of the computer [bytes]; 8 GB if unknown."""
    if not hasattr(os, "sysconf"):
        return 8 * 10**9
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def simulate(machine: Machine, scenario: Scenario, **options: Any) -> Record:
    """Simulate the closed loop; see :func:`simulate_run`, which also returns the estimate."""
    return simulate_run(machine, scenario, **options).record


def simulate_run(machine: Machine, scenario: Scenario, **options: Any) -> Run:
    """Simulate plant, amplifiers, sensors, controllers and estimator; see :class:`Loop`."""
    # A loop with an estimator in single precision is computed in single precision, plant and all.
    # The plant is continuous (Runge-Kutta of order 4 with ``scenario.substeps`` steps in a sample,
    # or as many more as what is fast in it needs): gyroscopics, nonlinear force laws, weight,
    # unbalance, loads, sensor lags, mechanical stops, and what else the machine has: an amplifier's
    # bandwidth and voltage, a dead time, runout. Demanded control currents and loads are held over
    # a sample. Noise is normal, white unless a sensor has coloured noise or hum, from independent
    # streams of counters with the scenario's seed and run as their key (``sim/many.h``).
    return Loop(machine, scenario, **options).run()


class Sampled(NamedTuple):
    """Signals of a scenario at the samples, one column per axis."""

    t: Array  #: (n,) [s].
    reference: Array  #: (n, p) [m].
    disturbance: Array  #: (n, p) [N].
    injected: Array  #: (n, p) [m].

    @classmethod
    def of(cls, machine: Machine, scenario: Scenario) -> Sampled:
        """Sample a scenario at a machine's sampling time."""
        t = machine.sampling_time * np.arange(samples(machine, scenario), dtype=float)
        names = tuple(machine.axis_names)
        return cls(t, *(along(scenario, what, names, t) for what in AXES))


class Loop:
    """A closed loop that can stop between two samples, and continue with another estimator."""

    # The simulation is that of :func:`simulate_run`; in segments it has the same bits as in one
    # run. In between, `estimator` may be replaced by one that continues its state, see
    # :meth:`ambkit.Estimator.transfer_from`: a filter can be retrained during a run. `controllers`
    # are ready-made, or the PID of each axis.

    def __init__(
        self,
        machine: Machine,
        scenario: Scenario,
        *,
        estimator: Estimator | None = None,
        magnet: MagnetModel | None = None,
        external_inputs: ExternalInputs | None = None,
        sampled: Sampled | None = None,
        controllers: Controllers | Sequence[PID] | None = None,
    ) -> None:
        of_type(Machine, machine=machine)
        of_type(Scenario, scenario=scenario)
        if estimator is not None:
            of_type(Estimator, filter=estimator)
        self._straight = machine.single and controllers is None
        check_for(scenario, machine)
        self.machine, self.external_inputs = machine, external_inputs or ExternalInputs()
        self.scenario = (
            settled_scenario(machine, scenario) if controllers is None
            else scenario.fed(feedback_of(scenario))
        )  # fmt: skip
        self._t, self._reference, self._load, self._injected = (
            Sampled.of(machine, self.scenario) if sampled is None else sampled
        )
        self._fly = self.external_inputs.fly
        self._energised = energised(scenario.off, scenario.on, self._t, machine.sampling_time)
        self._fails = self.scenario.off is not None
        if self._fly is None and self.scenario.sequence is not None:
            self._fly = fly_command(self.scenario.sequence, self._t, self._energised)
        fed = self.scenario.feedback == "estimate"
        if estimator is None and (fed or self.scenario.sequence is not None):
            estimator = default_filter(machine)
        self.estimator = estimator
        self._impose(magnet)
        self._form = self._make_form(magnet, controllers)
        if self.external_inputs.references is not None:
            self._reference = self._reference + self.external_inputs.references
        own, plant = self.scenario.controller.custom, self.scenario.plant
        if own is not None and self.scenario.sequence is not None:
            raise AmbkitError("sequence: lifts with our controllers, and not with one of your own")
        self._own = {
            "own_controller": None if own is None else OwnController(own, machine),
            "own_plant": None if plant is None else OwnPlant(plant, machine),
        }
        self._state: Any = None  # state of the loop between two segments
        self._rotating_model: tuple[Any, Any] = None, None  # an estimator, and its rotating model
        self._measured_rotation: NDArray[Any] | None = None  # its inputs from the rotation
        self._at = 0

    def _impose(self, magnet: MagnetModel | None) -> None:
        """Check and apply the external inputs."""
        machine, n, external_inputs = self.machine, self._t.size, self.external_inputs
        p, m = len(machine.axes), len(machine.readings)
        if magnet is not None and not self._straight:
            raise AmbkitError(f"magnet: is of one axis, and {machine.name} has several")
        for name, values in as_series(external_inputs):
            width = columns(name, p, m)
            one = width == 1 and np.shape(values) == (n,)
            if real(f"external_inputs {name}", values).shape != (n, width) and not one:
                parts = f" for each of {width}" if width > 1 else ""
                raise ValueError(
                    f"external_inputs {name} must have {n} values{parts}, has {np.shape(values)}"
                )
        if external_inputs.disturbance is not None:
            self._load = self._load + external_inputs.disturbance.reshape(n, p)
        self._faults = external_inputs.faults
        self._y_injected = self._injected
        if not self._straight:
            self._y_injected = self._injected @ np.linalg.pinv(View(machine).measured).T
        # For sensors without quantisation or position-dependent noise, the noise is additive.
        sensors = [reading.sensor for reading in machine.readings]
        adds = [at.quantisation is None and not at.position_noise for at in sensors]
        if not all(adds) and self._injected.any():  # after the sensor's effect on its noise
            faults = Faults.none(n) if self._faults is None else self._faults
            if self._faults is None and not self._straight:
                faults = faults.among(0, m, 0, p)
            later = np.where(adds, 0.0, self._y_injected).reshape(faults.y_plus.shape)
            self._faults = replace(faults, y_plus=faults.y_plus + later)
            self._y_injected = np.where(adds, self._y_injected, 0.0)

    def _make_form(
        self, magnet: MagnetModel | None, controllers: Controllers | Sequence[PID] | None
    ) -> StraightLine | InLoops:
        machine, scenario, t = self.machine, self.scenario, self._t
        at, load = self._reference[0], self._load[0]
        self._speed = self._base = None
        if self._straight:
            return StraightLine(machine, scenario, magnet, float(at[0]), float(load[0]))
        after = machine.sampling_time * np.arange(t.size + 1, dtype=float)
        own = np.full(after.size, machine.speed)
        self._speed = own if scenario.speed is None else scenario.speed.sample(after)
        fastest = float(np.abs(self._speed).max())
        if fastest * machine.sampling_time >= math.pi:
            raise AmbkitError(
                f"speed: {fastest:.6g} rad/s turns half a revolution within a sample, or more; "
                f"must be less than {math.pi / machine.sampling_time:.6g} rad/s"
            )
        if machine.angle is not None:
            low, high = machine.angle.range(machine.speed)
            if self._speed.min() < low or self._speed.max() > high:
                raise AmbkitError(
                    f"speed: {self._speed.min():.6g} to {self._speed.max():.6g} rad/s is beyond "
                    f"the {low:.6g} to {high:.6g} rad/s of [angle]; see max_speed and reverses"
                )
        self._base = _of_base(machine, scenario, t)
        return InLoops(machine, scenario, self.estimator, at, load, fastest, controllers)

    @property
    def start(self) -> Array:
        """Initial states (n,) of the estimator [unit of each state]."""
        assert self.estimator is not None  # callers have one
        return np.ravel(
            self.estimator.equilibrium_state(self._form.place, current=self._form.current)
        )

    @cached_property
    def noise(self) -> tuple[Array, Array]:
        """On control signals (n, p) [V] and on readings (n, m) [m], including injections."""
        noise_u, noise_y = noise_samples(self.machine, self.scenario, self._t.size)
        if self.external_inputs.sensor_noise is not None:
            noise_y = self.external_inputs.sensor_noise.reshape(noise_y.shape)
        if self._injected.any():
            noise_y = noise_y + self._y_injected
        if self.external_inputs.readings is not None:
            noise_y = noise_y + self.external_inputs.readings
        return noise_u, noise_y

    @cached_property
    def readings(self) -> Array | None:
        """Readings of the angle sensor (n,); None if there is none."""
        if self.machine.angle is None or self._speed is None:
            return None
        return angle_readings(self.machine, self.scenario, self._speed[:-1])

    @property
    def white_noise(self) -> tuple[list[float], list[float]] | None:
        """Standard deviations of the noise (p,) [V], (m,) [m], if it is white only."""
        options = self.external_inputs.sensor_noise, self.external_inputs.readings
        if any(item is not None for item in options) or self._injected.any():
            return None
        return white(self.machine, self.scenario)

    @property
    def series(self) -> tuple[Array, Array]:
        """References [m] and disturbance forces [N], (n, p) each."""
        return self._reference, self._load

    @property
    def precision(self) -> Literal["float64", "float32"]:
        """Precision of the computation: that of the estimator."""
        return "float64" if self.estimator is None else self.estimator.precision

    @property
    def core(self) -> ModuleType:
        """The build of the C that runs it."""
        if self.estimator is not None:
            return self.estimator.engine.core
        return core_module(self.precision, any_model=not self._straight)

    @property
    def calls_python(self) -> bool:
        """Whether it contains a class of the user, whose state serves one run."""
        own = self.estimator is not None and not self.estimator.side_by_side
        return own or any(part is not None for part in self._own.values())

    def check(self) -> None:
        """Raise errors of the user's classes that occurred meanwhile."""
        for own in (*self._own.values(), self.estimator):
            if isinstance(own, OwnStep):
                own.check()

    def arguments(self, here: slice) -> dict[str, Any]:
        """Return the arguments of a core for some samples, without their noise."""

        def converter(values: Array) -> NDArray[Any]:
            return np.ascontiguousarray(values[here], dtype=self.precision)

        estimator, external_inputs, faults = self.estimator, self.external_inputs, self._faults
        own = {} if external_inputs.exported is None else external_inputs.exported
        scale = external_inputs.magnet_scale
        core_arguments = {
            "estimator": None if estimator is None else estimator.core,
            "control": None, "hovers": True,
            "r": converter(self._reference), "load": converter(self._load),
            "scale": None if scale is None else converter(scale),
            "faults": None
            if faults is None
            else {name: converter(item) for name, item in faults.series.items()},
            "beside": faults is not None and faults.beside,
            "fly": None if self._fly is None else converter(self._fly),
            "on": converter(self._energised) if self._fails else None,
        }  # fmt: skip
        of_form = self._form.arguments(self.core, estimator, external_inputs.place, **own)
        return core_arguments | self._own | of_form | self._rotation_arguments(here)

    def _rotation_arguments(self, here: slice) -> dict[str, Any]:
        """Return the arguments of a core: rotation, base motion."""
        if self._speed is None or self._base is None:
            return {}
        if (estimator := self.estimator) is not None and self._rotating_model[0] is not estimator:
            follows = self._measured_rotation = None
            if self.readings is not None and estimator.machine.angle is not None:
                follows = self._measured_rotation = estimator.follow_angle(self.readings)
            else:
                follows = estimator.follow_speed(self._speed, self._speed.size)
            model = None if follows is None else estimator.engine.model_of_core
            self._rotating_model = estimator, model
        return {
            "speed": self._speed[here.start : here.stop + 1].astype(self.precision),
            "base": self._base[here].astype(self.precision), "model": self._rotating_model[1],
            "rotation": None if self._measured_rotation is None else self._measured_rotation[here],
        }  # fmt: skip

    def _next_samples(self, until: float | None) -> slice:
        """Return the next samples, checked."""
        precision, T, n = self.precision, self.machine.sampling_time, self._t.size
        if self._at == 0:
            self._began_in = precision
        elif precision != self._began_in:
            raise ValueError(
                f"the loop began in {self._began_in} and cannot continue with a filter in "
                f"{precision}"
            )
        end = n if until is None else min(n, math.ceil(until / T - 1e-6))
        if end < self._at + 2:
            raise ValueError(
                f"until must be 2 samples or more after {self._at * T:g} s, where the loop is, and "
                f"the run ends at {(n - 1) * T:g} s; is {until!r}"
            )
        if self._faults is not None and end < n:
            raise ValueError(f"a loop with faults runs in one go; until must be None, is {until!r}")
        return slice(self._at, end)

    def _simulate(self, here: slice, state: Any) -> dict[str, Any]:
        """Return C's results for some samples."""
        noise_u, noise_y = (np.ascontiguousarray(of[here], self.precision) for of in self.noise)
        result: dict[str, Any] = self.core.simulate(
            **self.arguments(here), noise_u=noise_u, noise_y=noise_y, state=state
        )
        self.check()
        if self._own["own_plant"] is not None:  # its magnet force is unknown
            result["force"] = np.full_like(result["force"], np.nan)
        return result

    def run(self, until: float | None = None) -> Run:
        """Simulate to the end of the scenario, or to a time before it."""
        here, estimator = self._next_samples(until), self.estimator
        if self._state is None:
            self._state = self.core.LoopState()
        if self._at == 0 and estimator is not None:
            self._rotation_arguments(here)
            estimator.reset(self.start)
            if self.external_inputs.exported is not None and self.scenario.sequence is None:
                first = self._simulate(slice(0, 1), self.core.LoopState())["y"]
                estimator.reset(estimator.initial_state(np.asarray(first, float)))
        out = self._simulate(here, self._state)
        self._at = here.stop
        if self._faults is not None:  # a record holds no infinities
            out |= {k: np.where(np.isinf(out[k]), np.nan, out[k]) for k in "yu"}
        t = self._t[here]
        series = {"r": self._reference[here], "f_d": self._load[here]}
        series["injected"] = self._injected[here]
        if self._speed is not None and self._base is not None:
            series |= {"speed": self._speed[here], "base": self._base[here]}
        if self.readings is not None:
            series["angle"] = self.readings[here]
        if self._fails:
            series["on"] = self._energised[here]
        record = recorded(self._form, t, out, series, here.start)
        usable = out["usable"].astype(bool) if "usable" in out else None
        estimate = None if estimator is None else estimator._estimated(t, out["estimate"])
        return Run(self.machine, record, estimate, out["status"], usable)


def _of_base(machine: Machine, scenario: Scenario, t: Array) -> Array:
    """Return the accelerations of the foundation (n, 3) [m/s^2]."""
    result = np.zeros((len(t), 3))
    for at, item in enumerate(scenario.base):
        if item.direction not in machine.rigid_coordinates:
            raise AmbkitError(
                f"base[{at}].direction: {machine.name} has no thrust bearing, and does not move "
                f"along {item.direction}"
            )
        result[:, "xyz".index(item.direction)] += item.acceleration.sample(t)
    return result
