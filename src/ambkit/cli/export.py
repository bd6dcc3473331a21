"""``ambkit export``: the trained filter for the controller, as C."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.kinds import NAMES, estimator_option, to_export
from ambkit.cli.parameters import BearingOrFilter, Force, Json, Synchronous, Verbose, quantity

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine


class Precision(StrEnum):
    """Of the exported numbers."""

    float = "float"
    double = "double"


class Form(StrEnum):
    """How the expert is exported."""

    exact = "exact"
    tabulated = "tabulated"


def export(context: typer.Context) -> None:
    """Export a filter as C, FMU, A2L or MAT-file."""
    # For example:
    #   ambkit export c zittau_axial --estimator expert.json --out out/
    if context.invoked_subcommand is None:
        print(context.get_help())


def export_c(
    bearing: BearingOrFilter,
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="DIR", help="The folder to write: new, empty, or of an older export."
        ),
    ],
    estimator: Annotated[str | None, estimator_option(NAMES)] = None,
    precision: Annotated[Precision, typer.Option(help="Of its numbers.")] = Precision.float,
    prefix: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Of its names; the bearing's name if not given."),
    ] = None,
    expert: Annotated[
        Form, typer.Option(help="The rules themselves, or a table of what they say.")
    ] = Form.exact,
    force_bound: Annotated[
        float | None,
        typer.Option(
            parser=quantity("N"),
            metavar="FORCE",
            help='How far the table may be from the rules, such as "0.1 N".',
        ),
    ] = None,
    editable: Annotated[
        bool,
        typer.Option(
            "--editable",
            help="Each number once in the data file; what follows is computed at init.",
        ),
    ] = False,
    controller: Annotated[
        Path | None,
        typer.Option(
            metavar="SCENARIO.toml",
            help="Export the whole controller of this scenario: from readings to coil currents.",
        ),
    ] = None,
    synchronous: Synchronous = None,
    calibration: Annotated[
        bool,
        typer.Option(
            "--calibration",
            help="Noise, gate, mass, k and gains of a --controller can be changed while it runs.",
        ),
    ] = False,
    telemetry: Annotated[
        bool,
        typer.Option(
            "--telemetry",
            help="Also a ring of frames: states, innovations and status of each sample.",
        ),
    ] = False,
    cost: Annotated[
        bool, typer.Option("--cost", help="Also print what it costs on a Cortex-M4F.")
    ] = False,
    clock: Annotated[
        float | None,
        typer.Option(
            parser=quantity("Hz"),
            metavar="FREQUENCY",
            help="Of the processor, for --cost; 168 MHz if not given.",
        ),
    ] = None,
    force: Force = False,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Write a filter as a folder of C99 that compiles alone.

    The library's own C, with the data of this bearing or machine and this filter.

    For example:
      ambkit train zittau_axial --out expert.json
      ambkit export c zittau_axial --estimator expert.json --out out/
      ambkit export c filter.toml --precision double --out out/
      ambkit export c tum_mlps --estimator extended --out out/
      ambkit export c filter.toml --controller scenario.toml --out out/
      ambkit export c tum_mlps --controller mlps.toml --out out/
    """
    from ambkit.cli import printing
    from ambkit.export import c
    from ambkit.export.c.cost import CLOCK

    if precision is Precision.double and (cost or clock is not None):
        raise AmbkitError("--cost is for --precision float: a Cortex-M4F has no double in hardware")
    if clock is not None and not clock > 0:
        raise AmbkitError(f"--clock must be greater than 0 Hz, is {clock:g} Hz")
    if editable and (cost or clock is not None):
        raise AmbkitError("--cost was measured of constants in flash, which --editable has not")
    if controller is not None and (cost or clock is not None):
        raise AmbkitError("--cost was measured of filters; of a whole controller: ambkit pil")
    model, chosen = to_export(bearing, estimator)
    if synchronous and chosen.file is not None:
        raise AmbkitError("--synchronous: the filter's file says what it estimates")
    options = _flown(model, controller, synchronous)
    written = c.export_c(
        model,
        chosen.magnet,
        out,
        kind=chosen.kind,
        filter_file=chosen.file,
        precision=precision.value,
        prefix=prefix,
        expert_form=expert.value,
        force_bound=force_bound,
        editable=editable,
        **options,
        calibrated=calibration,
        telemetry=telemetry,
        force=force,
    )
    if cost or clock is not None:
        written = replace(written, clock=clock or CLOCK)
    printing.deliver_result(written, as_json=json, verbose=verbose)
    printing.note(f"wrote {written.folder}, {len(written.files) + 1} files")


def _flown(
    model: Machine, controller: Path | None, synchronous: list[str] | None
) -> dict[str, Any]:
    """Return whose controller is exported, and what else only a rotor that turns has."""
    from ambkit.simulation.scenario import Scenario

    if synchronous and model.single:
        raise AmbkitError(f"--synchronous is of a rotor that turns; {model.name} is a mass")
    options: dict[str, Any] = {"synchronous": tuple(synchronous)} if synchronous else {}
    return options | {"scenario": controller and Scenario.load(controller)}
