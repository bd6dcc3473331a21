"""A bearing and a scenario make a record: the closed loop, run in one call into C (``sim/``)."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import real
from ambkit.base.asked import of_type
from ambkit.base.copying import own_version
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.estimate.base import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.machine.hovering import hover_current
from ambkit.machine.machine import Bearing
from ambkit.machine.magnets import Law, MagnetModel, core_module, magnet_of
from ambkit.simulation import parts
from ambkit.simulation.control import Controller
from ambkit.simulation.controllers import gains_of
from ambkit.simulation.imposed import Faults, Imposed, series_of
from ambkit.simulation.noise import drawn, white
from ambkit.simulation.scenario import AXES, Scenario
from ambkit.simulation.simulated import Run as Run

UNITS = {
    "r": "m", "y": "m", "u": "V",
    "x": "m", "v": "m/s", "f_d": "N", "x_m": "m", "iu": "A", "f_mag": "N",
}  # fmt: skip


COIL_UNITS = {"u_coil": "V", "u_coil_2": "V"}
"""Voltage of the coil, of a pair that of the coil towards +x and of the other one, just after the
sample; where the amplifier has a voltage limit."""


MODE_UNITS = {"mode": "1"}
"""What the controller was doing, `ambkit.simulation.sequence.Mode`; where there is a sequence."""


INJECTED_UNITS = {"injected": "m"}
"""What was added to the measurement; where the scenario has it."""


def _adds_noise(bearing: Bearing) -> bool:
    """Whether a sensor adds its noise, and neither rounds it nor has more of it at some places."""
    return bearing.sensor.quantisation is None and not bearing.sensor.noise_rise


def samples(bearing: Bearing, scenario: Scenario) -> int:
    """Return how many samples a run has."""
    T, most = bearing.sampling_time, _memory() // _BYTES
    if scenario.duration / T > most:
        raise AmbkitError(
            f"duration must be at most {engineering(most * T, 's', 3)} with a sampling_time of "
            f"{engineering(T, 's')}: this machine's memory holds {most:.3g} samples; is "
            f"{engineering(scenario.duration, 's')}"
        )
    return max(2, round(scenario.duration / T) + 1)


_BYTES = 400  # of memory that a sample takes, with all that is made of it


def _memory() -> int:
    """Return how much memory the machine has [bytes]; 8 GB where that cannot be asked."""
    if not hasattr(os, "sysconf"):
        return 8 * 10**9
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def simulate(
    bearing: Bearing,
    scenario: Scenario,
    *,
    estimator: Estimator | None = None,
    magnet: MagnetModel | None = None,
    imposed: Imposed | None = None,
) -> Record:
    """Simulate the closed loop; see :func:`simulate_run`, which also returns the estimate."""
    run = simulate_run(bearing, scenario, estimator=estimator, magnet=magnet, imposed=imposed)
    return run.record


def simulate_run(
    bearing: Bearing,
    scenario: Scenario,
    *,
    estimator: Estimator | None = None,
    magnet: MagnetModel | None = None,
    imposed: Imposed | None = None,
) -> Run:
    """Simulate plant, amplifier, sensor, controller and estimator in closed loop."""
    # A loop with an estimator in single precision is computed in single precision, plant and all.
    # The plant is continuous (Runge-Kutta of order 4 with ``scenario.substeps`` steps in a sample,
    # or as many more as a fast sensor needs): nonlinear force law, weight, disturbance, sensor lag,
    # mechanical stops, and what else the bearing has: an amplifier's bandwidth and voltage, a dead
    # time, runout, a stop that bounces. Demanded control current and disturbance are held over a
    # sample. Noise on the control signal and on the measurement is normal, white unless the sensor
    # has coloured noise or hum, from independent streams of counters with ``scenario.seed`` and
    # ``scenario.run`` as their key (``sim/noise.h``).
    return Loop(bearing, scenario, estimator=estimator, magnet=magnet, imposed=imposed).run()


class Sampled(NamedTuple):
    """The signals of a scenario at the samples, (n,) each."""

    t: NDArray[np.float64]
    """[s]."""
    reference: NDArray[np.float64]
    """[m]."""
    disturbance: NDArray[np.float64]
    """[N]."""
    injected: NDArray[np.float64]
    """[m]."""

    @classmethod
    def of(cls, bearing: Bearing, scenario: Scenario) -> Sampled:
        """Sample a scenario as often as a bearing is sampled."""
        t = bearing.sampling_time * np.arange(samples(bearing, scenario), dtype=float)
        return cls(t, *(scenario.along(what, ("",), t)[:, 0] for what in AXES))


class Loop:
    """A closed loop that can stop between two samples, and go on with another estimator."""

    # What is simulated is that of :func:`simulate_run`, and in stretches it is the same, to the
    # last bit, as in one go. In between, `estimator` may be replaced by one that goes on where the
    # old one is, see :meth:`ambkit.Estimator.take_over`: so a filter is learned anew in flight.

    def __init__(
        self,
        bearing: Bearing,
        scenario: Scenario,
        *,
        estimator: Estimator | None = None,
        magnet: MagnetModel | None = None,
        imposed: Imposed | None = None,
        sampled: Sampled | None = None,
    ) -> None:
        of_type(Bearing, bearing=bearing)
        of_type(Scenario, scenario=scenario)
        scenario.check_for(("",), body=False)
        scenario = scenario.of_one_axis(bearing)
        told = Sampled.of(bearing, scenario) if sampled is None else sampled
        t, reference, disturbance, injected = (
            told.t,
            told.reference,
            told.disturbance,
            told.injected,
        )
        n = len(t)
        self._scale = self._faults = self._place = self._sensor_noise = None
        if imposed is not None:
            for name, values in series_of(imposed):
                if real(f"imposed {name}", values).shape != (n,):
                    raise ValueError(f"imposed {name} must have {n} values, has {np.shape(values)}")
            self._faults, self._place = imposed.faults, imposed.place
            if imposed.disturbance is not None:
                disturbance = disturbance + imposed.disturbance
            self._sensor_noise, self._scale = imposed.sensor_noise, imposed.magnet_scale
        self._injected = injected if injected.any() else None
        if self._injected is not None and not _adds_noise(bearing):
            # After what the sensor does to its noise.
            faults = Faults.none(n) if self._faults is None else self._faults
            self._faults = replace(faults, y_plus=faults.y_plus + injected)
        needed = scenario.controller.feedback == "estimate" or scenario.sequence is not None
        if estimator is None and needed:
            estimator = KalmanFilter(bearing)
        self.bearing, self.scenario, self.estimator = bearing, scenario, estimator
        self._t = t
        self._series = {"r": reference, "f_d": disturbance}
        self._state, self._at = None, 0
        self._law = magnet if isinstance(magnet, Law) else magnet_of(bearing)
        self._plant = magnet if magnet is not None else self._law
        self._coil = parts.coil_fields(bearing) if magnet is None else None
        hover = scenario.start == "hover"
        self._start = float(reference[0]) if hover else 0.0
        balance = bearing.weight + self._law.bias_force + float(disturbance[0])
        self._held = hover_current(bearing, self._plant, self._start, balance) if hover else 0.0
        self._whole = scenario.sequence is not None or scenario.controller.needs_estimate
        self._fly = None if scenario.sequence is None else scenario.sequence.fly(t)

    @property
    def start(self) -> NDArray[np.float64]:
        """The states (n,) from which the estimator goes on [unit of each state]."""
        assert self.estimator is not None  # who asks has one
        # What was demanded before the start is the controller's own, and known.
        current = min(max(self._held, self.bearing.current_min), self.bearing.current_max)
        return self.estimator.at_rest(self._start, current=current)

    @cached_property
    def noise(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """On the control signal [V] and on the measurement [m], what is injected among it."""
        noise_u, noise_y = drawn(self.bearing, self.scenario, self._t.size)
        if self._sensor_noise is not None:
            noise_y = self._sensor_noise
        if self._injected is not None and _adds_noise(self.bearing):
            noise_y = noise_y + self._injected
        return noise_u, noise_y

    @property
    def white_noise(self) -> tuple[float, float] | None:
        """Standard deviations of the noise [V], [m], where it is white and nothing else."""
        if self._sensor_noise is not None or self._injected is not None:
            return None
        return white(self.bearing, self.scenario)

    @property
    def series(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Reference [m] and disturbance force [N], (n,) each."""
        return self._series["r"], self._series["f_d"]

    def arguments(
        self, core: ModuleType, given: Callable[[NDArray[np.float64]], NDArray[Any]]
    ) -> dict[str, Any]:
        """Return what a core is told of the loop and of what comes from outside, without noise."""
        bearing, estimator, pid = self.bearing, self.estimator, self.scenario.controller
        faults, precision = self._faults, "float64" if estimator is None else estimator.precision
        limits = bearing.current_min, bearing.current_max
        loop = {
            "axis": self._axis(core, precision),
            "T": bearing.sampling_time,
            "k_ui": [bearing.amplifier.gain],
            "pid": gains_of(pid, bearing.sampling_time, *limits),
            "feedback_estimate": pid.feedback == "estimate",
        }
        r, f_d = self.series
        one = self._start if self._place is None else self._place
        told = {
            "loop": loop,
            "estimator": None if estimator is None else estimator.core,
            "control": None,
            "r": given(r),
            "load": given(f_d),
            "scale": None if self._scale is None else given(self._scale),
            "place": one,
            "current": min(max(self._held, limits[0]), limits[1]),
            "integral": pid.integral(self._held, self._start, bearing.sampling_time),
            "hovers": True,
            "faults": None
            if faults is None
            else {k: given(each) for k, each in faults.series.items()},
            "beside": faults is not None and faults.beside,
            "fly": None if self._fly is None else given(self._fly),
        } | self._whole_controller()
        numbers = ("place", "current", "integral")
        return told | {name: np.array([told[name]], precision) for name in numbers}

    def _axis(self, core: ModuleType, precision: str) -> dict[str, Any]:
        """Return the fields of ``amb_axis``."""
        bearing = self.bearing
        return {
            "magnet": self._plant.in_core(core),
            "m": bearing.rotor.mass,
            "f_0": bearing.weight + self._law.bias_force,
            "bias": self._law.bias_force,
            "K_sen": bearing.sensor.gain,
            "T_sen": bearing.sensor_lag,
            "travel": bearing.rotor.travel_limit,
            "substeps": parts.substeps(bearing, self.scenario.substeps),
            "parts": parts.parts_of(bearing, precision),
            "coil": None if self._coil is None else core.Law(**self._coil),
        }

    def _whole_controller(self) -> dict[str, Any]:
        """Return what a core is told of a controller that is more than a PID, if it is."""
        if self.estimator is None or not self._whole:
            return {}
        scenario = self.scenario
        controller = Controller.of_axis(
            self.bearing, self.estimator, scenario.controller, scenario.sequence
        )
        hovers = scenario.start == "hover" or self._fly is None
        lies: dict[str, Any] = {} if hovers else {"hovers": False, "current": 0.0}
        if not hovers and self._place is None:
            lies["place"] = float(controller.down[0])
        integral = controller.integral(self._held, self._start)
        return lies | {"control": controller.in_core(), "integral": integral}

    def run(self, until: float | None = None) -> Run:
        """Go on, to the end of the scenario or to a time before it."""
        bearing, estimator = self.bearing, self.estimator
        precision = "float64" if estimator is None else estimator.precision
        if self._at == 0:
            self._precision = precision
        elif precision != self._precision:
            raise ValueError(
                f"the loop began in {self._precision} and cannot go on with an estimator in "
                f"{precision}"
            )
        T, n = bearing.sampling_time, self._t.size
        end = n if until is None else min(n, math.ceil(until / T - 1e-6))
        if end < self._at + 2:
            raise ValueError(
                f"until must be 2 samples or more after {self._at * T:g} s, where the loop is, and "
                f"the run ends at {(n - 1) * T:g} s; is {until!r}"
            )
        if self._faults is not None and end < n:
            raise ValueError(f"a loop with faults runs in one go; until must be None, is {until!r}")
        here = slice(self._at, end)
        if self._at == 0 and estimator is not None:
            estimator.reset(self.start)
        core = core_module(precision) if estimator is None else estimator.engine.core
        self._state = self._state or core.LoopState()

        def given(values: NDArray[np.float64]) -> NDArray[Any]:
            return np.ascontiguousarray(values[here], dtype=precision)

        noise_u, noise_y = self.noise
        out = core.simulate(
            **self.arguments(core, given),
            noise_u=given(noise_u),
            noise_y=given(noise_y),
            state=self._state,
        )
        self._at = end
        told = dict(zip(("x", "v", "x_m"), out["X"], strict=True))
        told |= {name: out[name][:, 0] for name in ("iu", "y", "u")}
        signals = {name: values.astype(float, copy=False) for name, values in told.items()}
        if self._faults is not None:  # a record holds no infinities
            signals |= {k: np.where(np.isinf(signals[k]), np.nan, signals[k]) for k in "yu"}
        signals |= {name: self._series[name][here] for name in ("r", "f_d")}
        if self._injected is not None:
            signals["injected"] = self._injected[here]
        signals["f_mag"] = out["force"][:, 0] + (bearing.weight + self._law.bias_force)
        signals["f_mag"] = (signals["f_mag"] - bearing.weight).astype(float, copy=False)
        signals |= {k: out[k].astype(float, copy=False) for k in COIL_UNITS if k in out}
        if self._fly is not None:
            signals["mode"] = out["mode"].astype(float)
        meta = {
            "bearing": _said(bearing),
            "scenario": self.scenario.model_dump(mode="json"),
            "seed": self.scenario.seed,
            "run": self.scenario.run,
            "version": own_version(),
            "stop_touched": int(out["touched"]),
            "first_touch": here.start + int(out["first"]) if out["touched"] else None,
        }
        t = self._t[here]
        known = UNITS | {"u": bearing.amplifier.control_unit}
        known |= INJECTED_UNITS | COIL_UNITS | MODE_UNITS
        units = {name: unit for name, unit in known.items() if name in signals}
        record = Record(t, {name: signals[name] for name in units}, units, meta=meta)
        usable = out["usable"].astype(bool) if "usable" in out else None
        estimate = None if estimator is None else estimator.told(t, out["estimate"])
        return Run(bearing, record, estimate, out["status"], usable)


@lru_cache(maxsize=64)
def _said(bearing: Bearing) -> str:
    """Return a bearing as text, which many runs of it share."""
    return bearing.to_toml()
