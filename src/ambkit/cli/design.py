"""``ambkit design``: from logs to the filter to fly, in one command."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.cli.export import Precision
from ambkit.cli.kinds import NAMES, known, names
from ambkit.cli.options import Json, MapFile, find_machine

if TYPE_CHECKING:
    from ambkit.workflow.designing import Design


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
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Of all that is drawn.")] = 0,
    json: Json = False,
) -> None:
    """Go from a machine and its logs to what flies: identify, tune, judge, export.

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
    output.deliver(found.to_dict(), [*_tables(found), found.why], as_json=json)
    for said in (*found.objections, *found.notes):
        output.note(f"note: {said}")
    output.note(f"wrote {found.folder}: {', '.join(found.made)}")
    if found.exported is None:
        output.note("nothing was exported: --anyway does it all the same")
        raise typer.Exit(1)


def _tables(found: Design) -> list[Any]:
    """Return controllers, the filters that were tried, and the loop."""
    from ambkit.cli import output
    from ambkit.estimate.registry import KINDS
    from ambkit.workflow.tuning_tasks import AHEAD

    gains = [
        [name, output.value(pid.kp, "A/m", 3), output.value(pid.ki, "A/(m s)", 3),
         output.value(pid.kd, "A s/m", 3), output.value(pid.derivative_filter, "s", 3),
         f"{pid.setpoint_weight:g}"]
        for name, pid in found.control.pid.items()
    ]  # fmt: skip
    steps = {f"{n} step{'s' if n > 1 else ''} ahead": figure for n, figure in AHEAD.items()}
    steps = {head: each for head, each in steps.items() if each in found.chosen.unseen}
    tried = [
        [KINDS[c.kind].label, "tuned" if c.kept else "untuned",
         *(output.value(c.unseen[figure], "m", 3) for figure in steps.values()),
         output.value(c.errors["x"], "m", 3), output.value(c.errors["f_d"], "N", 3),
         "–" if math.isnan(c.efficiency) else f"{100 * c.efficiency:.0f} %",
         "–" if math.isnan(c.peak) else f"{c.peak:.3f}"]
        for c in found.candidates
    ]  # fmt: skip
    loops = [
        [f"fed by {name}", each.zone, f"{each.peak:.3f}", f"{each.largest[0]:.3f}",
         output.value(each.current_noise, "A", 3)]
        for name, each in found.assessed.loops.items() if each.stable
    ]  # fmt: skip
    of_gains = ["", "kp", "ki", "kd", "derivative filter", "set-point weight"]
    of_tried = ["", "", *steps, "error of x", "of f_d", "x: of the bound", "peak of |S|"]
    of_loops = ["these controllers", "zone", "peak of |S|", "largest singular value",
                "noise's current"]  # fmt: skip
    return [
        *([output.table(f"Controllers of {found.machine.name}", of_gains, gains)] if gains else []),
        output.table("Filters that were tried, on what they were not tuned on", of_tried, tried),
        output.table("The loop", of_loops, loops),
    ]
