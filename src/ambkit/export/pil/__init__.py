"""Processor in the loop: the exported controller on a Cortex-M4F with the simulated plant."""

from ambkit.export.pil.build import BOARDS
from ambkit.export.pil.loop import Pil, pil

__all__ = ["BOARDS", "Pil", "pil"]
