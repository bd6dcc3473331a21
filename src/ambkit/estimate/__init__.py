"""The estimators, one class per kind, their registry, and their estimates.

The mathematics is C. Whether an estimate is consistent with its own innovations is told here too:
it needs nothing but the estimate.
"""

DEFAULT = "extended"
"""Default kind for a machine with a known force law, selected by ``python -m benchmarks.defaults``.
"""
