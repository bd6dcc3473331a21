"""What is written of a force law: its C, its binding, and a class in Python."""

import re

from models.laws.law import Function, Law, check, iu, x

WRITTEN = "Written by `python -m models`; do not edit."

COMMON = (
    ("bool", "two_sided", "two magnets in differential mode; else one, against gravity"),
    ("amb_real", "ampere", "what the through-origin form takes for equally far: [A] ..."),
    ("amb_real", "metre", "... and [m]; the paper's least squares steps 0.01 A and 0.01 mm"),
)
"""The fields of all laws."""


def header(law: Law) -> str:
    """Return the text of ``core/generated/NAME_law.h``, of a law whose functions others share."""
    return _guarded(law, f"generated_{law.name}_law", [functions(law)])


def functions(law: Law) -> str:
    """Return its functions, without a branch."""
    needs_root = any("sqrt(" in text for f in law.functions for _, text in f.steps)
    lines = [f'#include "ambkit/{law.name}.h"']
    lines += ['#include "ambkit/root.h"'] if needs_root else []
    return "\n".join(["\n".join(lines) + "\n", *(_function(law, one) for one in law.functions)])


def declaration(law: Law) -> str:
    """Return the text of ``core/include/ambkit/NAME.h``: the struct and its methods."""
    fields = [("amb_real", str(item.symbol), item.about) for item in law.parameters]
    struct = "".join(
        f"  {kind} {name}; /* {about} */\n" for kind, name, about in (*fields, *COMMON)
    )
    return _guarded(law, law.name, [
        '#include "ambkit/magnet.h"\n', "AMB_EXTERN_C_BEGIN\n",
        f"/* `self` of {law.prefix}_magnet. */",
        f"typedef struct {law.type} {{\n{struct}}} {law.type};\n",
        f"extern const amb_magnet_methods {law.prefix}_magnet;\n",
        "AMB_EXTERN_C_END\n",
    ])  # fmt: skip


def _guarded(law: Law, stem: str, parts: list[str]) -> str:
    guard = f"AMBKIT_{stem.upper()}_H"
    about = f"/* {law.title} (models/laws/{law.name}.py). {WRITTEN} */"
    return "\n".join([about, f"#ifndef {guard}\n#define {guard}\n", *parts, "#endif\n"])


def methods(law: Law) -> str:
    """Return the text of ``core/src/NAME.c``: the law as one of the core's magnets."""
    named = {f.name: f for f in law.functions}
    shared = f'#include "generated/{law.name}_law.h"\n#include "turn.h"\n'
    own = functions(law).replace("\n\n", '\n#include "turn.h"\n\n', 1)
    sides = "law->two_sided ? AMB_C(1.0) : AMB_C(0.0), "
    force = f"{law.prefix}_force(law, iu, x)"
    if "force_one_sided" in named:
        force = f"law->two_sided ? {force} : {law.prefix}_force_one_sided(law, iu, x)"
    elif named["force"].more:
        two, one = (force.replace("iu", f"AMB_C({there}.0), iu") for there in (1, 0))
        force = f"law->two_sided ? {two} : {one}"
    return f"""\
/* {law.title}, as a magnet. {WRITTEN} */
{shared if law.shared else own}
/* F - F(0, 0). */
static amb_real force_of(const void *self, amb_real iu, amb_real x)
{{
  const {law.type} *law = (const {law.type} *)self;
  return {force};
}}

static amb_stiffness tangent(const void *self, amb_real iu, amb_real x)
{{
  const {law.type} *law = (const {law.type} *)self;
  amb_stiffness k;
  {law.prefix}_tangent(law, {sides if named["tangent"].more else ""}iu, x, &k.k_i, &k.k_s);
  return k;
}}

static amb_stiffness through_origin(const void *self, amb_real iu, amb_real x)
{{
  const {law.type} *law = (const {law.type} *)self;
  return amb_through_origin(law->ampere, law->metre, force_of(self, iu, x), tangent(self, iu, x),
                            iu, x);
}}

const amb_magnet_methods {law.prefix}_magnet = {{force_of, through_origin, tangent}};
"""


def binding(laws: tuple[Law, ...]) -> str:
    """Return the text of ``bindings/laws.h``: where the fields of each law's struct are."""
    rows = []
    for law in laws:
        numbers = [("amb_real", str(symbol)) for symbol in law.symbols]
        fields = ", ".join(
            f'{{"{name}", offsetof({law.type}, {name}), {str(kind == "bool").lower()}}}'
            for kind, name in (*numbers, *(item[:2] for item in COMMON))
        )
        in_c = f'{{"{law.type}", "{law.prefix}_magnet", "{law.name}", "{law.about}"}}'
        rows.append(
            f'{{"{law.name}", {in_c}, &{law.prefix}_magnet, sizeof({law.type}), {{{fields}}}}}'
        )
    includes = "\n".join(f'#include "ambkit/{law.name}.h"' for law in laws)
    table = ",\n".join(rows)
    return f"""\
// The force laws (models/laws). {WRITTEN}
#pragma once

#include "magnets.h"
#include <cstddef>

extern "C" {{
{includes}
}}

static const LawInCore of_laws[] = {{
{table},
}};
"""


def python(laws: tuple[Law, ...]) -> str:
    """Return the text of ``src/ambkit/machine/laws.py``: a class for each law."""
    keys = "".join(
        f"""
    {key.name}: Annotated[float, Quantity("{key.unit}", "{key.example}", above=0)] | None = None
    \"""{key.about}\"""
"""
        for law in laws
        for key in law.keys
    )
    classes = "".join(_python_class(law) for law in laws)
    names = ", ".join(f"{law.name.title()}Law" for law in laws)
    quantity = "from ambkit.base.config.quantities import Quantity\n" if keys else ""
    annotated = "from typing import Annotated, Any" if keys else "from typing import Any"
    return f"""\
\"""The force laws of magnets (models/laws). {WRITTEN}\"""

import math
from dataclasses import dataclass
{annotated}

from ambkit.base.config import Part
{quantity}from ambkit.base.errors import AmbkitError
from ambkit.machine.force_law import MU_0, ForceLaw, IsolatedAxis, Law


class LawKeys(Part):
    \"""The keys of ``[magnet]`` that laws add to the common ones.\"""
{keys}
{classes}

LAWS: tuple[type[ForceLaw], ...] = ({names},)
\"""All laws; of each magnet one holds, the first where no other does.\"""


def law_of(machine: IsolatedAxis) -> Law:
    \"""Return the law that a magnet's description states, whatever force map it has.\"""
    laws = [law for law in LAWS if law.holds_for(machine.magnet)] or [LAWS[0]]
    if len(laws) > 1:
        names = ", ".join(law.__name__ for law in laws)
        raise AmbkitError(f"magnet: must have one force law, its keys state {{names}}")
    return laws[0](machine)
"""


def _python_class(law: Law) -> str:
    values = ", ".join(f'"{item.symbol}": {item.value}' for item in law.parameters)
    reference = f"\n\n    References\n    ----------\n    {law.reference}" if law.reference else ""
    holds = f"""
    @classmethod
    def holds_for(cls, m: Any) -> bool:
        return {law.holds_for}
"""
    return f"""

@dataclass(frozen=True)
class {law.name.title()}Law(ForceLaw):
    \"""{law.title}, two-sided or one-sided.

    Parameters
    ----------
    machine : Machine
        A machine with one axis.{reference}
    \"""

    name = "{law.name}"
    ideal = {not law.holds_for}
{holds if law.holds_for else ""}
    @classmethod
    def parameters_of(cls, m: Any) -> dict[str, float]:
        return {{{values}}}
"""


def _function(law: Law, f: Function) -> str:
    check(law, f)
    values = {name: text for name, (text, _) in f.results.items()}
    own = re.compile(rf"\b({'|'.join(map(str, law.symbols))})\b")

    def c(text: str) -> str:
        return own.sub(r"law->\1", _c(text))

    lines = [f"const amb_real {name} = {c(text)};" for name, text in f.steps]
    lines += [
        f"return {c(text)};" if name == "return" else f"*{name} = {c(text)};"
        for name, text in values.items()
    ]
    given = [f"const {law.type} *law", *(f"amb_real {s}" for s in (*f.more, iu, x))]
    given += [f"amb_real *{name}" for name in values if name != "return"]
    kind = "amb_real" if "return" in values else "void"
    body = "\n".join(f"  {line}" for line in lines)
    declared = f"AMB_INLINE {kind} {law.prefix}_{f.name}({', '.join(given)})"
    return f"/* {f.about} */\n{declared}\n{{\n{body}\n}}\n"


def _c(text: str) -> str:
    """Return an expression as C of either precision."""
    text = re.sub(r"(?<![\w.])(\d+)(?:\.0)?(?![\w.])", r"AMB_C(\1.0)", text)
    return re.sub(r"\bsqrt\(", "amb_root(", text)
