"""Write a model as a C header: structs, constants, and the three straight-line steps."""

from collections.abc import Iterable

import sympy as sp
from sympy.printing.c import C99CodePrinter
from sympy.printing.precedence import PRECEDENCE

from derivation.model import Expr, Model


class Printer(C99CodePrinter):  # type: ignore[misc]
    """C for either precision: no double literals, no pow."""

    def _print_Pow(self, expr: Expr) -> str:
        base = self.parenthesize(expr.base, PRECEDENCE["Atom"])
        exponent = int(expr.exp)
        product = "*".join([base] * abs(exponent))
        return product if exponent > 0 else f"1/({product})"

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
    """Return one static inline function."""
    inside = "\n".join("  " + line for line in body)
    return f"/* {doc} */\nstatic inline void {signature}\n{{\n{inside}\n}}\n"


def header(model: Model) -> str:
    """Return the text of ``core/generated/<name>.h``."""
    n = len(model.state)
    pairs = model.triangle()
    kind = f"amb_{model.name}"
    guard = f"AMBKIT_GENERATED_{model.name.upper()}_H"
    fields = [*model.kept, *model.constants]
    m = {s: f"model->{s}" for s in fields}
    mean = {s: f"mean[{i}]" for i, s in enumerate(model.state)}
    P = {sp.Symbol(f"P{i}{j}"): f"cov[{k}]" for k, (i, j) in enumerate(pairs)}
    noise = [model.control_variance, *model.extra_noise.values()]
    k_names = ", ".join(f"amb_real {s}" for s in model.stiffness)

    struct = "\n".join(f"  amb_real {s};" for s in fields)
    init = block(
        [(f"model->{s}", e) for s, e in [*((k, k) for k in model.kept), *model.constants.items()]],
        {},
    )
    predict_mean = block(
        [(mean[s], e) for s, e in zip(model.state, model.transition, strict=True) if s != e],
        m | mean,
    )
    AP = model.predicted_covariance()
    predict_cov = block([(f"cov[{k}]", AP[i, j]) for k, (i, j) in enumerate(pairs)], m | P)

    # Scalar update, eq. 11-13: K = P H' / S, X += K e, P -= K (P H')'. One division.
    cov, H = model.covariance(), model.H
    PH = cov * H.T
    S = (H * PH)[0] + model.measurement_variance
    inv, e = sp.symbols("inv e")
    update = [
        f"const amb_real inv = 1/(*variance = {c(S.subs({k: sp.Symbol(v) for k, v in P.items()}))});",
        f"const amb_real e = *innovation = y - "
        f"{c(model.measurement.subs({k: sp.Symbol(v) for k, v in mean.items()}))};",
    ]
    K = [sp.Symbol(f"K{i}") for i in range(n)]
    new_P = cov - sp.Matrix(K) * PH.T
    lines = [f"const amb_real {s} = {where};" for s, where in P.items()]
    lines += [f"const amb_real {k} = {c(PH[i] * inv)};" for i, k in enumerate(K)]
    lines += [f"mean[{i}] += {c(k * e)};" for i, k in enumerate(K)]
    lines += [f"cov[{k}] = {c(new_P[i, j])};" for k, (i, j) in enumerate(pairs)]

    model_arg = f"const {kind}_model *model"
    gain, control = model.gain, model.control
    parts = [
        f"/* {model.about}. Written by `python -m derivation`; do not edit. */",
        f'#ifndef {guard}\n#define {guard}\n\n#include "ambkit/exponential.h"\n#include "ambkit/real.h"\n',
        f"#define AMB_{model.name.upper()}_STATES {n}\n"
        f"#define AMB_{model.name.upper()}_TRIANGLE {len(pairs)}\n",
        "/* What the equations ask of the physical parameters, computed once. */\n"
        f"typedef struct {kind}_model {{\n{struct}\n}} {kind}_model;\n",
        function(
            "Constants from the physical parameters, SI.",
            f"{kind}_model_init({kind}_model *model, "
            + ", ".join(f"amb_real {p}" for p in model.parameters)
            + ")",
            init,
        ),
        function(
            f"Eq. 9, the mean one sample on; {model.force}: force on the rotor but {model.state[2]} [N].",
            f"{kind}_predict_mean({model_arg}, amb_real {model.force}, amb_real mean[{n}])",
            predict_mean,
        ),
        function(
            "Eq. 10, A P A' + Q on the upper triangle, row by row.",
            f"{kind}_predict_covariance({model_arg}, {k_names}, amb_real {gain}, "
            + ", ".join(f"amb_real {q}" for q in noise)
            + f", amb_real cov[{len(pairs)}])",
            predict_cov,
        ),
        function(
            "Eq. 11-13 for the scalar measurement of eq. 21; S must be positive.",
            f"{kind}_update(amb_real y, amb_real {model.measurement_variance}, amb_real mean[{n}], "
            f"amb_real cov[{len(pairs)}], amb_real *innovation, amb_real *variance)",
            update + lines,
        ),
        "#endif",
    ]
    assert control not in sp.Matrix([AP]).free_symbols
    return "\n".join(parts) + "\n"
