"""The linear model that an estimator predicts with, as matrices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.models.model import Model

Array = NDArray[np.float64]


class LinearModel(NamedTuple):
    """``X(k+1) = A X(k) + B u(k) + E f_0``, ``y(k) = H X(k)`` (paper, eq. 15-21); all in SI.

    Of one force, one control and one sensor.
    """

    A: Array  # (n, n)
    B: Array  # (n, 1)
    E: Array  # (n, 1), by a force of 1 N
    H: Array  # (1, n)
    Q: Array  # (n, n)
    R: float

    @classmethod
    def of(cls, model: Model, k_i: float, k_s: float, settings: Mapping[str, Any]) -> LinearModel:
        """Return a model with the noise of some settings of the core, at a working point."""
        gain = settings["k_ui"][0]
        return cls(
            A=model.jacobian(k_i, k_s),
            B=model.input_matrix(k_i) * gain,
            E=model.b.copy(),
            H=model.c.copy(),
            Q=model.process_noise(k_i, gain**2 * settings["var_u"][0], settings["var_d"]),
            R=settings["var_y"][0],
        )

    def scaled(self, units: Array) -> LinearModel:
        """Return the model for states counted in these units (n,), for the numerics' sake."""
        D, inverse = np.diag(units), np.diag(1 / units)
        return self._replace(
            A=inverse @ self.A @ D,
            B=inverse @ self.B,
            E=inverse @ self.E,
            H=self.H @ D,
            Q=inverse @ self.Q @ inverse,
        )
