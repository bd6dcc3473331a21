"""Faults that are injected into flights, and how estimators recover."""

from ambkit.judge.faults.fault_test import FaultCampaign, inject_faults
from ambkit.judge.faults.faults import FAULTS, Fault

__all__ = ["FAULTS", "Fault", "FaultCampaign", "inject_faults"]
