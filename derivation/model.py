"""From a model's equations to straight-line C: prediction, covariance step, measurement update.

The covariance is its upper triangle, row by row; nothing else is ever stored, so it cannot lose
symmetry. SymPy's common subexpressions find the sparse structure; there are no branches, so the
same text compiles for float, double and SIMD lanes.
"""

from dataclasses import dataclass
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
    linear_force: Expr
    measurement: Expr
    control_variance: Expr
    extra_noise: dict[Expr, Expr]
    measurement_variance: Expr

    @property
    def linear(self) -> sp.Matrix:
        """The transition with the linear force law put in: eq. 20 before it is sorted."""
        return sp.Matrix(self.transition).subs(self.force, self.linear_force)

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
        own = sp.diag(*[self.extra_noise.get(s, 0) for s in self.state])
        return self.control_variance * self.B * self.B.T + own

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
