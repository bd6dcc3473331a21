"""Whether a record can be of the bearing that is named with it, said before work begins."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ambkit.base.errors import RecordError

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.machine.machine import Machine


def say_what_is_odd(path: Path, record: Record, machine: Machine) -> None:
    """Say on stderr what ``ambkit check RECORD --bearing`` would say is wrong with a record."""
    from ambkit.assessment.plausibility import check_plausibility
    from ambkit.cli import printing

    try:
        odd = check_plausibility(record, machine)
    except RecordError as error:
        raise RecordError([f"{path}: {problem}" for problem in error.problems]) from None
    for text in odd:
        printing.note(f"{path}: {text}")
