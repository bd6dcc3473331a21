"""The tables of a result as LaTeX, with booktabs."""

from __future__ import annotations

import re

from ambkit.base.escaping import one_line
from ambkit.base.units import typeset
from ambkit.result.row import Stated
from ambkit.result.tables import Table, tables

_WRITTEN = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#",
    "%": r"\%", "_": r"\_", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "<": "$<$",
    ">": "$>$", "|": r"$\vert$", "\u00a0": "~", "°": r"\textdegree{}", "−": "$-$", "±": r"$\pm$",
    "²": r"\textsuperscript{2}", "✗": r"$\times$", "µ": r"\textmu{}", "–": "--", "∞": r"$\infty$",
    "Ω": r"$\Omega$", "√": r"$\surd$",
}  # fmt: skip


def latex(result: Stated) -> str:
    """Return the tables, one below the other; they need the packages booktabs and textcomp."""
    return "\n\n".join(map(_tabular, tables(result)))


def _tabular(of: Table) -> str:
    head, *rows = [" & ".join(map(escaped, cells)) + r" \\" for cells in (of.headers, *of.rows)]
    return "\n".join([
        f"% {one_line(of.title)}", rf"\begin{{tabular}}{{l{'r' * (len(of.headers) - 1)}}}",
        r"\toprule", head, r"\midrule", *rows, r"\bottomrule", r"\end{tabular}",
    ])  # fmt: skip


def escaped(text: str) -> str:
    """Write a text such that LaTeX sets it as it stands."""
    line = one_line(text).replace("  ", "\N{NO-BREAK SPACE}" * 2)
    line = typeset(line) if line[:1].isdigit() or line[:1] == "-" else line
    return re.sub(".", lambda at: _WRITTEN.get(at[0], at[0]), line)
