"""Rows of tables for what turns with the rotor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

_SHOWN = {"unbalance": ("g mm", 1e6), "runout": ("µm", 1e6)}


def rows(found: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    """Return a row of each vector: amplitude and angle, or what can be said in their place."""
    return [[f"{told['role']} {name}", _said(told)] for name, told in found.items()]


def _said(told: Mapping[str, Any]) -> str:
    unit, times = _SHOWN[told["role"]]
    if "amplitude" in told:
        size, std = times * told["amplitude"], times * told["amplitude_std"]
        angle, off = math.degrees(told["angle"]), math.degrees(told["angle_std"])
        return f"{size:.4g} ± {std:.2g} {unit} at {angle:.1f} ± {off:.2g}°"
    c, s = (times * told[key] for key in ("cosine", "sine"))
    (cc, cs), (_, ss) = told["covariance"]
    stds = times * math.sqrt(max(cc, 0.0)), times * math.sqrt(max(ss, 0.0))
    both = math.sqrt(cc * ss)
    alike = cs / both if both > 0 else 0.0
    why = "the start says more" if told["start_dominates"] else "not clear of 0"
    return (
        f"cosine {c:.3g} ± {stds[0]:.2g}, sine {s:.3g} ± {stds[1]:.2g} {unit}, "
        f"correlation {alike:.2f}: {why}"
    )
