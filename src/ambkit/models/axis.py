"""One axis: the composition that a bearing's keys give; the paper's is the plainest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

from ambkit.models.compose import compose
from ambkit.models.model import ONE, Model
from ambkit.models.parts import PARTS, SENSOR_NOISE
from ambkit.models.parts.typical import Typical
from ambkit.models.plan import Part

PAPER_STATES = ("x", "v", "f_d", "x_m")
"""The states of the paper's axis (eq. 15-21), which is built into the core as straight-line C."""

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


def axis_parts(bearing: Any, *, noise: bool = True) -> list[Part]:
    """Return the parts of a bearing of one axis, as its keys give them."""
    typical = Typical.of(bearing)
    kinds = [kind for kind in PARTS if noise or kind not in SENSOR_NOISE]
    return [part for kind in kinds for part in kind.of_axis(bearing, typical)]


def axis_model(
    bearing: Any, *, T: float | None = None, as_printed: bool = False, noise: bool = True
) -> Model:
    """Return the sampled model of one axis."""
    parts = axis_parts(bearing, noise=noise)
    model = compose(parts, bearing.sampling_time if T is None else T, name="axial")
    return printed(model) if as_printed else model


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
    m = SimpleNamespace
    bearing = m(
        sampling_time=1e-4, magnet=m(magnet_constant=1e-6, bias_current=1.0, air_gap=1e-3),
        rotor=m(mass=1.0, travel_limit=5e-4), amplifier=m(),
        sensor=m(gain=1.1, lag=1e-4), sensor_lag=1e-4,
    )  # fmt: skip
    return dict(axis_model(bearing).pattern)
