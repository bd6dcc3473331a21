"""What the sensors show, and the scalar update with what one of them shows."""

from __future__ import annotations

from ambkit.models.emit.names import COV, MEAN, Names, switched
from ambkit.models.emit.terms import Stages, in_place, product, total

SENSOR = "int r"


def shown(names: Names) -> str:
    """Return the function of what a sensor shows of a mean."""
    return names.form(
        "What the sensor shows (eq. 21).",
        "shown",
        [SENSOR, f"const {MEAN}"],
        [[_of_mean(names, r)] for r in range(names.m)],
    )


def shown_variance(names: Names) -> str:
    """Return the function of the variance of that."""
    cases = []
    for r in range(names.m):
        seen = [j for j, _ in names.entries("c", r)]
        loads, lines, PH = _with_sensor(names, r, seen)
        cases.append([*loads, *lines, _variance(names, r, PH)])
    arguments = [SENSOR, f"const {COV}"]
    return names.form("The variance of that.", "shown_variance", arguments, cases)


def shown_with(names: Names) -> str:
    """Return the function of its covariance with the states."""

    def column(r: int, i: int) -> str:
        terms = [product(in_place(c), _cov(names, i, j)) for j, c in names.entries("c", r)]
        return f"with_y[{i}] = {total(terms)};"

    cases = [[column(r, i) for i in range(names.n)] for r in range(names.m)]
    arguments = [SENSOR, f"const {COV}", "amb_real with_y[AMB_STATES]"]
    doc = "And its covariance with the states."
    return names.function(doc, "shown_with", arguments, switched(SENSOR, cases))


def update(names: Names) -> str:
    """Return the function that takes in a measurement: K = P c'/S, X += K e, P -= K (P c')'."""
    arguments = [
        "amb_real y", "amb_real S", MEAN, COV, "amb_real *innovation",
    ]  # fmt: skip
    doc = "Eq. 11-13 for the scalar measurement of {}; S must be positive."
    if names.m == 1:
        body = _update(names, 0)
        return names.function(doc.format("eq. 21"), "update", [SENSOR, *arguments], body)
    functions, cases = [], []
    for r, measurement in enumerate(names.model.measurements):
        what = doc.format(measurement.name)
        functions.append(names.function(what, f"update_{r}", arguments, _update(names, r)))
        call_arguments = "model, y, S, mean, cov, innovation"
        cases.append([f"amb_model_update_{r}({call_arguments});"])
    last = names.function(
        doc.format("one sensor"), "update", [SENSOR, *arguments], switched(SENSOR, cases)
    )
    return "\n".join([*functions, last])


def _update(names: Names, r: int) -> list[str]:
    """Return the body of the update with measurement r."""
    states = range(names.n)
    loads, lines, PH = _with_sensor(names, r, list(states), all_of_P=True)
    seen = _of_mean(names, r)
    head = [
        f"*innovation = y - {seen if len(names.entries('c', r)) == 1 else f'({seen})'};",
        "const amb_real inverse = AMB_C(1.0) / S;",  # one division for all of K
        "const amb_real e = *innovation;",
    ]
    # Where PH is a column of P the long way to K begins at once.
    body = [*loads, *lines, *head] if lines else [*head, *loads]
    body += [f"const amb_real K{i} = {product(PH[i], 'inverse').text};" for i in states]
    body += [f"mean[{i}] += {product(f'K{i}', 'e').text};" for i in states]
    # As differences, not as sums with -K: that would be one more operation to wait for.
    return body + [
        f"cov[{at}] = {names.P(i, j)} - {product(f'K{i}', PH[j]).text};"
        for (i, j), at in names.where.items()
    ]


def _of_mean(names: Names, r: int) -> str:
    return total(product(in_place(c), f"mean[{j}]") for j, c in names.entries("c", r))


def _cov(names: Names, i: int, j: int) -> str:
    return f"cov[{names.where[min(i, j), max(i, j)]}]"


def _with_sensor(
    names: Names, r: int, states: list[int], *, all_of_P: bool = False
) -> tuple[list[str], list[str], dict[int, str | None]]:
    """Return loads, and lines that compute PH = P c' of some states, and what these are called."""
    stages, entries = Stages(), names.entries("c", r)
    PH = {i: stages.add(f"PH{i}", [product(c, names.P(i, j)) for j, c in entries]) for i in states}
    lines, symbols = stages.needed([[product(x)] for x in PH.values()])
    if all_of_P:
        symbols |= {names.P(*ij) for ij in names.pairs}
    elif not lines:
        symbols = set()  # a variance is returned from where it is stored
    if lines:
        symbols |= {c for _, c in entries if c}
    return names.loads(symbols), lines, PH


def _variance(names: Names, r: int, PH: dict[int, str | None]) -> str:
    """Return c P c', from where it is stored if it is one entry."""
    known = {names.P(*ij): f"cov[{at}]" for ij, at in names.where.items()}
    return total(product(c, known.get(PH[j] or "", PH[j])) for j, c in names.entries("c", r))
