"""The expert system: a fuzzy basis function network, and how it is trained (paper, section D)."""

from ambkit.fuzzy.expert import Expert, Method, Rule, Training

__all__ = ["Expert", "Method", "Rule", "Training"]
