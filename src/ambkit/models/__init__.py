"""Models as data: parts composed into one exact sampled model, from which all else follows."""

from ambkit.models.axis import axis_model, axis_parts
from ambkit.models.compose import compose
from ambkit.models.model import MATRICES, NUMBER, ONE, ZERO, Descriptor, Model

__all__ = [
    "MATRICES",
    "NUMBER",
    "ONE",
    "ZERO",
    "Descriptor",
    "Model",
    "axis_model",
    "axis_parts",
    "compose",
]
