"""Which force law a magnet has."""

from __future__ import annotations

from ambkit.base.errors import AmbkitError
from ambkit.machine.force_law import IsolatedAxis, Law
from ambkit.machine.laws import LAWS


def law_of(machine: IsolatedAxis) -> Law:
    """Return the law that a magnet's description states, whatever force map it has."""
    laws = [law for law in LAWS if law.holds_for(machine.magnet)] or [LAWS[0]]
    if len(laws) > 1:
        names = ", ".join(law.__name__ for law in laws)
        raise AmbkitError(f"magnet: must have one force law, its keys state {names}")
    return laws[0](machine)
