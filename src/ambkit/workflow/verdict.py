"""The verdict on a loop, line by line: what was looked at, what it came to, and against what."""

from __future__ import annotations

import math
import os
from typing import NamedTuple

from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.workflow.assessing import Assessment
from ambkit.workflow.loop_of import ZONE_A


class Line(NamedTuple):
    """One line of a verdict.

    Attributes
    ----------
    what : str
        What was looked at.
    found : str
        What it came to.
    limit : str
        Against what; empty where it is only told.
    good : bool or None
        Whether it keeps to that; None where it is only told.
    """

    what: str
    found: str
    limit: str = ""
    good: bool | None = None


def verdict(found: Assessment, filter: str) -> list[Line]:
    """Return the verdict on one stable loop.

    Parameters
    ----------
    found : Assessment
        The loops.
    filter : str
        By what the controller of the loop in question is fed.
    """
    loop = found.loops[filter]
    m, d = loop.margins, loop.demands
    assert m is not None
    assert d is not None
    lines = [
        Line("peak of the sensitivity (ISO 14839-3)",
             f"{loop.peak:.3f} at {engineering(loop.peak_frequency, 'Hz', 4)}, zone {loop.zone}",
             f"below {ZONE_A:g} for zone A", loop.peak < ZONE_A),
        Line("  what no linear controller is below", f"{found.least[0]:.3f}"),
        Line("gain margin, up and down",
             f"{_decibels(m.gain_up)}, {_decibels(m.gain_down)}"),
        Line("phase margin", f"{math.degrees(m.phase):.1f}°"),
        Line("delay margin", engineering(m.delay, "s", 3)),
        Line("greatest displacement (ISO 14839-2)",
             f"{engineering(d.displacement, 'm', 3)}, {100 * d.displacement / d.clearance:.0f} % "
             f"of the clearance, zone {d.zone}", "below 30 % for zone A", d.zone == "A"),
        Line("greatest control current", engineering(d.current, "A", 3),
             f"below {engineering(found.bearing.current_max, 'A')}",
             d.current < found.bearing.current_max),
        Line("constant load that can be held", " to ".join(
            engineering(end, "N", 3) for end in d.capacity.static)),
        Line("least harmonic load that comes to a limit",
             f"{engineering(d.capacity.least[0], 'N', 3)} at "
             f"{engineering(d.capacity.least[1], 'Hz', 3)}"),
        Line("copper loss", "resistance not known" if d.copper_loss is None
             else engineering(d.copper_loss, "W", 3)),
        Line("check: Bode's integral of ln|S|",
             f"{loop.integral.integral:.8f}", f"{loop.integral.poles:.8f}, by the unstable poles",
             loop.integral.holds),
    ]  # fmt: skip
    return lines


def facts(found: Assessment, filter: str) -> dict[str, str]:
    """Return what a verdict holds for, by name.

    Parameters
    ----------
    found : Assessment
        The loops.
    filter : str
        By what the controller is fed.
    """
    b, c, point = found.bearing, found.controller, found.point
    gains = ((c.kp, "A/m"), (c.ki, "A/(m s)"), (c.kd, "A s/m"))
    return {
        "bearing": b.name,
        "controller fed by": filter,
        "held at": f"{engineering(point.x, 'm')} by {engineering(point.iu, 'A', 3)}",
        "kp, ki, kd": ", ".join(f"{value:g} {unit}" for value, unit in gains),
        "derivative filter": engineering(c.derivative_filter, "s", 3),
        "sampling time, dead time": f"{engineering(b.sampling_time, 's')}, "
        f"{engineering(b.delay or 0.0, 's')}",
        "looked at up to": engineering(found.top, "Hz"),
    }


def write_verdict(
    found: Assessment, path: str | os.PathLike[str], filter: str | None = None
) -> None:
    """Write the verdict on one loop as a page that can be signed off.

    Parameters
    ----------
    found : Assessment
        The loops.
    path : path
        Ends with ``.html``.
    filter : str, optional
        By what the controller of that loop is fed; by default the last one.

    Raises
    ------
    AmbkitError
        There is no such loop, or it is not stable; the file cannot be written.
    """
    from ambkit.show.pages.assessment import write_assessment

    name = list(found.loops)[-1] if filter is None else filter
    if name not in found.loops:
        raise AmbkitError(f"no loop is fed by {name}; there are {', '.join(found.loops)}")
    if not found.loops[name].stable:
        raise AmbkitError(f"the loop fed by {name} is not stable: there is nothing to sign off")
    write_assessment(
        path, found.bearing.name, name, verdict(found, name), found.figure(),
        found.capacity_figure(), facts(found, name),
    )  # fmt: skip


def _decibels(factor: float) -> str:
    if not 0 < factor < math.inf:
        return "∞" if factor else "-∞"
    return f"{20 * math.log10(factor):.1f} dB"
