"""The linear model that an estimator predicts with, as matrices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class LinearModel(NamedTuple):
    """``X(k+1) = A X(k) + B u(k) + E f_0``, ``y(k) = H X(k)`` (paper, eq. 15-21); all in SI."""

    A: Array  # (4, 4)
    B: Array  # (4, 1)
    E: Array  # (4, 1), by a force of 1 N
    H: Array  # (1, 4)
    Q: Array  # (4, 4)
    R: float

    @classmethod
    def of(cls, parameters: Mapping[str, Any], k_i: float, k_s: float) -> LinearModel:
        """Build it from what the C core holds (``core/generated/axial.h``).

        Parameters
        ----------
        parameters : mapping
            What an estimator of the core shows of itself.
        k_i, k_s : float
            Stiffnesses [N/A], [N/m].
        """
        c, s = parameters["model"], parameters["set"]
        E = np.array([[c["T2_2m"]], [c["T_m"]], [0.0], [c["d_sen"]]])
        A = np.array([
            [1.0, c["T"], 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
            [c["b_sen"], c["c_sen"], 0.0, c["a_sen"]],
        ])  # fmt: skip
        A += E @ np.array([[k_s, k_s * c["T_2"], 1.0, 0.0]])
        B = E * (k_i * s["k_ui"])
        growth = np.array([
            [c["N00"], c["N01"], c["N02"], c["N03"]],
            [c["N01"], c["N11"], c["N12"], c["N13"]],
            [c["N02"], c["N12"], 1.0, c["N23"]],
            [c["N03"], c["N13"], c["N23"], c["N33"]],
        ])  # fmt: skip
        Q = B @ B.T * s["var_u"] + growth * s["var_d"]
        return cls(A, B, E, np.array([[0.0, 0.0, 0.0, 1.0]]), Q, s["var_y"])

    def scaled(self, units: Array) -> LinearModel:
        """Return the model for states counted in these units (4,), for the numerics' sake."""
        D, inverse = np.diag(units), np.diag(1 / units)
        return self._replace(
            A=inverse @ self.A @ D,
            B=inverse @ self.B,
            E=inverse @ self.E,
            H=self.H @ D,
            Q=inverse @ self.Q @ inverse,
        )
