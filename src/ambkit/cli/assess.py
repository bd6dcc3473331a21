"""``ambkit assess``: stability margins of a loop, with the filter in it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.kinds import NAMES, is_filter, known, names
from ambkit.cli.options import BearingOrFilter, ExpertFile, Json, Plot, find_bearing, quantity

if TYPE_CHECKING:
    from collections.abc import Callable

    from ambkit.judge.loop.margins import Margins
    from ambkit.machine.bearing import Bearing
    from ambkit.workflow.assessing import AssessedLoop, Assessment


def assess(
    bearing: BearingOrFilter,
    estimator: Annotated[
        str | None,
        typer.Option(
            "--estimator",
            "--filter",
            callback=lambda text: text if text in (None, "none") else known(text),
            metavar="NAMES",
            help="Whose estimate feeds the controller: none, or one or several of "
            f"{', '.join(NAMES)}; all; or filters' files (.toml).",
            show_default="the filter whose file is given, or linear",
        ),
    ] = None,
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
      ambkit assess my.toml --filter filter.toml
    """
    from ambkit.cli import output
    from ambkit.cli.kinds import factories
    from ambkit.judge.loop.pieces import tells
    from ambkit.show import plots
    from ambkit.simulation.scenario import Scenario
    from ambkit.workflow.assessing import assess as assessed

    plant, estimator = _asked(bearing, estimator)
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
        [*_tables(found), *_said(found)],
        [(plot, lambda path: plots.save_figure(found.figure(), path))],
        as_json=json,
    )


def _asked(target: str, estimator: str | None) -> tuple[Bearing, str]:
    """Return the plant, and who is in the loop: where a filter's file is the target, both."""
    from ambkit.estimate.filter_file import FilterFile

    if not is_filter(target):
        return find_bearing(target), estimator or "linear"
    if estimator is not None:
        raise AmbkitError(f"{target} is a filter already: leave out --estimator")
    return FilterFile.load(target).bearing.bearing, target


BESIDE = 5
"""Loops beside each other in one table."""


def _tables(found: Assessment) -> list[Any]:
    """Return tables with a row for each figure, a column for each loop."""
    from ambkit.cli.output import table, value

    top = value(found.top, "Hz")

    def margin(said: Callable[[Margins], str]) -> Callable[[AssessedLoop], str]:
        return lambda each: "–" if each.margins is None else said(each.margins)

    rows: list[tuple[str, Callable[[AssessedLoop], str]]] = [
        ("zone of ISO 14839-3", lambda e: e.zone),
        (f"  peak of |S| to {top}", lambda e: f"{e.peak:.3f}" if e.stable else "–"),
        ("  at", lambda e: value(e.peak_frequency, "Hz")),
        ("peak of |S| to half the sampling rate", margin(lambda m: f"{m.peak:.3f}")),
        ("peak of |T|", margin(lambda m: f"{m.complementary_peak:.3f}")),
        ("gain margin up, down", margin(lambda m: _decibels(m.gain_up, m.gain_down))),
        ("phase margin", margin(lambda m: f"{math.degrees(m.phase):.1f} deg")),
        ("delay margin", margin(lambda m: value(m.delay, "s", 3))),
        ("disk margin: gain, both ways", margin(lambda m: _decibels(m.disk_gain[1]))),
        ("  phase, both ways", margin(lambda m: f"{math.degrees(m.disk_phase):.1f} deg")),
        ("|S| below -3 dB up to", margin(lambda m: value(m.bandwidth, "Hz", 3))),
        ("highest crossover", margin(lambda m: value(m.crossover, "Hz", 3))),
        ("current by noise, rms", lambda e: value(e.current_noise, "A", 3)),
        ("position by noise, rms", lambda e: value(e.position_noise, "m", 3)),
        ("check: Bode's integral of ln|S|", lambda e: f"{e.integral.integral:.8f}"),
        ("  ln|p| of the unstable poles", lambda e: f"{e.integral.poles:.8f}"),
    ]  # fmt: skip
    at = f"at {value(found.point.x, 'm')} and {value(found.point.iu, 'A')}"
    title = f"{found.bearing.name} {at}, controller fed by"
    names = list(found.loops)
    return [
        table(
            title,
            ["", *some],
            [[head, *(said(found.loops[name]) for name in some)] for head, said in rows],
        )
        for some in (names[k : k + BESIDE] for k in range(0, len(names), BESIDE))
    ]


def _decibels(*factors: float) -> str:
    def one(factor: float) -> str:
        if not 0 < factor < math.inf:
            return "∞" if factor else "-∞"
        return f"{20 * math.log10(factor):.1f}"

    return f"{', '.join(map(one, factors))} dB"


def _said(found: Assessment) -> list[str]:
    """The bound, the check, and what all of it is."""
    from ambkit.workflow.assessing import BASIS

    said = []
    if found.least[0] > 1:
        said.append(
            f"no linear controller brings the peak of |S| below {found.least[0]:.3f} here, nor "
            f"that of |T| below {found.least[1]:.3f}, for the unstable pole and the dead time"
        )
    wrong = [name for name, each in found.loops.items() if not each.integral.holds]
    if wrong:
        said.append(f"the check does not hold, as in an unstable loop: {', '.join(wrong)}")
    return [*said, BASIS]
