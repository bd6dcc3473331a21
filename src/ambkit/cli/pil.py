"""``ambkit pil``: processor in the loop."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambkit.cli.kinds import NAMES, estimator_option, to_export
from ambkit.cli.options import BearingOrFilter, Force, Json, file_option

if TYPE_CHECKING:
    from ambkit.export.pil import Pil
    from ambkit.result.report.figure import Figure


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
    json: Json = False,
) -> None:
    """Fly a simulated bearing or machine by its exported controller, on a Cortex-M4F in qemu.

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
    from ambkit.show.pages.pil import write_pil
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
    rows = _rows(found, model.sampling_time)
    output.deliver(
        found.to_dict(),
        [output.table("Processor in the loop", ("", ""), rows)],
        [
            (out, found.record.save),
            (
                report,
                lambda path: write_pil(
                    path, model.name, found.passed, rows, found.samples, _figures(found)
                ),
            ),
        ],
        as_json=json,
    )
    if not found.passed:
        raise typer.Exit(1)


def _figures(found: Pil) -> list[Figure]:
    from ambkit.show.pages.pil import cost_figure
    from ambkit.show.plots.simulation import simulation_figure

    counted = found.answers["instructions"]
    return [simulation_figure(found.run), cost_figure(found.record.t, counted)]


def _rows(found: Pil, T: float) -> list[tuple[str, str]]:
    from ambkit.base.units import engineering
    from ambkit.export.c.cost import CLOCK, CYCLES_PER_INSTRUCTION

    time = found.most * CYCLES_PER_INSTRUCTION / CLOCK
    slow = "more than" if time > T else "of"
    built = found.built
    return [
        ("bits", f"{found.unequal} numbers differ from Python's, of {found.samples} samples"),
        ("telemetry", f"{found.unequal_frames} numbers differ from what it answered"),
        ("self-test there", "pass" if found.selftest == 0 else f"{found.selftest} are wrong"),
        ("modes", ", ".join(f"{name} {engineering(t, 's', 4)}" for t, name in found.modes)),
        ("off the reference in flight, at most", engineering(found.worst, "m", 3)),
        ("off the reference in flight, rms", engineering(found.rms, "m", 3)),
        ("samples on a stop in flight", f"{found.touched}"),
        ("instructions a step", f"{found.instructions}, the most seen {found.most}"),
        (
            f"time of the most seen at {engineering(CLOCK, 'Hz')}, {CYCLES_PER_INSTRUCTION} cycles "
            "an instruction assumed",
            f"{engineering(time, 's', 3)}, {slow} the {engineering(T, 's', 3)} of a sample",
        ),
        ("stack of a step, the most seen", f"{found.stack_seen} bytes"),
        ("memory of an instance", f"{found.state} bytes"),
        ("built for", f"{found.board}: {built.compiler}"),
        ("flash", f"{built.code} bytes of code, {built.constants} bytes of constants"),
        ("memory besides", f"{built.variables} bytes"),
        (
            "stack of a step, at most by the call graph",
            "not told" if built.stack is None else f"{built.stack} bytes",
        ),
    ]
