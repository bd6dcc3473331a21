"""The part of ``ambkit identify`` that learns as a controller would, sample by sample."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.options import CONSTANT, arguments_of_the_user, quantity

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ambkit.data.record import Record
    from ambkit.identification.online.side_by_side import SideBySide
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
    from ambkit.cli import output
    from ambkit.identification.online import side_by_side
    from ambkit.identification.online.magnet_constant import ONLINE, identified
    from ambkit.show import plots
    from ambkit.show.plots.online import online_figure

    if method == ALL and out is not None:
        raise AmbkitError(f"--out writes what one method found: --method {', '.join(ONLINE)}")
    load = _force(disturbance, record)
    with arguments_of_the_user(), output.progress("identifying"):
        learned = side_by_side.learn_online(record, known, start=start, disturbance=load)
    data: dict[str, Any] = {"bearing": known.name, "method": method} | learned.to_dict()
    found = known
    if method != ALL:
        found = identified(known, learned.results[method]).bearing
        data |= data["learners"][method]
    output.deliver(
        data,
        [_table(learned), learned.agreement],
        [
            (out, found.save),
            (plot, lambda path: plots.save_figure(online_figure(learned), path)),
        ],
        as_json=json,
    )
    for note in learned.notes:
        output.note(note)


def _table(learned: SideBySide) -> Any:
    from ambkit.cli.output import table, value
    from ambkit.identification.online.result import CONFIDENCE
    from ambkit.identification.online.side_by_side import NAMES, figures

    told = [figures(result) for result in learned.results.values()]

    def percent(title: str, of: Callable[[dict[str, Any]], float], form: str) -> list[str]:
        cells = [100 * of(one) for one in told]
        return [title, *(f"{cell:{form}} %" if math.isfinite(cell) else "–" for cell in cells)]

    def against(title: str, other: float) -> list[str]:
        return percent(title, lambda one: one["magnet_constant"] / other - 1, "+.2f")

    rows = [
        [
            "magnet constant, start",
            *(value(learned.start, CONSTANT, like=one["magnet_constant"]) for one in told),
        ],
        ["magnet constant, found", *(value(one["magnet_constant"], CONSTANT) for one in told)],
        percent("  95 % interval, ±", lambda one: CONFIDENCE * _part(one, "standard_error"), ".2g"),
        percent("  drift over the last quarter", lambda one: _part(one, "drift"), "+.1f"),
        against("change", learned.start),
    ]
    if learned.truth is not None:
        rows.append(against(f"against the true {value(learned.truth, CONSTANT)}", learned.truth))
    rows += [
        ["load that was not told", *(value(one.get("load"), "N", 3) for one in told)],
        ["held for want of excitation"]
        + [f"{100 * one['held_share']:.1f} % of the samples" for one in told],
    ]
    return table(learned.bearing.name, ["", *(NAMES[name] for name in learned.results)], rows)


def _part(figures: dict[str, Any], key: str) -> float:
    return float(figures[key] / figures["magnet_constant"])


def _force(given: str | None, record: Record) -> ArrayLike | None:
    """Return the known disturbance: a signal of the record, or the same force throughout [N]."""
    if given is None:
        return None
    if given in record:
        return record[given]
    try:
        return quantity("N")(given)
    except typer.BadParameter as error:
        hint = f"or a signal of the record: {', '.join(record)}"
        raise typer.BadParameter(f"{error.message}, {hint}", param_hint="--disturbance") from None
