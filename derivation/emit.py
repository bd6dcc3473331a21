"""Write a model as a C header: structs, constants, and the three straight-line steps."""

from collections.abc import Iterable

import sympy as sp
from sympy.printing.c import C99CodePrinter
from sympy.printing.precedence import PRECEDENCE

from derivation.model import Expr, Model, Sum


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


MODEL = "const amb_model *model"


class Names:
    """What a model's symbols are called in C."""

    def __init__(self, model: Model) -> None:
        self.values = {kept: kept for kept in model.kept} | model.constants | model.growth_constants
        self.constants = {s: f"model->{s}" for s in self.values}
        self.mean = {s: f"mean[{i}]" for i, s in enumerate(model.state)}
        self.pairs = model.triangle()
        self.entries = {sp.Symbol(f"P{i}{j}"): f"cov[{k}]" for k, (i, j) in enumerate(self.pairs)}
        self.growth = {s: f"growth[{k}]" for k, s in enumerate(model.growth_in_sample)}
        self.mean_argument = "amb_real mean[AMB_STATES]"
        self.cov_argument = "amb_real cov[AMB_TRIANGLE]"
        self.growth_argument = "amb_real growth[AMB_TRIANGLE]"

    def in_place(self, expr: Expr) -> str:
        """Return an expression with the arrays' entries for its symbols."""
        entries = (self.constants | self.mean | self.entries).items()
        return c(expr.subs({symbol: sp.Symbol(entry) for symbol, entry in entries}))


def constants(model: Model, names: Names) -> str:
    """Return the struct of the model's constants, and the functions that compute them."""
    fields = "\n".join(f"  amb_real {s};" for s in names.constants)
    arguments = ", ".join(f"amb_real {p}" for p in model.parameters)
    return (
        "/* What the equations ask of the physical parameters, computed once. */\n"
        f"typedef struct amb_model {{\n{fields}\n}} amb_model;\n\n"
        "#ifndef AMB_SIDE_BY_SIDE /* vectors of filters take theirs from the scalars' */\n"
        + function(
            "Constants from the physical parameters, SI.",
            f"amb_model_init(amb_model *model, {arguments})",
            block(
                [(names.constants[s], e) for s, e in names.values.items()],
                {s: c(e) for s, e in model.factors.items()},
            ),
        )
        + "\n"
        + function(
            "What the equations as printed leave out: the force and the speed within the sample.",
            f"amb_model_as_printed(amb_model *model)",
            [
                f"{names.constants[s]} = AMB_C(0.0);"
                for s in (*model.printed, *model.growth_constants)
            ],
        )
        + "\n"
        + function(
            f"Covariance that a growth of {model.growth} of variance var[0] leaves in a sample.",
            f"amb_model_growth({MODEL}, const amb_real var[AMB_NOISES], {names.growth_argument})",
            [
                f"{names.growth[s]} = "
                + names.in_place(e.subs(model.growth_variance, sp.Symbol("var[0]")))
                + ";"
                for s, e in model.growth_in_sample.items()
            ],
        )
        + "\n"
        + scalar_forms(model, names)
        + "\n"
        + variances(model, names)
        + "#endif\n"
    )


def scalar_forms(model: Model, names: Names) -> str:
    """Return what is asked of a model only one filter at a time."""
    _, b = model.held
    return "\n".join([
        function(
            "How a force of 1 N moves the states within a sample.",
            f"amb_model_pushed({MODEL}, int f, amb_real moved[AMB_STATES])",
            ["(void)f;", *(f"moved[{i}] = {names.in_place(e)};" for i, e in enumerate(b))],
        ),
        form(
            "What each state is.",
            f"amb_model_role({MODEL}, int i)",
            [
                "static const amb_role role[AMB_STATES] = {" + ", ".join(model.roles) + "};",
                "(void)model;",
                "return role[i];",
            ],
            "amb_role",
        ),
    ])  # fmt: skip


def variances(model: Model, names: Names) -> str:
    """Return what is asked of the variances, which must not be loops (``ambkit/model.h``)."""
    n = len(model.state)
    diagonal = [f"cov[{names.pairs.index((i, i))}]" for i in range(n)]
    positions = [i for i, role in enumerate(model.roles) if role == "AMB_POSITION"]
    zeros = {f"cov[{k}]": "AMB_C(0.0)" for k in range(len(names.pairs))}
    alone = zeros | {at: f"amb_magnitude(variances[{i}])" for i, at in enumerate(diagonal)}
    given = f"const {names.cov_argument}"
    unused = "(void)model;"
    return "\n".join([
        form(
            "Whether they are such.",
            f"amb_model_sound({MODEL}, {given})",
            [unused, f"return {' && '.join(f'({at} >= AMB_C(0.0))' for at in diagonal)};"],
            "bool",
        ),
        form(
            "Whether the position is known better than this.",
            f"amb_model_known({MODEL}, {given}, const amb_real widest[AMB_STATES])",
            [unused, f"return {' && '.join(f'({diagonal[i]} <= widest[{i}])' for i in positions)};"],
            "bool",
        ),
        function(
            "A covariance of these variances, and nothing else.",
            f"amb_model_uncorrelated({MODEL}, const amb_real variances[AMB_STATES], "
            f"{names.cov_argument})",
            [unused, *(f"{at} = {value};" for at, value in alone.items())],
        ),
    ])  # fmt: skip


def forms(model: Model, names: Names) -> str:
    """Return what magnet and sensor are asked about: linear forms of the state."""
    k = model.state.index(model.measurement)
    last = [names.pairs.index((min(i, k), max(i, k))) for i in range(len(model.state))]
    rest = {names.mean[s]: names.in_place(e) for s, e in model.at_rest.items()}
    n = len(model.state)
    diagonal = [f"cov[{names.pairs.index((i, i))}]" for i in range(n)]
    unused = "(void)model;"
    return "\n".join([
        form(
            "Displacement at which the magnet pulls, the mean over the sample [m].",
            f"amb_model_displacement({MODEL}, int f, const {names.mean_argument})",
            ["(void)f;", f"return {names.in_place(model.displacement)};"],
        ),
        form(
            "Its current [A].",
            f"amb_model_current({MODEL}, int f, const {names.mean_argument}, "
            "const amb_real iu[AMB_CONTROLS])",
            [unused, "(void)f;", "(void)mean;", "return iu[0];"],
        ),
        form(
            "What the sensor shows (eq. 21).",
            f"amb_model_shown({MODEL}, int r, const {names.mean_argument})",
            [unused, "(void)r;", f"return {names.in_place(model.measurement)};"],
        ),
        form(
            "The variance of that.",
            f"amb_model_shown_variance({MODEL}, int r, const {names.cov_argument})",
            [unused, "(void)r;", f"return cov[{last[k]}];"],
        ),
        function(
            "The variances of all states.",
            f"amb_model_variances({MODEL}, const {names.cov_argument}, amb_real variances[AMB_STATES])",
            [unused, *(f"variances[{i}] = {at};" for i, at in enumerate(diagonal))],
        ),
        function(
            "And its covariance with the states.",
            f"amb_model_shown_with({MODEL}, int r, const {names.cov_argument}, "
            "amb_real with_y[AMB_STATES])",
            [unused, "(void)r;", *(f"with_y[{i}] = cov[{e}];" for i, e in enumerate(last))],
        ),
        function(
            "What follows from the positions when all is at rest.",
            f"amb_model_at_rest({MODEL}, {names.mean_argument})",
            [f"{state} = {value};" for state, value in rest.items()],
        ),
    ])  # fmt: skip


def form(doc: str, signature: str, body: list[str], returned: str = "amb_real") -> str:
    """Return one function that returns a value."""
    return function(doc, signature, body).replace("AMB_INLINE void", f"AMB_INLINE {returned}")


def total(terms: Sum) -> str:
    """Return a sum as C, term by term."""
    return " + ".join(c(term) for term in terms)


def mean_step(model: Model, names: Names) -> str:
    """Return the prediction of the mean (eq. 9)."""
    rows = list(zip(model.state, model.mean_sums, strict=True))
    changed = [(state, terms) for state, terms in rows if terms != [state]]
    used = {s for _, terms in changed for term in terms for s in term.free_symbols}
    stored = names.constants | names.mean
    lines = [
        f"const amb_real {s} = {where};"
        for s, where in stored.items()
        if s in used | model.whole_force.free_symbols
    ]
    whole = model.whole_force.subs(model.force, sp.Symbol("F[0]"))
    lines.insert(0, "(void)iu;")
    lines.append(f"const amb_real {model.driving} = {c(whole)};")
    lines += [f"{names.mean[state]} = {total(terms)};" for state, terms in changed]
    return function(
        f"Eq. 9, the mean one sample on; F: force on the rotor without {model.growth} [N].",
        f"amb_model_predict_mean({MODEL}, const amb_real F[AMB_FORCES], "
        f"const amb_real iu[AMB_CONTROLS], {names.mean_argument})",
        lines,
    )


def covariance_step(model: Model, names: Names) -> str:
    """Return the prediction of the covariance (eq. 10)."""
    stages, triangle = model.covariance_stages()
    places = {s: sp.Symbol(f"{s}[0]") for s in (model.gain, model.control_variance)}
    stages = [(s, [term.subs(places) for term in terms]) for s, terms in stages]
    entries = [(f"cov[{k}]", terms) for k, terms in enumerate(triangle)]
    stored = {**names.constants, **names.growth, **names.entries}
    computed = [terms for _, terms in stages] + triangle
    used = {s for terms in computed for term in terms for s in term.free_symbols}
    lines = [f"const amb_real {s} = {where};" for s, where in stored.items() if s in used]
    lines += [f"const amb_real {s} = {total(terms)};" for s, terms in stages]
    lines += [f"{entry} = {total(terms)};" for entry, terms in entries]
    given = {s: f"k[0].{s}" for s in model.stiffness}
    lines = [f"const amb_real {s} = {place};" for s, place in given.items()] + lines
    return function(
        "Eq. 10, A P A' + Q on the upper triangle, row by row.",
        f"amb_model_predict_covariance({MODEL}, const amb_stiffness k[AMB_FORCES], "
        f"const amb_real {model.gain}[AMB_CONTROLS], "
        f"const amb_real {model.control_variance}[AMB_CONTROLS], "
        f"const {names.growth_argument}, {names.cov_argument}, amb_real work[AMB_WORK])",
        ["(void)work;", *lines],
    )


def update(model: Model, names: Names) -> str:
    """Return the scalar update, eq. 11-13: K = P H' / S, X += K e, P -= K (P H')'."""
    P = model.covariance()
    PH = P * model.H.T
    S = (model.H * PH)[0] + model.measurement_variance
    inverse, e = sp.symbols("inverse e")
    K = sp.Matrix(sp.symbols(f"K:{len(model.state)}"))
    lines = [
        "(void)model;",
        "(void)r;",
        f"*variance = {names.in_place(S)};",
        f"*innovation = y - {names.in_place(model.measurement)};",
        "const amb_real inverse = AMB_C(1.0)/(*variance);",  # one division for all of K
        "const amb_real e = *innovation;",
    ]
    lines += [f"const amb_real {s} = {entry};" for s, entry in names.entries.items()]
    lines += [f"const amb_real {k} = {c(p * inverse)};" for k, p in zip(K, PH, strict=True)]
    lines += [f"mean[{i}] += {c(k * e)};" for i, k in enumerate(K)]
    # As differences, not as sums with -K: that would be one more operation to wait for.
    lines += [
        f"cov[{k}] = {c(P[i, j])} - {c(K[i] * PH[j])};" for k, (i, j) in enumerate(names.pairs)
    ]
    return function(
        "Eq. 11-13 for the scalar measurement of eq. 21; S must be positive.",
        f"amb_model_update({MODEL}, int r, amb_real y, amb_real {model.measurement_variance}, "
        f"{names.mean_argument}, {names.cov_argument}, amb_real *innovation, amb_real *variance)",
        lines,
    )


def fields(model: Model) -> str:
    """Return the text of ``core/generated/<name>_fields.h``: no controller needs it."""
    names = Names(model)
    guard = f"AMBKIT_GENERATED_{model.name.upper()}_FIELDS_H"
    listed = "; ".join(f"FIELD({s})" for s in names.constants)
    return (
        "/* Each constant of the model, for whoever asks for all. Written by "
        "`python -m derivation`; do not edit. */\n"
        f"#ifndef {guard}\n#define {guard}\n\n"
        f"#define AMB_MODEL_FIELDS(FIELD) {listed}\n\n#endif\n"
    )


def header(model: Model) -> str:
    """Return the text of ``core/generated/<name>.h``."""
    names, upper = Names(model), model.name.upper()
    guard = f"AMBKIT_GENERATED_{upper}_H"
    return "\n".join([
        f"/* {model.about}. Written by `python -m derivation`; do not edit. */",
        f"#ifndef {guard}\n#define {guard}\n",
        '#include "ambkit/magnet.h"\n#include "ambkit/phi.h"\n',
        f"#define AMB_STATES {len(model.state)}",
        f"#define AMB_TRIANGLE {len(names.pairs)}",
        *(f"#define AMB_{what} 1" for what in ("FORCES", "CONTROLS", "SENSORS", "NOISES", "WORK")),
        "",
        *(
            f"#define AMB_FIRST_{role} {model.roles.index(f'AMB_{role}')}"
            for role in ("POSITION", "VELOCITY", "LOAD")
        ),
        "",
        *(
            f"#define amb_{what.lower()}(model) ((void)(model), AMB_{what})"
            for what in ("STATES", "FORCES", "CONTROLS", "SENSORS", "NOISES")
        ),
        "",
        constants(model, names),
        forms(model, names),
        mean_step(model, names),
        covariance_step(model, names),
        update(model, names),
        "#endif\n",
    ])  # fmt: skip
