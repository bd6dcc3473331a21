"""From a force law to the C that computes it.

A law is stated as physics has it. Computed so, it would lose all digits near the origin, where two
equal pulls are subtracted. So each function is written out as steps, in the order in which the C
adds and multiplies, and is held to the law: `header` refuses steps that are not the force of the
statement, or not its derivatives as SymPy finds them.
"""

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import sympy as sp

Expr = Any

iu, x, k, i0, s0, there = sp.symbols("iu x k i0 s0 there")
"""Control current, displacement; magnet constant, bias current, air gap; 1, or 0 for one side."""

DIGITS, POINTS = 60, 5
"""Steps and law agree to so many digits, at so many places."""


@dataclass(frozen=True)
class Function:
    """A function of a law, as it is computed.

    Attributes
    ----------
    name, about : str
        In C.
    steps : tuple of (str, str)
        Intermediate results in their order: name, expression.
    results : dict
        For each result its expression as it is computed and what it must be by the law. One called
        ``return`` is returned.
    more : tuple of Symbol
        Arguments between the law and (iu, x).
    """

    name: str
    about: str
    steps: tuple[tuple[str, str], ...]
    results: dict[str, tuple[str, Expr]]
    more: tuple[Expr, ...] = ()


@dataclass(frozen=True)
class Law:
    """A force law: its parameters in C and its functions."""

    name: str
    about: str
    struct: str
    include: str
    parameters: tuple[Expr, ...]
    functions: tuple[Function, ...]


def two_sides(side: Expr, gap: Expr, current: Expr) -> Expr:
    """Return the whole force of a magnet, of one side or two, from what one side pulls."""
    own = side.subs({gap: s0 - x, current: i0 + iu}, simultaneous=True)
    other = side.subs({gap: s0 + x, current: i0 - iu}, simultaneous=True)
    return own - there * other


def relative(force: Expr) -> Expr:
    """Return a force less that at the origin."""
    return force - force.subs({iu: 0, x: 0})


def header(law: Law) -> str:
    """Return the text of ``core/generated/<name>.h``."""
    guard = f"AMBKIT_GENERATED_{law.name.upper()}_H"
    return "\n".join([
        f"/* {law.about}. Written by `python -m models`; do not edit. */",
        f"#ifndef {guard}\n#define {guard}\n",
        f'#include "{law.include}"\n',
        *(_function(law, one) for one in law.functions),
        "#endif\n",
    ])  # fmt: skip


def _function(law: Law, f: Function) -> str:
    check(law, f)
    values = {name: text for name, (text, _) in f.results.items()}
    whole = " ".join([*(text for _, text in f.steps), *values.values()])
    used = set(re.findall(r"[A-Za-z_]\w*", whole))
    lines = [f"const amb_real {p} = law->{p};" for p in law.parameters if str(p) in used]
    lines += [f"const amb_real {name} = {_c(text)};" for name, text in f.steps]
    lines += [
        f"return {_c(text)};" if name == "return" else f"*{name} = {_c(text)};"
        for name, text in values.items()
    ]
    given = [f"const {law.struct} *law", *(f"amb_real {s}" for s in (*f.more, iu, x))]
    given += [f"amb_real *{name}" for name in values if name != "return"]
    kind = "amb_real" if "return" in values else "void"
    body = "\n".join(f"  {line}" for line in lines)
    return f"/* {f.about} */\nAMB_INLINE {kind} {f.name}({', '.join(given)})\n{{\n{body}\n}}\n"


def _c(text: str) -> str:
    """Return an expression as C of either precision."""
    text = re.sub(r"(?<![\w.])(\d+)(?:\.0)?(?![\w.])", r"AMB_C(\1.0)", text)
    return re.sub(r"\bsqrt\(", "amb_root(", text)


def check(law: Law, f: Function) -> None:
    """Refuse a function that does not compute what the law says.

    Raises
    ------
    ValueError
        With the name of the function and of the result.
    """
    known = {str(s): s for s in (*law.parameters, there, iu, x)}
    for name, text in f.steps:
        known[name] = sp.sympify(text, known)
    for name, (text, stated) in f.results.items():
        off = sp.sympify(text, known) - stated
        for place in _places([*law.parameters, *f.more, iu, x]):
            if abs(sp.N(off.subs(place), DIGITS)) > sp.Float(10) ** (20 - DIGITS):
                raise ValueError(f"{f.name}: {name} is not that of the law, at {place}")


def _places(symbols: list[Expr]) -> Iterator[dict[Expr, Expr]]:
    """Yield places at which a law is defined: all positive, and within the air gap."""
    draw = random.Random(0)
    for _ in range(POINTS):
        place = {s: sp.Rational(draw.randint(1, 999), 1000) for s in symbols}
        yield place | {item: place[item] + 1 for item in (s0, i0) if item in place}
