"""Displacement, current, the mean one sample on, and the scalar update."""

from __future__ import annotations

from ambkit.models.emit.names import Names
from ambkit.models.emit.terms import Factor, Stages, Sum, product, total
from ambkit.models.model import NUMBER, ZERO


def displacement(names: Names) -> str:
    """Return the function of the displacements with which the magnets are asked."""
    rows = [
        [product(f"mean[{j}]", _in_place(h)) for j, h in names.entries("h", f)]
        for f in range(names.p)
    ]
    doc = "Displacement at which the magnet pulls, the mean over the sample [m]."
    return _forms(names, "displacement", doc, "s", rows, [])


def current(names: Names) -> str:
    """Return the function of the currents with which the magnets are asked."""
    rows = [
        [product(f"mean[{j}]", _in_place(e)) for j, e in names.entries("e", f)]
        + [product(_in_place(d), names.of_c("u", at)) for at, d in names.entries("d", f)]
        for f in range(names.p)
    ]
    doc = (
        "Control current with which the magnet pulls, the mean over the sample [A]; u: demanded"
        " current [A]."
    )
    return _forms(names, "current", doc, "i", rows, names.argument("u", names.c))


def _forms(names: Names, name: str, doc: str, result: str, rows: list[Sum], more: list[str]) -> str:
    """Return a function of linear forms, one of each force; of one force as its value."""
    given = [names.given, f"const {names.mean}", *more]
    if names.p == 1:
        return names.function(doc, name, given, [f"return {total(rows[0])};"], "amb_real")
    body = [f"{result}[{f}] = {total(row)};" for f, row in enumerate(rows)]
    return names.function(doc, name, [*given, f"amb_real {result}[{names.p}]"], body)


def _in_place(constant: Factor) -> Factor:
    """Return a constant where it is stored."""
    return None if constant is None else f"model->{constant}"


def predict_mean(names: Names) -> str:
    """Return the function that predicts the mean: entries of L, of B_u, of b."""
    stages, whole, riders = Stages(), [], []
    for f in range(names.p):
        terms = [product(names.of_p("f", f))]
        terms += [product(r, names.state[j]) for j, r in names.entries("r", f)]
        riders += [names.model.states[j].name for j, _ in names.entries("r", f)]
        whole.append(stages.add(names.whole_force(f), terms))
    changed = {}
    for i, state in enumerate(names.state):
        terms = [product(a, names.state[j]) for j, a in names.entries("L", i)]
        terms += [product(a, names.of_c("u", at)) for at, a in names.entries("B_u", i)]
        terms += [product(a, whole[f]) for f, a in names.entries("b", i)]
        if [term.text for term in terms] != [state]:
            changed[i] = terms
    lines, symbols = stages.needed(changed.values())
    lines = names.loads(symbols) + lines
    lines += [f"mean[{i}] = {total(terms)};" for i, terms in changed.items()]
    without = f" without {', '.join(riders)}" if riders else ""
    controlled = (names.model.pattern["B_u"] != ZERO).any()
    return names.function(
        f"Eq. 9, the mean one sample on; f: force on the rotor{without} [N].",
        "predict_mean",
        [
            names.given,
            *names.argument("f", names.p),
            *(names.argument("u", names.c) if controlled else []),
            names.mean,
        ],
        lines,
    )


def update(names: Names, r: int) -> str:
    """Return the function that takes in measurement r: K = P c'/S, X += K e, P -= K (P c')'."""
    entries, stages = names.entries("c", r), Stages()
    states = range(names.n)
    PH = [
        stages.add(f"PH{i}", [product(c, names.P(min(i, j), max(i, j))) for j, c in entries])
        for i in states
    ]
    lines, _ = stages.needed([[product(x)] for x in PH])
    loads = names.loads({names.P(*ij) for ij in names.pairs} | {c for _, c in entries if c})
    known = {names.P(*ij): f"cov[{at}]" for ij, at in names.where.items()}
    S = total(product(c, known.get(PH[j] or "", PH[j])) for j, c in entries)
    seen = total(product(c, f"mean[{j}]") for j, c in entries)
    head = [
        f"*variance = {S} + var_y;",
        f"*innovation = y - {seen if len(entries) == 1 else f'({seen})'};",
        "const amb_real inverse = AMB_C(1.0) / (*variance);",  # one division for all of K
        "const amb_real e = *innovation;",
    ]
    # Where PH is a column of P the long way to K begins at once.
    body = [*loads, *lines, *head] if lines else [*head, *loads]
    body += [f"const amb_real K{i} = {product(PH[i], 'inverse').text};" for i in states]
    body += [f"mean[{i}] += {product(f'K{i}', 'e').text};" for i in states]
    # As differences, not as sums with -K: that would be one more operation to wait for.
    body += [
        f"cov[{at}] = {names.P(i, j)} - {product(f'K{i}', PH[j]).text};"
        for (i, j), at in names.where.items()
    ]
    only = names.m == 1
    what = "of eq. 21" if only else names.model.measurements[r].name
    return names.function(
        f"Eq. 11-13 for the scalar measurement {what}; S must be positive.",
        "update" if only else f"update_{r}",
        [
            *([names.given] if (names.model.pattern["c"] == NUMBER).any() else []),
            "amb_real y",
            "amb_real var_y",
            names.mean,
            names.cov,
            "amb_real *innovation",
            "amb_real *variance",
        ],
        body,
    )
