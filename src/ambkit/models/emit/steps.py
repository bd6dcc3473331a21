"""C of displacements, currents, mean, sensors and initialisation."""

import numpy as np

from ambkit.models.emit.names import (
    COV,
    CURRENTS,
    GROWTH,
    MEAN,
    Names,
    Stages,
    in_place,
    product,
    switched,
    total,
)
from ambkit.models.model import LOAD, ONE, POSITION, ROLES, SHOWN, VELOCITY, ZERO

SENSOR = "int r"


def shown(names: Names) -> str:
    """Return the function for a sensor's reading of a mean."""
    return names.form(
        "What the sensor shows (eq. 21).",
        "shown",
        [SENSOR, f"const {MEAN}"],
        [[_of_mean(names, r)] for r in range(names.m)],
    )


def shown_variance(names: Names) -> str:
    """Return the function for the variance of the reading."""
    cases = []
    for r in range(names.m):
        loads, lines, PH = _with_sensor(names, r, [j for j, _ in names.entries("c", r)])
        cases.append([*loads, *lines, _variance(names, r, PH)])
    arguments = [SENSOR, f"const {COV}"]
    return names.form("The variance of that.", "shown_variance", arguments, cases)


def shown_with(names: Names) -> str:
    """Return the function for its covariance with the states."""

    def column(r: int, i: int) -> str:
        cov = {j: f"cov[{names.where[min(i, j), max(i, j)]}]" for j in range(names.n)}
        terms = (product(in_place(c), cov[j]) for j, c in names.entries("c", r))
        return f"with_y[{i}] = {total(terms)};"

    cases = [[column(r, i) for i in range(names.n)] for r in range(names.m)]
    arguments = [SENSOR, f"const {COV}", "amb_real with_y[AMB_STATES]"]
    doc = "And its covariance with the states."
    return names.function(doc, "shown_with", arguments, switched(SENSOR, cases))


def update(names: Names) -> str:
    """Return the measurement update: K = P c'/S, X += K e, P -= K (P c')'."""
    arguments = ["amb_real y", "amb_real S", MEAN, COV, "amb_real *innovation"]
    doc = "Eq. 11-13 for the scalar measurement of {}; S must be positive."
    if names.m == 1:
        body = _update(names, 0)
        return names.function(doc.format("eq. 21"), "update", [SENSOR, *arguments], body)
    functions, cases = [], []
    for r, measurement in enumerate(names.model.measurements):
        what = doc.format(measurement.name)
        functions.append(names.function(what, f"update_{r}", arguments, _update(names, r)))
        cases.append([f"amb_model_update_{r}(model, y, S, mean, cov, innovation);"])
    last = names.function(
        doc.format("one sensor"), "update", [SENSOR, *arguments], switched(SENSOR, cases)
    )
    return "\n".join([*functions, last])


def _update(names: Names, r: int) -> list[str]:
    """Return the body of the update with measurement r."""
    states = range(names.n)
    loads, lines, PH = _with_sensor(names, r, list(states), stored=False)
    seen = _of_mean(names, r)
    head = [
        f"*innovation = y - {seen if len(names.entries('c', r)) == 1 else f'({seen})'};",
        "const amb_real inverse = AMB_C(1.0) / S;",  # one division for all of K
        "const amb_real e = *innovation;",
    ]
    # If PH is a column of P, the long path to K starts immediately.
    body = [*loads, *lines, *head] if lines else [*head, *loads]
    body += [f"const amb_real K{i} = {product(PH[i], 'inverse').text};" for i in states]
    body += [f"mean[{i}] += {product(f'K{i}', 'e').text};" for i in states]
    # As differences, not as sums with -K, which would lengthen the dependency chain.
    return body + [
        f"cov[{at}] -= {product(f'K{i}', PH[j]).text};" for (i, j), at in names.where.items()
    ]


def _of_mean(names: Names, r: int) -> str:
    return total(product(in_place(c), f"mean[{j}]") for j, c in names.entries("c", r))


def _with_sensor(
    names: Names, r: int, states: list[int], *, stored: bool = True
) -> tuple[list[str], list[str], dict[int, str | None]]:
    """Return loads, and lines that compute PH = P c' of some states, with their names."""
    stages, entries = Stages(), names.entries("c", r)
    PH = {i: stages.add(f"PH{i}", [product(c, names.P(i, j)) for j, c in entries]) for i in states}
    lines, symbols = stages.needed([[product(x)] for x in PH.values()])
    if stored and not lines:
        symbols = set()  # a variance is returned from its place
    if lines:
        symbols |= {c for _, c in entries if c}
    return names.loads(symbols), lines, PH


def _variance(names: Names, r: int, PH: dict[int, str | None]) -> str:
    """Return c P c', from its place if it is one entry."""
    known = {names.P(*ij): f"cov[{at}]" for ij, at in names.where.items()}
    return total(product(c, known.get(PH[j] or "", PH[j])) for j, c in names.entries("c", r))


def growth(names: Names) -> str:
    """Return the function for the process noise covariance of a sample."""
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
    """Return the function for which noise drives which state."""
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
    """Return the function for the effect of a force on the states."""
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
    """Return the function for the role of each state."""
    unknown = [state.name for state in names.model.states if state.role not in ROLES]
    if unknown:
        raise ValueError(f"states of unknown roles: {', '.join(unknown)}")
    roles = ", ".join(ROLES[state.role] for state in names.model.states)
    body = [f"static const amb_role role[AMB_STATES] = {{{roles}}};", "return role[i];"]
    return names.function("What each state is.", "role", ["int i"], body, "amb_role")


def equilibrium(names: Names) -> str:
    """Return the function that sets the measured states to their equilibrium."""
    body = [
        f"mean[{i}] = "
        f"{total(product(f'mean[{j}]', in_place(a)) for j, a in names.entries('rest', i))};"
        for i in range(names.n)
        if names.shown(i)
    ]
    doc = "What follows from the positions when all is at rest."
    return names.function(doc, "equilibrium", [MEAN], body)


def initial_values(names: Names) -> list[str]:
    """Return macros with the first state of each existing role."""
    roles = [ROLES[state.role] for state in names.model.states]
    return [
        f"#define {role.replace('AMB_', 'AMB_FIRST_')} {roles.index(role)}"
        for role in (POSITION, VELOCITY, LOAD)
        if role in roles
    ]


def sound(names: Names) -> str:
    """Return the function that checks variances."""
    body = " && ".join(
        f"({at} >= AMB_C(0.0))"
        for i, at in enumerate(_diagonal(names))
        if ROLES[names.model.states[i].role] != SHOWN
    )
    doc = "Whether they are such; what a sensor shows is looked after by who takes it in."
    return names.function(doc, "sound", [f"const {COV}"], [f"return {body};"], "bool")


def known(names: Names) -> str:
    """Return the function that checks whether the positions are known."""
    body = " && ".join(
        f"({at} <= widest[{i}])"
        for i, at in enumerate(_diagonal(names))
        if ROLES[names.model.states[i].role] == POSITION
    )
    arguments = [f"const {COV}", "const amb_real widest[AMB_STATES]"]
    doc = "Whether all positions are known better than this."
    return names.function(doc, "known", arguments, [f"return {body or 'true'};"], "bool")


def uncorrelated(names: Names) -> str:
    """Return the function for a diagonal covariance."""
    body = [
        f"cov[{at}] = " + (f"amb_magnitude(variances[{i}]);" if i == j else f"{total([])};")
        for (i, j), at in names.where.items()
    ]
    arguments = ["const amb_real variances[AMB_STATES]", COV]
    doc = "A covariance of these variances, and nothing else."
    return names.function(doc, "uncorrelated", arguments, body)


def variances(names: Names) -> str:
    """Return the function for the variances of all states."""
    body = [f"variances[{i}] = {at};" for i, at in enumerate(_diagonal(names))]
    arguments = [f"const {COV}", "amb_real variances[AMB_STATES]"]
    return names.function("The variances of all states.", "variances", arguments, body)


def _diagonal(names: Names) -> list[str]:
    return [f"cov[{names.where[i, i]}]" for i in range(names.n)]


def displacement(names: Names) -> str:
    """Return the function for the displacements in the magnets."""
    rows = [
        [product(f"mean[{j}]", in_place(h)) for j, h in names.entries("h", f)]
        for f in range(names.p)
    ]
    doc = "Displacement at which the magnet pulls, the mean over the sample [m]."
    return names.form(doc, "displacement", ["int f", f"const {MEAN}"], [[total(r)] for r in rows])


def current(names: Names) -> str:
    """Return the function for the currents in the magnets."""
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
        total_forces.append(stages.add(names.total_force(f), terms))
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
