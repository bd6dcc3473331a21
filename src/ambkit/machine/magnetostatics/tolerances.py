"""Map of a magnet with dimensions slightly different from its drawing's.

For each deviating dimension, two coarse maps beside a coarse nominal one give the second-order
change of force and flux linkage; many machines of a drawing thus need a few fields only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.magnet_map import Box, MagnetMap, map_of

STEP, MOST = 0.04, 0.1  #: Relative step of the differences, and their range of validity.
ROUGH = (7, 5), 0.5  #: Nodes and fineness of the maps for differences.


def value_in(drawing: Drawing, key: str) -> Any:
    """Return the value at a dotted key."""
    here: Any = drawing
    for step in key.split("."):
        here = getattr(here, step)
    return here


def map_near(drawing: Drawing, changes: Mapping[str, Any], box: Box) -> MagnetMap:
    """Return the map of a drawing with other values at some dotted keys."""
    near = {}
    for key, new in changes.items():
        old = value_in(drawing, key)
        if isinstance(old, float) and 0 < abs(new - old) <= MOST * abs(old):
            near[key] = new
        elif new != old:  # too different, or not a number
            drawing = drawing.replace(**{key: new})
    base = _map(drawing, box)
    if not near:
        return base
    weighted = _weighted(base, base)
    for key, new in near.items():
        first, second, step = _differences(drawing, box, key)
        t = (new - value_in(drawing, key)) / step
        weighted = weighted + t * (first + t * second)
    gap = near.get("geometry.air_gap", base.gap)
    result = replace(base, gap=gap, left_out=np.empty((3, 0)))
    w = result.weight(base.displacement)[0][:, None]
    return replace(result, force=weighted[0] / w**2, flux=weighted[1] / w)


@lru_cache(maxsize=64)
def _map(drawing: Drawing, box: Box, *how: Any) -> MagnetMap:
    box = box._replace(bias=drawing.bias_current)
    return map_of(drawing, box, *how)


@lru_cache(maxsize=64)
def _differences(drawing: Drawing, box: Box, key: str) -> tuple[Array, Array, float]:
    """Return the first and second difference by the value at a key, and its step."""
    base, old = _map(drawing, box), value_in(drawing, key)
    step = STEP * abs(old)
    less, middle, more = (
        _weighted(_map(drawing.replace(**{key: old + by}) if by else drawing, box, *ROUGH), base)
        for by in (-step, 0, step)
    )
    return 0.5 * (more - less), 0.5 * (more - 2 * middle + less), step


def _weighted(result: MagnetMap, base: MagnetMap) -> Array:
    """Return force and flux linkage at the points of another map, without the poles at the gap."""
    x = base.displacement[:, None]
    w = result.weight(x)[0]
    return np.stack([result.force_at(base.current, x) * w**2, result.flux_at(base.current, x) * w])
