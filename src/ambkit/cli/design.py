"""``ambkit design``: from logs to the filter to fly, in one command."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from ambkit.cli.export import Precision
from ambkit.cli.kinds import NAMES, known, names
from ambkit.cli.options import Json, MapFile, Verbose, find_machine


def design(
    bearing: Annotated[
        str,
        typer.Option(
            "--bearing",
            metavar="BEARING",
            help="What is known already: a preset's name, or a TOML file.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            help="The folder for all of it; an older design goes on.",
        ),
    ],
    logs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="LOG",
            help="Runs in closed loop: any format. Without any the filter is tuned on simulated "
            "runs.",
            show_default=False,
        ),
    ] = None,
    channel_map: MapFile = None,
    validate: Annotated[
        list[Path] | None,
        typer.Option(metavar="LOG", help="Judge by this record; again for more."),
    ] = None,
    estimator: Annotated[
        str | None,
        typer.Option(
            callback=lambda text: text and known(text),
            metavar="NAMES",
            help=f"Some of {', '.join(NAMES)}.",
            show_default="linear,extended,adaptive",
        ),
    ] = None,
    free: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="What to identify, see 'ambkit identify'.",
            show_default="what a record usually tells",
        ),
    ] = None,
    max_sensitivity: Annotated[
        float,
        typer.Option(
            "--max-sensitivity",
            metavar="PEAK",
            help="What the peak of |S| in the loop is to stay below, see 'ambkit tune'; inf: no "
            "limit.",
            show_default="3, the end of zone A",
        ),
    ] = 3.0,
    precision: Annotated[Precision, typer.Option(help="Of the exported C.")] = Precision.float,
    prefix: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Of the C's names; the bearing's name if not given."),
    ] = None,
    anyway: Annotated[
        bool,
        typer.Option(
            "--anyway",
            "--force",
            help="Export also what is worse than the raw sensor, far from the bound, out of zone "
            "A, or what must not fly.",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Random seed.")] = 0,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Design controller and filter from logs: identify, tune, assess, export.

    A machine with one axis is identified from its logs; of several 'ambkit identify --axis' comes
    before. Controllers are chosen on the margins of the loop, and a filter is tuned in it. The
    folder gets machine.toml, scenario.toml with the controllers, filter.toml, verdict.html,
    design.html, which says which filter to fly and why, the filter as C in c/, and with its
    controllers in controller/. A second call goes on where the first was interrupted.

    For example:
      ambkit design run.csv --bearing my.toml --out design/
      ambkit design log.mat --channels rig.toml --bearing my.toml --validate other.mat --out design/
      ambkit design --bearing tum_mlps --max-sensitivity 2 --out design/
      ambkit assess design/filter.toml --controller design/scenario.toml
    """
    from ambkit.cli import output
    from ambkit.cli.options import arguments_of_the_user
    from ambkit.workflow.designing import design as designed

    plant = find_machine(bearing)
    with arguments_of_the_user(), output.progress("designing", None) as done:
        found = designed(
            plant, logs or (), out, channels=channel_map, validate=validate or (),
            kinds=None if estimator is None else names(estimator), precision=precision.value,
            prefix=prefix, anyway=anyway, seed=seed, note=done,
            free=None if free is None else free.replace(" ", "").split(","),
            max_sensitivity=max_sensitivity if math.isfinite(max_sensitivity) else None,
        )  # fmt: skip
    output.deliver_result(found, as_json=json, verbose=verbose)
    output.note(f"wrote {found.folder}: {', '.join(found.made)}")
    if found.exported is None:
        output.note("nothing was exported: --anyway does it all the same")
        raise typer.Exit(1)
