"""The paper's axis (eq. 15-21), which is built into the core as straight-line C."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from ambkit.machine.machine import Bearing
from ambkit.models.machine_parts import machine_model
from ambkit.models.model import ONE, Model

PAPER_STATES = ("x", "v", "f_d", "x_m")
"""Its states."""

PAPER_CONSTANTS: Mapping[tuple[str, int, int], str] = {
    ("L", 0, 1): "T",
    ("h", 0, 1): "T_2",
    ("b", 1, 0): "T_m",
    ("b", 0, 0): "T2_2m",
    ("L", 3, 3): "a_sen",
    ("L", 3, 0): "b_sen",
    ("L", 3, 1): "c_sen",
    ("b", 3, 0): "d_sen",
    ("rest", 3, 0): "K_sen",
} | {("N0", i, j): f"N{i}{j}" for i in range(4) for j in range(i, 4) if (i, j) != (2, 2)}
"""What the constants of the paper's axis (eq. 15-21) are called in C, in their order there."""


def printed(model: Model) -> Model:
    """Return the paper's axis as eq. 15-21 print it: what acts within the sample is zero."""
    names = tuple(state.name for state in model.states)
    if names != PAPER_STATES:
        raise ValueError(f"as printed there are the states x, v, f_d and x_m, not {list(names)}")
    h, L, b = model.h.copy(), model.L.copy(), model.b.copy()
    h[0, 1] = L[3, 1] = b[3, 0] = 0.0
    return replace(model, h=h, L=L, b=b, N=(model.pattern["N"] == ONE).astype(float))


@cache
def paper_pattern() -> dict[str, Any]:
    """Return the pattern of the paper's axis, whatever its numbers."""
    return dict(machine_model(Bearing.preset("zittau_axial").replace(sensor__gain=1.1)).pattern)
