"""``ambkit design``: from logs to the filter to fly, in one command."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.cli.export import Precision
from ambkit.cli.kinds import NAMES, known, names
from ambkit.cli.options import Json, MapFile, find_plant

if TYPE_CHECKING:
    from ambkit.workflow.designing import Design
    from ambkit.workflow.designing_machine import MachineDesign


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
            help="Runs in closed loop: any format. Of several axes none is needed: the filter is "
            "then tuned on simulated flights.",
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
            show_default="linear,extended, of one axis adaptive too",
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
    """Go from logs to the filter to fly: identify, train, tune, judge, export.

    The folder gets found.toml, expert.json, filter.toml, the C in c/, and design.html, which says
    which filter to fly and why. A second call goes on where the first was interrupted.

    Of several axes controllers and filter are chosen on the margins of the loop: the folder gets
    flight.toml, filter.toml, verdict.html, and both as C. 'ambkit identify' comes before it.

    For example:
      ambkit design run.csv --bearing my.toml --out design/
      ambkit design log.mat --channels rig.toml --bearing my.toml --validate other.mat --out design/
      ambkit design --bearing tum_mlps --max-sensitivity 2 --out design/
      ambkit assess design/filter.toml --controller design/flight.toml
    """
    from ambkit.cli import output
    from ambkit.cli.options import arguments_of_the_user
    from ambkit.workflow.designing import Design
    from ambkit.workflow.designing import design as designed

    plant = find_plant(bearing)
    with arguments_of_the_user(), output.progress("designing", None) as done:
        found = designed(
            plant, logs or (), out, channels=channel_map, validate=validate or (),
            kinds=None if estimator is None else names(estimator), precision=precision.value,
            prefix=prefix, anyway=anyway, seed=seed, note=done,
            free=None if free is None else free.replace(" ", "").split(","),
            max_sensitivity=max_sensitivity if math.isfinite(max_sensitivity) else None,
        )  # fmt: skip
    tables = _of_filters(found) if isinstance(found, Design) else _of_loop(found)
    output.deliver(found.to_dict(), [*tables, found.why], as_json=json)
    for said in (*found.objections, *found.notes):
        output.note(f"note: {said}")
    output.note(f"wrote {found.folder}: {', '.join(found.made)}")
    if found.exported is None:
        output.note("nothing was exported: --anyway does it all the same")
        raise typer.Exit(1)


def _of_filters(found: Design) -> list[Any]:
    """Return the filters that were tried for one axis."""
    from ambkit.cli import output
    from ambkit.estimate.registry import KINDS
    from ambkit.workflow.tuning_tasks import AHEAD

    rows = [
        [KINDS[c.kind].label,
         *(output.value(c.unseen[figure], "m", 3) for figure in AHEAD.values()),
         output.value(c.errors["x"], "m", 3), output.value(c.errors["f_d"], "N", 3),
         f"{100 * c.efficiency:.0f} %", "–" if math.isnan(c.peak) else f"{c.peak:.2f}"]
        for c in found.candidates
    ]  # fmt: skip
    heads = ["", "1 step ahead", "10 steps ahead", "error of x", "of f_d", "x: of the bound",
             "peak of |S|"]  # fmt: skip
    return [output.table("Unseen records, and simulated runs", heads, rows)]


def _of_loop(found: MachineDesign) -> list[Any]:
    """Return controllers, filters and the loop of several axes."""
    from ambkit.cli import output
    from ambkit.estimate.registry import KINDS

    gains = [
        [name, output.value(pid.kp, "A/m", 3), output.value(pid.ki, "A/(m s)", 3),
         output.value(pid.kd, "A s/m", 3), output.value(pid.derivative_filter, "s", 3),
         f"{pid.setpoint_weight:g}"]
        for name, pid in found.control.pid.items()
    ]  # fmt: skip
    loops = [
        [f"fed by {name}", each.zone, f"{each.peak:.3f}", f"{each.largest[0]:.3f}",
         output.value(each.current_noise, "A", 3)]
        for name, each in found.assessed.loops.items() if each.stable
    ]  # fmt: skip
    tried = [
        [KINDS[kind].label, "tuned" if each.kept else "untuned", f"{each.peak:.3f}"]
        for kind, each in found.tuned.items()
    ]
    heads = ["axis", "kp", "ki", "kd", "derivative filter", "set-point weight"]
    seen = ["these controllers", "zone", "peak of |S|", "largest singular value", "noise's current"]
    return [
        *([output.table(f"Controllers of {found.machine.name}", heads, gains)] if gains else []),
        output.table("Filters that were tried", ["", "", "peak of |S|"], tried),
        output.table("The loop", seen, loops),
    ]
