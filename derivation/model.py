"""From a model's equations to straight-line C: prediction, covariance step, measurement update.

The covariance is its upper triangle, row by row; nothing else is ever stored, so it cannot lose
symmetry. There are no branches, so the same text compiles for float, double and SIMD lanes.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy as sp
from sympy.integrals.quadrature import gauss_legendre

Expr = Any
Sum = list[Expr]
"""Terms in the order in which they are added up."""


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
    whole_force: Expr
    linear_force: Expr
    measurement: Expr
    control_variance: Expr
    growth: Expr  # the state that wanders
    growth_variance: Expr  # of its random walk, in one sample
    pushed: Callable[[Expr], list[Expr]]  # how far it moves the state, a share of a sample later
    measurement_variance: Expr
    roles: list[str]  # of the states, amb_role
    at_rest: dict[Expr, Expr]  # states that follow from others when all is at rest
    printed: list[Expr]  # constants that are zero in the paper's equations

    @property
    def linear(self) -> sp.Matrix:
        """The transition with the linear force law put in: eq. 20 before it is sorted."""
        return self.forced.subs(self.force, self.linear_force)

    @property
    def forced(self) -> sp.Matrix:
        """The transition as it depends on state and force."""
        return sp.Matrix(self.transition).subs(self.driving, self.whole_force)

    @property
    def held(self) -> tuple[sp.Matrix, sp.Matrix]:
        """L and b of ``L X + b F``, where F is all force on the rotor, held over the sample."""
        transition = sp.Matrix(self.transition)
        return transition.jacobian(self.state), transition.jacobian([self.driving])

    @property
    def mean_sums(self) -> list[Sum]:
        """Eq. 9, row by row: the terms of ``L X + b F``."""
        L, b = self.held
        rows = range(len(self.state))
        return [product_terms([*L[i, :], b[i]], [*self.state, self.driving]) for i in rows]

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

    def covariance_stages(self) -> tuple[list[tuple[Expr, Sum]], list[Sum]]:
        """Eq. 10 in stages, by way of the one force that drives the rotor.

        The next state is ``L X + b F`` with constant L and b, and all that changes from sample to
        sample is in the force ``F = h X + g u``. So the covariances of F with the state come first
        (w), with them those of the next state with the state (M), then those of the next state
        with F (z), and from M and z those of the next state with itself. That takes half the
        operations of ``A P A' + Q`` multiplied out.

        Each step waits for the chain P, w, M, z, P+, so what is known last is added last: ``w_j``,
        entries of h from the last, which needs no product, to the first; ``M_ij``, entries of row i
        of L, then ``b_i w_j``; ``z_i``, noise of the control, then entries of h as in w; ``P+_ij``,
        entries of row j of L, growth, then ``b_j z_i``. Loops over the entries in this order give
        the same bits.

        Returns
        -------
        stages : list of (symbol, sum)
            Intermediate results in the order in which they are computed.
        covariance : list of sums
            Upper triangle of :meth:`predicted_covariance`, in terms of them and of
            :attr:`growth_in_sample`.
        """
        P, n = self.covariance(), len(self.state)
        L, b = self.held
        F = sp.Matrix([self.whole_force.subs(self.force, self.linear_force)])
        g = F.diff(self.control)[0]
        stages: list[tuple[Expr, Sum]] = []

        def stage(name: str, terms: Sum) -> Expr:
            """Give a symbol to what is no symbol or number yet."""
            if len(terms) == 1 and terms[0].is_Atom:
                return terms[0]
            stages.append((sp.Symbol(name), terms))
            return stages[-1][0]

        h = [stage(f"h{j}", [entry]) for j, entry in enumerate(F.jacobian(self.state))]
        gain = stage("g0", [g])
        noise = stage("q0", [gain * gain * self.control_variance])
        w = [stage(f"w{j}", product_terms(h[::-1], P[::-1, j])) for j in range(n)]
        M = [
            [stage(f"M{i}{j}", product_terms([*L[i, :], b[i]], [*P[:, j], w[j]])) for j in range(n)]
            for i in range(n)
        ]
        z = [
            stage(f"z{i}", product_terms([b[i], *M[i][::-1]], [noise, *h[::-1]])) for i in range(n)
        ]
        growth = self.symmetric("G")
        upper = [
            product_terms([*M[i], growth[i, j], z[i]], [*L[j, :], 1, b[j]])
            for i, j in self.triangle()
        ]
        return _needed(stages, upper), upper


def product_terms(left: Iterable[Expr], right: Iterable[Expr]) -> Sum:
    """Return the products of a scalar product that are not zero, in their order.

    They are added up in this order wherever the model is computed, so that the bits agree.
    """
    return [a * b for a, b in zip(left, right, strict=True) if a * b != 0]


def _gauss_legendre(points: int) -> tuple[list[Expr], list[Expr]]:
    """Return nodes and weights on (0, 1)."""
    nodes, weights = gauss_legendre(points, 30)
    return [(1 + node) / 2 for node in nodes], [weight / 2 for weight in weights]


def _needed(stages: list[tuple[Expr, Sum]], results: list[Sum]) -> list[tuple[Expr, Sum]]:
    """Return the stages that the results ask for, directly or through others."""
    asked, kept = _symbols(term for terms in results for term in terms), []
    for symbol, terms in reversed(stages):
        if symbol in asked:
            kept.append((symbol, terms))
            asked |= _symbols(terms)
    return kept[::-1]


def _symbols(terms: Iterable[Expr]) -> set[Expr]:
    """Return all symbols of some terms."""
    found: set[Expr] = set()
    return found.union(*(term.free_symbols for term in terms))
