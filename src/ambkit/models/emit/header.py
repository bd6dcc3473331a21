"""The header of one kind of machine: its constants and its steps."""

from __future__ import annotations

from ambkit.models.emit.covariance import predict_covariance
from ambkit.models.emit.names import Names
from ambkit.models.emit.steps import current, displacement, predict_mean, update
from ambkit.models.emit.terms import product, total
from ambkit.models.model import MATRICES, ONE, ZERO, Model


def struct(names: Names) -> str:
    """Return the struct of the constants."""
    fields = "".join(f"  amb_real {name};\n" for name in names.constants.values())
    return (
        "/* What the equations ask of the physical parameters, computed once. */\n"
        f"typedef struct {names.kind}_model {{\n{fields}}} {names.kind}_model;\n"
    )


def constants(names: Names, model: Model) -> dict[str, float]:
    """Return a model's numbers by name, in the struct's order.

    Raises
    ------
    ValueError
        The model is of another kind than the names are of.
    """
    if model.pattern_key() != names.model.pattern_key():
        raise ValueError("the model is of another pattern than the struct")
    return {
        name: float(
            getattr(model, at)[i, j] if at in MATRICES else model.N[int(at.removeprefix("N")), i, j]
        )
        for (at, i, j), name in names.constants.items()
    }


def initialiser(names: Names, model: Model) -> str:
    """Return the struct's initialiser with a model's numbers, which either precision reads back."""
    values = constants(names, model).values()
    return "{" + ", ".join(f"AMB_C({value!r})" for value in values) + "}"


def growth(names: Names) -> str:
    """Return the function of the covariance that the sources of noise leave in a sample."""
    pattern, body = names.model.pattern["N"], []
    for at, (i, j) in enumerate(names.pairs):
        terms = []
        for k in range(names.k):
            if (kind := pattern[k, i, j]) != ZERO:
                N = None if kind == ONE else f"model->{names.constants[f'N{k}', i, j]}"
                terms.append(product(N, names.of("var_noise", k, names.k)))
        body.append(f"growth[{at}] = {total(terms)};")
    return names.function(
        "Covariance that the sources of noise, of these variances, leave in a sample.",
        "growth",
        [names.given, *names.argument("var_noise", names.k), names.growth],
        body,
    )


def header(names: Names, about: str) -> str:
    """Return the header's text, not yet formatted.

    Parameters
    ----------
    names : Names
        Of the model.
    about : str
        What machine it is, for the first line.
    """
    upper = names.model.name.upper()
    guard = f"AMBKIT_GENERATED_{upper}_H"
    return "\n".join([
        f"/* {about}. Written by ambkit.models.emit; do not edit. */",
        f"#ifndef {guard}\n#define {guard}\n",
        '#include "ambkit/real.h"\n',
        f"#define AMB_{upper}_STATES {names.n}",
        f"#define AMB_{upper}_TRIANGLE {len(names.pairs)}\n",
        struct(names),
        "#ifndef AMB_SIDE_BY_SIDE /* vectors of filters take theirs from the scalars' */",
        f"{growth(names)}#endif\n",
        displacement(names),
        current(names),
        predict_mean(names),
        predict_covariance(names),
        *(update(names, r) for r in range(names.m)),
        "#endif\n",
    ])  # fmt: skip
