"""A force function from a table."""

from collections.abc import Callable
from typing import Any

from scipy.interpolate import RegularGridInterpolator


def force_table(current: Any, displacement: Any, values: Any) -> Callable[[Any, Any], Any]:
    """Interpolate by cubics, which go on outside; `values`: a row for each displacement."""
    grid = RegularGridInterpolator(
        (displacement, current), values, method="cubic", bounds_error=False, fill_value=None
    )
    return lambda iu, x: grid((x, iu))
