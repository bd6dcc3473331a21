"""The summary as a short table on the terminal."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ambkit.show.report.summary import SummaryRow, number, ours, runs, tally, verdict_of

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_COLOURS = {"good": "green", "bad": "red", "odd": "yellow", "plain": "dim"}


def summary_table(rows: Sequence[SummaryRow]) -> "Table":
    """Build the table.

    Parameters
    ----------
    rows : sequence of SummaryRow
        The summary.

    Returns
    -------
    rich.table.Table
        One row each; the verdict with its sign, so that it reads without colour.

    Raises
    ------
    ValueError
        If a row's verdict is not one of `summary.VERDICTS`.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    table.add_column("what", ratio=1, min_width=10)
    table.add_column("paper", justify="right", overflow="fold")
    table.add_column("ours", justify="right", overflow="fold")
    table.add_column("unit", no_wrap=True)
    table.add_column("runs", justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for row in rows:
        verdict = verdict_of(row)
        table.add_row(
            Text(row["what"]),
            Text(number(row["paper"])),
            Text(ours(row), style="bold"),
            Text(row["unit"]),
            Text(runs(row)),
            Text(f"{verdict.sign} {row['verdict']}", style=_COLOURS[verdict.kind]),
        )
    return table


def print_summary(rows: Sequence[SummaryRow], console: "Console | None" = None) -> None:
    """Print the table and, below it, how often each verdict was given.

    Parameters
    ----------
    rows : sequence of SummaryRow
        The summary.
    console : rich.console.Console, optional
        Where to; standard output if not given.

    Raises
    ------
    ValueError
        If a row's verdict is not one of `summary.VERDICTS`.
    """
    from rich.console import Console

    console = console or Console()
    console.print(summary_table(rows))
    console.print(", ".join(f"{count} × {word}" for word, count in tally(rows)), highlight=False)
