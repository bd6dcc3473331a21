"""One loop: margins, noise, load capacity and the demands on the machine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from ambkit.control.linear.closed_loop import Loop
from ambkit.judge.loop.capacity import Demands, demands
from ambkit.judge.loop.loop_of import LoopOf, zone_of
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
    """One axis of a stable loop, all other loops closed."""

    name: str  #: Of the axis.
    margins: Margins  #: Of its loop.
    peak: float  #: Greatest of abs(S) within the standard's range [1], and where [Hz].
    peak_frequency: float
    #: Standard deviations of the demanded current [A] and of the position [m] by the sensors' white
    #: noise and the amplifiers' noise.
    current_noise: float
    position_noise: float
    demands: Demands  #: What it asks of the machine, and what load it bears.

    @property
    def zone(self) -> str:
        """Zone A to D."""
        return zone_of(self.peak)


@dataclass(frozen=True, eq=False)
class AssessedLoop:
    """One loop, of one axis or of several, and what is said of it."""

    name: str  #: By what its controllers are fed.
    loop: Loop  #: The linear loop, to be asked for any response.
    stable: bool  #: Whether it is; nothing below means anything else.
    axes: dict[str, AssessedAxis]  #: By their names; empty of an unstable loop.
    #: Greatest singular value of S up to half the sampling rate [1], and where [Hz]; NaN of an
    #: unstable loop.
    largest: tuple[float, float]
    integral: BodeIntegral  #: The check of all of it.
    of: LoopOf  #: Plant and operating point.

    @property
    def worst(self) -> AssessedAxis | None:
        """The axis that decides the zone: that of the greatest peak; None of an unstable loop."""
        # Of axes that are alike, the first: rounding does not choose.
        return max(self.axes.values(), key=lambda item: float(f"{item.peak:.9g}"), default=None)

    @property
    def margins(self) -> Margins | None:
        """Those of the worst axis; None of an unstable loop."""
        return None if self.worst is None else self.worst.margins

    @property
    def peak(self) -> float:
        """Greatest of abs(S) of any axis within the standard's range [1]; NaN if unstable."""
        return math.nan if self.worst is None else self.worst.peak

    @property
    def peak_frequency(self) -> float:
        """Where that is [Hz]."""
        return math.nan if self.worst is None else self.worst.peak_frequency

    @property
    def current_noise(self) -> float:
        """Greatest standard deviation of a demanded current by noise [A]; NaN if unstable."""
        return max((axis.current_noise for axis in self.axes.values()), default=math.nan)

    @property
    def position_noise(self) -> float:
        """Greatest standard deviation of a position by noise [m]; NaN if unstable."""
        return max((axis.position_noise for axis in self.axes.values()), default=math.nan)

    @property
    def demands(self) -> Demands | None:
        """Those of the axis that goes farthest in its clearance; None of an unstable loop."""
        parts = [axis.demands for axis in self.axes.values()]
        return max(parts, key=lambda one: one.displacement / one.clearance, default=None)

    @property
    def zone(self) -> str:
        """Zone A to D; ``"unstable"`` of a loop that is."""
        return zone_of(self.peak) if self.stable else "unstable"

    @property
    def unstable_poles(self) -> list[UnstablePole]:
        """What grows, the fastest first; empty of a stable loop."""
        return [] if self.stable else unstable_poles(self.loop)

    @property
    def verdict(self) -> str:
        """The worst of the zones of peak and displacement, A to D, or unstable; D if saturated."""
        # Beyond the limit of a current no displacement follows from a linear model.
        limits = dict(zip(self.of.axes, self.of.isolated, strict=True))
        saturated = any(
            axis.demands.current > limits[name].current_max for name, axis in self.axes.items()
        )
        d = self.demands
        return self.zone if d is None else max(self.zone, "D" if saturated else d.zone)


def assessed(name: str, loop: Loop, of: LoopOf) -> AssessedLoop:
    """Return a loop with all that is said of it."""
    integral = bode_integral(loop)
    if not loop.is_stable:
        return AssessedLoop(name, loop, False, {}, (math.nan, math.nan), integral, of)
    f = grid(loop)
    f = np.unique(np.append(f, of.top))
    S, counts, p = loop.along_axes(f), f <= of.top, loop.axes
    noise = np.sqrt(np.diag(loop.noise_covariance(*of.noise())))
    currents = np.array([b.amplifier.gain for b in of.isolated]) * noise[p:]
    responses = of.turned(loop)
    axis_demands = demands(loop, of.machine, of.point, currents, noise[:p], responses)
    axes = {}
    for k, axis in enumerate(of.axes):
        seen = S[:, k, k]
        peak, where = highest(partial(loop.of_axis, k), f[counts], seen[counts])
        axes[axis] = AssessedAxis(
            axis,
            margins(loop, k, f, seen),
            peak,
            where,
            float(currents[k]),
            float(noise[k]),
            axis_demands[k],
        )
    largest = highest(loop.largest_sensitivity, f, np.linalg.norm(S, 2, axis=(1, 2)))
    return AssessedLoop(name, loop, True, axes, largest, integral, of)
