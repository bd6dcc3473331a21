"""``ambkit design``: from logs to the filter to fly, in one command."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.export import Precision
from ambkit.cli.kinds import NAMES, known, names
from ambkit.cli.options import Json, MapFile, find_bearing, find_machine

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ambkit.machine.machine import Machine

_USUAL = "linear,extended,adaptive"  # of one axis


def design(
    bearing: Annotated[
        str,
        typer.Option(
            "--bearing",
            metavar="BEARING",
            help="What is known already: a preset's name, or a TOML file; of a bearing, or of a "
            "whole machine.",
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
            help="Runs in closed loop: any format. A whole machine needs none: its filter is then "
            "tuned on simulated flights.",
            show_default=False,
        ),
    ] = None,
    channel_map: MapFile = None,
    validate: Annotated[
        list[Path] | None,
        typer.Option(metavar="LOG", help="Judge by this record; again for more."),
    ] = None,
    estimator: Annotated[
        str, typer.Option(callback=known, metavar="NAMES", help=f"Some of {', '.join(NAMES)}.")
    ] = _USUAL,
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

    Of a whole machine controllers and filter are chosen on the margins of its loop: the folder gets
    flight.toml, filter.toml, verdict.html, and both as C. What is identified of it is for 'ambkit
    identify'.

    For example:
      ambkit design run.csv --bearing my.toml --out design/
      ambkit design log.mat --channels rig.toml --bearing my.toml --validate other.mat --out design/
      ambkit design --bearing tum_mlps --max-sensitivity 2 --out design/
      ambkit assess design/filter.toml --controller design/flight.toml
    """
    from ambkit.cli import output
    from ambkit.cli.options import arguments_of_the_user
    from ambkit.estimate.registry import KINDS
    from ambkit.workflow.designing import design as designed
    from ambkit.workflow.tuning_tasks import AHEAD

    whole = find_machine(bearing)
    if whole is not None:
        if free is not None:
            raise AmbkitError("--free says what is identified of a bearing, and this is a machine")
        design_whole(
            whole, logs or (), out, channels=channel_map, validate=validate or (),
            kinds=("linear", "extended") if estimator == _USUAL else names(estimator),
            max_sensitivity=max_sensitivity if math.isfinite(max_sensitivity) else None,
            precision=precision.value, prefix=prefix, anyway=anyway, seed=seed, json=json,
        )  # fmt: skip
        return
    if not logs:
        raise AmbkitError("a bearing is designed from its logs: give at least one")
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


def design_whole(
    machine: Machine, logs: Sequence[Path], out: Path, *, json: bool, **options: Any
) -> None:
    """Design controllers and filter of a whole machine, and say what their loop comes to."""
    from ambkit.cli import output
    from ambkit.cli.options import arguments_of_the_user
    from ambkit.estimate.registry import KINDS
    from ambkit.workflow.designing_machine import design_machine

    with arguments_of_the_user(), output.progress("designing", None) as done:
        found = design_machine(machine, logs, out, note=done, **options)
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
    output.deliver(
        found.to_dict(),
        [
            *([output.table(f"Controllers of {machine.name}", heads, gains)] if gains else []),
            output.table("Filters that were tried", ["", "", "peak of |S|"], tried),
            output.table("The loop", seen, loops),
            found.why,
        ],
        as_json=json,
    )
    for said in found.objections:
        output.note(f"note: {said}")
    output.note(f"wrote {found.folder}: {', '.join(found.made)}")
    if found.exported is None:
        output.note("nothing was exported: --anyway does it all the same")
        raise typer.Exit(1)
