"""Estimators compared: over seeds in their own loops, and along the same records."""

from ambkit.comparison.constant_velocity import ConstantVelocityFilter
from ambkit.comparison.innovations import Whiteness, prediction_error, whiteness
from ambkit.comparison.seeds import JUDGED, Score, compare, rmse

__all__ = [
    "JUDGED",
    "ConstantVelocityFilter",
    "Score",
    "Whiteness",
    "compare",
    "prediction_error",
    "rmse",
    "whiteness",
]
