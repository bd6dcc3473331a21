"""A bearing from records of any loop, with its uncertainty; and whether it holds on others."""

from ambkit.identification.maximum_likelihood.estimate import maximum_likelihood
from ambkit.identification.maximum_likelihood.result import MaximumLikelihood

__all__ = ["MaximumLikelihood", "maximum_likelihood"]
