"""How far a speed of operation is from each critical speed, after API 617."""

# API 617, Axial and centrifugal compressors and expander-compressors, and API RP 684, 6.8.2.10,
# with the amplification factor AF: below the operating speed the lesser of 16 % and
# ``17 % (1 - 1/(AF - 1.5))``, above it the lesser of 26 % and 10 % more; none where AF < 2.5. The
# standards themselves were not at hand: the figures are those by which ROSS, the rotordynamic
# software of Petrobras, judges (github.com/petrobras/ross, ``separation margin``, after API 684).
# ISO 14839 has no separation margins; its part 3 judges the peak of the sensitivity.

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ambkit.base.errors import AmbkitError
from ambkit.base.units import rpm
from ambkit.control.default_control import default_control
from ambkit.control.linear.steady_state_filter import tells
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.judge.loop.loop_of import LoopOf
from ambkit.judge.whirl_modes import DAMPED, CriticalSpeed, whirl_modes
from ambkit.machine.machine import Machine
from ambkit.result.row import Row, put
from ambkit.rotordynamics.loop_criticals import loop_criticals

SHARE, ABOVE = 0.17, 0.10  #: Factor of the margin; what is added above the operating speed.
MOST = 0.16  #: The greatest margin that a critical speed below the operating speed needs.
MOST_SPEED = 0.99  #: Highest speed of the search, of half a revolution a sample.
BASIS = "API 617"  #: Where the margins are from.


@dataclass(frozen=True)
class Separation:
    """The distance of an operating speed from one critical speed."""

    critical: CriticalSpeed  #: The critical speed.
    speed: float  #: Of operation [rad/s].

    @property
    def margin(self) -> float:
        """Distance, of the operating speed [1]."""
        return abs(self.critical.speed / self.speed - 1)

    @property
    def needed(self) -> float:
        """Margin that is required [1]: none of a mode that is critically damped."""
        factor = self.critical.amplification
        if factor < DAMPED:
            return 0.0
        margin = min(MOST, SHARE * (1 - 1 / (factor - 1.5)))
        return margin + (ABOVE if self.critical.speed > self.speed else 0.0)

    @property
    def kept(self) -> bool:
        """Whether the speed is far enough."""
        return self.margin >= self.needed

    def text(self) -> str:
        """Return it as one phrase."""
        side = "above" if self.critical.speed > self.speed else "below"
        limit = f"at least {100 * self.needed:.3g} %" if self.needed else "none: critically damped"
        return (
            f"{rpm(self.critical.speed)}, {100 * self.margin:.3g} % {side} {rpm(self.speed)} "
            f"(amplification factor {self.critical.amplification:.3g}; required: {limit})"
        )

    def rows(self) -> list[Row]:
        """Return it as rows."""
        factor = self.critical.amplification
        return put([
            Row("critical_speed", "critical speed", self.critical.speed, "rpm", detail=True),
            Row("speed", "speed", self.speed, "rpm", detail=True),
            Row("damping_ratio", "damping ratio", self.critical.damping_ratio, detail=True),
            Row("amplification_factor", "amplification factor",
                factor if math.isfinite(factor) else None, digits=3),
            Row("margin", "margin", self.margin, "%", least=self.needed or None),
        ], section=("critical_speeds",), of=rpm(self.critical.speed))  # fmt: skip


class Separations(list[Separation]):
    """The distances of an operating speed from all critical speeds up to an end."""

    def __init__(
        self, speed: float, critical: Iterable[CriticalSpeed] = (), end: float = 0.0
    ) -> None:
        super().__init__(Separation(one, speed) for one in critical)
        self.speed = speed  #: Of operation [rad/s].
        self.end = end  #: Of the search [rad/s].

    def sentence(self) -> str:
        """Return whether the margins are kept."""
        if not self:
            return f"no critical speed up to {rpm(self.end)}"
        parts = "; ".join(one.text() for one in self)
        near = [rpm(one.critical.speed) for one in self if not one.kept]
        verdict = f"too near to {', '.join(near)} ({BASIS})" if near else f"kept ({BASIS})"
        return f"separation from critical speeds: {parts}: {verdict}"


def separations(
    machine: Machine, speed: float | None = None, loop: LoopOf | None = None,
    fed_by: Estimator | None = None, max_speed: float = 0.0,
) -> Separations:  # fmt: skip
    """Return the distances of a speed from all critical speeds up to twice of it, or further."""
    # Of the closed loop, with the controllers that are flown by default where none is given; where
    # nothing holds the rotor, of the Campbell diagram.
    speed = abs(machine.speed if speed is None else speed)
    if not speed:
        return Separations(speed)
    top = min(max(2 * speed, max_speed), MOST_SPEED * math.pi / machine.sampling_time)
    try:
        if loop is None:
            chosen = default_control(machine).chosen
            loop = LoopOf(machine, chosen.control)
            fed_by = KalmanFilter(machine) if chosen.feedback == "estimate" else None
        elif fed_by is not None and not tells(fed_by):  # it stands for one that settles to no gain
            fed_by = KalmanFilter(machine, synchronous=fed_by.options.get("synchronous", ()))
        criticals = loop_criticals(loop, fed_by, top)
    except (AmbkitError, ValueError):  # nothing holds the rotor, or no filter takes it
        criticals = whirl_modes(machine, top).criticals
    return Separations(speed, criticals, top)
