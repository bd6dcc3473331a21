"""``ambkit assess``: stability margins of a loop, with the filter in it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.cli.kinds import NAMES, known, names
from ambkit.cli.options import BearingName, ExpertFile, Json, Plot, find_bearing, quantity

if TYPE_CHECKING:
    from collections.abc import Callable

    from ambkit.workflow.assessing import AssessedLoop, Assessment


def assess(
    bearing: BearingName,
    estimator: Annotated[
        str,
        typer.Option(
            callback=lambda text: text if text == "none" else known(text),
            metavar="NAME",
            help="Whose estimate feeds the controller: none, or with commas for more: "
            f"{', '.join(NAMES)}, or the file of a filter (.toml).",
        ),
    ] = "linear",
    expert: ExpertFile = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Whose [controller] is assessed; what it does not say, all of it without one, is "
            "tuned for the bearing.",
        ),
    ] = None,
    x: Annotated[
        float | None,
        typer.Option(
            "--position", parser=quantity("m"), metavar="LENGTH", help="Where the rotor is held."
        ),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(parser=quantity("N"), metavar="FORCE", help="Constant load there."),
    ] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Say how far the loop is from the limit of stability, with the filter in it.

    Sensitivity at the measurement as ISO 14839-3 looks at it, with its zones, of the loop as it is:
    sampled, with dead time, amplifier, sensor, controller and estimator. Beside it stands the same
    controller on the measurement.

    For example:
      ambkit assess zittau_axial --estimator linear,observer --plot margins.png
    """
    from ambkit.cli import output
    from ambkit.cli.kinds import factories
    from ambkit.judge.loop.pieces import tells
    from ambkit.show import plots
    from ambkit.simulation.scenario import Scenario
    from ambkit.workflow.assessing import assess as assessed

    plant = find_bearing(bearing)
    controller = None if scenario is None else Scenario.load(scenario).controller
    built = factories([] if estimator == "none" else names(estimator), plant, expert)
    filters = {name: make() for name, make in built.items()}
    if "all" in names(estimator):
        for name in [name for name, each in filters.items() if not tells(each)]:
            output.note(f"{name} is left out: it does not settle to a gain")
            del filters[name]
    found = assessed(plant, filters, controller, x=x or 0.0, load=load or 0.0)
    output.deliver(
        found.to_dict(),
        [_table(found), *_said(found)],
        [(plot, lambda path: plots.save_figure(found.figure(), path))],
        as_json=json,
    )


def _table(found: Assessment) -> Any:
    """A row for each figure, a column for each loop."""
    from ambkit.cli.output import table, value

    rows: list[tuple[str, Callable[[Any], str]]] = [
        ("zone of ISO 14839-3", lambda e: e.zone),
        (f"  peak of |S| to {value(found.top, 'Hz')}", lambda e: f"{e.peak:.3f}"),
        ("  at", lambda e: value(e.peak_frequency, "Hz")),
        ("peak of |S| to half the sampling rate", lambda e: f"{e.margins.peak:.3f}"),
        ("peak of |T|", lambda e: f"{e.margins.complementary_peak:.3f}"),
        ("gain margin up, down", lambda e: _decibels(e.margins.gain_up, e.margins.gain_down)),
        ("phase margin", lambda e: f"{math.degrees(e.margins.phase):.1f} deg"),
        ("delay margin", lambda e: value(e.margins.delay, "s", 3)),
        ("disk margin: gain, both ways", lambda e: _decibels(e.margins.disk_gain[1])),
        ("  phase, both ways", lambda e: f"{math.degrees(e.margins.disk_phase):.1f} deg"),
        ("|S| below -3 dB up to", lambda e: value(e.margins.bandwidth, "Hz", 3)),
        ("highest crossover", lambda e: value(e.margins.crossover, "Hz", 3)),
        ("current by noise, rms", lambda e: value(e.current_noise, "A", 3)),
        ("position by noise, rms", lambda e: value(e.position_noise, "m", 3)),
    ]  # fmt: skip
    loops = list(found.loops.values())
    text = [
        [head, *(_shown(each, said, first=k == 0) for each in loops)]
        for k, (head, said) in enumerate(rows)
    ]
    at = f"at {value(found.point.x, 'm')} and {value(found.point.iu, 'A')}"
    title = f"{found.bearing.name} {at}, controller fed by"
    return table(title, ["", *found.loops], text)


def _shown(each: AssessedLoop, said: Callable[[Any], str], *, first: bool) -> str:
    return said(each) if first or each.stable else "–"


def _decibels(*factors: float) -> str:
    def one(factor: float) -> str:
        if not 0 < factor < math.inf:
            return "∞" if factor else "-∞"
        return f"{20 * math.log10(factor):.1f}"

    return f"{', '.join(map(one, factors))} dB"


def _said(found: Assessment) -> list[str]:
    """The bound, the check, and what all of it is."""
    from ambkit.workflow.assessing import BASIS

    said = [
        f"no linear controller brings the peak of |S| below {found.least[0]:.3f} here, nor that of "
        f"|T| below {found.least[1]:.3f}, for the unstable pole and the dead time"
    ]
    for name, each in found.loops.items():
        i = each.integral
        equal = "agrees" if i.holds else "does not agree"
        said.append(
            f"check, {name}: Bode's integral of ln|S| {i.integral:.8f}, ln|p| of the unstable "
            f"poles {i.poles:.8f}: {equal}"
        )
    return [*said, BASIS]
