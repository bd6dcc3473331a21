"""The summary as a short table on the terminal."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ambkit.result.report.summary import SummaryRow, number, ours, tally, verdict_of
from ambkit.result.table import Table, table

if TYPE_CHECKING:
    from rich.console import Console


def summary_table(rows: Sequence[SummaryRow]) -> Table:
    """Build the table: what stands before a colon is a heading, once for the rows that share it."""
    lines, subject = [], ""
    for row in rows:
        head, _, item = row["what"].rpartition(": ")
        if head and head != subject:
            lines.append([head, "", "", ""])
        subject, verdict, unit = head, verdict_of(row), f" {row['unit']}".rstrip()
        paper = number(row["paper"]) + unit * (row["paper"] is not None)
        verdict_text = f"{verdict.sign} {row['verdict']}"
        lines.append([f"  {item}" if head else item, paper, ours(row) + unit, verdict_text])
    return table("The paper, reproduced", ["", "paper", "ours", "verdict"], lines)


def print_summary(rows: Sequence[SummaryRow], console: "Console | None" = None) -> None:
    """Print how often each verdict was given, and the table."""
    from rich.console import Console

    console = console or Console()
    verdicts = ", ".join(f"{count} × {word}" for word, count in tally(rows))
    console.print(f"{verdicts}.\n", highlight=False)
    console.print(summary_table(rows), crop=False)
