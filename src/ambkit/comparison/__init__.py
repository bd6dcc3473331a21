"""Estimators compared: over seeds in their own loops, and along the same records."""

from ambkit.comparison.innovations import Whiteness, prediction_error, whiteness
from ambkit.comparison.seeds import JUDGED, Score, compare, rmse

__all__ = ["JUDGED", "Score", "Whiteness", "compare", "prediction_error", "rmse", "whiteness"]
