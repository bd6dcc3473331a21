"""Low-pass filters with numerical derivatives: the usual approach without a noise model."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.estimate.core_model import Engine
from ambkit.estimate.estimator import Arguments, Estimator
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, core_module
from ambkit.models.linear import LinearSystem, Signal


class LowPass(Estimator):
    """First-order low-pass of the measurement, its difference quotient, and the force.

    The disturbance force is the unexplained acceleration force (paper, eq. 16, solved for it);
    currents that lag the controls follow the model. The sensor's lag is not compensated, coloured
    and line noise are not separated from the position, and the covariance is zero.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Magnet model; by default the constant stiffnesses at the origin.
    position, velocity, force : float or str, optional
        Corner frequencies [rad/s]. Defaults: the minimum of the squared errors by noise and by the
        lag under steps of the reference and the disturbance force.
    **options
        As for :class:`KalmanFilter`.

    Raises
    ------
    ValueError
        A corner is not positive and finite.
    """

    name = "low-pass and derivative"
    binding = "LowPass"
    steady = "constant"
    by_model = False
    predicts = "no model: exponential averages"
    has_noise_estimate = False
    several_axes = False

    def __init__(
        self,
        machine: Machine,
        magnet: MagnetModel | None = None,
        *,
        position: QuantityLike | None = None,
        velocity: QuantityLike | None = None,
        force: QuantityLike | None = None,
        **options: Any,
    ) -> None:
        arguments = {"position": position, "velocity": velocity, "force": force}
        corners = {name: in_si(name, corner, "rad/s") for name, corner in arguments.items()}
        self.corners = {name: c for name, c in corners.items() if c is not None}
        for name, corner in self.corners.items():
            if not (math.isfinite(corner) and corner > 0):
                raise ValueError(f"{name} must be greater than 0 rad/s, got {corner!r}")
        super().__init__(machine, magnet, **options)

    def _usual_corners(self) -> dict[str, float]:
        """Return the corner frequencies of least error [rad/s], of noise and lag."""
        R, Q = self.variances.measurement, self.variances.disturbance
        corners = core_module().corners(self.view.seen_by, R, Q)
        return dict(zip(("position", "velocity", "force"), corners, strict=True))

    def linear_system(self) -> LinearSystem:
        """Return position and velocity of ``core/src/low_pass.c``; its force is separate."""
        T, gain = self.machine.sampling_time, self.machine.sensor.gain
        a, b = (-np.expm1(-self.corners[name] * T) for name in ("position", "velocity"))
        # x += a (y/K - x) =: dx, then v += b (dx/T - v)
        A = np.array([[1 - a, 0.0], [-a * b / T, 1 - b]])
        B = np.array([[a / gain, 0.0], [a * b / (T * gain), 0.0]])
        return LinearSystem(
            A, B, A, B, T, (Signal("x", "m"), Signal("v", "m/s")),
            (Signal("y", "m"), Signal("u", "V")),
            (Signal("position", "m"), Signal("velocity", "m/s")),
        )  # fmt: skip

    def _arguments(self, engine: Engine, settings: dict[str, Any]) -> Arguments:
        T = self.machine.sampling_time
        self.corners = self._usual_corners() | self.corners
        coefficients = {name: -math.expm1(-corner * T) for name, corner in self.corners.items()}
        return (), {"m": self.machine.rotor.mass, **coefficients}
