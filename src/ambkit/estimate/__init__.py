"""The estimators, one class per kind, their registry, and their estimates.

The mathematics is in C. The consistency of an estimate with its innovations is evaluated here, as
it needs nothing else.
"""

DEFAULT = "extended"
"""Default kind for a machine with a known force law, selected by ``python -m benchmarks.defaults``.
"""
