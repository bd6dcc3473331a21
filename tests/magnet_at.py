"""A magnet of the core at one point: its arrays have one element."""

from typing import Any

import numpy as np


def one(values: Any) -> tuple[float, ...]:
    """Take the only point out of what a magnet returns."""
    return tuple(float(v[0]) for v in (values if isinstance(values, tuple) else (values,)))


def force(magnet: Any, iu: float, x: float) -> float:
    return one(magnet.force(np.array([iu]), np.array([x])))[0]


def through_origin(magnet: Any, iu: float, x: float) -> tuple[float, ...]:
    return one(magnet.through_origin(np.array([iu]), np.array([x])))


def tangent(magnet: Any, iu: float, x: float) -> tuple[float, ...]:
    return one(magnet.tangent(np.array([iu]), np.array([x])))


def differences(magnet: Any, iu: float, x: float, d_iu: float, d_x: float) -> tuple[float, float]:
    """Central differences of the force."""
    along_iu = force(magnet, iu + d_iu, x) - force(magnet, iu - d_iu, x)
    along_x = force(magnet, iu, x + d_x) - force(magnet, iu, x - d_x)
    return along_iu / (2 * d_iu), along_x / (2 * d_x)
