"""Write a model's constants as C: functions of the physical parameters, in closed form."""

from collections.abc import Iterable

import sympy as sp
from sympy.printing.c import C99CodePrinter
from sympy.printing.precedence import PRECEDENCE

from models.model import Expr, Model


class Printer(C99CodePrinter):  # type: ignore[misc]
    """C for either precision: no double literals, no pow."""

    def _print_Pow(self, expr: Expr) -> str:
        base = self.parenthesize(expr.base, PRECEDENCE["Atom"], strict=True)
        exponent = int(expr.exp)
        product = "(" + "*".join([base] * abs(exponent)) + ")"
        return product if exponent > 0 else f"AMB_C(1.0)/{product}"

    def _print_Integer(self, expr: Expr) -> str:
        return f"AMB_C({expr}.0)"

    def _print_Rational(self, expr: Expr) -> str:
        if expr.q & (expr.q - 1):
            return f"(AMB_C({expr.p}.0)/AMB_C({expr.q}.0))"
        return f"AMB_C({expr.p / expr.q!r})"

    def _print_Float(self, expr: Expr) -> str:
        return f"AMB_C({float(expr)!r})"

    def _print_exp(self, expr: Expr) -> str:
        return f"amb_exp_negative({self._print(-expr.args[0])})"

    def _print_Function(self, expr: Expr) -> str:
        return f"amb_{expr.func}({self._print(expr.args[0])})"


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


def initialisation(model: Model) -> str:
    """Return the functions that compute the constants of ``amb_model``."""
    values = {kept: kept for kept in model.kept} | model.constants | model.growth_constants
    arguments = ", ".join(f"amb_real {p}" for p in model.parameters)
    return "\n".join([
        function(
            "Constants from the physical parameters, SI.",
            f"amb_model_init(amb_model *model, {arguments})",
            block(
                [(f"model->{s}", e) for s, e in values.items()],
                {s: c(e) for s, e in model.factors.items()},
            ),
        ),
        function(
            "What the equations as printed leave out: the force and the speed within the sample.",
            "amb_model_as_printed(amb_model *model)",
            [f"model->{s} = AMB_C(0.0);" for s in (*model.printed, *model.growth_constants)],
        ),
    ])  # fmt: skip
