"""Separation of an operating speed from each critical speed, after API 617."""

# API 617, Axial and centrifugal compressors and expander-compressors, and API RP 684, 6.8.2.10,
# with the amplification factor AF: below the operating speed the lesser of 16 % and
# ``17 % (1 - 1/(AF - 1.5))``, above it the lesser of 26 % and 10 % more; none where AF < 2.5. The
# standards themselves were not at hand: the figures are those by which ROSS, the rotordynamic
# software of Petrobras, judges (github.com/petrobras/ross, ``separation margin``, after API 684).
# ISO 14839 has no separation margins; its part 3 judges the peak of the sensitivity.

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ambkit.base.arrays import Complex
from ambkit.base.errors import AmbkitError
from ambkit.base.threads import one_thread
from ambkit.base.units import rpm
from ambkit.control.default_control import default_control
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_plant import unbalance_columns
from ambkit.control.linear.steady_state_filter import tells
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.judge.whirl_modes import CriticalSpeed, followed, whirl_modes
from ambkit.machine.machine import Machine
from ambkit.result.row import Row, put

SHARE, ABOVE = 0.17, 0.10  #: Factor of the margin; addition above the operating speed.
MOST = 0.16  #: Maximum margin for a critical speed below the operating speed.
MOST_SPEED = 0.99  #: Highest speed of the search, over half a revolution per sample.
BASIS = "API 617"  #: Origin of the margins.


@dataclass(frozen=True)
class Separation:
    """Separation of an operating speed from one critical speed."""

    critical: CriticalSpeed  #: The critical speed.
    speed: float  #: Operating speed [rad/s].

    @property
    def margin(self) -> float:
        """Distance over the operating speed [1]."""
        return abs(self.critical.speed / self.speed - 1)

    @property
    def needed(self) -> float:
        """Required margin [1]: none for a critically damped mode."""
        factor = self.critical.amplification
        if self.critical.damped:
            return 0.0
        margin = min(MOST, SHARE * (1 - 1 / (factor - 1.5)))
        return margin + (ABOVE if self.critical.speed > self.speed else 0.0)

    @property
    def kept(self) -> bool:
        """Whether the margin is sufficient."""
        return self.margin >= self.needed

    def text(self) -> str:
        """Return an insufficient margin as one phrase."""
        return (
            f"{rpm(self.critical.speed)} (margin {100 * self.margin:.3g} %, required "
            f"{100 * self.needed:.3g} %, amplification factor {self.critical.amplification:.3g})"
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
    """Separation of an operating speed from all critical speeds up to an end."""

    def __init__(
        self, speed: float, critical: Iterable[CriticalSpeed] = (), end: float = 0.0
    ) -> None:
        super().__init__(Separation(one, speed) for one in critical)
        self.speed = speed  #: Operating speed [rad/s].
        self.end = end  #: End of the search [rad/s].

    def sentence(self) -> str:
        """Return whether the margins are sufficient."""
        if not self:
            return f"no critical speed up to {rpm(self.end)}"
        near = ", ".join(one.text() for one in self if not one.kept)
        if near:
            return f"{rpm(self.speed)} is too near to {near} ({BASIS})"
        there = ", ".join(rpm(one.critical.speed) for one in self if not one.critical.damped)
        if not there:
            return f"all whirl modes up to {rpm(self.end)} are critically damped ({BASIS})"
        return f"{rpm(self.speed)} keeps its margins from the critical speeds {there} ({BASIS})"


def separations(
    machine: Machine, speed: float | None = None, loop: LoopBuilder | None = None,
    fed_by: Estimator | None = None, max_speed: float = 0.0,
) -> Separations:  # fmt: skip
    """Return the separation of a speed from all critical speeds, at least up to twice the speed."""
    # For the closed loop, by default with the default controllers; without stabilising controllers
    # for the Campbell diagram.
    speed = abs(machine.speed if speed is None else speed)
    if not speed:
        return Separations(speed)
    top = min(max(2 * speed, max_speed), MOST_SPEED * math.pi / machine.sampling_time)
    try:
        if loop is None:
            chosen = default_control(machine).chosen
            loop = LoopBuilder(machine, chosen.control)
            fed_by = KalmanFilter(machine) if chosen.feedback == "estimate" else None
        elif fed_by is not None and not tells(fed_by):  # replaces one without steady-state gain
            fed_by = KalmanFilter(machine, synchronous=fed_by.options.get("synchronous", ()))
        criticals = loop_criticals(loop, fed_by, top)
    except (AmbkitError, ValueError):  # no stabilising controller, or no filter for the machine
        criticals = whirl_modes(machine, top).criticals
    return Separations(speed, criticals, top)


At = Callable[[float], tuple[LoopBuilder, Loop]]

COUNT, LEAST = 21, 0.01
"""Speeds of the poles; lowest over highest: an unbalance estimator needs rotation to settle."""

PEAK, NARROWEST, END = 1.3, 0.002, 1.2
"""Minimum ratio to the response three widths beside it; minimum width; end over maximum speed."""

HALF_POWER, BETWEEN = math.sqrt(0.5), 6
"""Depth of the valley between two peaks, as a share, and number of speeds evaluated there."""

ACROSS = np.linspace(-3, 3, 13)  #: Speeds around each pole of a common peak, in widths.
SAME = 1e-6  #: Relative distance of two critical speeds, up to which they count as one.
SHARP = 1e-4  #: Relative accuracy of a common peak's speed.
OVERDAMPED = 1e-3  #: Relative imaginary part of a pole that is rounding.

POLE_SHARE = 0.1
"""Share of a pole in the unbalance response below which it is a filter pole or a backward whirl."""


@one_thread()
def loop_criticals(
    of: LoopBuilder, fed_by: Estimator | None, max_speed: float
) -> list[CriticalSpeed]:
    """Return the critical speeds of a loop up to a speed [rad/s], with damping."""
    of = of.with_controllers(fed_by, max_speed)

    @lru_cache(maxsize=8)
    def at(speed: float) -> tuple[LoopBuilder, Loop]:
        there, inner = of.at_speed(speed, fed_by)
        return there, there.loop(inner)

    def rates(loop: Loop) -> Complex:
        poles = np.linalg.eigvals(loop.closed.A).astype(complex)
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(poles) / loop.T)

    speed = np.linspace(LEAST * max_speed, max_speed, COUNT)
    paths = [rates(at(speed[-1])[1])]
    for k in reversed(range(COUNT - 1)):
        paths.insert(0, followed(paths[:2], rates(at(speed[k])[1])))
    results = []
    for path in np.array(paths).T:
        ahead = path.imag - speed
        for n in np.flatnonzero((ahead[:-1] > 1e-9 * max_speed) & (ahead[1:] <= 0)):
            share = ahead[n] / (ahead[n] - ahead[n + 1])
            critical = float(speed[n] + share * (speed[n + 1] - speed[n]))
            moved, loop = at(critical)
            poles, expected = rates(loop), path[n] + share * (path[n + 1] - path[n])
            pole = complex(poles[np.argmin(np.abs(poles - expected))])
            result = CriticalSpeed(critical, -pole.real / abs(pole))
            if pole.imag <= OVERDAMPED * abs(pole) or _share(moved, loop, pole) < POLE_SHARE:
                continue
            if result.damped or _is_peak(at, result, max_speed):
                results.append(result)
    return _distinct(at, sorted(results), END * max_speed)


def _response(at: At, speed: float) -> float:
    """Return the magnitude of the unbalance response at the bearings."""
    return float(np.linalg.norm(sum(_parts(*at(speed))[1])))


def _distinct(at: At, criticals: list[CriticalSpeed], end: float) -> list[CriticalSpeed]:
    """Return distinct critical speeds, one for each peak of the response."""
    # Coupled poles of rotor and filter make one peak. Two peaks are distinct if the response
    # between them falls to half the power, by which API 684 defines the amplification factor. For a
    # rotor that is symmetric in x and y, a whirl and its mirror image are one.
    groups: list[list[CriticalSpeed]] = []
    for critical in criticals:
        last = groups[-1][-1] if groups else critical
        if groups and critical.speed <= (1 + SAME) * last.speed:
            continue
        sharp = not (critical.damped or last.damped)
        if sharp and last is not critical and not _valley(at, last.speed, critical.speed):
            groups[-1].append(critical)
        else:
            groups.append([critical])
    return [group[0] if len(group) == 1 else _peak_of(at, group, end) for group in groups]


def _valley(at: At, low: float, high: float) -> bool:
    """Return whether the response falls to half the power between two speeds."""
    size = [_response(at, float(speed)) for speed in np.linspace(low, high, BETWEEN)]
    return min(size) < HALF_POWER * min(size[0], size[-1])


def _peak_of(at: At, group: list[CriticalSpeed], end: float) -> CriticalSpeed:
    """Return the common peak of several poles, with the damping ratio of its half-power points."""
    from scipy import optimize

    across = [(1 + one.damping_ratio * ACROSS) * one.speed for one in group]
    speed = np.unique(np.minimum(across, end))
    size = np.array([_response(at, float(one)) for one in speed])
    k = int(np.argmax(size))
    sides = float(speed[max(k - 1, 0)]), float(speed[min(k + 1, len(speed) - 1)])
    peak = optimize.fminbound(lambda one: -_response(at, float(one)), *sides, xtol=SHARP * sides[0])
    wide = speed[size > HALF_POWER * size[k]]
    return CriticalSpeed(float(peak), float((wide[-1] - wide[0]) / (2 * peak)))


def _is_peak(at: At, critical: CriticalSpeed, max_speed: float) -> bool:
    """Return whether the unbalance response has a peak there, not just a filter pole."""
    width = max(critical.damping_ratio, NARROWEST)
    size = {}
    for off in (-3, -1, 0, 1, 3):
        speed = (1 + off * width) * critical.speed
        if speed < END * max_speed:
            size[off] = _response(at, speed)
    inside = max(value for off, value in size.items() if abs(off) < 3)
    return bool(inside > PEAK * max(value for off, value in size.items() if abs(off) == 3))


def _share(of: LoopBuilder, loop: Loop, rate: complex) -> float:
    """Return the share of a pole in the unbalance response at the bearings."""
    poles, parts = _parts(of, loop)
    k = int(np.argmin(np.abs(poles - np.exp(rate * loop.T))))
    return float(np.linalg.norm(parts[k]) / np.linalg.norm(sum(parts)))


def _parts(of: LoopBuilder, loop: Loop) -> tuple[Complex, list[Complex]]:
    """Return the poles, and the contribution of each to the positions (axes, bearings)."""
    places = sorted({bearing.place for bearing in of.machine.bearings})
    columns = unbalance_columns(of.machine, of.point, places)
    poles, right = np.linalg.eig(loop.closed.A)
    z = np.exp(1j * of.machine.speed * loop.T)
    moved = np.linalg.inv(right)[:, : len(columns)] @ columns / (z - poles)[:, None]
    seen = loop.closed.C[loop.measurements : len(loop.plant.outputs)] @ right
    return poles, [np.outer(one, other) for one, other in zip(seen.T, moved, strict=True)]
