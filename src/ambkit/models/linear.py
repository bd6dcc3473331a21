"""Linear systems as matrices with named signals, and a machine linearised at an operating point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array, Complex
from ambkit.machine.magnets import core_module
from ambkit.models.declaration import Part, Plan
from ambkit.models.sampling import Sampling

MOST_AT_ONCE = 4096  #: Maximum number of frequencies per solution, which limits the memory.

MANY_STATES, WORST_VECTORS, NEAR_ONE = 10, 1e9, 1e-6
"""Minimum number of states for a modal response, and maximum condition number of the eigenvectors;
z must not be closer to 1 than the last, because rounding grows there with the inverse powers of
z - 1 of a chain of integrators.
"""

LATE, LEFT = 1e-3, 8
"""Magnitude of z below which a pole belongs to a dead time, with dependent eigenvectors, and
further terms of its series in 1/z.
"""


class Signal(NamedTuple):
    """Name and SI unit of a state, input or output."""

    name: str
    unit: str


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """``X+ = A X + B w, z = C X + D w``, or in continuous time ``dX/dt = A X + B w``; all in SI."""

    A: Array  #: (n, n) (n, inputs) (outputs, n) (outputs, inputs) The matrices.
    B: Array
    C: Array
    D: Array
    T: float | None  #: Sampling time [s]; None: continuous.
    states: tuple[Signal, ...]  #: Names and units of the states.
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]

    def select(self, outputs: Sequence[str], inputs: Sequence[str]) -> LinearSystem:
        """Return the system with some of its outputs and inputs, by name."""
        return self.part(_places(self.outputs, outputs), _places(self.inputs, inputs))

    def part(self, outputs: slice | list[int], inputs: slice | list[int]) -> LinearSystem:
        """Return the system with some of its outputs and inputs, by index."""
        z, w = np.arange(len(self.outputs))[outputs], np.arange(len(self.inputs))[inputs]
        return replace(
            self, B=self.B[:, w], C=self.C[z], D=self.D[np.ix_(z, w)],
            inputs=tuple(self.inputs[i] for i in w), outputs=tuple(self.outputs[i] for i in z),
        )  # fmt: skip

    def response(self, frequency: ArrayLike) -> Complex:
        """Return the frequency response (k, outputs, inputs)."""
        # frequency (k,) [Hz]
        s = 2j * np.pi * np.atleast_1d(np.asarray(frequency, float))
        n = len(self.A)
        if self.T is None:
            shift, A = s, self.A
        else:
            # z - 1 to all digits: at low frequencies the poles near 1 dominate.
            half = s * self.T / 2
            shift, A = 2 * np.exp(half) * np.sinh(half), self.A - np.eye(n)
        modes = self._modes if self.T is not None and n >= MANY_STATES else None
        near = np.abs(shift) < NEAR_ONE if modes is not None else np.ones(len(shift), bool)
        result = np.empty((len(shift), *self.D.shape), complex)
        for at in _pieces(np.flatnonzero(near)):
            solved = np.linalg.solve(shift[at, None, None] * np.eye(n) - A, self.B + 0j)
            result[at] = self.D + self.C @ solved
        if modes is not None:
            poles, parts = modes
            for at in _pieces(np.flatnonzero(~near)):
                late = (1 + shift[at, None]) ** -np.arange(1, len(parts) - len(poles) + 1)
                sums = np.hstack([1 / (shift[at, None] - poles), late]) @ parts
                result[at] = self.D + sums.reshape(len(at), *self.D.shape)
        return result

    @cached_property
    def _modes(self) -> tuple[Complex, Complex] | None:
        """Poles (m,) of z - 1 and residues; then the series in 1/z of the dead time's poles."""
        # None if the eigenvectors of the former are nearly dependent. The residues are (m + terms,
        # outputs inputs). The latter are separated (Bavely and Stewart 1979, An algorithm for
        # computing reducing subspaces by block diagonalization).
        from scipy.linalg import matrix_balance, schur, solve_sylvester

        A, (size, _) = matrix_balance(self.A - np.eye(len(self.A)), permute=False, separate=True)
        late_first: Any = lambda pole: abs(1 + pole) < LATE  # noqa: E731
        R, Q, n = schur(A, output="complex", sort=late_first)
        poles, V = np.linalg.eig(R[n:, n:])
        shared = solve_sylvester(R[:n, :n], -R[n:, n:], -R[:n, n:]) @ V if 0 < n < len(R) else 0
        basis = Q @ np.block(
            [[np.eye(n), np.zeros((n, len(V))) + shared], [np.zeros((len(V), n)), V]]
        )
        if not np.linalg.cond(basis) < WORST_VECTORS:
            return None
        C, B = self.C * size @ basis, np.linalg.solve(basis, self.B / size[:, None] + 0j)
        residues = C.T[n:, :, None] * B[n:, None, :]
        late, powers = C[:, :n], []
        for _ in range(n + LEFT if n else 0):
            powers.append(late @ B[:n])
            late = late @ (R[:n, :n] + np.eye(n))
        parts = np.concatenate([residues, np.reshape(powers, (-1, *self.D.shape))])
        return np.asarray(poles, complex), np.asarray(parts.reshape(len(parts), -1), complex)

    def poles(self) -> Complex:
        """Return the poles (n,): in z, or in continuous time in s [1/s]."""
        return self._poles

    @cached_property
    def _poles(self) -> Complex:
        return np.asarray(np.linalg.eigvals(self.A), complex)

    def unstable(self) -> Complex:
        """Return the poles outside the unit circle, or in continuous time the growing ones."""
        poles = self.poles()
        if self.T is None:
            return poles[poles.real > EDGE * max(1.0, float(np.abs(poles).max(initial=0)))]
        return poles[np.abs(poles) > 1 + EDGE]


EDGE = 1e-9  #: Tolerance for a pole on the stability limit, as of an integrator.


def _pieces(places: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Return indices in batches of at most `MOST_AT_ONCE`."""
    if len(places) <= MOST_AT_ONCE:
        return [places] if len(places) else []
    return np.array_split(places, -(-len(places) // MOST_AT_ONCE))


def _places(signals: Sequence[Signal], names: Sequence[str]) -> list[int]:
    known = [at.name for at in signals]
    for name in names:
        if name not in known:
            raise ValueError(f"no signal {name}; there are {', '.join(known)}")
    return [known.index(name) for name in names]


LOAD = "disturbance force"


def linearised(
    parts: Sequence[Part], T: float, k_i: ArrayLike, k_s: ArrayLike, *, continuous: bool = False
) -> LinearSystem:
    """Return a machine with linear magnets: inputs commanded currents and disturbances."""
    # For machines of equal structure with arrays (n,) as numbers, matrices are (n, ...). Sampled,
    # it is exact: the position stiffness acts within the sample (it is part of the exponential),
    # commanded currents and disturbances are held over it, and if a dead time ends within the
    # sample, the transition is the product of those before and after. k_i (..., p) [N/A]; k_s (...,
    # p) [N/m]
    plan = Plan(T)
    for part in parts:
        plan.add(part)
    plan.check()
    if continuous and plan.past:
        raise ValueError("a dead time has no state space in continuous time")
    full_sampling = Sampling(plan)
    n, p, c, _ = full_sampling.sizes
    i, s = (np.broadcast_to(k, (*np.shape(k)[:-1], p))[..., None] for k in (k_i, k_s))
    loads = [k for k, at in enumerate(plan.states) if at.role == LOAD]
    state_indices = [k for k in range(n) if k not in loads]
    moving = [*range(n), *range(n + p, n + p + c)]

    def rates(after: float) -> Array:
        """Return the rates of states and controls, with the magnet forces inserted."""
        G = full_sampling.generator(after)
        displaced = slice(n + p + c, n + 2 * p + c)
        seen = s * G[..., displaced, :] * T + i * G[..., n + 2 * p + c :, :] * T
        for state, force in plan.riders.items():
            seen[..., [at.name for at in plan.forces].index(force), full_sampling.at(state)] += 1
        driven = G + G[..., n : n + p] @ seen
        return np.asarray(driven[..., moving, :][..., moving])

    if continuous:
        Phi = rates(0.0)
    else:
        shares = {share for _, share in plan.past.values() if share < 1}
        Phi = np.eye(n + c)
        for start, end in pairwise([0.0, *sorted(shares), 1.0]):
            Phi = core_module().transition(rates(start), (end - start) * T) @ Phi
        for control, (past, _share) in plan.past.items():
            for k, state in enumerate(past):
                Phi[..., full_sampling.at(state), :] = 0
                source = full_sampling.at(past[k - 1]) if k else full_sampling.at(control) - p
                Phi[..., full_sampling.at(state), source] = 1
    inputs = [*range(n, n + c), *loads]
    positions = [k for k in state_indices if plan.states[k].role == "position"]
    readings = full_sampling.linear_forms(plan.readings)[0]
    C = np.concatenate([readings, np.broadcast_to(
        np.eye(n)[positions], (*readings.shape[:-2], len(positions), n)
    )], axis=-2)[..., state_indices]  # fmt: skip
    states = [Signal(at.name, at.unit) for at in plan.states]
    controls, measured = (
        [Signal(at.name, at.unit) for at in of] for of in (plan.controls, plan.measurements)
    )
    return LinearSystem(
        Phi[..., state_indices, :][..., state_indices], Phi[..., state_indices, :][..., inputs], C,
        np.zeros((C.shape[-2], len(inputs))),
        None if continuous else T, tuple(states[k] for k in state_indices),
        (*controls, *(states[k] for k in loads)), (*measured, *(states[k] for k in positions)),
    )  # fmt: skip


KNOWN = 1e-8  #: Relative singular value below which it is rounding.


def pulse_sizes(A: Array, B: Array) -> Array:
    """Return the largest magnitudes of the states (n,) after a pulse of the inputs."""
    pulsed = [B]
    for _ in A:
        pulsed.append(A @ pulsed[-1])
    return np.asarray(np.abs(pulsed).max(axis=(0, 2)))


def realised(
    response: Array, T: float, inputs: Sequence[Signal], outputs: Sequence[Signal], blocks: int
) -> LinearSystem:
    """Return a realisation of an impulse response (n, outputs, inputs); Juang and Pappa 1985."""
    # Inputs and outputs are scaled to similar sizes first, because the order follows from ratios.
    out = np.sqrt((response**2).sum(axis=(0, 2)).max(initial=0)) or 1.0
    rows = np.sqrt((response**2).sum(axis=(0, 2))) / out
    rows = np.where(rows > 0, rows, 1.0)
    columns = np.sqrt(((response / rows[:, None]) ** 2).sum(axis=(0, 1)))
    columns = np.where(columns > 0, columns, 1.0)
    h = response / rows[:, None] / columns
    p, m = h.shape[1:]
    at = np.add.outer(np.arange(blocks), np.arange(blocks))
    first, shifted = (
        h[at + k].transpose(0, 2, 1, 3).reshape(blocks * p, blocks * m) for k in (1, 2)
    )
    U, s, Vt = np.linalg.svd(first, full_matrices=False)
    order = int((s > KNOWN * s[0]).sum())
    root = np.sqrt(s[:order])
    A = (U[:, :order] / root).T @ shifted @ (Vt[:order].T / root)
    B, C = (root[:, None] * Vt[:order])[:, :m], (U[:, :order] * root)[:p]
    states = tuple(Signal(f"s{k}", "1") for k in range(order))
    return LinearSystem(
        A, B * columns, C * rows[:, None], response[0], T, states, tuple(inputs), tuple(outputs)
    )
