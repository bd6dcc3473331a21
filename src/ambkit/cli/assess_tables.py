"""Tables of ``ambkit assess``: a row for each figure, a column for each loop or axis."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ambkit.judge.loop.demands import Demands
    from ambkit.judge.loop.margins import Margins
    from ambkit.workflow.assessment import Assessment
    from ambkit.workflow.over_speed import OverSpeed
    from ambkit.workflow.separation import Separation

BESIDE = 5
"""Loops beside each other in one table."""


def tables(found: Assessment) -> list[Any]:
    """Return all tables of loops, and the sentences below."""
    return [
        *_of_loops(found),
        *_of_each_axis(found),
        *tables_of_critical(found.separations),
        *_of_grades(found),
        *tables_of_unstable(found),
        *tables_of_shares(found),
        *said(found),
    ]


def _of_loops(found: Assessment) -> list[Any]:
    """Return tables with a row for each figure, a column for each loop."""
    from ambkit.base import units
    from ambkit.cli.output import table
    from ambkit.workflow.verdict import held_at

    if len(found.of.axes) == 1:
        rows, at = _rows(found.top), held_at(found)
    else:
        rows, at = _of_several(found.top), units.rpm(found.machine.speed, 6)
    names = list(found.loops)
    title = f"{found.machine.name} at {at}, controllers fed by"
    return [
        table(title, ["", *some], _filled([*rows, *CHECKS], [found.loops[name] for name in some]))
        for some in (names[k : k + BESIDE] for k in range(0, len(names), BESIDE))
    ]


def _of_several(top: float) -> list[tuple[str, Callable[[Any], str]]]:
    """Return heads and what is said of a loop of several axes."""
    from ambkit.cli.output import value

    return [
        ("zone, the worse of stability and displacement", lambda e: e.verdict),
        ("zone of ISO 14839-3", lambda e: e.zone),
        ("  worst axis", lambda e: "–" if e.worst is None else e.worst.name),
        (f"  peak of |S| to {value(top, 'Hz')}", lambda e: _number(e.peak)),
        ("  at", lambda e: value(e.peak_frequency, "Hz")),
        ("largest singular value of S", lambda e: _number(e.largest[0])),
        ("  at", lambda e: value(e.largest[1], "Hz")),
        ("current by noise, rms, at most", lambda e: value(e.current_noise, "A", 3)),
        ("position by noise, rms, at most", lambda e: value(e.position_noise, "m", 3)),
        ("zone of ISO 14839-2", _asked(lambda d: d.zone)),
        ("  greatest displacement, of the clearance", _asked(_displacement)),
    ]


def _of_each_axis(found: Assessment) -> list[Any]:
    """Return the table of the axes of the last loop; none where there is one, or it is unstable."""
    from ambkit.cli.output import table

    last = list(found.loops)[-1]
    if len(found.of.axes) == 1 or not found.loops[last].stable:
        return []
    groups = found.alike(last)
    each = [found.loops[last].axes[same[0]] for same in groups]
    heads = ["", *(" and ".join(same) for same in groups)]
    title = f"Each axis with all other loops closed, controllers fed by {last}"
    return [table(title, heads, _filled(_rows(found.top), each))]


def _of_grades(found: Assessment) -> list[Any]:
    """Return what unbalance of each grade would do; none of a rotor that does not turn."""
    from ambkit.base import units
    from ambkit.cli.output import table, value

    heads = ["grade", "unbalance", "force", "orbit", "of the clearance", "current"]
    rpm = units.rpm(found.machine.speed, 6)
    rows = [
        [f"G {1e3 * each.grade:g}", f"{1e6 * each.unbalance:.4g} g mm",
         value(each.force, "N", 3), value(each.displacement, "m", 3),
         f"{100 * each.clearance_share:.2g} %", value(each.current, "A", 3)]
        for each in found.grades()
    ]  # fmt: skip
    title = f"Unbalance of grades of ISO 21940-11 at {rpm}, angles as bad as can be"
    return [table(title, heads, rows)] if rows else []


def tables_of_unstable(found: Assessment) -> list[Any]:
    """Return what grows in the loops that are unstable; none where all are stable."""
    from ambkit.cli.output import table, value

    rows = [
        [name, value(pole.frequency, "Hz"), f"{pole.growth:.4g}/s", value(pole.doubling, "s", 3)]
        for name, each in found.loops.items() for pole in each.unstable_poles
    ]  # fmt: skip
    heads = ["controller fed by", "frequency", "growth rate", "doubles in"]
    return [table("Unstable poles of the closed loop", heads, rows)] if rows else []


def tables_of_critical(found: Sequence[Separation]) -> list[Any]:
    """Return how far the speed is from each critical speed; none where there is none."""
    from ambkit.cli.output import table
    from ambkit.workflow.separation import BASIS, rpm

    rows = [
        [rpm(each.critical.speed), each.factor, f"{100 * each.margin:.3g} %", each.limit,
         "kept" if each.kept else "not kept"]
        for each in found
    ]  # fmt: skip
    heads = ["critical speed", "amplification factor", "margin", f"required ({BASIS})", ""]
    title = f"Separation of {rpm(found[0].speed)} from critical speeds" if found else ""
    return [table(title, heads, rows)] if rows else []


def tables_over_speed(found: OverSpeed) -> list[Any]:
    """Return a table of a machine's loop over its speed."""
    from ambkit.base import units
    from ambkit.cli.output import table
    from ambkit.workflow.separation import separations
    from ambkit.workflow.verdict import celsius

    def at(speed: float) -> str:
        return units.rpm(speed)

    def share(of: tuple[float, float]) -> str:
        return f"{100 * of[0]:.3g} % at {at(of[1])}"

    peak, where = found.worst
    rows = [
        ["zone of ISO 14839-3", found.zone],
        ["  peak of |S|, worst axis and speed", f"{_number(peak)} at {at(where)}"],
        ["  largest singular value of S", _number(float(found.largest.max()))],
        ["displacement, of the clearance, at most", share(found.farthest)],
        ["current, of its limit, at most", share(found.hardest)],
    ]
    if found.hottest is not None:
        kelvin, where = found.hottest
        of = "runs away" if math.isinf(kelvin) else celsius(kelvin)
        rows.append(["temperature of a coil, at most", f"{of} at {at(where)}"])
    for speed, each in found.integrals.items():
        rows.append([f"check: Bode's integral of ln|det S| at {at(speed)}",
                     f"{each.integral:.8f}"])  # fmt: skip
        rows.append(["  ln|p| of the unstable poles", f"{each.poles:.8f}"])
    title = f"{found.machine.name} to {at(float(found.speed[-1]))}, controllers fed by"
    apart = tables_of_critical(separations(found.machine))
    return [table(title, ["", found.fed_by], rows), *apart]


def tables_of_shares(found: Assessment) -> list[Any]:
    """Return what each piece of the loops costs; none where all are ideal."""
    from ambkit.cli.output import table
    from ambkit.workflow.assessing import HINF, LQG

    names = [name for name in found.loops if name not in (LQG, HINF)]
    each = {name: found.shares(name) for name in names}
    pieces = list(dict.fromkeys(piece for shares in each.values() for piece in shares))
    rows = [
        [PIECES[piece], *(_number(each[name].get(piece, math.nan)) for name in names)]
        for piece in pieces
    ]
    title = "Peak of |S|, all else as it is, controllers fed by"
    return [table(title, ["", *names], rows)] if len(rows) > 1 else []


PIECES = {
    "as it is": "as it is",
    "amplifier": "if the amplifier were without lag",
    "sensor": "if the sensor were without lag",
    "delay": "without dead time, but for the hold",
    "filter": "fed by the measurement",
}
"""What is said of each piece of a loop."""


def _number(peak: float) -> str:
    if math.isinf(peak):
        return "unstable"
    return "–" if math.isnan(peak) else f"{peak:.3f}"


def _filled(
    rows: Sequence[tuple[str, Callable[[Any], str]]], each: Sequence[Any]
) -> list[list[str]]:
    return [[head, *(said(one) for one in each)] for head, said in rows]


def _asked(said: Callable[[Demands], str]) -> Callable[[Any], str]:
    return lambda each: "–" if each.demands is None else said(each.demands)


def _rows(top: float) -> list[tuple[str, Callable[[Any], str]]]:
    """Return heads and what is said of a loop of one axis, or of one axis of several."""
    from ambkit.cli.output import value

    def margin(said: Callable[[Margins], str]) -> Callable[[Any], str]:
        return lambda each: "–" if each.margins is None else said(each.margins)

    return [
        ("zone of ISO 14839-3", lambda e: e.zone),
        (f"  peak of |S| to {value(top, 'Hz')}", lambda e: _number(e.peak)),
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
        ("zone of ISO 14839-2", _asked(lambda d: d.zone)),
        ("  greatest displacement, of the clearance",
         _asked(_displacement)),
        ("least harmonic load that comes to a limit",
         _asked(lambda d: value(d.capacity.least[0], "N", 3))),
        ("  at", _asked(lambda d: value(d.capacity.least[1], "Hz", 3))),
        ("copper loss", _asked(lambda d: _known(d.copper_loss, "W"))),
        ("temperature of the hottest coil", _asked(_temperature)),
    ]  # fmt: skip


def _displacement(d: Demands) -> str:
    return f"{100 * d.displacement / d.clearance:.2g} %"


def _known(figure: float | None, unit: str) -> str:
    from ambkit.cli.output import value

    return "–" if figure is None else value(figure, unit, 3)


def _temperature(d: Demands) -> str:
    from ambkit.workflow.verdict import celsius

    if d.heating is None:
        return "–"
    if math.isinf(d.heating.temperature):
        return "runs away"
    limit = d.heating.limit
    of = "" if limit is None else f" of {celsius(limit)}"
    return f"{celsius(d.heating.temperature)}{of}"


CHECKS: list[tuple[str, Callable[[Any], str]]] = [
    ("check: Bode's integral of ln|det S|", lambda e: f"{e.integral.integral:.8f}"),
    ("  ln|p| of the unstable poles", lambda e: f"{e.integral.poles:.8f}"),
]
"""Rows of the check."""


def _decibels(*factors: float) -> str:
    def one(factor: float) -> str:
        if not 0 < factor < math.inf:
            return "∞" if factor else "-∞"
        return f"{20 * math.log10(factor):.1f}"

    return f"{', '.join(map(one, factors))} dB"


def said(found: Assessment) -> list[str]:
    """Return the bound, the check, and what all of it is."""
    from ambkit.workflow.assessment import BASIS
    from ambkit.workflow.verdict import NEEDED

    said = []
    several = len(found.of.axes) > 1
    S, T = ("the largest singular value of S", "that of T") if several else (
        "the peak of |S|", "that of |T|"
    )  # fmt: skip
    if found.least[0] > 1:
        said.append(
            f"no linear controller brings {S} below {found.least[0]:.3f} here, nor {T} below "
            f"{found.least[1]:.3f}, for the unstable pole{'s' if several else ''} and the dead time"
        )
    asked = [each.demands for loop in found.loops.values() for each in loop.axes.values()]
    if any(each.heating is None for each in asked):
        said.append(f"the temperature of coils is not known: {NEEDED}")
    wrong = [name for name, each in found.loops.items() if not each.integral.holds]
    if wrong:
        said.append(f"the check does not hold, as in an unstable loop: {', '.join(wrong)}")
    fed_by: list[Any] = [None] * ("measurement" in found.loops) + list(found.estimators.values())[
        :1
    ]
    said += [each for each in dict.fromkeys(map(found.of.choice, fed_by)) if each]
    return [*said, *found.plain(), BASIS]
