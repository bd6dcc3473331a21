"""Write a model as a C header: structs, constants, and the three straight-line steps."""

from collections.abc import Iterable
from typing import Any

import sympy as sp
from sympy.printing.c import C99CodePrinter
from sympy.printing.precedence import PRECEDENCE

from derivation.model import Expr, Model


class Printer(C99CodePrinter):  # type: ignore[misc]
    """C for either precision: no double literals, no pow."""

    def _print_Pow(self, expr: Expr) -> str:
        base = self.parenthesize(expr.base, PRECEDENCE["Atom"], strict=True)
        exponent = int(expr.exp)
        product = "*".join([base] * abs(exponent))
        return product if exponent > 0 else f"AMB_C(1.0)/({product})"

    def _print_Add(self, expr: Expr, order: Any = None) -> str:
        # Products last: each can be fused with its addition.
        terms = self._as_ordered_terms(expr, order=order)
        texts = [self._print(t) for t in sorted(terms, key=lambda t: t.is_Mul or t.is_Pow)]
        rest = (f" - {t[1:]}" if t[0] == "-" else f" + {t}" for t in texts[1:])
        return str(texts[0]) + "".join(rest)

    def _print_Integer(self, expr: Expr) -> str:
        return f"AMB_C({expr}.0)"

    def _print_Rational(self, expr: Expr) -> str:
        if expr.q & (expr.q - 1):
            return f"(AMB_C({expr.p}.0)/AMB_C({expr.q}.0))"
        return f"AMB_C({expr.p / expr.q!r})"

    def _print_exp(self, expr: Expr) -> str:
        return f"amb_exp_negative({self._print(-expr.args[0])})"


def c(expr: Expr) -> str:
    """Return one expression as C."""
    return str(Printer().doprint(expr))


def block(
    targets: Iterable[tuple[str, Expr]], rename: dict[Expr, str], prefix: str = "t"
) -> list[str]:
    """Return the C lines that compute all targets from the old values, then store them."""
    names, expressions = zip(*targets, strict=True)
    shared, reduced = sp.cse(
        expressions, symbols=sp.numbered_symbols(prefix), optimizations="basic"
    )
    used = set().union(*(e.free_symbols for _, e in shared), *(e.free_symbols for e in reduced))
    lines = [
        f"const amb_real {s} = {where};"
        for s, where in rename.items()
        if s in used and str(s) != where
    ]
    lines += [f"const amb_real {s} = {c(e)};" for s, e in shared]
    return lines + [f"{name} = {c(e)};" for name, e in zip(names, reduced, strict=True)]


def function(doc: str, signature: str, body: list[str]) -> str:
    """Return one function that becomes part of its caller."""
    inside = "\n".join("  " + line for line in body)
    return f"/* {doc} */\nAMB_INLINE void {signature}\n{{\n{inside}\n}}\n"


class Names:
    """What a model's symbols are called in C."""

    def __init__(self, model: Model) -> None:
        self.kind = f"amb_{model.name}"
        self.model_argument = f"const {self.kind}_model *model"
        self.constants = {s: f"model->{s}" for s in (*model.kept, *model.constants)}
        self.mean = {s: f"mean[{i}]" for i, s in enumerate(model.state)}
        self.pairs = model.triangle()
        self.entries = {sp.Symbol(f"P{i}{j}"): f"cov[{k}]" for k, (i, j) in enumerate(self.pairs)}
        self.mean_argument = f"amb_real mean[{len(model.state)}]"
        self.cov_argument = f"amb_real cov[{len(self.pairs)}]"

    def in_place(self, expr: Expr) -> str:
        """Return an expression with the arrays' entries for its symbols."""
        entries = (self.mean | self.entries).items()
        return c(expr.subs({symbol: sp.Symbol(entry) for symbol, entry in entries}))


def constants(model: Model, names: Names) -> str:
    """Return the struct of the model's constants, and the function that computes them."""
    fields = "\n".join(f"  amb_real {s};" for s in names.constants)
    values = {kept: kept for kept in model.kept} | model.constants
    arguments = ", ".join(f"amb_real {p}" for p in model.parameters)
    return (
        "/* What the equations ask of the physical parameters, computed once. */\n"
        f"typedef struct {names.kind}_model {{\n{fields}\n}} {names.kind}_model;\n\n"
    ) + function(
        "Constants from the physical parameters, SI.",
        f"{names.kind}_model_init({names.kind}_model *model, {arguments})",
        block([(names.constants[s], e) for s, e in values.items()], {}),
    )


def mean_step(model: Model, names: Names) -> str:
    """Return the prediction of the mean (eq. 9)."""
    pairs = zip(model.state, model.forced, strict=True)
    return function(
        f"Eq. 9, the mean one sample on; {model.force}: force on the rotor without "
        f"{model.state[2]} [N].",
        f"{names.kind}_predict_mean({names.model_argument}, amb_real {model.force}, "
        f"{names.mean_argument})",
        block([(names.mean[s], e) for s, e in pairs if s != e], names.constants | names.mean),
    )


def covariance_step(model: Model, names: Names) -> str:
    """Return the prediction of the covariance (eq. 10)."""
    stages, triangle = model.covariance_stages()
    targets = {f"cov[{k}]": e for k, e in enumerate(triangle)}
    stored = {**names.constants, **names.entries}
    changed = {entry: e for entry, e in targets.items() if stored.get(e) != entry}
    used = set().union(*(e.free_symbols for _, e in stages), *(e.free_symbols for e in triangle))
    lines = [f"const amb_real {s} = {where};" for s, where in stored.items() if s in used]
    lines += [f"const amb_real {s} = {c(e)};" for s, e in stages]
    lines += [f"{entry} = {c(e)};" for entry, e in changed.items()]
    given = [*model.stiffness, model.gain, model.control_variance, *model.extra_noise.values()]
    arguments = ", ".join(f"amb_real {s}" for s in given)
    return function(
        "Eq. 10, A P A' + Q on the upper triangle, row by row.",
        f"{names.kind}_predict_covariance({names.model_argument}, {arguments}, "
        f"{names.cov_argument})",
        lines,
    )


def update(model: Model, names: Names) -> str:
    """Return the scalar update, eq. 11-13: K = P H' / S, X += K e, P -= K (P H')'."""
    P = model.covariance()
    PH = P * model.H.T
    S = (model.H * PH)[0] + model.measurement_variance
    inverse, e = sp.symbols("inverse e")
    K = sp.Matrix(sp.symbols(f"K:{len(model.state)}"))
    new_P = P - K * PH.T
    lines = [
        f"*variance = {names.in_place(S)};",
        f"*innovation = y - {names.in_place(model.measurement)};",
        "const amb_real inverse = AMB_C(1.0)/(*variance);",  # one division for all of K
        "const amb_real e = *innovation;",
    ]
    lines += [f"const amb_real {s} = {entry};" for s, entry in names.entries.items()]
    lines += [f"const amb_real {k} = {c(p * inverse)};" for k, p in zip(K, PH, strict=True)]
    lines += [f"mean[{i}] += {c(k * e)};" for i, k in enumerate(K)]
    lines += [f"cov[{k}] = {c(new_P[i, j])};" for k, (i, j) in enumerate(names.pairs)]
    return function(
        "Eq. 11-13 for the scalar measurement of eq. 21; S must be positive.",
        f"{names.kind}_update(amb_real y, amb_real {model.measurement_variance}, "
        f"{names.mean_argument}, {names.cov_argument}, amb_real *innovation, amb_real *variance)",
        lines,
    )


def header(model: Model) -> str:
    """Return the text of ``core/generated/<name>.h``."""
    names, upper = Names(model), model.name.upper()
    guard = f"AMBKIT_GENERATED_{upper}_H"
    return "\n".join([
        f"/* {model.about}. Written by `python -m derivation`; do not edit. */",
        f"#ifndef {guard}\n#define {guard}\n",
        '#include "ambkit/exponential.h"\n#include "ambkit/real.h"\n',
        f"#define AMB_{upper}_STATES {len(model.state)}",
        f"#define AMB_{upper}_TRIANGLE {len(names.pairs)}\n",
        constants(model, names),
        mean_step(model, names),
        covariance_step(model, names),
        update(model, names),
        "#endif\n",
    ])  # fmt: skip
