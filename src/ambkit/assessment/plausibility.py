"""Whether a record can be of the machine that is named with it, checked before work begins."""

from __future__ import annotations

import numpy as np

from ambkit.base.errors import RecordError
from ambkit.data.record import Record
from ambkit.judge.plausibility import evaluate_record, off_rate
from ambkit.machine.machine import Machine

MOST = 0.5
"""Share of the measurements beyond the air gap, where no rotor can be, with which nothing works."""


def check_plausibility(record: Record, machine: Machine) -> list[str]:
    """Return what is odd about a record of a machine, or refuse it."""
    machine = machine.short
    if off_rate(record, machine):
        return []
    verdict = evaluate_record(record, machine)
    if machine.single and "y" in record:
        bearing = machine.isolated_axis("")
        y = record["y"][np.isfinite(record["y"])] / bearing.sensor.gain
        beyond = float(np.mean(np.abs(y) > bearing.magnet.air_gap)) if y.size else 0.0
        if beyond > MOST:
            raise RecordError(verdict.problems)
    return [*verdict.problems, *(remark for remark in verdict.remarks if remark.endswith("?"))]
