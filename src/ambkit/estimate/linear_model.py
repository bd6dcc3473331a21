"""The linear prediction model of an estimator, as matrices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.arrays import Array
from ambkit.estimate.noise_model import with_rounding
from ambkit.models.model import Model


class LinearModel(NamedTuple):
    """``X(k+1) = A X(k) + B u(k) + E f_0``, ``y(k) = H X(k)`` (paper, eq. 15-21); all in SI."""

    # For one axis and one sensor, or several.

    A: Array  # (n, n)
    B: Array  # (n, controls)
    E: Array  # (n, forces), by 1 N
    H: Array  # (sensors, n)
    Q: Array  # (n, n)
    R: Any  # scalar for one sensor; for several (sensors,)

    @classmethod
    def of(cls, model: Model, k_i: Any, k_s: Any, settings: Mapping[str, Any]) -> LinearModel:
        """Return a model with the noise of the core's settings, at an operating point."""
        gain, var_u = np.array(settings["k_ui"]), np.array(settings["var_u"])
        R = with_rounding(settings["var_y"], settings["step"], settings["dwell"])
        return cls(
            A=model.jacobian(k_i, k_s),
            B=model.input_matrix(k_i) * gain,
            E=model.b.copy(),
            H=model.c.copy(),
            Q=model.process_noise(k_i, gain**2 * var_u, settings["var_d"]),
            R=R[0] if len(R) == 1 else np.array(R),
        )

    def scaled(self, units: Array) -> LinearModel:
        """Return the model with states in other units (n,), for numerical reasons."""
        D, inverse = np.diag(units), np.diag(1 / units)
        return self._replace(
            A=inverse @ self.A @ D,
            B=inverse @ self.B,
            E=inverse @ self.E,
            H=self.H @ D,
            Q=inverse @ self.Q @ inverse,
        )
