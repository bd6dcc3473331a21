"""One loop: margins, noise, load capacity and the demands on the machine."""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from ambkit.control.linear.closed_loop import Loop
from ambkit.judge.loop.capacity import Demands, demands
from ambkit.judge.loop.loop_builder import LoopBuilder, zone_of
from ambkit.judge.loop.margins import (
    BodeIntegral,
    Margins,
    UnstablePole,
    bode_integral,
    grid,
    highest,
    margins,
    unstable_poles,
)


@dataclass(frozen=True, eq=False)
class AssessedAxis:
    """One axis of a stable loop, with all others closed."""

    name: str  #: Of the axis.
    margins: Margins  #: Of its loop.
    peak: float  #: Maximum of abs(S) within the standard's range [1], and its frequency [Hz].
    peak_frequency: float
    #: Standard deviations of the commanded current [A] and the position [m] due to the sensors'
    #: white noise and the amplifiers' noise.
    current_noise: float
    position_noise: float
    demands: Demands  #: Demands on the machine, and load capacity.

    @property
    def zone(self) -> str:
        """Zone A to D."""
        return zone_of(self.peak)


@dataclass(frozen=True, eq=False)
class AssessedLoop:
    """Assessment of one loop, of one axis or several."""

    name: str  #: Feedback of its controllers.
    loop: Loop  #: Linear loop, for further responses.
    stable: bool  #: Whether it is stable; otherwise nothing below applies.
    axes: dict[str, AssessedAxis]  #: By name; empty for an unstable loop.
    #: Maximum of the largest singular value of S up to half the sampling rate [1], and its
    #: frequency [Hz]; NaN for an unstable loop.
    largest: tuple[float, float]
    integral: BodeIntegral  #: Numerical check.
    of: LoopBuilder  #: Plant and operating point.

    @property
    def worst(self) -> AssessedAxis | None:
        """The axis with the greatest peak, which determines the zone; None for an unstable loop."""
        # Of equal axes the first, independent of rounding.
        return max(self.axes.values(), key=lambda item: float(f"{item.peak:.9g}"), default=None)

    @property
    def margins(self) -> Margins | None:
        """Those of the worst axis; None for an unstable loop."""
        return None if self.worst is None else self.worst.margins

    @property
    def peak(self) -> float:
        """Maximum of abs(S) over the axes within the standard's range [1]; NaN if unstable."""
        return math.nan if self.worst is None else self.worst.peak

    @property
    def peak_frequency(self) -> float:
        """Frequency of the peak [Hz]."""
        return math.nan if self.worst is None else self.worst.peak_frequency

    @property
    def current_noise(self) -> float:
        """Maximum standard deviation of a commanded current due to noise [A]; NaN if unstable."""
        return max((axis.current_noise for axis in self.axes.values()), default=math.nan)

    @property
    def position_noise(self) -> float:
        """Maximum standard deviation of a position due to noise [m]; NaN if unstable."""
        return max((axis.position_noise for axis in self.axes.values()), default=math.nan)

    @property
    def demands(self) -> Demands | None:
        """Those of the axis with the largest share of its clearance; None for an unstable loop."""
        parts = [axis.demands for axis in self.axes.values()]
        return max(parts, key=lambda one: one.displacement / one.clearance, default=None)

    @property
    def zone(self) -> str:
        """Zone A to D, or ``"unstable"``."""
        return zone_of(self.peak) if self.stable else "unstable"

    @property
    def unstable_poles(self) -> list[UnstablePole]:
        """Unstable poles, the fastest first."""
        return [] if self.stable else unstable_poles(self.loop)

    @property
    def zones(self) -> dict[str, str]:
        """Zones A to D of peak, displacement and current, or unstable: D is a saturated current."""
        # Beyond a current limit no displacement follows from a linear model.
        limits = dict(zip(self.of.axes, self.of.isolated, strict=True))
        saturated = any(
            axis.demands.current > limits[name].current_max for name, axis in self.axes.items()
        )
        zones = {"peak of |S|": self.zone}
        if self.demands is not None:
            zones["displacement"] = self.demands.zone
            zones["control current"] = "D" if saturated else "A"
        return zones

    @property
    def verdict(self) -> str:
        """The worst of the zones."""
        return max(self.zones.values())

    @property
    def cause(self) -> str:
        """Quantities that bring the verdict above the zone of the peak, such as `` by current``."""
        if self.verdict == self.zone:
            return ""
        return " by " + " and ".join(k for k, zone in self.zones.items() if zone == self.verdict)


def assessed(name: str, loop: Loop, of: LoopBuilder) -> AssessedLoop:
    """Assess a loop."""
    integral = bode_integral(loop)
    if not loop.is_stable:
        return AssessedLoop(name, loop, False, {}, (math.nan, math.nan), integral, of)
    f = grid(loop)
    f = np.unique(np.append(f, of.top))
    S, counts, p = loop.along_axes(f), f <= of.top, loop.axes
    noise = np.sqrt(np.diag(loop.noise_covariance(*of.noise())))
    currents = np.array([b.amplifier.gain for b in of.isolated]) * noise[p:]
    responses = of.harmonic_responses(loop)
    axis_demands = demands(loop, of.machine, of.point, currents, noise[:p], responses)
    axes = {}
    for k, axis in enumerate(of.axes):
        seen = S[:, k, k]
        own = margins(loop, k, f, seen)
        peak, where = own.peak, own.peak_frequency
        if where > of.top:
            peak, where = highest(partial(loop.of_axis, k), f[counts], seen[counts])
        axes[axis] = AssessedAxis(
            axis, own, peak, where, float(currents[k]), float(noise[k]), axis_demands[k]
        )
    largest = highest(loop.largest_sensitivity, f, np.linalg.norm(S, 2, axis=(1, 2)))
    return AssessedLoop(name, loop, True, axes, largest, integral, of)
