"""The part of ``ambkit identify`` that learns as a controller would: ADALINE, least squares."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ambkit.commands.options import arguments_of_the_user, quantity

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ambkit.bearing import Bearing
    from ambkit.identification.adaline import AdalineResult
    from ambkit.record import Record

CONSTANT = "N m^2/A^2"

DRIFTING = 0.02
"""Part of itself by which a magnet constant moves in the last quarter if it has not settled."""


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
    """Identify the magnet constant by one method, and show the others beside it."""
    from ambkit import plots
    from ambkit.commands import output
    from ambkit.estimators import check_sampling
    from ambkit.identification import identify
    from ambkit.identification.magnet_constant import ONLINE

    load = _force(disturbance, record)
    with arguments_of_the_user(), output.progress("identifying"):
        check_sampling(known, record)
        found = identify(record, known, method=method, disturbance=load, start=start)
        beside = {
            name: found.history
            if name == method
            else learner(known, start=start).run(record, disturbance=load)
            for name, learner in ONLINE.items()
        }
    before = known.magnet.magnet_constant if start is None else start
    learned = {name: _figures(history) for name, history in beside.items()}
    data: dict[str, Any] = {"bearing": known.name, "method": method, "start": before}
    data |= learned[method] | {"learners": learned}

    def picture(path: Path) -> None:
        plots.save_figure(plots.identification_figure(found, before, beside), path)

    output.deliver(
        data,
        [_table(known.name, before, learned)],
        [(out, found.bearing.save), (plot, picture)],
        as_json=json,
    )
    if abs(data["drift"]) > DRIFTING * found.magnet_constant:
        output.note(
            "the magnet constant still drifts: a longer record may settle it; a load that is known "
            "belongs to --disturbance, one that is not moves the result"
        )


def _figures(history: AdalineResult) -> dict[str, Any]:
    from ambkit.identification.rls import LeastSquaresResult

    last = max(1, len(history.k) // 4)
    figures = {
        "magnet_constant": history.magnet_constant,
        "spread": history.spread,
        "drift": float(history.k[-1] - history.k[-last]),
        "held_share": float(history.held.mean()),
        "excitation": float(history.excitation[-1]),
    }
    if isinstance(history, LeastSquaresResult):
        figures["load"] = float(history.load[-last:].mean())
    return figures


def _table(name: str, before: float, learned: dict[str, dict[str, Any]]) -> Any:
    from ambkit.commands.output import table, value
    from ambkit.plots import LEARNERS

    def row(title: str, key: str, unit: str) -> list[str]:
        return [title, *(value(figures.get(key), unit) for figures in learned.values())]

    rows = [
        ["magnet constant, start", *(value(before, CONSTANT) for _ in learned)],
        row("magnet constant, found", "magnet_constant", CONSTANT),
        row("  its spread over the last quarter", "spread", CONSTANT),
        row("  its drift over the last quarter", "drift", CONSTANT),
        ["change"]
        + [f"{100 * (one['magnet_constant'] / before - 1):+.2f} %" for one in learned.values()],
        row("load that was not known", "load", "N"),
        ["held for want of excitation"]
        + [f"{100 * one['held_share']:.1f} % of the samples" for one in learned.values()],
    ]
    return table(name, ["", *(LEARNERS[one][1] for one in learned)], rows)


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
