"""Displacement, current, and the mean one sample on."""

from __future__ import annotations

from ambkit.models.emit.names import CURRENTS, MEAN, Names
from ambkit.models.emit.terms import Stages, in_place, product, total


def displacement(names: Names) -> str:
    """Return the function of the displacements at which the magnets are asked."""
    rows = [
        [product(f"mean[{j}]", in_place(h)) for j, h in names.entries("h", f)]
        for f in range(names.p)
    ]
    doc = "Displacement at which the magnet pulls, the mean over the sample [m]."
    return names.form(doc, "displacement", ["int f", f"const {MEAN}"], [[total(r)] for r in rows])


def current(names: Names) -> str:
    """Return the function of the currents at which the magnets are asked."""
    rows = [
        [product(f"mean[{j}]", in_place(e)) for j, e in names.entries("e", f)]
        + [product(in_place(d), f"iu[{at}]") for at, d in names.entries("d", f)]
        for f in range(names.p)
    ]
    doc = "Its current, the mean over the sample [A]."
    arguments = ["int f", f"const {MEAN}", CURRENTS]
    return names.form(doc, "current", arguments, [[total(row)] for row in rows])


def predict_mean(names: Names) -> str:
    """Return the function that predicts the mean: entries of L, of B_u, of b."""
    stages, total_forces, riders = Stages(), [], []
    for f in range(names.p):
        terms = [product(f"F[{f}]")]
        terms += [product(r, names.state[j]) for j, r in names.entries("r", f)]
        riders += [names.model.states[j].name for j, _ in names.entries("r", f)]
        total_forces.append(stages.add(names.whole_force(f), terms))
    changed = {}
    for i, state in enumerate(names.state):
        terms = [product(a, names.state[j]) for j, a in names.entries("L", i)]
        terms += [product(a, f"iu[{at}]") for at, a in names.entries("B_u", i)]
        terms += [product(a, total_forces[f]) for f, a in names.entries("b", i)]
        if [term.text for term in terms] != [state]:
            changed[i] = terms
    lines, symbols = stages.needed(changed.values())
    lines = names.loads(symbols) + lines
    lines += [f"mean[{i}] = {total(terms)};" for i, terms in changed.items()]
    without = f" without {', '.join(riders)}" if riders else ""
    return names.function(
        f"Eq. 9, the mean one sample on; F: force on the rotor{without} [N].",
        "predict_mean",
        ["const amb_real F[AMB_FORCES]", CURRENTS, MEAN],
        lines,
    )
