"""``ambkit design``: from logs to the filter to fly, in one command."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.export import Precision
from ambkit.cli.kinds import NAMES, known, names
from ambkit.cli.options import Json, MapFile, find_bearing, find_machine


def design(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG", help="Runs in closed loop: any format.")
    ],
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
    channel_map: MapFile = None,
    validate: Annotated[
        list[Path] | None,
        typer.Option(metavar="LOG", help="Judge by this record; again for more."),
    ] = None,
    estimator: Annotated[
        str, typer.Option(callback=known, metavar="NAMES", help=f"Some of {', '.join(NAMES)}.")
    ] = "linear,extended,adaptive",
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
            help="Export also what is worse than the raw sensor, far from the bound, or out of "
            "zone A.",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Of all that is drawn.")] = 0,
    json: Json = False,
) -> None:
    """Go from logs to the filter to fly: identify, train, tune, judge, export.

    The folder gets found.toml, expert.json, filter.toml, the C in c/, and design.html, which says
    which filter to fly and why. A second call goes on where the first was interrupted.

    For example:
      ambkit design run.csv --bearing my.toml --out design/
      ambkit design log.mat --channels rig.toml --bearing my.toml --validate other.mat --out design/
    """
    from ambkit.cli import output
    from ambkit.cli.options import arguments_of_the_user
    from ambkit.estimate.registry import KINDS
    from ambkit.workflow.designing import design as designed
    from ambkit.workflow.tuning_tasks import AHEAD

    whole = find_machine(bearing)
    if whole is not None:
        raise AmbkitError(
            f"{whole.name} is a whole machine, which is not identified from logs in one go: "
            f"'ambkit tune LOG --bearing {bearing}' tunes its filter below a peak of |S|, 'ambkit "
            f"assess {bearing}' judges it, 'ambkit export c {bearing}' writes it"
        )
    with arguments_of_the_user(), output.progress("designing", None) as done:
        found = designed(
            find_bearing(bearing), logs, out, channels=channel_map, validate=validate or (),
            kinds=names(estimator), precision=precision.value, prefix=prefix, anyway=anyway,
            free=None if free is None else free.replace(" ", "").split(","), seed=seed, note=done,
            max_sensitivity=max_sensitivity if math.isfinite(max_sensitivity) else None,
        )  # fmt: skip
    rows = [
        [KINDS[c.kind].label,
         *(output.value(c.unseen[figure], "m", 3) for figure in AHEAD.values()),
         output.value(c.errors["x"], "m", 3), output.value(c.errors["f_d"], "N", 3),
         f"{100 * c.efficiency:.0f} %", "–" if math.isnan(c.peak) else f"{c.peak:.2f}"]
        for c in found.candidates
    ]  # fmt: skip
    heads = [
        "",
        "1 step ahead",
        "10 steps ahead",
        "error of x",
        "of f_d",
        "x: of the bound",
        "peak of |S|",
    ]
    output.deliver(
        found.to_dict(),
        [output.table("Unseen records, and simulated runs", heads, rows), found.why],
        as_json=json,
    )
    for said in (*found.objections, *found.notes):
        output.note(f"note: {said}")
    output.note(f"wrote {found.folder}: {', '.join(found.made)}")
    if found.exported is None:
        output.note("nothing was exported: --anyway does it all the same")
        raise typer.Exit(1)
