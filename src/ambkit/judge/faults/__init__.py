"""Faults that estimators are put through, and what becomes of them."""

from ambkit.judge.faults.campaign import Torture, torture
from ambkit.judge.faults.declared import FAULTS, Fault

__all__ = ["FAULTS", "Fault", "Torture", "torture"]
