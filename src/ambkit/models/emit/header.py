"""Header of a kind of machine: its constants and steps, for ``ambkit/model.h``."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

from ambkit.models.emit import steps
from ambkit.models.emit.covariance import predict_covariance
from ambkit.models.emit.names import Names
from ambkit.models.model import MATRICES, Model

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
