"""A plant and a compensator in a loop, broken at the measurement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.models.linear import Complex, LinearSystem, Signal

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Loop:
    """A sampled loop of m measurements, c controls, l loads and q positions.

    Attributes
    ----------
    plant : LinearSystem
        Inputs: c control signals [V], then l loads [N]; outputs: m measurements, then q positions
        [m]. From control to measurement without feedthrough.
    compensator : LinearSystem
        Inputs: m measurements, then references [m]; outputs: c control signals [V].
    measurements : int
        m.
    """

    plant: LinearSystem
    compensator: LinearSystem
    measurements: int = 1

    @property
    def T(self) -> float:
        """Sampling time [s]."""
        assert self.plant.T is not None
        return self.plant.T

    @property
    def nyquist(self) -> float:
        """Half the sampling rate [Hz]."""
        return 0.5 / self.T

    @cached_property
    def closed(self) -> LinearSystem:
        """The closed loop, from all that comes from outside.

        Inputs: m noises ``n_y`` on the measurements [m], l loads [N], c noises ``n_u`` on the
        control signals [V], the references [m]. Outputs: m readings without the noise [m], q
        positions [m], c control signals [V] as the compensator gives them.
        """
        P, K, m = self.plant, self.compensator, self.measurements
        c = len(K.outputs)
        B_u, B_f, C_y = P.B[:, :c], P.B[:, c:], P.C[:m]
        B_y, D_y = K.B[:, :m], K.D[:, :m]
        A = np.block([[P.A + B_u @ D_y @ C_y, B_u @ K.C], [B_y @ C_y, K.A]])
        B_r, D_r = K.B[:, m:], K.D[:, m:]
        none = np.zeros((len(K.A), B_f.shape[1] + c))
        B = np.block([[B_u @ D_y, B_f, B_u, B_u @ D_r], [B_y, none, B_r]])
        C = np.block([[P.C, np.zeros((len(P.C), len(K.A)))], [D_y @ C_y, K.C]])
        D = np.zeros((len(C), B.shape[1]))
        D[-c:, :m], D[-c:, B.shape[1] - D_r.shape[1] :] = D_y, D_r
        noises = (Signal(f"n_{at.name}", at.unit) for at in P.outputs[:m])
        shaken = (Signal(f"n_{at.name}", at.unit) for at in P.inputs[:c])
        return LinearSystem(
            A, B, C, D, P.T, P.states + K.states,
            (*noises, *P.inputs[c:], *shaken, *K.inputs[m:]), (*P.outputs, *K.outputs),
        )  # fmt: skip

    @cached_property
    def is_stable(self) -> bool:
        """Whether all poles of the closed loop are within the unit circle."""
        return bool((np.abs(self.closed.poles()) < 1).all())

    def unstable_poles(self) -> Complex:
        """Return the unstable poles of the open loop: of plant and compensator, each alone."""
        return np.concatenate([self.plant.unstable(), self.compensator.unstable()])

    def open(self, frequency: ArrayLike) -> Complex:
        """Return the open loop L (k, m, m) at the measurements, such that ``S = 1/(1 + L)``.

        Parameters
        ----------
        frequency : array_like (k,)
            Frequencies [Hz], above 0 up to `nyquist`.
        """
        m, c = self.measurements, len(self.compensator.outputs)
        P, K = self.plant.response(frequency), self.compensator.response(frequency)
        return np.asarray(-P[:, :m, :c] @ K[:, :, :m])

    def sensitivity(self, frequency: ArrayLike) -> Complex:
        """Return S (k, m, m): from what is added to the measurements to the measurements [1].

        Its diagonal is the sensitivity of each axis with all other loops closed.

        Parameters
        ----------
        frequency : array_like (k,)
            Frequencies [Hz].
        """
        L = self.open(frequency)
        return np.asarray(np.linalg.inv(np.eye(self.measurements) + L))

    def largest_sensitivity(self, frequency: ArrayLike) -> Array:
        """Return the largest singular value of S (k,) [1]; of one axis, its magnitude.

        Parameters
        ----------
        frequency : array_like (k,)
            Frequencies [Hz].
        """
        return np.asarray(np.linalg.norm(self.sensitivity(frequency), 2, axis=(1, 2)))

    def complementary(self, frequency: ArrayLike) -> Complex:
        """Return T = 1 - S (k, m, m) [1].

        Parameters
        ----------
        frequency : array_like (k,)
            Frequencies [Hz].
        """
        return np.asarray(np.eye(self.measurements) - self.sensitivity(frequency))

    def _of(self, outputs: slice, inputs: slice, frequency: ArrayLike) -> Complex:
        closed = self.closed
        part = replace(
            closed, B=closed.B[:, inputs], C=closed.C[outputs], D=closed.D[outputs, inputs],
            inputs=closed.inputs[inputs], outputs=closed.outputs[outputs],
        )  # fmt: skip
        return part.response(frequency)

    @property
    def _positions(self) -> slice:
        return slice(self.measurements, len(self.plant.outputs))

    @property
    def _loads(self) -> slice:
        m = self.measurements
        return slice(m, m + len(self.plant.inputs) - len(self.compensator.outputs))

    def compliance(self, frequency: ArrayLike) -> Complex:
        """Return the positions by the loads (k, q, l) [m/N]; a load is held over each sample.

        Parameters
        ----------
        frequency : array_like (k,)
            Frequencies [Hz].
        """
        return self._of(self._positions, self._loads, frequency)

    def stiffness(self, frequency: ArrayLike) -> Complex:
        """Return the dynamic stiffness (k, l, q) [N/m], the inverse of the compliance.

        Parameters
        ----------
        frequency : array_like (k,)
            Frequencies [Hz].
        """
        return np.asarray(np.linalg.inv(self.compliance(frequency)))

    def control_by_load(self, frequency: ArrayLike) -> Complex:
        """Return the control signals by the loads (k, c, l) [V/N]; a load is held over each sample.

        Parameters
        ----------
        frequency : array_like (k,)
            Frequencies [Hz].
        """
        controls = slice(-len(self.compensator.outputs), None)
        return self._of(controls, self._loads, frequency)

    def noise_to_control(self, frequency: ArrayLike) -> Complex:
        """Return the control signals by the noise of the measurements (k, c, m) [V/m].

        Parameters
        ----------
        frequency : array_like (k,)
            Frequencies [Hz].
        """
        c = len(self.compensator.outputs)
        return self._of(slice(-c, None), slice(self.measurements), frequency)

    def noise_to_position(self, frequency: ArrayLike) -> Complex:
        """Return the positions by the noise of the measurements (k, q, m) [1].

        Parameters
        ----------
        frequency : array_like (k,)
            Frequencies [Hz].
        """
        return self._of(self._positions, slice(self.measurements), frequency)

    def noise_covariance(self, var_y: ArrayLike, var_u: ArrayLike) -> Array:
        """Return the stationary covariance of positions and control signals (q + c, q + c).

        Parameters
        ----------
        var_y : array_like (m,)
            Variances of white noise on the measurements [m^2].
        var_u : array_like (c,)
            Variances of white noise on the control signals [V^2], after the compensator.
        """
        closed, m, c = self.closed, self.measurements, len(self.compensator.outputs)
        shaken = m + len(self.plant.inputs) - c
        columns = [*range(m), *range(shaken, shaken + c)]
        variances = np.concatenate([np.atleast_1d(var_y), np.atleast_1d(var_u)])
        G, D, C = closed.B[:, columns], closed.D[m:, columns], closed.C[m:]
        # A sum of squares over ever longer times (Smith 1968): no digit is lost between units.
        power, X = closed.A, (G * variances) @ G.T
        for _ in range(DOUBLINGS):
            grown = power @ X @ power.T
            X, power = X + grown, power @ power
            if (np.abs(np.diag(grown)) <= 1e-16 * np.abs(np.diag(X))).all():
                break
        return np.asarray(C @ X @ C.T + (D * variances) @ D.T)


DOUBLINGS = 40
"""After so many a sum is over 10^12 samples."""
