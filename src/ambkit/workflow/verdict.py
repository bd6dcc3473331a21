"""The verdict on a loop, line by line: what was looked at, what it came to, and against what."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from ambkit.base.units import engineering
from ambkit.workflow.loop_of import ZONE_A

if TYPE_CHECKING:
    from ambkit.workflow.assessing import Assessment


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


def _decibels(factor: float) -> str:
    if not 0 < factor < math.inf:
        return "∞" if factor else "-∞"
    return f"{20 * math.log10(factor):.1f} dB"
