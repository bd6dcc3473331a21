"""A bearing from records of any loop, with its uncertainty; and whether it holds on others."""

from ambkit.identification.maximum_likelihood.estimate import MaximumLikelihood, maximum_likelihood

__all__ = ["MaximumLikelihood", "maximum_likelihood"]
