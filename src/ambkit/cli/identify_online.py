"""The part of ``ambkit identify`` that learns as a controller would, sample by sample."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.parameters import arguments_of_the_user, quantity

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ambkit.data.record import Record
    from ambkit.machine.machine import Bearing

ALL = "online"
"""The method that shows all and prefers none."""


def learn_online(
    record: Record,
    known: Bearing,
    method: str,
    start: float | None,
    disturbance: str | None,
    out: Path | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Learn the magnet constant in all ways, and take that of one method for the result."""
    from ambkit.cli import printing
    from ambkit.identification.online import comparison
    from ambkit.identification.online.magnet_constant import ONLINE, identified

    if method == ALL and out is not None:
        raise AmbkitError(f"--out writes what one method found: --method {', '.join(ONLINE)}")
    load = _force(disturbance, record)
    with arguments_of_the_user(), printing.progress("identifying"):
        learned = comparison.learn_online(record, known, start=start, disturbance=load)
    result, more = known, {"method": method}
    if method != ALL:
        result = identified(known, learned.results[method]).bearing
        more |= learned.to_dict()["learners"][method]
    printing.deliver_result(learned, [(out, result.save)], as_json=json, plot=plot, more=more)


def _force(force_text: str | None, record: Record) -> ArrayLike | None:
    """Return the known disturbance: a signal of the record, or the same force throughout [N]."""
    if force_text is None:
        return None
    if force_text in record:
        return record[force_text]
    try:
        return quantity("N")(force_text)
    except typer.BadParameter as error:
        hint = f"or a signal of the record: {', '.join(record)}"
        raise typer.BadParameter(f"{error.message}, {hint}", param_hint="--disturbance") from None
