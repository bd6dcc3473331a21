"""Long lines in a quarter of the letters: as steps, which the page's script adds up again.

What is drawn has at most a few thousand pixels. A value takes one of 65,535 levels over the line's
span, a time one of four million; the static picture and the files keep all digits.
"""

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

SHORT = 200
"""Lines of fewer points stay as they are."""
LEVELS = 65_534
_MISSING = 65_535  # the level of NaN
_TIMES = 1 << 22


def shorten(described: dict[str, Any]) -> None:
    """Replace the arrays of long lines in what plotly is told, where the eye cannot tell."""
    # Not on a logarithmic axis, nor where the axis shows a small part of the line's span.
    for trace in described["data"]:
        if trace["type"] != "scatter" or trace["mode"] != "lines":
            continue
        for name, coded in (("x", times), ("y", values)):
            axis = described["layout"][f"{name}axis{trace[f'{name}axis'][1:]}"]
            if "bdata" not in trace[name] or axis["type"] == "log":
                continue
            line = _unpacked(trace[name])
            low, high = axis.get("range", (-np.inf, np.inf))
            if line.size >= SHORT and abs(high - low) > 0.25 * _span(line):
                trace[name] = coded(line) or trace[name]


def values(line: NDArray[np.float64]) -> dict[str, Any] | None:
    """Give each value (n,) its level, and of the levels their differences, modulo 65,536."""
    step = _span(line) / LEVELS
    if not step > 0:
        return None
    low = float(np.nanmin(line))
    levels = np.where(np.isnan(line), _MISSING, np.rint((line - low) / step)).astype(np.int64)
    return {"from": low, "step": step, "levels": _planes(np.diff(levels, prepend=0) % 65_536)}


def times(line: NDArray[np.float64]) -> dict[str, Any] | None:
    """Give rising times (n,) as steps of a fine clock; None where one is too long."""
    step = _span(line) / _TIMES
    if not step > 0 or not (np.diff(line) >= 0).all():
        return None
    ticks = np.diff(np.rint((line - line[0]) / step), prepend=0).astype(np.int64)
    if ticks.max() > _MISSING:
        return None
    return {"from": float(line[0]), "step": step, "ticks": _planes(ticks)}


def _span(line: NDArray[np.float64]) -> float:
    finite = line[np.isfinite(line)]
    return float(np.ptp(finite)) if finite.size and not np.isinf(line).any() else 0.0


def _unpacked(array: dict[str, Any]) -> NDArray[np.float64]:
    """Return what `ambkit.result.report.interactive_items.packed` made."""
    numbers = np.frombuffer(base64.b64decode(array["bdata"]), f"<{array['dtype']}")
    return np.asarray(numbers, dtype=np.float64)


def _planes(numbers: NDArray[np.int64]) -> str:
    """Write numbers below 65,536 as all low bytes, then all high ones: these pack well."""
    low, high = numbers % 256, numbers // 256
    return base64.b64encode(np.concatenate([low, high]).astype(np.uint8).tobytes()).decode()
