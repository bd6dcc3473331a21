"""Error of the modal truncation over the speed, against the full matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering, percent, rpm
from ambkit.control.stabilising_controller import holding
from ambkit.estimate.kalman import KalmanFilter
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.judge.loop.margins import axis_peaks
from ambkit.judge.whirl_modes import whirl_modes
from ambkit.machine.machine import Machine
from ambkit.machine.rotors import modes
from ambkit.machine.rotors.descriptions import OfMatrices

MORE, LEAST = 4, 10
"""Number of modes, over those kept, that represents all in the loop, and its minimum."""

BESIDE = 1.05  #: Frequency margin above an unstable mode that must be kept.
SPEEDS = 61  #: Speeds on which critical speeds are searched.


class Peak(NamedTuple):
    """Sensitivity peak of an axis, with the truncated and the full model."""

    axis: str
    speed: float  #: Speed of rotation [rad/s].
    kept: float  #: Truncated [1].
    full: float  #: Full [1]; infinite if the loop is unstable.

    @property
    def share(self) -> float:
        """Relative error [1]."""
        return math.inf if math.isinf(self.full) else abs(self.kept / self.full - 1)


@dataclass(frozen=True, eq=False)
class Reduction:
    """Truncated against full modal model."""

    kept: int  #: Number of modes kept, and of all.
    every: int
    tolerance: float  #: Tolerance of the relative errors [1].
    fastest: float  #: Maximum speed of the comparison [rad/s].
    highest: float  #: Maximum whirl frequency of the comparison [Hz].
    whirl: modes.WhirlError  #: Whirl frequencies of the free rotor, against the full matrices.
    #: (float, float) Critical speeds up to `fastest`, except critically damped ones, truncated and
    #: full [rad/s]; NaN if missing.
    critical: tuple[tuple[float, float], ...]
    #: Of the default loop, where the difference is largest; None if the truncated loop is unstable.
    peak: Peak | None
    #: Pole of the default loop that is unstable in the full model [1/s], but not in the truncated
    #: one.
    grows: complex | None
    #: Minimum of `modes_up_to` for the whirls and unstable modes, or one mode more if the
    #: sensitivity is off [Hz].
    needed: float

    @property
    def critical_error(self) -> float:
        """Largest error of a critical speed [1]; infinite if one is missing."""
        parts = [abs(kept / full - 1) for kept, full in self.critical]
        return max((math.inf if math.isnan(one) else one for one in parts), default=0.0)

    @property
    def error(self) -> float:
        """Largest error of a whirl, a critical speed or a peak [1]; infinite if one is missing."""
        share = 0.0 if self.peak is None else self.peak.share
        return max(self.whirl.error, self.critical_error, share)

    @property
    def good(self) -> bool:
        """Whether all errors are within the tolerance."""
        return self.error <= self.tolerance

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as data, in SI; infinite or NaN without a value."""
        w, p = self.whirl, self.peak
        return {
            "modes_kept": self.kept,
            "modes": self.every,
            "tolerance": self.tolerance,
            "within": self.good,
            "up_to_speed": self.fastest,
            "up_to_frequency": self.highest,
            "whirl": {
                "error": w.share, "kept": w.kept, "full": w.full, "speed": w.speed,
                "left_out": w.left_out,
            },
            "critical_speeds": [{"kept": kept, "full": full} for kept, full in self.critical],
            "sensitivity_peak": p and {
                "axis": p.axis, "speed": p.speed, "kept": p.kept, "full": p.full, "error": p.share,
            },
            "grows": self.grows and [self.grows.real, self.grows.imag],
            "modes_up_to_needed": self.needed,
        }  # fmt: skip

    def _of_whirls(self) -> str:
        w, to = self.whirl, f"up to {rpm(self.fastest)} and {engineering(self.highest, 'Hz', 4)}"
        if not self.fastest:
            return "free whirl frequencies: the rotor stands still, and the modes kept are exact"
        deviation = "as with the full matrices"
        if w.share:
            deviation = (
                f"off by {percent(w.share)} at most, {engineering(w.kept / 2 / math.pi, 'Hz', 4)} "
                f"where the full matrices have {_whirl_text(w.full)} at {rpm(w.speed)}"
            )
        if not math.isnan(w.left_out):
            deviation += f", and {_whirl_text(w.left_out)} at {rpm(w.left_out_at)} is left out"
        return f"free whirl frequencies {to}: {deviation}"

    def _of_critical(self) -> list[str]:
        if not self.critical:
            return []
        parts = ", ".join(
            f"{rpm(kept)} (full: {rpm(full)})" if abs(kept / full - 1) > 1e-4 else rpm(kept)
            if kept == kept and full == full
            else f"{'none' if math.isnan(kept) else rpm(kept)} "
                 f"(full: {'none' if math.isnan(full) else rpm(full)})"
            for kept, full in self.critical
        )  # fmt: skip
        share = self.critical_error
        off = "one is missing" if math.isinf(share) else f"off by {percent(share)} at most"
        return [f"critical speeds: {parts}; {off}"]

    def _of_peak(self) -> str:
        p = self.peak
        if p is None:
            return "sensitivity: the default loop is unstable with the modes kept as well"
        if self.grows is not None:
            f = engineering(abs(self.grows.imag) / 2 / math.pi, "Hz", 4)
            return (
                f"sensitivity: the default loop, stable with the modes kept, is unstable with all: "
                f"at {rpm(p.speed)} a mode at {f} grows by {self.grows.real:.3g}/s"
            )
        return (
            f"sensitivity of the default loop: peak off by {percent(p.share)} at most, "
            f"{p.kept:.4g} where all modes give {p.full:.4g}, axis {p.axis} at {rpm(p.speed)}"
        )

    def text(self) -> str:
        """Return it as one sentence, with advice."""
        what = f"{self.kept} of {self.every} bending modes kept, against all: "
        lead = what + "; ".join([self._of_whirls(), *self._of_critical(), self._of_peak()])
        if self.good:
            return f"{lead}; {'' if self.peak is None else 'all '}within {percent(self.tolerance)}"
        help = "leave out rotor.modes_up_to, so that enough modes are kept"
        if max(self.whirl.error, self.critical_error) <= self.tolerance:  # the loop is the cause
            help = f"give rotor.modes_up_to = {engineering(self.needed, 'Hz', 4)}, so that the "
            help += "default controllers are chosen with more modes"
        elif self.needed:
            help += f", or raise it to {engineering(self.needed, 'Hz', 4)}"
        return f"{lead}; not within {percent(self.tolerance)} (rotor.modes_within): {help}"


@lru_cache(maxsize=32)
def reduction(machine: Machine) -> Reduction | None:
    """Return the error of a machine's modal truncation."""
    # Free whirl frequencies with the full finite-element matrices; critical speeds and the
    # sensitivity of the default loop with so many modes that further ones change nothing that is
    # told. The controllers are those tuned with the modes kept, in both.
    rotor, bending = machine.rotor, machine.bending
    if not isinstance(rotor, OfMatrices) or bending is None:
        return None
    T, speed, every = machine.sampling_time, machine.speed, rotor.every_mode
    f = every.frequency / (2 * math.pi)
    mode_count = len(bending.frequency) - bending.attached
    top = modes.max_frequency(T, speed)
    frequency_limit = rotor.modes_up_to or top
    count = min(len(f), max(mode_count + MORE, LEAST))
    many = machine.model_copy(
        update={"rotor": rotor.model_copy(
            update={"modes_up_to": modes.above(f, count), "residual": False}
        )}
    )  # fmt: skip
    max_speed = modes.BEYOND * abs(speed)
    peak, grows = _peaks(machine, many)
    needed = modes.enough(rotor, T, speed, rotor.modes_within)
    if grows is not None:
        needed = max(needed, BESIDE * abs(grows.imag) / 2 / math.pi)
    elif peak is not None and peak.share > rotor.modes_within and mode_count < len(f):
        needed = max(needed, modes.above(f, mode_count + 1))
    return Reduction(
        mode_count, len(f), rotor.modes_within, max_speed, min(frequency_limit, top),
        modes.whirl_error(rotor, bending, min(frequency_limit, top), modes.speeds_of(speed)),
        _critical(machine, many, max_speed), peak, grows, needed,
    )  # fmt: skip


def _critical(machine: Machine, many: Machine, max_speed: float) -> tuple[tuple[float, float], ...]:
    """Return the critical speeds of both models that are not critically damped [rad/s]."""
    if not max_speed:
        return ()
    pids = holding(machine).pids
    some, all_of = (
        [
            one.speed for one in whirl_modes(item, max_speed, count=SPEEDS, pids=pids).criticals
            if not one.damped
        ]
        for item in (machine, many)
    )  # fmt: skip
    n = max(len(some), len(all_of))
    padded = [[*item, *([math.nan] * (n - len(item)))] for item in (some, all_of)]
    return tuple(zip(*padded, strict=True))


def _peaks(machine: Machine, many: Machine) -> tuple[Peak | None, complex | None]:
    """Return the largest difference of the peaks, and the full model's unstable pole."""
    try:
        of = LoopBuilder(machine)
        estimator = KalmanFilter(machine)
        control_law = of.controllers_with(estimator)
    except (AmbkitError, ValueError):  # no stabilising controller, or no filter for the machine
        return None, None
    worst: Peak | None = None
    for speed in dict.fromkeys((0.0, machine.speed / 2, machine.speed)):
        estimator = KalmanFilter(machine.model_copy(update={"speed": speed}))
        loops = [
            LoopBuilder(
                item.model_copy(update={"speed": speed}),
                of.control,
                point=of.point,
                law=control_law,
            ).loop(estimator)
            for item in (machine, many)
        ]
        if not loops[0].is_stable:
            return None, None
        if not loops[1].is_stable:
            with np.errstate(divide="ignore"):
                rates = np.log(loops[1].closed.poles().astype(complex)) / machine.sampling_time
            return (
                Peak(of.axes[0], speed, math.nan, math.inf),
                complex(rates[np.argmax(rates.real)]),
            )
        tops = (axis_peaks(loop, of.top).tolist() for loop in loops)
        for axis, reduced_peak, full in zip(of.axes, *tops, strict=True):
            result = Peak(axis, speed, reduced_peak, full)
            worst = result if worst is None or result.share > worst.share else worst
    return worst, None


def _whirl_text(whirl: float) -> str:
    way = "forward" if whirl > 0 else "backward"
    return f"{engineering(abs(whirl) / 2 / math.pi, 'Hz', 4)} {way}"
