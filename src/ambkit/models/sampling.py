"""A machine's continuous model over one sample: the pattern, and exact numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Bools
from ambkit.models import exponential
from ambkit.models.declaration import UNIT, Plan, Row
from ambkit.models.model import NUMBER, ONE, ZERO, Model, Pattern

Kinds = tuple[Array, Pattern]  #: Numbers, and their pattern.

HELD, RIDERS, VARYING = range(3)
"""Terms of held magnet forces; with what rides on them; with what changes in them by currents."""


def pattern_of(driven: Bools) -> Pattern:
    """Return the pattern of the exponential of a matrix of this structure."""
    # What something drives, at once or by way of others, has a number; what nothing drives back to
    # itself has a one on the diagonal.
    reached, ways = driven, driven.astype(float)
    while (further := reached | (ways @ ways > 0)).sum() > reached.sum():  # of twice the steps
        reached, ways = further, further.astype(float)
    kinds = np.where(reached, NUMBER, ZERO)
    kinds[np.diag_indices(len(kinds))] = np.where(np.diag(reached), NUMBER, ONE)
    return kinds.astype(np.int8)


def structured(values: Array, kinds: NDArray[np.generic]) -> Kinds:
    """Return numbers with exact zeros and ones where the pattern has them."""
    pattern = np.asarray(kinds).astype(np.int8)
    return np.where(pattern == NUMBER, values, pattern == ONE).astype(float), pattern


def set_one(part: Kinds, i: int, j: int) -> None:
    """Make an entry one by structure."""
    part[0][i, j], part[1][i, j] = 1.0, ONE


@dataclass
class Sampling:
    """A plan over one sample."""

    # The exponential is taken of one state that holds everything which moves or is held over the
    # sample: the n states, p forces and c controls, and the integrals of the p displacements and p
    # currents, from which their means come. Where a delay ends within the sample, it is the product
    # of the exponentials before and after. A force with a current stiffness k_i is held but for
    # k_i (i(t) - mean of i), which is in L and B_u.

    plan: Plan

    @cached_property
    def place(self) -> dict[str, int]:
        """Where each state, force and control stands in the whole state."""
        plan = self.plan
        return {at.name: k for k, at in enumerate((*plan.states, *plan.forces, *plan.controls))}

    @cached_property
    def sizes(self) -> tuple[int, int, int, int]:
        """Numbers n, p, c and size of the whole state."""
        n, p, c = len(self.plan.states), len(self.plan.forces), len(self.plan.controls)
        return n, p, c, n + 3 * p + c

    def at(self, name: str) -> int:
        """Return where something stands."""
        if name not in self.place:
            raise ValueError(f"no part declares {name}; there are {', '.join(self.place)}")
        return self.place[name]

    def acting(self, control: str, after: float) -> str:
        """Return what acts on an amplifier from some share of a sample on: a past control, or u."""
        past, share = self.plan.past.get(control, ([], 0.0))
        return [control, *past][len(past) - (after >= share if past else 0)]

    @cached_property
    def _terms(self) -> tuple[list[tuple[int, str, float]], ...]:
        """The terms of `HELD`, `RIDERS` and `VARYING`."""
        plan, held = self.plan, self.terms(riders=False)
        changing = [
            (row, plan.currents[force], value * plan.k_i[force])
            for row, force, value in held
            if plan.varies(force)
        ]
        return held, self.terms(riders=True), held + changing

    def terms(self, *, riders: bool) -> list[tuple[int, str, float]]:
        """Return what drives each state, as (row, name, value); sums of equal places."""
        plan = self.plan
        terms = [(self.at(state), by, value) for (state, by), value in plan.rates.items()]
        force_inputs = dict(plan.pushes)
        if riders:
            force_inputs |= {state: plan.pushes[force] for state, force in plan.riders.items()}
        for source, places in force_inputs.items():
            for position, share in places.items():
                terms += [
                    (self.at(velocity), source, value * share)
                    for velocity, value in plan.inertia[position].items()
                ]
        n, p, c, _ = self.sizes
        for k, force in enumerate(plan.forces):
            terms += [
                (n + p + c + k, position, value / plan.T)
                for position, value in plan.places[force.name].items()
            ]
            if force.name in plan.currents:
                terms.append((n + 2 * p + c + k, plan.currents[force.name], 1 / plan.T))
        return terms

    def generator(self, after: float, which: int = HELD) -> Array:
        """Return A of the whole state, from some share of the sample on [1/s, times the units]."""
        rows, names, values = zip(*self._terms[which], strict=True)
        acting = {at.name: self.acting(at.name, after) for at in self.plan.controls}
        columns = [self.at(acting.get(name, name)) for name in names]
        alike = np.broadcast_shapes(*{getattr(value, "shape", ()) for value in values})
        A = np.zeros((*alike, *(self.sizes[3],) * 2))
        place: Any = (..., rows, columns)
        alike_values = np.stack(np.broadcast_arrays(*values), axis=-1) if alike else values
        np.add.at(A, place, alike_values)
        return A

    def driven(self, which: int) -> Bools:
        """Return what drives what in some part of the sample, by structure."""
        A = np.zeros((self.sizes[3],) * 2, bool)
        for i, name, _ in self._terms[which]:
            past, _share = self.plan.past.get(name, ([], 0.0))
            for source in [name, *past][-2:]:
                A[i, self.at(source)] = True
        return A

    def whole(self) -> Kinds:
        """Return the whole state's transition over the sample, and its pattern."""
        shares = {share for _, share in self.plan.past.values() if share < 1}
        ends = [0.0, *sorted(shares), 1.0]
        Phi = np.eye(self.sizes[3])
        for start, end in pairwise(ends):
            A = self.generator(start, VARYING)
            Phi = exponential.transition(A, (end - start) * self.plan.T) @ Phi
        driven = self.driven(VARYING)
        # What is on no circle but its own decays by its own rate, however far: no digit is lost.
        others = pattern_of(driven & ~np.eye(len(driven), dtype=bool))
        decoupled = np.flatnonzero(np.diag(others) == ONE)
        Phi[decoupled, decoupled] = np.exp(np.diag(self.generator(0.0))[decoupled] * self.plan.T)
        return structured(Phi, pattern_of(driven))

    def model(self, name: str) -> Model:
        """Return the sampled model."""
        plan, (n, p, c, _) = self.plan, self.sizes
        Phi, kinds = self.whole()
        states, forces, controls = slice(n), slice(n, n + p), slice(n + p, n + p + c)
        displaced, currents = slice(n + p + c, n + 2 * p + c), slice(n + 2 * p + c, None)
        rotor, collocated = self._rotor_columns(), np.zeros((p, n))
        for state, force in plan.riders.items():
            collocated[[at.name for at in plan.forces].index(force), self.at(state)] = ONE
        parts = {
            "L": (Phi[states, states], kinds[states, states]),
            "b": (Phi[states, forces], kinds[states, forces]),
            "B_u": (Phi[states, controls], kinds[states, controls]),
            "h": (Phi[displaced, states] * rotor, kinds[displaced, states] * rotor),
            "e": (Phi[currents, states], kinds[currents, states]),
            "d": (Phi[currents, controls], kinds[currents, controls]),
            "r": (collocated, collocated.astype(np.int8)),  # ones and zeros, as their pattern
            "c": self.linear_forms(plan.readings),
            "N": self._growth(),
            "rest": self._rest(),
        }
        self._hold_mean_forces(parts)
        self._pure_means(parts)
        self._shift(parts)
        return Model(
            name=name, T=plan.T, states=tuple(plan.states), forces=tuple(plan.forces),
            controls=tuple(plan.controls), measurements=tuple(plan.measurements),
            noises=tuple(plan.noises), pattern={key: kind for key, (_, kind) in parts.items()},
            **{key: values for key, (values, _) in parts.items()},
        )  # fmt: skip

    def _hold_mean_forces(self, parts: dict[str, Kinds]) -> None:
        """Subtract what varying forces do by their mean currents, which a magnet's law has."""
        L, B_u, b, e, d = (parts[name][0] for name in ("L", "B_u", "b", "e", "d"))
        for k, force in enumerate(self.plan.forces):
            if self.plan.varies(force.name):
                held = self.plan.k_i[force.name] * b[:, k, None]
                L -= held * e[k]
                B_u -= held * d[k]

    def _rotor_columns(self) -> Bools:
        """Return, for each force, the states (p, n) of the rotor at which it pulls."""
        plan = self.plan
        owner = np.array(plan.owner, int)
        rows = [
            np.isin(owner, [owner[self.at(q)] for q in plan.places[force.name]])
            for force in plan.forces
        ]
        return np.array(rows, bool).reshape(len(plan.forces), len(plan.states))

    def linear_forms(self, rows: Sequence[Row]) -> Kinds:
        """Return rows of coefficients of the states, and their pattern."""
        alike = np.broadcast_shapes(*(np.shape(item) for row in rows for item in row.values()))
        values = np.zeros((*alike, len(rows), len(self.plan.states)))
        kinds = np.zeros(values.shape[-2:], np.int8)
        for i, entries in enumerate(rows):
            for state, value in entries.items():
                values[..., i, self.at(state)] = value
                kinds[i, self.at(state)] = ONE if value is UNIT else NUMBER
        return values, kinds

    def _growth(self) -> Kinds:
        n = self.sizes[0]
        A, kinds = self.generator(0.0, RIDERS)[:n, :n], pattern_of(self.driven(RIDERS))
        reached = kinds[:n, :n] != ZERO
        pattern = np.zeros((len(self.plan.sources), n, n))
        intensity = np.zeros((len(self.plan.sources), n))
        for k, (row, walk) in enumerate(self.plan.sources):
            for state, value in row.items():
                source = self.at(state)
                intensity[k, source] = value
                pattern[k][np.outer(reached[:, source], reached[:, source])] = NUMBER
                if walk and kinds[source, source] == ONE:
                    pattern[k, source, source] = ONE
        return structured(exponential.growth(A, intensity, self.plan.T), pattern)

    def _rest(self) -> Kinds:
        """Return what each state is at rest, each dependent one traced back to free ones."""
        # What rests on a demanded current is free itself, unless a past control holds that.
        controls = {at.name for at in self.plan.controls}
        held = {control: past[0] for control, (past, _) in self.plan.past.items()}
        rests = {
            state: {held.get(by, by): value for by, value in terms.items()}
            for state, terms in self.plan.rests.items()
            if all(by in held or by not in controls for by in terms)
        }
        rows = [rests.get(at.name, {at.name: UNIT}) for at in self.plan.states]
        for _ in rests:
            rows = [_traced(row, rests) for row in rows]
        return self.linear_forms(rows)

    def _pure_means(self, parts: dict[str, Kinds]) -> None:
        """Set the ones of h and d: the mean of what does not move by itself is what it was."""
        plan, (n, p, _c, _) = self.plan, self.sizes
        pattern = pattern_of(self.driven(VARYING))
        for k, force in enumerate(plan.forces):
            seen = {self.at(q): value for q, value in plan.places[force.name].items()}
            for q, value in seen.items():
                single = all(pattern[other, q] == ZERO for other in seen if other != q)
                if value is UNIT and single and pattern[q, q] == ONE:
                    set_one(parts["h"], k, q)
            current = plan.currents.get(force.name)
            if current in {at.name for at in plan.controls} and current not in plan.past:
                set_one(parts["d"], k, self.at(current) - n - p)

    def _shift(self, parts: dict[str, Kinds]) -> None:
        """Let the past controls move on by one sample."""
        _, p, _, _ = self.sizes
        for control, (past, _) in self.plan.past.items():
            for k, state in enumerate(past):
                i = self.at(state)
                for name in ("L", "B_u"):
                    for array in parts[name]:
                        array[i] = 0
                if k == 0:
                    set_one(parts["B_u"], i, self.at(control) - self.sizes[0] - p)
                else:
                    set_one(parts["L"], i, self.at(past[k - 1]))


def _traced(row: Row, rests: dict[str, dict[str, float]]) -> dict[str, float]:
    results: dict[str, float] = {}
    for state, value in row.items():
        for by, share in rests.get(state, {state: UNIT}).items():
            product = share if value is UNIT else value if share is UNIT else value * share
            results[by] = results[by] + product if by in results else product
    return results
