"""``ambkit pil``: processor in the loop."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ambkit.cli.kinds import NAMES, estimator_option, to_export
from ambkit.cli.options import BearingOrFilter, Force, Json, Verbose, file_option


def pil(
    bearing: BearingOrFilter,
    estimator: Annotated[str | None, estimator_option(NAMES)] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="What happens, and whose controller flies: a scenario; a "
            "second in the middle if not given.",
        ),
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Flash, memory and stack for a board: stm32f4, amdc or c2000."
        ),
    ] = None,
    out: Annotated[
        Path | None, file_option("Also write the flight as a record.", (".csv", ".npz"), "--out")
    ] = None,
    report: Annotated[
        Path | None, file_option("Also write a report with a picture.", (".html",), "--report")
    ] = None,
    force: Force = False,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Run the exported controller on a simulated machine, on a Cortex-M4F in qemu.

    What the sensors of the simulated plant show goes there, sample by sample. Said are whether all
    bits are Python's, instructions, stack, flash, memory, and how the rotor flew. Exit code 1 where
    bits differ. Needs gcc-arm-none-eabi and qemu-system-arm.

    For example:
      ambkit pil zittau_axial
      ambkit pil filter.toml --scenario scenario.toml --board stm32f4 --report pil.html
      ambkit pil tum_mlps --scenario mlps.toml
    """
    from ambkit.cli import output
    from ambkit.export import pil as loop
    from ambkit.simulation.scenario import Scenario

    model, chosen = to_export(bearing, estimator)
    found = loop.pil(
        model,
        chosen.magnet,
        scenario=None if scenario is None else Scenario.load(scenario),
        kind=chosen.kind,
        filter_file=chosen.file,
        board=board,
        force=force,
    )
    output.deliver_result(
        found, [(out, found.record.save)], as_json=json, verbose=verbose, report=report
    )
    if not found.passed:
        raise typer.Exit(1)
