"""A machine's continuous model over one sample: pattern and exact numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Bools
from ambkit.machine.magnets import core_module
from ambkit.models.declaration import UNIT, Plan, Row
from ambkit.models.model import NUMBER, ONE, ZERO, Model, Pattern

Kinds = tuple[Array, Pattern]  #: Numbers and pattern.

MOVES, SPREADS = 1, 2
"""Membership of a term (``ambkit/sampling.h``): motion over a sample, and spreading of noise. Held
forces belong to both; collocated inputs spread noise only, and changes of forces by currents
belong to the motion only.
"""

LAYOUTS: dict[Any, Layout] = {}  #: Cache by kind of machine.


def pattern_of(driven: Bools) -> Pattern:
    """Return the pattern of the exponential of a matrix with this structure."""
    # Driven entries, directly or indirectly, are numbers; without feedback the diagonal is one.
    reached, ways = driven, driven.astype(float)
    while (further := reached | (ways @ ways > 0)).sum() > reached.sum():  # by doubling
        reached, ways = further, further.astype(float)
    kinds = np.where(reached, NUMBER, ZERO)
    kinds[np.diag_indices(len(kinds))] = np.where(np.diag(reached), NUMBER, ONE)
    return kinds.astype(np.int8)


def structured(values: Array, kinds: Pattern) -> Array:
    """Return numbers with exact zeros and ones according to the pattern."""
    return np.where(kinds == NUMBER, values, kinds)


class Layout(NamedTuple):
    """Common structure of all machines of a kind."""

    row: NDArray[np.uint16]  #: Row of each term, ...
    column: NDArray[np.uint16]  #: ... its column ...
    use: NDArray[np.uint8]  #: ... and its membership.
    Phi: Pattern  #: Of all dynamic or held quantities.
    N: Pattern  #: Of the noises.


@dataclass
class Sampling:
    """A plan over one sample."""

    # The exponential is that of one state with everything that moves or is held over the sample:
    # the n states, p forces and c controls, and the integrals of the p displacements and p
    # currents, for their means. If a delay ends within the sample, it is the product of the
    # exponentials before and after. A force with a current stiffness k_i is held except for k_i
    # (i(t) - mean of i), which is in L and B_u. C computes it (``ambkit/sampling.h``).

    plan: Plan

    @cached_property
    def place(self) -> dict[str, int]:
        """Index of each state, force and control in the extended state."""
        plan = self.plan
        return {at.name: k for k, at in enumerate((*plan.states, *plan.forces, *plan.controls))}

    @cached_property
    def sizes(self) -> tuple[int, int, int, int]:
        """Numbers n, p, c and size of the extended state."""
        n, p, c = len(self.plan.states), len(self.plan.forces), len(self.plan.controls)
        return n, p, c, n + 3 * p + c

    def at(self, name: str) -> int:
        """Return an index."""
        if name not in self.place:
            raise ValueError(f"no part declares {name}; there are {', '.join(self.place)}")
        return self.place[name]

    def acting(self, control: str, after: float) -> str:
        """Return the input of an amplifier from some share of a sample on: a past control, or u."""
        past, share = self.plan.past.get(control, ([], 0.0))
        return [control, *past][len(past) - (after >= share if past else 0)]

    @cached_property
    def terms(self) -> list[tuple[int, str, float, int]]:
        """The drives of each state, as (row, name, value, use); equal places are added."""
        plan, (n, p, c, _) = self.plan, self.sizes
        held = [(self.at(state), by, value) for (state, by), value in plan.rates.items()]
        riders = {state: plan.pushes[force] for state, force in plan.riders.items()}
        held += self._by_forces(plan.pushes)
        for k, force in enumerate(plan.forces):
            held += [
                (n + p + c + k, position, value / plan.T)
                for position, value in plan.places[force.name].items()
            ]
            if force.name in plan.currents:
                held.append((n + 2 * p + c + k, plan.currents[force.name], 1 / plan.T))
        changing = [
            (row, plan.currents[force], value * plan.k_i[force])
            for row, force, value in held
            if plan.varies(force)
        ]
        return [
            (*term, use)
            for terms, use in (
                (held, MOVES | SPREADS), (changing, MOVES), (self._by_forces(riders), SPREADS)
            )
            for term in terms
        ]  # fmt: skip

    def _by_forces(self, inputs: dict[str, Row]) -> list[tuple[int, str, float]]:
        """Return the drives of the rotor by sources at given places."""
        return [
            (self.at(velocity), source, value * share)
            for source, places in inputs.items()
            for position, share in places.items()
            for velocity, value in self.plan.inertia[position].items()
        ]

    def generator(self, after: float) -> Array:
        """Return A of the extended state from some share of a sample on [1/s, times the units]."""
        held = [term[:3] for term in self.terms if term[3] == MOVES | SPREADS]
        rows, names, values = zip(*held, strict=True)
        acting = {at.name: self.acting(at.name, after) for at in self.plan.controls}
        columns = [self.at(acting.get(name, name)) for name in names]
        alike = np.broadcast_shapes(*{getattr(value, "shape", ()) for value in values})
        A = np.zeros((*alike, *(self.sizes[3],) * 2))
        place: Any = (..., rows, columns)
        alike_values = np.stack(np.broadcast_arrays(*values), axis=-1) if alike else values
        np.add.at(A, place, alike_values)
        return A

    def driven(self, use: int) -> Bools:
        """Return the structural drives in some part of the sample."""
        A = np.zeros((self.sizes[3],) * 2, bool)
        for i, name, _, of in self.terms:
            past, _share = self.plan.past.get(name, ([], 0.0))
            for source in [name, *past][-2:] if of & use else ():
                A[i, self.at(source)] = True
        return A

    @cached_property
    def layout(self) -> Layout:
        """The common structure of its kind."""
        key = self.plan.structure, tuple(share < 1 for _, share in self.plan.past.values())
        if key not in LAYOUTS:
            n, p, c, _ = self.sizes
            Phi, displaced = pattern_of(self.driven(MOVES)), n + p + c
            means = slice(displaced, displaced + p), slice(n)
            Phi[means] *= self._rotor_columns()
            self._sample_means(Phi)
            self._shift(Phi)
            rows, names, _, uses = zip(*self.terms, strict=True)
            LAYOUTS[key] = Layout(
                np.array(rows, np.uint16), np.array([self.at(name) for name in names], np.uint16),
                np.array(uses, np.uint8), Phi, self._spread(),
            )  # fmt: skip
        return LAYOUTS[key]

    @property
    def late(self) -> list[tuple[int, list[int], float]]:
        """Delayed controls: past ones, and the share after which the last but one acts."""
        before = self.sizes[0] + self.sizes[1]
        return [
            (self.at(control) - before, [self.at(state) for state in past], share)
            for control, (past, share) in self.plan.past.items()
        ]

    @property
    def k_i(self) -> list[float]:
        """Current stiffnesses of the forces that follow their currents within a sample; 0: held."""
        plan = self.plan
        return [plan.k_i[at.name] if plan.varies(at.name) else 0.0 for at in plan.forces]

    def numbers(self) -> tuple[Array, Array]:
        """Return the extended state's transition over the sample, and the noise covariances."""
        plan, (n, _, c, _), layout = self.plan, self.sizes, self.layout
        intensity = np.zeros((len(plan.sources), n))
        for k, (row, _) in enumerate(plan.sources):
            for state, value in row.items():
                intensity[k, self.at(state)] = value
        Phi, N = core_module().sampled(
            plan.T, n, c, layout.row, layout.column, layout.use, [term[2] for term in self.terms],
            self.k_i, self.late, intensity,
        )  # fmt: skip
        return structured(Phi, layout.Phi), structured(N, layout.N)

    def model(self, name: str) -> Model:
        """Return the sampled model."""
        plan = self.plan
        parts = self.assembled(*self.numbers())
        return Model(
            name=name, T=plan.T, states=tuple(plan.states), forces=tuple(plan.forces),
            controls=tuple(plan.controls), measurements=tuple(plan.measurements),
            noises=tuple(plan.noises), pattern={key: kind for key, (_, kind) in parts.items()},
            **{key: values for key, (values, _) in parts.items()},
        )  # fmt: skip

    def assembled(self, Phi: Array, N: Array) -> dict[str, Kinds]:
        """Return the matrices of a model, each with its pattern."""
        plan, (n, p, c, _), layout = self.plan, self.sizes, self.layout
        states, forces, controls = slice(n), slice(n, n + p), slice(n + p, n + p + c)
        displaced, currents = slice(n + p + c, n + 2 * p + c), slice(n + 2 * p + c, None)
        collocated = np.zeros((p, n))
        for state, force in plan.riders.items():
            collocated[[at.name for at in plan.forces].index(force), self.at(state)] = ONE
        blocks = {
            "L": (states, states), "b": (states, forces), "B_u": (states, controls),
            "h": (displaced, states), "e": (currents, states), "d": (currents, controls),
        }  # fmt: skip
        parts: dict[str, Kinds] = {key: (Phi[at], layout.Phi[at]) for key, at in blocks.items()}
        return parts | {
            "r": (collocated, collocated.astype(np.int8)),  # ones and zeros, as their pattern
            "c": self.linear_forms(plan.readings),
            "N": (N, layout.N),
            "rest": self.linear_forms(self.rests()),
        }

    def _rotor_columns(self) -> Bools:
        """Return, for each force, the rotor states (p, n) at its place."""
        plan = self.plan
        owner = np.array(plan.owner, int)
        rows = [
            np.isin(owner, [owner[self.at(q)] for q in plan.places[force.name]])
            for force in plan.forces
        ]
        return np.array(rows, bool).reshape(len(plan.forces), len(plan.states))

    def linear_forms(self, rows: Sequence[Row]) -> Kinds:
        """Return rows of coefficients of the states, with their pattern."""
        alike = np.broadcast_shapes(*(np.shape(item) for row in rows for item in row.values()))
        values = np.zeros((*alike, len(rows), len(self.plan.states)))
        kinds = np.zeros(values.shape[-2:], np.int8)
        for i, entries in enumerate(rows):
            for state, value in entries.items():
                values[..., i, self.at(state)] = value
                kinds[i, self.at(state)] = ONE if value is UNIT else NUMBER
        return values, kinds

    def _spread(self) -> Pattern:
        """Return the pattern of the noises' covariances (k, n, n)."""
        n = self.sizes[0]
        kinds = pattern_of(self.driven(SPREADS))
        reached = kinds[:n, :n] != ZERO
        pattern = np.zeros((len(self.plan.sources), n, n), np.int8)
        for k, (row, walk) in enumerate(self.plan.sources):
            for state in row:
                source = self.at(state)
                pattern[k][np.outer(reached[:, source], reached[:, source])] = NUMBER
                if walk and kinds[source, source] == ONE:
                    pattern[k, source, source] = ONE
        return pattern

    def rests(self) -> list[Row]:
        """Return the equilibrium of each state, dependent ones traced to free ones."""
        # A state that depends on a commanded current is free, unless a past control holds that.
        controls = {at.name for at in self.plan.controls}
        held = {control: past[0] for control, (past, _) in self.plan.past.items()}
        rests = {
            state: {held.get(by, by): value for by, value in terms.items()}
            for state, terms in self.plan.rests.items()
            if all(by in held or by not in controls for by in terms)
        }
        rows: list[Row] = [rests.get(at.name, {at.name: UNIT}) for at in self.plan.states]
        for _ in rests:
            rows = [_traced(row, rests) for row in rows]
        return rows

    def _sample_means(self, Phi: Pattern) -> None:
        """Set the ones of h and d: the mean of a constant is its value."""
        plan, (n, p, c, _) = self.plan, self.sizes
        for k, force in enumerate(plan.forces):
            seen = {self.at(q): value for q, value in plan.places[force.name].items()}
            for q, value in seen.items():
                single = all(Phi[other, q] == ZERO for other in seen if other != q)
                if value is UNIT and single and Phi[q, q] == ONE:
                    Phi[n + p + c + k, q] = ONE
            current = plan.currents.get(force.name)
            if current in {at.name for at in plan.controls} and current not in plan.past:
                Phi[n + 2 * p + c + k, self.at(current)] = ONE

    def _shift(self, Phi: Pattern) -> None:
        """Move the past controls on by one sample."""
        for control, (past, _) in self.plan.past.items():
            for state, source in zip(past, [control, *past], strict=False):
                Phi[self.at(state)] = ZERO
                Phi[self.at(state), self.at(source)] = ONE


def _traced(row: Row, rests: dict[str, dict[str, float]]) -> dict[str, float]:
    results: dict[str, float] = {}
    for state, value in row.items():
        for by, share in rests.get(state, {state: UNIT}).items():
            product = share if value is UNIT else value if share is UNIT else value * share
            results[by] = results[by] + product if by in results else product
    return results
