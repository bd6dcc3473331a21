"""Maximum likelihood identification from closed-loop records, with uncertainty and validation."""

from ambkit.identification.maximum_likelihood.estimate import maximum_likelihood
from ambkit.identification.maximum_likelihood.result import MaximumLikelihood

__all__ = ["MaximumLikelihood", "maximum_likelihood"]
