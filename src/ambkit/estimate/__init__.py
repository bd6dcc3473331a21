"""The estimators, one class each kind, one registry of the kinds, and the estimate they give.

The mathematics is C. Whether an estimate is consistent with its own innovations is told here too:
it needs nothing but the estimate.
"""

DEFAULT = "extended"
"""The kind of a machine for which none is named, as its law is known: what
``python -m benchmarks.defaults`` picks."""
