"""Faults that estimators are put through, and what becomes of them."""

from ambkit.faults.campaign import Torture, torture
from ambkit.faults.declared import FAULTS, Fault

__all__ = ["FAULTS", "Fault", "Torture", "torture"]
