"""``ambkit reproduce``: the whole paper, with its pictures, tables and verdicts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ambkit.cli.parameters import Json


def reproduce(
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder; made if it is not there.")
    ] = Path("out"),
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="First seed of the noise.")] = 0,
    show: Annotated[bool, typer.Option("--open", help="Open the report in the browser.")] = False,
    json: Json = False,
) -> None:
    """Reproduce the paper.

    Writes report.html, figures/, tables/ and summary.json, and prints the verdicts.

    For example:
      ambkit reproduce --out out --open
    """
    from ambkit.cli import printing
    from ambkit.workflow.reproduction import reproduce as run

    with printing.progress("reproducing the paper") as done:
        outcome = run(out, seed=seed, progress=done)
    report = outcome.folder / "report.html"
    printing.written.append(report)
    if json:
        printing.deliver(outcome.rows, [], as_json=True)
    else:
        from ambkit.result.report.terminal import print_summary

        print_summary(outcome.rows, printing.stdout())
        printing.deliver(None, [], as_json=False)
    if show:
        typer.launch(str(report))
