"""Whether a record can be of the bearing that is named with it, asked before work begins."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ambkit.base.errors import RecordError

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.machine.bearing import Bearing

MOST = 0.5
"""Share of the measurements beyond the air gap, where no rotor can be, with which nothing works."""


def check_belongs(path: Path, record: Record, bearing: Bearing) -> None:
    """Say on stderr what ``ambkit check RECORD --bearing`` would say is wrong with a record.

    Parameters
    ----------
    path : Path
        Where it is from.
    record : Record
        With y [m] and u [V], as far as it has them.
    bearing : Bearing
        The bearing.

    Raises
    ------
    RecordError
        Most of the measurements are beyond the air gap.
    """
    import numpy as np

    from ambkit.cli import output
    from ambkit.judge.belongs import judge_record, off_rate

    if off_rate(record, bearing):
        return  # that is refused anyway
    verdict = judge_record(record, bearing)
    if "y" in record:
        y = record["y"][np.isfinite(record["y"])] / bearing.sensor.gain
        beyond = float(np.mean(np.abs(y) > bearing.magnet.air_gap)) if y.size else 0.0
        if beyond > MOST:
            raise RecordError([f"{path}: {problem}" for problem in verdict.problems])
    # Of the remarks those that ask whether a unit is wrong.
    for text in (*verdict.problems, *(each for each in verdict.remarks if each.endswith("?"))):
        output.note(f"{path}: {text}")
