"""The summary as a short table on the terminal."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ambkit.result.report.summary import SummaryRow, number, ours, runs, tally, verdict_of

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Column, Table

_COLOURS = {"good": "green", "bad": "red", "odd": "yellow", "plain": "dim"}


def summary_table(rows: Sequence[SummaryRow]) -> "Table":
    """Build the table."""
    from rich import box
    from rich.cells import cell_len
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    table.add_column("what", overflow="fold")
    table.add_column("paper", justify="right", no_wrap=True)
    table.add_column("ours", justify="right", no_wrap=True)
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
    for column in table.columns:  # where there is little room, "what" gets more lines
        least = [cell_len(word) for cell in column.cells for word in _pieces(column, str(cell))]
        column.min_width = max([cell_len(str(column.header)), *least])
    return table


def _pieces(column: "Column", cell: str) -> list[str]:
    return [cell] if column.no_wrap else cell.split()


def print_summary(rows: Sequence[SummaryRow], console: "Console | None" = None) -> None:
    """Print the table and, below it, how often each verdict was given."""
    from rich.console import Console

    console = console or Console()
    console.print(summary_table(rows), crop=False)
    console.print(", ".join(f"{count} × {word}" for word, count in tally(rows)), highlight=False)
