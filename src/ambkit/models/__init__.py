"""Models as data: parts composed into one exact sampled model, the source of everything else."""

from ambkit.models.machine_parts import compose, machine_model, machine_parts
from ambkit.models.model import MATRICES, NUMBER, ONE, ZERO, Descriptor, Model

__all__ = [
    "MATRICES",
    "NUMBER",
    "ONE",
    "ZERO",
    "Descriptor",
    "Model",
    "compose",
    "machine_model",
    "machine_parts",
]
