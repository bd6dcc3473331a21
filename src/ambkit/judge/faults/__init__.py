"""Fault injection into simulations, and the recovery of estimators."""

from ambkit.judge.faults.fault_test import FaultCampaign, inject_faults
from ambkit.judge.faults.faults import FAULTS, Fault

__all__ = ["FAULTS", "Fault", "FaultCampaign", "inject_faults"]
