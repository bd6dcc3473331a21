"""One closed loop as ambkit runs it; what comes from outside is the same for numba_loop.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ambkit
from ambkit import _core
from ambkit.models.plant_parts import axis_fields
from benchmarks.work import NOISE, Settings, Work

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClosedLoop:
    """Machine, scenario and what comes from outside, n samples each, as `core.simulate` asks."""

    bearing: ambkit.Machine
    scenario: ambkit.Scenario
    filter: ambkit.KalmanFilter
    settings: Settings
    r: Array
    f_d: Array
    noise_u: Array
    noise_y: Array
    integral: float

    @classmethod
    def of(cls, work: Work) -> ClosedLoop:
        """Take the scenario of `work`, and noise with the bearing's variances."""
        bearing, scenario, n = work.bearing, work.scenario, work.y.size
        rng = np.random.default_rng(scenario.seed)
        t = work.record.t
        f_d = scenario.disturbance.sample(t)
        return cls(
            bearing=bearing,
            scenario=scenario,
            filter=ambkit.KalmanFilter(bearing, noise=NOISE),
            settings=work.settings,
            r=scenario.reference.sample(t),
            f_d=f_d,
            noise_u=rng.normal(0.0, np.sqrt(bearing.amplifier.noise_variance), n),
            noise_y=rng.normal(0.0, np.sqrt(bearing.sensor.noise_variance), n),
            # At x = 0 the force of a two-sided magnet is linear in the current.
            integral=-(bearing.weight + float(f_d[0])) / ambkit.ConstantStiffness.of(bearing).k_i,
        )

    def core_run(self) -> dict[str, Any]:
        """Run it in one call into sim/, the linear filter feeding the controller."""
        b, pid = self.bearing, self.scenario.controller
        self.filter.reset()
        start = np.array([self.integral])
        magnet = ambkit.ClosedLaw(b).in_core(_core)
        loop = axis_fields(b, magnet, None, 0.0, self.scenario.substeps) | {
            "T": b.sampling_time,
            "k_ui": [b.amplifier.gain],
            "pid": [pid.kp, pid.ki, pid.kd, pid.derivative_filter, pid.anti_windup, 1.0,
                    b.current_min, b.current_max],
            "feedback_estimate": True,
        }  # fmt: skip
        result: dict[str, Any] = _core.simulate(
            loop,
            estimator=self.filter.core,
            r=self.r,
            load=self.f_d,
            noise_u=self.noise_u,
            noise_y=self.noise_y,
            place=np.zeros(1),
            current=start,
            integral=start,
        )
        columns = {name: result[name][:, 0] for name in ("iu", "y", "u", "force")}
        return result | columns | dict(zip(("x", "v", "x_m"), result["X"], strict=True))

    def public_run(self) -> ambkit.Estimate:
        """Run it as users do: noise is drawn, signals are checked and labelled."""
        run = ambkit.simulate(self.bearing, self.scenario, filter=self.filter)
        assert run.estimate is not None  # an estimator is given
        return run.estimate
