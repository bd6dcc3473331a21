"""The verdict on a loop, line by line: what was looked at, what it came to, and against what."""

from __future__ import annotations

import math
import os
from typing import NamedTuple

from ambkit.base import units
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.judge.loop.demands import ROOM
from ambkit.judge.loop.heating import ZERO
from ambkit.judge.loop.loop_of import ZONE_A
from ambkit.simulation.controllers import Control
from ambkit.workflow.assessed_loop import AssessedLoop
from ambkit.workflow.assessment import Assessment
from ambkit.workflow.balance import grade_of
from ambkit.workflow.over_speed import OverSpeed
from ambkit.workflow.separation import BASIS


class Line(NamedTuple):
    """One line of a verdict."""

    what: str  #: What was looked at.
    found: str  #: What it came to.
    limit: str = ""  #: Against what; empty where it is only told.
    good: bool | None = None  #: Whether it keeps to that; None where it is only told.


def verdict(found: Assessment, filter: str, over: OverSpeed | None = None) -> list[Line]:
    """Return the verdict on one loop; of one that is unstable, what grows in it."""
    loop, several = found.loops[filter], len(found.of.axes) > 1
    if not loop.stable:
        return [*_of_unstable(loop), *_of_critical(found)]
    worst, d = loop.worst, loop.demands
    assert worst is not None
    assert d is not None
    m, all_of = worst.margins, list(loop.axes.values())
    axis = f", axis {worst.name}" if several else ""
    S = "the largest singular value" if several else "it"
    asked = [each.demands for each in all_of]
    limits = [b.current_max for b in found.of.alone]
    nearest = max(range(len(asked)), key=lambda k: asked[k].current / limits[k])
    used, limit = asked[nearest].current, limits[nearest]
    frailest = min(all_of, key=lambda each: each.demands.capacity.least[0])
    load, at = frailest.demands.capacity.least
    lines = [
        Line("zone, the worse of stability and displacement", loop.verdict, "A",
             loop.verdict == "A"),
        Line("peak of the sensitivity (ISO 14839-3)",
             f"{loop.peak:.3f} at {engineering(loop.peak_frequency, 'Hz', 4)}{axis}, "
             f"zone {loop.zone}", f"below {ZONE_A:g} for zone A", loop.peak < ZONE_A),
    ]  # fmt: skip
    if several:
        value, where = loop.largest
        lines.append(
            Line("  largest singular value", f"{value:.3f} at {engineering(where, 'Hz', 4)}")
        )
    lines.append(Line(f"  below which no linear controller brings {S}", f"{found.least[0]:.3f}"))
    lines += [
        Line(f"  with {PIECES[piece]}", "unstable" if math.isinf(peak) else f"{peak:.3f}")
        for piece, peak in found.shares(filter).items() if piece in PIECES
    ]  # fmt: skip
    if over is not None:
        peak, speed = over.worst
        lines.append(
            Line(f"  from rest to {rpm(float(over.speed[-1]))}",
                 f"{peak:.3f} at {rpm(speed)}, zone {over.zone}", f"below {ZONE_A:g} for zone A",
                 peak < ZONE_A)
        )  # fmt: skip
    lines += [
        Line(f"gain margin, up and down{axis}",
             f"{_decibels(m.gain_up)}, {_decibels(m.gain_down)}"),
        Line(f"phase margin{axis}", f"{math.degrees(m.phase):.1f}°"),
        Line(f"delay margin{axis}", engineering(m.delay, "s", 3)),
        Line("greatest displacement (ISO 14839-2)",
             f"{engineering(d.displacement, 'm', 3)}, {100 * d.displacement / d.clearance:.2g} % "
             f"of the clearance, zone {d.zone}", "below 30 % for zone A", d.zone == "A"),
        Line("greatest control current", engineering(used, "A", 3),
             f"below {engineering(limit, 'A')}", used < limit),
    ]  # fmt: skip
    if over is not None:
        lines += _of_run_up(over)
    lines += _of_critical(found)
    lines += [
        Line(f"constant load that can be held{f', axis {each.name}' if several else ''}",
             " to ".join(engineering(end, "N", 3) for end in each.demands.capacity.static))
        for each in all_of
    ]  # fmt: skip
    least = f"{engineering(load, 'N', 3)} at {engineering(at, 'Hz', 3)}"
    lines += [
        Line("least harmonic load that comes to a limit",
             f"{least}, axis {frailest.name}" if several else least),
        *_of_coils(found, filter),
        *_of_balance(found, filter),
        Line("check: Bode's integral of ln|det S|",
             f"{loop.integral.integral:.8f}", f"{loop.integral.poles:.8f}, by the unstable poles",
             loop.integral.holds),
    ]  # fmt: skip
    return lines


def _of_unstable(loop: AssessedLoop) -> list[Line]:
    """Return what grows in an unstable loop."""
    return [
        Line("stability of the closed loop", "unstable", "all poles stable", False),
        *(
            Line(f"  unstable pole at {engineering(each.frequency, 'Hz', 4)}",
                 f"grows by {each.growth:.4g}/s, doubles in {engineering(each.doubling, 's', 3)}")
            for each in loop.unstable_poles
        ),
    ]  # fmt: skip


def _of_critical(found: Assessment) -> list[Line]:
    """Return how far the speed is from each critical speed."""
    return [
        Line(f"separation from the critical speed of {rpm(each.critical.speed)} ({BASIS})",
             f"{each.where}, amplification factor {each.factor}", each.limit,
             each.kept if each.needed else None)
        for each in found.separations
    ]  # fmt: skip


def _of_coils(found: Assessment, filter: str) -> list[Line]:
    """Return copper loss and temperature of the coils, or what they need to be known."""
    axes = found.loops[filter].axes
    losses = [each.demands.copper_loss for each in axes.values()]
    known = [each for each in losses if each is not None]
    lines = [
        Line("copper loss", engineering(sum(known), "W", 3) if known
             else "not known: give the amplifier's resistance, of a coil")
    ]  # fmt: skip
    warm = {name: each.demands.heating for name, each in axes.items()}
    if None in warm.values():
        return [*lines, Line("coil temperature", f"not known: {NEEDED}")]
    name, hottest = max(
        ((name, each) for name, each in warm.items() if each is not None),
        key=lambda one: one[1].temperature,
    )
    axis = f", axis {name}" if len(axes) > 1 else ""
    lines.append(temperature_line(f"coil temperature{axis}", hottest.temperature, hottest.limit))
    if hottest.until_limit is not None and 0 < hottest.until_limit < math.inf:
        lines.append(Line("  from there on until the limit, at the greatest current",
                          engineering(hottest.until_limit, "s", 3)))  # fmt: skip
    return lines


NEEDED = (
    "give the amplifier's resistance, and under [coil] its thermal_resistance and temperature_limit"
)
"""What the temperature of coils is computed from."""


def temperature_line(what: str, temperature: float, limit: float | None) -> Line:
    """Return the line of a coil's temperature."""
    if math.isinf(temperature):
        return Line(what, "runs away: a warmer coil loses more than is cooled away",
                    "at rest" if limit is None else f"below {celsius(limit)}", False)  # fmt: skip
    if limit is None:
        return Line(what, celsius(temperature))
    return Line(what, celsius(temperature), f"below {celsius(limit)}", temperature < limit)


def celsius(temperature: float) -> str:
    """Return a temperature [K] in degrees Celsius, as text."""
    return f"{temperature - ZERO:.1f} °C"


PIECES = {
    "amplifier": "an amplifier without lag",
    "sensor": "a sensor without lag",
    "delay": "no dead time but the hold",
    "filter": "the measurement in place of the filter",
}
"""What is said of a piece that is ideal, all else as it is."""


def _of_run_up(over: OverSpeed) -> list[Line]:
    """Return what is asked in a slow run-up."""
    (far, there), (used, at) = over.farthest, over.hardest
    limit = ROOM[0][1]
    return [
        Line("  in a slow run-up, displacement",
             f"{100 * far:.3g} % of the clearance at {rpm(there)}",
             f"below {100 * limit:g} % for zone A", far < limit),
        Line("  in a slow run-up, current", f"{100 * used:.3g} % of its limit at {rpm(at)}",
             "below 100 %", used < 1),
        *([] if over.hottest is None else [
            temperature_line(f"  in a slow run-up, coil at {rpm(over.hottest[1])}",
                             over.hottest[0], over.temperature_limit)
        ]),
    ]  # fmt: skip


def _of_balance(found: Assessment, filter: str) -> list[Line]:
    """Return the grade of a machine's unbalance, and what grades would do."""
    lines = []
    own = grade_of(found.machine)
    if own is not None:
        lines.append(
            Line("balance quality grade of the unbalance (ISO 21940-11)", f"G {1e3 * own:.3g}")
        )
    for each in found.grades(filter):
        if each.grade in SHOWN_GRADES:
            lines.append(
                Line(f"  orbit with G {1e3 * each.grade:g}, {1e6 * each.unbalance:.3g} g mm",
                     f"{engineering(each.displacement, 'm', 3)}, "
                     f"{100 * each.clearance_share:.2g} % of the clearance")
            )  # fmt: skip
    return lines


SHOWN_GRADES = (2.5e-3, 6.3e-3)
"""Balance quality grades that a verdict names [m/s]."""


def rpm(speed: float) -> str:
    """Return a speed of rotation [rad/s] in revolutions a minute, as text."""
    return units.rpm(speed)


def held_at(found: Assessment) -> str:
    """Return displacement and control current of each axis at the work point, as text."""
    each = [
        f"{engineering(float(x), 'm')} by {engineering(float(iu), 'A', 3)}"
        for x, iu in zip(found.of.point.x, found.of.point.iu, strict=True)
    ]
    if len(each) == 1:
        return each[0]
    return ", ".join(f"{name} {held}" for name, held in zip(found.of.axes, each, strict=True))


def facts(found: Assessment, filter: str) -> dict[str, str]:
    """Return what a verdict holds for, by name."""
    b = found.machine
    told = {"machine": b.name, "controller fed by": filter, "held at": held_at(found)}
    if b.speed:
        told["speed"] = rpm(b.speed)
    orbit = found.loops[filter].of.point.orbit
    if orbit is not None:
        far = zip(found.of.axes, orbit.x, strict=True)
        told["along the orbit of"] = ", ".join(
            f"{engineering(float(abs(x)), 'm', 3)} ({name})" for name, x in far
        )
    gains: dict[str, list[str]] = {}
    told |= _control(found.of.control_for(found.estimators.get(filter)))
    plain = found.of.plain(found.estimators.get(filter))
    told |= {} if plain is None else {"plain control": plain}
    for name, c in found.of.pids(found.estimators.get(filter)).items():
        if c.type == "lqg":
            told["control"] = c.type
            continue
        if c.feed_forward:
            told["feed-forward"] = f"{c.feed_forward:g} of the estimated disturbance force"
        each = ((c.kp, "A/m"), (c.ki, "A/(m s)"), (c.kd, "A s/m"))
        said = ", ".join(f"{value:g} {unit}" for value, unit in each)
        gains.setdefault(f"{said}, derivative filter {engineering(c.derivative_filter, 's', 3)}",
                         []).append(name)  # fmt: skip
    for said, axes in gains.items():
        told[f"kp, ki, kd of {', '.join(axes)}"] = said
    return told | {
        "sampling time, dead time": f"{engineering(b.sampling_time, 's')}, "
        f"{engineering(b.delay or 0.0, 's')}",
        "looked at up to": engineering(found.top, "Hz"),
    }


def _control(control: Control) -> dict[str, str]:
    """Return how a machine is controlled, where it is not one PID an axis."""
    told: dict[str, str] = {}
    if control.type not in (None, "decentralised"):
        scheduled = ", gains scheduled by speed" if control.gain_scheduling else ""
        told["control"] = f"{control.type}{scheduled}"
    if control.cross_feedback:
        told["cross feedback"] = f"{control.cross_feedback:g} of the gyroscopic torques"
    if control.unbalance != "fought":
        told["unbalance"] = control.unbalance
    return told


def write_verdict(
    found: Assessment,
    path: str | os.PathLike[str],
    filter: str | None = None,
    over: OverSpeed | None = None,
) -> None:
    """Write the verdict on one loop as a page that can be signed off."""
    from ambkit.show.pages.assessment import write_assessment

    name = list(found.loops)[-1] if filter is None else filter
    if name not in found.loops:
        raise AmbkitError(f"no loop is fed by {name}; there are {', '.join(found.loops)}")
    if over is not None and (over.fed_by, over.machine.name) != (name, found.bearing.name):
        raise AmbkitError(
            f"over speed is of {over.machine.name}, fed by {over.fed_by}; the verdict is on "
            f"{found.bearing.name}, fed by {name}"
        )
    stable = found.loops[name].stable
    margins, loads = [found.figure(name)], [found.capacity_figure(name)] if stable else []
    if over is not None and stable:
        margins.append(over.figure())
        loads.append(over.run_up_figure())
    write_assessment(
        path, found.bearing.name, name, verdict(found, name, over), margins, loads,
        facts(found, name),
    )  # fmt: skip


def _decibels(factor: float) -> str:
    if not 0 < factor < math.inf:
        return "∞" if factor else "-∞"
    return f"{20 * math.log10(factor):.1f} dB"
