"""Comparison of estimators: over seeds in their own loops, and along the same records."""

from ambkit.estimate.constant_velocity import ConstantVelocityFilter
from ambkit.judge.comparison.score import Score
from ambkit.judge.comparison.seeds import compare, rmse

__all__ = ["ConstantVelocityFilter", "Score", "compare", "rmse"]
