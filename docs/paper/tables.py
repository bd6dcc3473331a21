"""The tables as files, in the layout of the reference figures."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from ambkit.fuzzy.expert import Expert
from paper.printed import INITIAL_WIDTH

Array = NDArray[np.float64]


def stiffness_csv(current: Array, displacement: Array, stiffness: Array) -> str:
    """Rows are displacements [mm], columns currents [A], as Tables 4 and 5."""
    lines = [",".join(["x_mm\\i_A", *(f"{i:g}" for i in current)])]
    for x, values in zip(displacement, stiffness, strict=True):
        lines.append(",".join([f"{x * 1e3:g}", *(f"{value:.4f}" for value in values)]))
    return "\n".join(lines) + "\n"


def widths_csv(expert: Expert) -> str:
    """One row a rule, widths in units of 1 A and 1 mm, as Table 6."""
    text = io.StringIO()
    text.write("rule,i_A,x_mm,initial,width_ki,width_ks\n")
    for number, rule in enumerate(expert.rules, start=1):
        text.write(
            f"{number},{rule.current:g},{rule.displacement * 1e3:g},{INITIAL_WIDTH:g},"
            f"{rule.width_k_i:.6g},{rule.width_k_s:.6g}\n"
        )
    return text.getvalue()
