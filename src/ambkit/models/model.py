"""A sampled model as data: patterns, numbers and descriptors."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array

Pattern = NDArray[np.int8]

#: Entries of a pattern; 0 and 1 are the same in every machine of the kind.
ZERO, ONE, NUMBER = 0, 1, 2


POSITION, VELOCITY, SHOWN, LOAD, KNOWN, NOISE = ENUMERATORS = (
    "AMB_POSITION", "AMB_VELOCITY", "AMB_SHOWN", "AMB_LOAD", "AMB_KNOWN", "AMB_NOISE",
)  # fmt: skip
"""The enumerators of ``amb_role`` (``ambkit/role.h``), in their order there."""

ROLES = {
    "position": POSITION, "velocity": VELOCITY, "sensor": SHOWN, "disturbance force": LOAD,
    "noise": NOISE, "noise in quadrature": NOISE, "unbalance": NOISE, "runout": NOISE,
    "speed error": NOISE,
    "bending": NOISE, "bending velocity": NOISE, "lagged force": NOISE,
    "current": KNOWN, "past control": KNOWN,
}  # fmt: skip
"""Groups of states in the core (``ambkit/envelope.h``); readings exclude bending."""


@dataclass(frozen=True)
class Descriptor:
    """A state, force, control, measurement or noise, as in plots, records and exports."""

    name: str  #: Symbol, a C identifier: ``x``, ``f_d``.
    unit: str  #: SI unit; of a noise, that of its standard deviation.
    size: float  #: Typical size in that unit; of a noise, its standard deviation.
    role: str  #: Role; for a state one of `ROLES`.
    start: float = 1.0  #: Initial standard deviation of a state, in its typical sizes.

    def __post_init__(self) -> None:
        if not (self.name.isidentifier() and self.name.isascii()):
            raise ValueError(f"name must be an identifier of C, is {self.name!r}")
        if not (np.isfinite(self.size) and self.size > 0):
            raise ValueError(f"size of {self.name} must be positive, is {self.size!r}")


MATRICES = {
    "L": ("states", "states"),
    "b": ("states", "forces"),
    "B_u": ("states", "controls"),
    "h": ("forces", "states"),
    "e": ("forces", "states"),
    "d": ("forces", "controls"),
    "r": ("forces", "states"),
    "c": ("measurements", "states"),
    "N": ("noises", "states", "states"),
    "rest": ("states", "states"),
}
"""Rows and columns of each matrix."""


@dataclass(frozen=True, eq=False)
class Model:
    """A machine over one sample, exact for magnet forces held over it."""

    # ``X+ = L X + B_u u + sum_f b_f F_f + noise`` with ``F_f = magnet_f(i_f, s_f) + f_0f + r_f X``,
    # ``i_f = e_f X + d_f u``, ``s_f = h_f X`` and ``y = c X + v``; currents and displacements are
    # means over the sample. SI; u are the commanded currents [A] of this sample. Arrays are
    # read-only.

    name: str  #: Kind of machine, an identifier of C.
    T: float  #: Sampling time [s].
    states: tuple[Descriptor, ...]  #: The n states, in order.
    forces: tuple[Descriptor, ...]  #: The p magnets' forces.
    controls: tuple[Descriptor, ...]  #: The commanded currents, one per amplifier.
    measurements: tuple[Descriptor, ...]  #: The m sensors' readings.
    noises: tuple[Descriptor, ...]  #: Independent noises besides that of the controls.
    L: Array  #: Transition (n, n), without the forces.
    b: Array  #: Effect of a held force of 1 N on the state (n, p).
    B_u: Array  #: Direct effect of a commanded current of 1 A (n, c).
    h: Array  #: Mean displacement in each magnet, for the rotor's free motion (p, n).
    e: Array  #: Mean current of each magnet, by the state (p, n).
    d: Array  #: Mean current of each magnet, by the commanded currents (p, c).
    r: Array  #: States that act at the place of a magnet (p, n).
    c: Array  #: Measurements (m, n).
    N: Array  #: Covariance of the state from a source of variance 1 over a sample (k, n, n).
    rest: Array  #: Equilibrium of each state by the free ones, whose rows are the identity (n, n).
    pattern: Mapping[str, Pattern] = field(repr=False)
    """For each matrix, of equal shape: `ZERO`, `ONE` or `NUMBER`, by the kind of machine only."""

    def __repr__(self) -> str:
        names = ", ".join(state.name for state in self.states)
        return f"<Model {self.name}, sampled every {self.T:g} s: {names}>"

    def __post_init__(self) -> None:
        if not (self.name.isidentifier() and self.name.isascii()):
            raise ValueError(f"name must be an identifier of C, is {self.name!r}")
        patterns = {}
        for name in MATRICES:
            values = np.array(getattr(self, name), float)
            pattern = np.array(self.pattern[name], np.int8)
            shape = tuple(len(getattr(self, of)) for of in MATRICES[name])
            if not values.shape == pattern.shape == shape:
                raise ValueError(
                    f"{name} must be of shape {shape}, is of {values.shape} in a pattern of "
                    f"{pattern.shape}"
                )
            if ((values != pattern) & (pattern != NUMBER)).any():
                raise ValueError(f"{name} has other numbers where its pattern says 0 or 1")
            if not np.isfinite(values).all():
                raise ValueError(f"{name} must be finite")
            values.setflags(write=False)
            pattern.setflags(write=False)
            object.__setattr__(self, name, values)
            patterns[name] = pattern
        object.__setattr__(self, "pattern", MappingProxyType(patterns))
        names = [at.name for at in self.states]
        if len(set(names)) < len(names):
            raise ValueError(f"names of states must differ, are {names}")

    def index(self, state: str) -> int:
        """Return the index of a state; `KeyError` with the existing names."""
        names = [at.name for at in self.states]
        if state not in names:
            raise KeyError(f"no state {state}; there are {', '.join(names)}")
        return names.index(state)

    def pattern_key(self) -> str:
        """Return a hash (hex) of the sizes and patterns: equal for machines of one kind."""
        text = hashlib.sha256()
        for name in MATRICES:
            pattern = self.pattern[name]
            text.update(f"{name}{pattern.shape}".encode() + pattern.tobytes())
        return text.hexdigest()

    def jacobian(self, k_i: ArrayLike, k_s: ArrayLike) -> Array:
        """Return A (n, n), the transition with the linearised forces."""
        # k_i (..., p) [N/A]; k_s (..., p) [N/m]
        i, s = self._per_force(k_i)[..., None], self._per_force(k_s)[..., None]
        return self.L + self.b @ (s * self.h + i * self.e + self.r)

    def input_matrix(self, k_i: ArrayLike) -> Array:
        """Return B (n, c) by the commanded currents [A], with current stiffnesses (p,) [N/A]."""
        return self.B_u + self.b @ (self._per_force(k_i)[..., None] * self.d)

    def process_noise(self, k_i: ArrayLike, var_u: ArrayLike, var_noise: ArrayLike) -> Array:
        """Return Q (n, n)."""
        # k_i (p,) [N/A]; var_u (c,) [A^2]; var_noise (k,)
        B = self.input_matrix(k_i)
        scales = np.broadcast_to(np.asarray(var_noise, float), len(self.noises))
        driven = (B * np.asarray(var_u, float)) @ np.swapaxes(B, -1, -2)
        return np.asarray(driven + np.tensordot(scales, self.N, 1))

    def _per_force(self, values: ArrayLike) -> Array:
        values = np.asarray(values, float)
        return np.broadcast_to(values, (*values.shape[:-1], len(self.forces)))


def compressed_rows(
    values: Array, there: NDArray[np.bool_]
) -> tuple[list[int], list[int], list[float]]:
    """Return the structural entries of a matrix, row by row."""
    # values (rows, columns); there (rows, columns)
    row, column = np.nonzero(there)
    start = np.searchsorted(row, np.arange(len(values) + 1))
    return start.tolist(), column.tolist(), values[row, column].tolist()
