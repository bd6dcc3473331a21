"""Closed loop of a plant and a compensator, opened at the measurement."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array, Complex
from ambkit.models.linear import LinearSystem, Signal


@dataclass(frozen=True, eq=False)
class Loop:
    """A loop of m measurements, c controls, l disturbances and q positions, with a axes."""

    #: Inputs: c control signals [V], then l disturbances [N]; outputs: m measurements, then q
    #: positions [m]. No feedthrough from control to measurement.
    plant: LinearSystem
    compensator: LinearSystem  #: Inputs: m measurements, references [m]; outputs: u [V].
    measurements: int = 1  #: m.
    measured: Array | None = (
        None  #: (a, m) Axes' displacements by the measurements; None: identity.
    )
    added: Array | None = None  #: (m, a) Measurements by the signals added at the axes.

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
        """The closed loop, from all external signals."""
        # Inputs: m noises ``n_y`` on the measurements [m], l disturbances [N], c noises ``n_u`` on
        # the control signals [V], the references [m]. Outputs: m readings without the noise [m], q
        # positions [m], c control signals [V] of the compensator.
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

    @property
    def axes(self) -> int:
        """Number a of axes."""
        return self.measurements if self.measured is None else len(self.measured)

    @cached_property
    def is_stable(self) -> bool:
        """Whether all poles of the closed, sampled loop are inside the unit circle."""
        return bool((np.abs(self.closed.poles()) < 1).all())

    def unstable_poles(self) -> Complex:
        """Return the unstable poles of the open loop: those of plant and compensator."""
        return np.concatenate([self.plant.unstable(), self.compensator.unstable()])

    @cached_property
    def _broken(self) -> tuple[LinearSystem, LinearSystem]:
        """Plant and compensator in series."""
        y, u = slice(self.measurements), slice(len(self.compensator.outputs))
        return self.plant.part(y, u), self.compensator.part(u, y)

    def open(self, frequency: ArrayLike) -> Complex:
        """Return the open loop L (k, m, m) at the measurements, with ``S = 1/(1 + L)``."""
        # frequency (k,) [Hz]
        P, K = (part.response(frequency) for part in self._broken)
        return np.asarray(-P @ K)

    def sensitivity(self, frequency: ArrayLike) -> Complex:
        """Return S (k, m, m): from a signal added to the measurements to the measurements [1]."""
        # frequency (k,) [Hz]
        L = self.open(frequency)
        return np.asarray(np.linalg.inv(np.eye(self.measurements) + L))

    def along_axes(self, frequency: ArrayLike) -> Complex:
        """S (k, a, a) from signals added at the axes' summing points to the displacements there."""
        # Its diagonal is the sensitivity of each axis with all other loops closed.
        # frequency (k,) [Hz]
        S = self.sensitivity(frequency)
        if self.measured is None or self.added is None:
            return S
        return np.asarray(self.measured @ S @ self.added)

    def of_axis(self, axis: int, frequency: ArrayLike) -> Complex:
        """Return S (k,) of one axis with all other loops closed [1]."""
        # frequency (k,) [Hz]
        return np.asarray(self.along_axes(frequency)[:, axis, axis])

    def largest_sensitivity(self, frequency: ArrayLike) -> Array:
        """Return the largest singular value of S along the axes (k,) [1]."""
        # frequency (k,) [Hz]
        return np.asarray(np.linalg.norm(self.along_axes(frequency), 2, axis=(1, 2)))

    def _of(self, outputs: slice, inputs: slice, frequency: ArrayLike) -> Complex:
        return self.closed.part(outputs, inputs).response(frequency)

    @property
    def _positions(self) -> slice:
        return slice(self.measurements, len(self.plant.outputs))

    @property
    def _loads(self) -> slice:
        m = self.measurements
        return slice(m, m + len(self.plant.inputs) - len(self.compensator.outputs))

    def driven(self, columns: Complex, frequency: float) -> tuple[Complex, Complex]:
        """Return positions (q,) [m] and control signals (c,) [V] under a rotating load."""
        # columns (n,)
        closed = self.closed
        B = np.zeros((len(closed.A), 1), complex)
        B[: len(self.plant.A), 0] = columns
        z = np.exp(2j * np.pi * frequency * self.T)
        X = np.asarray(np.linalg.solve(z * np.eye(len(closed.A)) - closed.A, B + 0j)[:, 0], complex)
        c = len(self.compensator.outputs)
        return np.asarray(closed.C[self._positions] @ X), np.asarray(closed.C[-c:] @ X)

    def compliance(self, frequency: ArrayLike) -> Complex:
        """Return the positions by the disturbances (k, q, l) [m/N], held over each sample."""
        # frequency (k,) [Hz]
        return self._of(self._positions, self._loads, frequency)

    def control_by_load(self, frequency: ArrayLike) -> Complex:
        """Return the control signals by the disturbances (k, c, l) [V/N], held over each sample."""
        # frequency (k,) [Hz]
        controls = slice(-len(self.compensator.outputs), None)
        return self._of(controls, self._loads, frequency)

    def noise_to_control(self, frequency: ArrayLike) -> Complex:
        """Return the control signals by the noise of the measurements (k, c, m) [V/m]."""
        # frequency (k,) [Hz]
        c = len(self.compensator.outputs)
        return self._of(slice(-c, None), slice(self.measurements), frequency)

    def noise_to_position(self, frequency: ArrayLike) -> Complex:
        """Return the positions by the noise of the measurements (k, q, m) [1]."""
        # frequency (k,) [Hz]
        return self._of(self._positions, slice(self.measurements), frequency)

    def noise_covariance(self, var_y: ArrayLike, var_u: ArrayLike) -> Array:
        """Return the stationary covariance of positions and control signals (q + c, q + c)."""
        # var_y (m,) [m^2]; var_u (c,) [V^2]
        closed, m, c = self.closed, self.measurements, len(self.compensator.outputs)
        shaken = m + len(self.plant.inputs) - c
        columns = [*range(m), *range(shaken, shaken + c)]
        variances = np.concatenate([np.atleast_1d(var_y), np.atleast_1d(var_u)])
        G, D, C = closed.B[:, columns], closed.D[m:, columns], closed.C[m:]
        # Sum of squares by doubling (Smith 1968): no digits are lost between units.
        power, X = closed.A, (G * variances) @ G.T
        for _ in range(DOUBLINGS):
            grown = power @ X @ power.T
            X, power = X + grown, power @ power
            if (np.abs(np.diag(grown)) <= 1e-16 * np.abs(np.diag(X))).all():
                break
        return np.asarray(C @ X @ C.T + (D * variances) @ D.T)


DOUBLINGS = 40  #: Doublings up to a sum over 10^12 samples.
