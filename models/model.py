"""A model's equations as symbols, and what follows from them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy as sp
from sympy.integrals.quadrature import gauss_legendre

Expr = Any


@dataclass(frozen=True)
class Model:
    """One model: its symbols and its equations, as the source states them."""

    name: str
    about: str
    state: list[Expr]
    parameters: list[Expr]
    kept: list[Expr]
    factors: dict[Expr, Expr]  # what the constants are formed from, first of all
    constants: dict[Expr, Expr]
    force: Expr
    control: Expr
    stiffness: list[Expr]
    gain: Expr
    transition: list[Expr]
    driving: Expr
    displacement: Expr
    total_force: Expr
    linear_force: Expr
    measurement: Expr
    control_variance: Expr
    growth: Expr  # the state that wanders
    growth_variance: Expr  # of its random walk, in one sample
    pushed: Callable[[Expr], list[Expr]]  # how far it moves the state, a share of a sample later
    measurement_variance: Expr
    printed: list[Expr]  # constants that are zero in the paper's equations

    @property
    def linear(self) -> sp.Matrix:
        """The transition with the linear force law put in: eq. 20 before it is sorted."""
        return self.forced.subs(self.force, self.linear_force)

    @property
    def forced(self) -> sp.Matrix:
        """The transition as it depends on state and force."""
        return sp.Matrix(self.transition).subs(self.driving, self.total_force)

    @property
    def held(self) -> tuple[sp.Matrix, sp.Matrix]:
        """L and b of ``L X + b F``, where F is all force on the rotor, held over the sample."""
        transition = sp.Matrix(self.transition)
        return transition.jacobian(self.state), transition.jacobian([self.driving])

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

    @cached_property
    def growth_constants(self) -> dict[Expr, Expr]:
        """Covariance that a growth of variance 1 leaves in the state, on the upper triangle.

        ``N = int_0^1 g(s) g(s)' ds`` with g(s) what the state has made of a growth the share s of a
        sample after it. By four points of Gauss and Legendre: exact but for the exponential in the
        sensor's row, whose share is right to four digits at the worst; and never indefinite by
        rounding.
        """
        n = len(self.state)
        nodes, weights = _gauss_legendre(4)
        N = sp.zeros(n, n)
        for node, weight in zip(nodes, weights, strict=True):
            g = sp.Matrix(self.pushed(node))
            g[self.state.index(self.growth)] = 1
            N += weight * g * g.T
        return {
            sp.Symbol(f"N{i}{j}"): N[i, j]
            for i, j in self.triangle()
            if not self.state[i] == self.state[j] == self.growth
        }

    @property
    def own_noise(self) -> sp.Matrix:
        """Growth of what is not modelled, in one sample."""
        return self.symmetric("G").subs(self.growth_in_sample)

    @property
    def growth_in_sample(self) -> dict[Expr, Expr]:
        """Upper triangle of :attr:`own_noise`; constant as long as the growth's variance is."""
        known = self.growth_constants
        entries = {pair: sp.Symbol("N{}{}".format(*pair)) for pair in self.triangle()}
        return {
            sp.Symbol("G{}{}".format(*pair)): self.growth_variance * (N if N in known else 1)
            for pair, N in entries.items()
        }

    def triangle(self) -> list[tuple[int, int]]:
        """Index pairs of the upper triangle in the order of storage."""
        n = len(self.state)
        return [(i, j) for i in range(n) for j in range(i, n)]

    def symmetric(self, name: str) -> sp.Matrix:
        """Symmetric matrix of the symbols that stand for a stored triangle."""
        n = len(self.state)
        matrix = sp.zeros(n, n)
        for i, j in self.triangle():
            matrix[i, j] = matrix[j, i] = sp.Symbol(f"{name}{i}{j}")
        return matrix

    def covariance(self) -> sp.Matrix:
        """Covariance of the state."""
        return self.symmetric("P")

    def predicted_covariance(self) -> sp.Matrix:
        """``A P A' + Q`` (eq. 10)."""
        return self.A * self.covariance() * self.A.T + self.Q


def _gauss_legendre(points: int) -> tuple[list[Expr], list[Expr]]:
    """Return nodes and weights on (0, 1)."""
    nodes, weights = gauss_legendre(points, 30)
    return [(1 + node) / 2 for node in nodes], [weight / 2 for weight in weights]
