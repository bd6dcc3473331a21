"""What is asked of a model one filter at a time only, when it is set up or has lost its rotor."""

from __future__ import annotations

import numpy as np

from ambkit.models.emit.names import COV, GROWTH, MEAN, Names, switched
from ambkit.models.emit.terms import in_place, product, total
from ambkit.models.model import ONE, ZERO
from ambkit.models.roles import LOAD, POSITION, ROLES, SHOWN, VELOCITY


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


def drives(names: Names) -> str:
    """Return the function of which noise drives which state."""
    flags = np.diagonal(names.model.pattern["N"], axis1=1, axis2=2) != ZERO
    rows = ", ".join(
        "{" + ", ".join("true" if on else "false" for on in row) + "}" for row in flags
    )
    body = [
        f"static const bool drives[AMB_NOISES][AMB_STATES] = {{{rows}}};",
        "return drives[k][i];",
    ]
    doc = "Whether noise k drives state i within a sample."
    return names.function(doc, "drives", ["int k", "int i"], body, "bool")


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
    """Return the function of what each state is."""
    unknown = [state.name for state in names.model.states if state.role not in ROLES]
    if unknown:
        raise ValueError(f"states of unknown roles: {', '.join(unknown)}")
    roles = ", ".join(ROLES[state.role] for state in names.model.states)
    body = [f"static const amb_role role[AMB_STATES] = {{{roles}}};", "return role[i];"]
    return names.function("What each state is.", "role", ["int i"], body, "amb_role")


def equilibrium(names: Names) -> str:
    """Return the function that sets what sensors show to what it is at rest."""
    body = [
        f"mean[{i}] = "
        f"{total(product(f'mean[{j}]', in_place(a)) for j, a in names.entries('rest', i))};"
        for i in range(names.n)
        if names.shown(i)
    ]
    doc = "What follows from the positions when all is at rest."
    return names.function(doc, "equilibrium", [MEAN], body)


def firsts(names: Names) -> list[str]:
    """Return the macros of the first state of some roles, of those that there are."""
    roles = [ROLES[state.role] for state in names.model.states]
    return [
        f"#define {role.replace('AMB_', 'AMB_FIRST_')} {roles.index(role)}"
        for role in (POSITION, VELOCITY, LOAD)
        if role in roles
    ]


def sound(names: Names) -> str:
    """Return the function that says whether variances are such."""
    body = " && ".join(
        f"({at} >= AMB_C(0.0))"
        for i, at in enumerate(_diagonal(names))
        if ROLES[names.model.states[i].role] != SHOWN
    )
    doc = "Whether they are such; what a sensor shows is looked after by who takes it in."
    return names.function(doc, "sound", [f"const {COV}"], [f"return {body};"], "bool")


def known(names: Names) -> str:
    """Return the function that says whether the positions are known."""
    body = " && ".join(
        f"({at} <= widest[{i}])"
        for i, at in enumerate(_diagonal(names))
        if ROLES[names.model.states[i].role] == POSITION
    )
    arguments = [f"const {COV}", "const amb_real widest[AMB_STATES]"]
    doc = "Whether all positions are known better than this."
    return names.function(doc, "known", arguments, [f"return {body or 'true'};"], "bool")


def uncorrelated(names: Names) -> str:
    """Return the function of a covariance of variances alone."""
    body = [
        f"cov[{at}] = " + (f"amb_magnitude(variances[{i}]);" if i == j else f"{total([])};")
        for (i, j), at in names.where.items()
    ]
    arguments = ["const amb_real variances[AMB_STATES]", COV]
    doc = "A covariance of these variances, and nothing else."
    return names.function(doc, "uncorrelated", arguments, body)


def variances(names: Names) -> str:
    """Return the function of the variances of all states."""
    body = [f"variances[{i}] = {at};" for i, at in enumerate(_diagonal(names))]
    arguments = [f"const {COV}", "amb_real variances[AMB_STATES]"]
    return names.function("The variances of all states.", "variances", arguments, body)


def _diagonal(names: Names) -> list[str]:
    return [f"cov[{names.where[i, i]}]" for i in range(names.n)]
