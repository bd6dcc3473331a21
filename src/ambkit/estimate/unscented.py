"""Unscented Kalman filter: the force at points around the mean, instead of its tangent."""

from __future__ import annotations

import math
from typing import Any

from ambkit.estimate.core_model import Engine
from ambkit.estimate.estimator import Arguments, Estimator
from ambkit.machine.axes import ideal_laws
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel


class UnscentedKalmanFilter(Estimator):
    """Unscented Kalman filter: 2 n + 1 points around the mean pass through the force law.

    Three force evaluations are sufficient, because only the displacement enters the force
    (``core/include/ambkit/unscented.h``).

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Magnet model; by default the closed law.
    alpha, beta, kappa : float
        Spread of the points [1]: ``alpha sqrt(n + kappa)`` standard deviations from the mean of n
        states. The defaults, ``kappa = 3 - n``, give ``sqrt(3)``, the nodes of Gauss-Hermite
        quadrature.
    **options
        As for :class:`KalmanFilter`.

    Raises
    ------
    ValueError
        The parameters give no spread, or a negative variance.

    References
    ----------
    Julier & Uhlmann, A new extension of the Kalman filter to nonlinear systems, 1997; van der
    Merwe, Sigma-point Kalman filters for probabilistic inference, 2004.
    """

    name = "unscented Kalman filter"
    binding = "Unscented"
    _default_magnet = staticmethod(ideal_laws)
    steady = "tangent"

    def __init__(
        self,
        machine: Machine,
        magnet: MagnetModel | None = None,
        *,
        alpha: float = 1.0,
        beta: float = 0.0,
        kappa: float | None = None,
        **options: Any,
    ) -> None:
        self._spread: dict[str, Any] = {"alpha": alpha, "beta": beta, "kappa": kappa}
        super().__init__(machine, magnet, **options)

    def _arguments(self, engine: Engine, settings: dict[str, Any]) -> Arguments:
        n, alpha, beta = len(engine.states), self._spread["alpha"], self._spread["beta"]
        kappa = 3.0 - n if self._spread["kappa"] is None else self._spread["kappa"]
        for name, value, least in (("alpha", alpha, 0.0), ("kappa", kappa, -float(n))):
            if not (math.isfinite(value) and value > least):
                raise ValueError(f"{name} must be greater than {least:g}, got {value!r}")
        spread = alpha**2 * (n + kappa)
        self.reach = math.sqrt(spread)
        self.curvature = spread + beta - alpha**2
        if not (math.isfinite(self.curvature) and self.curvature >= 0):
            lowest = alpha**2 - spread
            raise ValueError(f"beta must be {lowest:.6g} or more for a variance, got {beta!r}")
        return (self.reach, self.curvature), {}
