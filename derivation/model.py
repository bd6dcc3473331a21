"""From a model's equations to straight-line C: prediction, covariance step, measurement update.

The covariance is its upper triangle, row by row; nothing else is ever stored, so it cannot lose
symmetry. There are no branches, so the same text compiles for float, double and SIMD lanes.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import sympy as sp

Expr = Any


@dataclass(frozen=True)
class Model:
    """One model: its symbols and its equations, as the source states them."""

    name: str
    about: str
    state: list[Expr]
    parameters: list[Expr]
    kept: list[Expr]
    constants: dict[Expr, Expr]
    force: Expr
    control: Expr
    stiffness: list[Expr]
    gain: Expr
    transition: list[Expr]
    driving: Expr
    whole_force: Expr
    linear_force: Expr
    measurement: Expr
    control_variance: Expr
    extra_noise: dict[Expr, Expr]
    measurement_variance: Expr

    @property
    def linear(self) -> sp.Matrix:
        """The transition with the linear force law put in: eq. 20 before it is sorted."""
        return self.forced.subs(self.force, self.linear_force)

    @property
    def forced(self) -> sp.Matrix:
        """The transition as it depends on state and force."""
        return sp.Matrix(self.transition).subs(self.driving, self.whole_force)

    @property
    def A(self) -> sp.Matrix:
        """System matrix, the Jacobian of the transition (eq. 20)."""
        return self.linear.jacobian(self.state)

    @property
    def B(self) -> sp.Matrix:
        """Input matrix (eq. 20)."""
        return self.linear.jacobian([self.control])

    @property
    def H(self) -> sp.Matrix:
        """Measurement matrix (eq. 21)."""
        return sp.Matrix([self.measurement]).jacobian(self.state)

    @property
    def Q(self) -> sp.Matrix:
        """Process noise covariance, ``B var B'`` and the growth of what is not modelled."""
        return self.control_variance * self.B * self.B.T + self.own_noise

    @property
    def own_noise(self) -> sp.Matrix:
        """Growth of what is not modelled, in one sample."""
        return sp.diag(*[self.extra_noise.get(s, 0) for s in self.state])

    def triangle(self) -> list[tuple[int, int]]:
        """Index pairs of the upper triangle in the order of storage."""
        n = len(self.state)
        return [(i, j) for i in range(n) for j in range(i, n)]

    def covariance(self) -> sp.Matrix:
        """Symmetric matrix of the symbols that stand for the stored triangle."""
        n = len(self.state)
        P = sp.zeros(n, n)
        for i, j in self.triangle():
            P[i, j] = P[j, i] = sp.Symbol(f"P{i}{j}")
        return P

    def predicted_covariance(self) -> sp.Matrix:
        """``A P A' + Q`` (eq. 10)."""
        return self.A * self.covariance() * self.A.T + self.Q

    def covariance_stages(self) -> tuple[list[tuple[Expr, Expr]], list[Expr]]:
        """Eq. 10 in stages, by way of the one force that drives the rotor.

        The next state is ``L X + b F`` with constant L and b, and all that changes from sample to
        sample is in the force ``F = h X + g u``. So the covariances of F with the state come first
        (w), with them those of the next state with the state (M), then those of the next state
        with F (z), and from M and z those of the next state with itself. That takes half the
        operations of ``A P A' + Q`` multiplied out.

        Returns
        -------
        stages : list of (symbol, expression)
            Intermediate results in the order in which they are computed.
        covariance : list of expressions
            Upper triangle of :meth:`predicted_covariance`, in terms of them.
        """
        transition, P = sp.Matrix(self.transition), self.covariance()
        L, b = transition.jacobian(self.state), transition.jacobian([self.driving])
        F = sp.Matrix([self.whole_force.subs(self.force, self.linear_force)])
        h, g = F.jacobian(self.state), F.diff(self.control)[0]
        stages: list[tuple[Expr, Expr]] = []

        def stage(matrix: sp.Matrix, name: str) -> sp.Matrix:
            """Give a symbol to each entry that is an expression."""
            for i, j in product(range(matrix.rows), range(matrix.cols)):
                if not matrix[i, j].is_Atom:
                    place = f"{i}{j}" if min(matrix.shape) > 1 else f"{i + j}"
                    stages.append((sp.Symbol(name + place), matrix[i, j]))
                    matrix[i, j] = stages[-1][0]
            return matrix

        gain = stage(sp.Matrix([g]), "g")
        noise = stage(gain * gain * self.control_variance, "q")
        w = stage(h * P, "w")
        M = stage(L * P + b * w, "M")
        z = stage(M * h.T + b * noise, "z")
        predicted = M * L.T + z * b.T + self.own_noise
        upper = [predicted[i, j] for i, j in self.triangle()]
        return _needed(stages, upper), upper


def _needed(stages: list[tuple[Expr, Expr]], results: list[Expr]) -> list[tuple[Expr, Expr]]:
    """Return the stages that the results ask for, directly or through others."""
    asked, kept = set().union(*(e.free_symbols for e in results)), []
    for symbol, expression in reversed(stages):
        if symbol in asked:
            kept.append((symbol, expression))
            asked |= expression.free_symbols
    return kept[::-1]
