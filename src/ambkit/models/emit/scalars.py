"""What is asked of a model one filter at a time only, when it is set up or has lost its rotor."""

from __future__ import annotations

from ambkit.models.emit.names import GROWTH, MEAN, Names, switched
from ambkit.models.emit.terms import in_place, product, total
from ambkit.models.model import ONE, ZERO
from ambkit.models.roles import ROLES


def growth(names: Names) -> str:
    """Return the function of the covariance that the sources of noise leave in a sample."""
    pattern, body = names.model.pattern["N"], []
    for at, (i, j) in enumerate(names.pairs):
        terms = []
        for k in range(names.k):
            if (kind := pattern[k, i, j]) != ZERO:
                N = None if kind == ONE else f"model->{names.constants[f'N{k}', i, j]}"
                terms.append(product(N, f"var[{k}]"))
        body.append(f"growth[{at}] = {total(terms)};")
    of = ", ".join(noise.name for noise in names.model.noises)
    return names.function(
        f"Covariance that growths of these variances leave in a sample: {of}.",
        "growth",
        ["const amb_real var[AMB_NOISES]", GROWTH],
        body,
    )


def pushed(names: Names) -> str:
    """Return the function of what a force leaves in the states."""
    rows = [dict(names.entries("b", i)) for i in range(names.n)]
    cases = [
        [
            f"moved[{i}] = {product(in_place(row[f])).text if f in row else total([])};"
            for i, row in enumerate(rows)
        ]
        for f in range(names.p)
    ]
    arguments = ["int f", "amb_real moved[AMB_STATES]"]
    doc = "How a force of 1 N moves the states within a sample."
    return names.function(doc, "pushed", arguments, switched("int f", cases))


def role(names: Names) -> str:
    """Return the function of what each state is.

    Raises
    ------
    ValueError
        A state has a role that the core does not know.
    """
    unknown = [state.name for state in names.model.states if state.role not in ROLES]
    if unknown:
        raise ValueError(f"states of unknown roles: {', '.join(unknown)}")
    roles = ", ".join(ROLES[state.role] for state in names.model.states)
    body = [f"static const amb_role role[AMB_STATES] = {{{roles}}};", "return role[i];"]
    return names.function("What each state is.", "role", ["int i"], body, "amb_role")


def at_rest(names: Names) -> str:
    """Return the function that sets what sensors show to what it is at rest."""
    body = [
        f"mean[{i}] = "
        f"{total(product(f'mean[{j}]', in_place(a)) for j, a in names.entries('rest', i))};"
        for i in range(names.n)
        if names.shown(i)
    ]
    doc = "What follows from the positions when all is at rest."
    return names.function(doc, "at_rest", [MEAN], body)
