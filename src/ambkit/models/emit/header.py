"""Header of a kind of machine: constants, steps and covariance, for ``ambkit/model.h``."""

import re
import textwrap
from collections.abc import Sequence

from ambkit.models.emit import steps
from ambkit.models.emit.names import (
    COV,
    GROWTH,
    Factor,
    Names,
    Stages,
    Sum,
    Term,
    product,
    products,
    total,
)
from ambkit.models.model import MATRICES, ZERO, Model

Symbols = list[list[str | None]]

Rings = Sequence[tuple[int, ...]] | None  #: Forces of each ring; None: they are not predicted.

OTHER_FORCES = (
    "const amb_real row[AMB_FORCES * AMB_STATES]",
    "const amb_real variance[AMB_FORCES * AMB_FORCES]",
)
"""Gradients of further forces by the states, and their covariances (``linear_forces.h``)."""


def predict_covariance(names: Names, rings: Rings = None) -> str:
    """Return the function that predicts the covariance, or that with forces of rings as well."""
    n, p, stages = range(names.n), range(names.p), Stages()
    rows = [_force_row(names, f, stages, rings) for f in p]
    g = _gains(names, stages)
    q = _force_noise(names, g, stages, rings)
    b = [names.entries("b", i) for i in n]
    w = [
        [
            stages.add(
                names.of_force("w", f, j), [product(names.P(k, j), a) for k, a in rows[f][::-1]]
            )
            for j in n
        ]
        for f in p
    ]
    M: Symbols = []
    for i in n:
        M.append([])
        for j in n:
            terms = [product(a, names.P(k, j)) for k, a in names.entries("L", i)]
            terms += products((a, w[f][j]) for f, a in b[i])
            M[i].append(stages.add(names.pair("M", i, j), terms))
    direct = [_direct(names, i, stages) for i in n]
    z: Symbols = []
    for i in n:
        z.append([])
        V = {
            at: stages.add(names.of_control("V", i, at), [product(B, f"var_u[{at}]")])
            for at, B in direct[i].items()
        }
        for f in p:
            terms = products((a, q[min(k, f)][max(k, f)]) for k, a in b[i])
            terms += products((noise, g[f][at]) for at, noise in V.items())
            terms += products((a, M[i][k]) for k, a in rows[f][::-1])
            z[i].append(stages.add(names.of_force("z", f, i), terms))
    U = [_with_noise(names, i, direct[i], g, stages) for i in n]
    upper: list[Sum] = []
    for i, j in names.pairs:
        terms = products((a, M[i][k]) for k, a in names.entries("L", j))
        if (names.model.pattern["N"][:, i, j] != ZERO).any():
            terms.append(product(f"growth[{names.where[i, j]}]"))
        terms += products((B, U[i][at]) for at, B in direct[j].items())
        terms += products((a, z[i][f]) for f, a in b[j])
        upper.append(terms)
    lines, symbols = stages.needed(upper)
    stored = [f"cov[{at}] = {total(terms)};" for at, terms in enumerate(upper)]
    return names.function(
        "Eq. 10, A P A' + Q on the upper triangle, row by row.",
        "predict_covariance" if rings is None else "predict_with_forces",
        [
            "const amb_stiffness k[AMB_FORCES]",
            *(() if rings is None else OTHER_FORCES),
            *(f"const amb_real {name}[AMB_CONTROLS]" for name in ("k_ui", "var_u")),
            f"const {GROWTH}",
            COV,
            "amb_real work[AMB_WORK]",
        ],
        names.loads(symbols) + lines + stored,
    )


def _force_row(names: Names, f: int, stages: Stages, rings: Rings) -> list[tuple[int, Factor]]:
    """Return the entries of a linearised force by the state: k_s h + k_i e + r."""
    h, e, r = (dict(names.entries(name, f)) for name in "her")
    collocated = {j for g in range(names.p) for j, _ in names.entries("r", g)}
    others = set() if rings is None else {*h, *collocated}
    results: list[tuple[int, Factor]] = []
    for j in sorted({*h, *e, *r, *others}):
        terms = [product(h[j], names.of_p("k_s", f))] if j in h else []
        terms += [product(e[j], names.of_p("k_i", f))] if j in e else []
        terms += [product(r[j])] if j in r else []
        terms += [product(f"row[{f * names.n + j}]")] if j in others else []
        # a collocated input, with coefficient one
        single = len(terms) == 1 and not terms[0].symbols
        results.append((j, None if single else stages.add(names.of_force("h", f, j), terms)))
    return results


def _gains(names: Names, stages: Stages) -> Symbols:
    """Return g = (k_i d) k_ui, of each force by each control signal."""
    gains: Symbols = [[None] * names.c for _ in range(names.p)]
    for f in range(names.p):
        for at, d in names.entries("d", f):
            current = [product(d, names.of_p("k_i", f))]
            stiffness = stages.add(names.of_control("a", f, at), current)
            gain = [product(stiffness, f"k_ui[{at}]")]
            gains[f][at] = stages.add(names.of_control("g", f, at), gain)
    return gains


def _force_noise(names: Names, g: Symbols, stages: Stages, rings: Rings) -> Symbols:
    """Return q, the covariances of the forces due to the controls' noise: the upper triangle."""
    q: Symbols = [[None] * names.p for _ in range(names.p)]
    for i in range(names.p):
        for j in range(i, names.p):
            terms = [
                Term(f"({a} * {b}) * {var}", frozenset({a, b, var}))
                for at, (a, b) in enumerate(zip(g[i], g[j], strict=True))
                for var in [f"var_u[{at}]"]
                if a is not None and b is not None
            ]
            if any({i, j} <= set(ring) for ring in rings or ()):
                terms.append(product(f"variance[{i * names.p + j}]"))
            q[i][j] = stages.add(names.of_force("q", i, j), terms)
    return q


def _direct(names: Names, i: int, stages: Stages) -> dict[int, Factor]:
    """Return the direct effect of a control signal of 1 on a state: B_u k_ui."""
    return {
        at: stages.add(names.of_control("B", i, at), [product(B, f"k_ui[{at}]")])
        for at, B in names.entries("B_u", i)
    }


def _with_noise(
    names: Names, i: int, direct: dict[int, Factor], g: Symbols, stages: Stages
) -> list[str | None]:
    """Return the covariances of a predicted state with the controls' noise."""
    results = []
    for at in range(names.c):
        terms = [product(direct[at])] if at in direct else []
        terms += products((a, g[f][at]) for f, a in names.entries("b", i))
        name, var = names.of_control("U", i, at), f"var_u[{at}]"
        results.append(stages.add(name, terms, times=var))
    return results


SCALAR = (steps.growth, steps.drives, steps.pushed, steps.role, steps.sound, steps.known)
"""Functions of the scalar filter used for several lanes."""
IN_LANES = (
    steps.displacement, steps.current, steps.shown, steps.shown_variance, steps.variances,
    steps.shown_with, steps.equilibrium, steps.predict_mean, predict_covariance, steps.update,
)  # fmt: skip
"""Functions of each lane, in the order of the file."""

WIDTH = 100


def struct(names: Names) -> str:
    """Return the struct of the constants."""
    fields = "".join(f"  amb_real {name};\n" for name in names.constants.values())
    return (
        "/* What the equations ask of the physical parameters, computed once. */\n"
        f"typedef struct amb_model {{\n{fields}}} amb_model;\n"
    )


def constants(names: Names, model: Model) -> dict[str, float]:
    """Return a model's numbers by name, in the struct's order."""
    if model.pattern_key() != names.model.pattern_key():
        raise ValueError("the model is of another pattern than the struct")
    return {
        name: float(
            getattr(model, at)[i, j] if at in MATRICES else model.N[int(at.removeprefix("N")), i, j]
        )
        for (at, i, j), name in names.constants.items()
    }


def initialiser(names: Names, model: Model) -> str:
    """Return the struct's initialiser with a model's numbers, exact in both precisions."""
    values = constants(names, model).values()
    return "{" + ", ".join(f"AMB_C({value!r})" for value in values) + "}"


def header(
    names: Names,
    about: str,
    *,
    stem: str = "model",
    by: str = "ambkit",
    includes: Sequence[str] = (),
    more: str = "",
    rings: Rings = None,
) -> str:
    """Return the header's text, with wrapped lines but not formatted."""
    guard = f"AMBKIT_GENERATED_{stem.upper()}_H"
    counts = {
        "STATES": names.n, "FORCES": names.p, "CONTROLS": names.c, "SENSORS": names.m,
        "NOISES": names.k,
    }  # fmt: skip
    text = "\n".join([
        f"/* {about}. Written by {by}; do not edit. */",
        f"#ifndef {guard}\n#define {guard}\n",
        *(f'#include "ambkit/{name}.h"' for name in ("magnet", *includes)),
        "",
        *(f"#define AMB_{what} {count}" for what, count in counts.items()),
        f"#define AMB_TRIANGLE {len(names.pairs)}",
        "#define AMB_WORK 1 /* nothing is needed */\n",
        *steps.initial_values(names),
        "",
        struct(names),
        "#ifndef AMB_SIDE_BY_SIDE /* vectors of filters take theirs from the scalars' */",
        *([more] if more else []),
        *(function(names) for function in SCALAR),
        f"{steps.uncorrelated(names)}#endif\n",
        *(function(names) for function in IN_LANES),
        *([] if rings is None else [predict_covariance(names, rings)]),
        "#endif\n",
    ])  # fmt: skip
    return "\n".join(line for long in text.split("\n") for line in _wrapped(long))


def fields(names: Names, *, stem: str, by: str) -> str:
    """Return a header with a macro that lists all constants."""
    guard = f"AMBKIT_{stem.upper()}_FIELDS_H"
    listed = "; \\\n  ".join(f"FIELD({name})" for name in names.constants.values())
    return "\n".join([
        f"/* Each constant, for whoever asks for all. Written by {by}; do not edit. */",
        f"#ifndef {guard}\n#define {guard}\n",
        f"#define AMB_MODEL_FIELDS(FIELD) \\\n  {listed}\n",
        "#endif\n",
    ])  # fmt: skip


def _wrapped(line: str) -> list[str]:
    """Break a long line of a comment or of code at blanks."""
    if len(line) <= WIDTH or line.startswith("#"):
        return [line]
    indent = re.match(" *", line)[0]  # type: ignore[index]
    further = indent + (" * " if line.lstrip().startswith("/*") else "    ")
    return textwrap.wrap(
        line.strip(), WIDTH, initial_indent=indent, subsequent_indent=further,
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip
