"""Plausibility of a log: an estimate or a reference as y, a rotor that lies still."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array, Bools, stretches
from ambkit.base.units import engineering
from ambkit.data.reading.channel_statistics import slow
from ambkit.data.reading.clock import instant
from ambkit.data.reading.derived_channels import OFTEN, is_formula
from ambkit.data.reading.faults import noise
from ambkit.data.reading.position_search import NO_NOISE, in_steps
from ambkit.data.signals import TRUTH

NEAR = 0.02  #: Part of a position's range within which of its ends a rotor lies on a stop.
MOVES = 20.0  #: Range of a position over its noise, from which on it moves at all.
AT_AN_END = 0.3  #: Share of the samples at an end, from which on that is reported.


@dataclass(frozen=True)
class Standstill:
    """A position that is at one end of its range for long."""

    end: float  #: That end, in the channel's unit.
    share: float  #: Share of the samples that are there.
    at_max: bool  #: Whether it is the greater end.

    def describe(self, unit: str = "") -> str:
        """Say it in a sentence's part."""
        end = "greatest" if self.at_max else "least"
        value = engineering(self.end, unit, digits=3) if unit else f"{self.end:.4g}"
        return f"at its {end} value, {value}, in {100 * self.share:.0f} % of the samples"


def standstill(values: Array) -> Standstill | None:
    """Find out whether a position (n,) lies at one of its ends for a good part of the time."""
    # values (n,)
    if values.size < 50:
        return None
    least, max_value = np.quantile(values, [0.002, 0.998])
    rough = noise(values)
    value_range = max_value - least
    if not value_range > MOVES * rough or not value_range > 0:
        return None
    near = max(NEAR * value_range, 4 * rough)
    results = [
        Standstill(float(end), float(np.mean(abs(values - end) < near)), end == max_value)
        for end in (least, max_value)
    ]
    most = max(results, key=lambda item: item.share)
    return most if most.share > AT_AN_END else None


LIES = 50  #: Samples in a row in which nothing moves, that a rotor in flight does not have.
RESTS = 6.0  #: Standard deviations of its noise within which a position rests.
MOVED = 0.25  #: Share of the range of u in which a rotor that rests does not move.
DRIVEN = 6.0  #: That range over the noise of its means, at least: a loop amplifies noise.
LEAST = 200  #: Samples from which on the noise of a position says where it is from.
SELDOM = 0.01  #: Part of the samples in which a reference of steps changes at most.
DIFFERENT = 0.95  #: Share of different values that only a computed channel has.


def suspects(
    t: Array, signals: Mapping[str, Array], units: Mapping[str, str], *, coarse: bool = False
) -> Iterator[str]:
    """Say what is suspect about the measured position, in sentences."""
    # coarse: its converter's steps are known to hide its noise, so that it stands still at times.
    # t (n,) [s]
    if "y" not in signals:
        return
    y = signals["y"]
    for name, other in signals.items():
        alike = name not in TRUTH and name != "y" and units.get(name) == units.get("y")
        if alike and not _stands_still(y) and np.allclose(y, other, 1e-9, 0, equal_nan=True):
            yield (
                f"y and {name} hold the same numbers: is y the sensor reading, or computed from it?"
            )
    if "u" in signals and _stands_still(signals["u"]) and not _stands_still(y):
        yield "u stands still throughout: is it the control signal?"
    elif "u" in signals:
        lying = [] if coarse else list(_lies(t, y, signals["u"], units.get("y", "m")))
        yield from lying or _unmoved(y, signals["u"], units.get("y", "m"))
    if not coarse:
        yield from _computed(y, signals)


def _stands_still(values: Array) -> bool:
    there = _finite(values)
    return bool(there.size > 1 and np.ptp(there) == 0)


def _lies(t: Array, y: Array, u: Array, unit: str) -> Iterator[str]:
    """Tell of a position that rests at its end while the control signal stands still."""
    there = np.isfinite(y) & np.isfinite(u)
    if np.count_nonzero(there) < LIES:
        return
    rough, seen = noise(y), y[there]
    least, max_value = float(seen.min()), float(seen.max())
    if not max_value - least > MOVES * rough:
        return
    still = np.r_[False, u[1:] == u[:-1]] & there
    for end, near in ((least, y - least), (max_value, max_value - y)):
        start, length = longest_run(still & (near < RESTS * rough))
        if length >= LIES:
            first, last = (
                instant(float(t[k]), float(t[1] - t[0])) for k in (start, start + length - 1)
            )
            yield (
                f"y rests at its end, {engineering(end, unit, digits=3)}, from {first} to {last}, "
                "and u stands still: is the rotor in contact with a stop there?"
            )


def _unmoved(y: Array, u: Array, unit: str) -> Iterator[str]:
    """Tell of a position that stays at its end while the control signal goes elsewhere."""
    there = np.isfinite(y) & np.isfinite(u)
    if np.count_nonzero(there) < LIES or (rests := standstill(y[there])) is None:
        return
    y_, u_ = slow(y[there]), slow(u[there])  # without their noise
    near = abs(y_ - rests.end) < max(NEAR * float(np.ptp(y[there])), 4 * noise(y))
    low, high = np.quantile(u[there], [0.01, 0.99])
    # In one visit: a rotor that floats there takes another current too, once a load has pushed it
    # away and its controller has brought it back.
    visits = np.split(u_, np.flatnonzero(np.diff(near)) + 1)[0 if near[0] else 1 :: 2]
    least = LIES * y_.size / y[there].size
    ways = [(float(np.ptp(np.quantile(v, [0.05, 0.95]))), v) for v in visits if v.size >= least]
    went = max((way for way, v in ways if way > DRIVEN * noise(v)), default=0.0)
    if went > MOVED * (high - low) > 0:
        yield (
            f"y is {rests.describe(unit)}, while u goes through "
            f"{100 * went / (high - low):.0f} % of its range: is the rotor in "
            "contact with a stop there? Such an interval carries no information: cut it out"
        )


def _computed(y: Array, signals: Mapping[str, Array]) -> Iterator[str]:
    """Tell of a position that no sensor measured: a reference, or what a filter made of it."""
    there = y[np.isfinite(y)]
    if there.size < LEAST or np.ptp(there) == 0:
        return
    rough, changes = noise(there), np.diff(there)
    seldom = rough == 0 and np.count_nonzero(changes) < SELDOM * changes.size
    steps = abs(changes[changes != 0])
    leaps = seldom and bool(steps.max() > 0.05 * np.ptp(there))
    leaps = leaps and np.unique(there).size < 0.01 * there.size
    if leaps or (not seldom and has_no_noise(there)):
        yield (
            "y has no noise: is it the reference or a computed signal instead of the measurement?"
        )
        return
    in_steps_too = [
        name for name, other in signals.items()
        if name in ("u", "current", "i", "iu") and _comes_in_steps(_finite(other))
    ]  # fmt: skip
    if in_steps_too and np.unique(there).size > DIFFERENT * there.size:
        yield (
            f"y never repeats a value, though {in_steps_too[0]} comes in the steps of a converter: "
            "was y filtered before logging? Its noise is then not that of the sensor; log "
            "the raw measurement"
        )


def has_no_noise(values: Array) -> bool:
    """Whether a channel (n,) is too smooth for what a sensor showed."""
    if values.size < LEAST:
        return False
    bends = float(np.quantile(abs(np.diff(values, 2)), OFTEN))
    return bends < NO_NOISE * float(values.std()) or is_formula(values)


def _comes_in_steps(values: Array) -> bool:
    """Whether a current repeats its values, apart from where it stands still as at its limit."""
    changing = values[1:][np.diff(values) != 0]
    return changing.size >= LEAST and in_steps(changing) and noise(values) > 0


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]


def longest_run(where: Bools) -> tuple[int, int]:
    """Return start and length of the longest stretch that is true (n,); length 0 without one."""
    runs = [(start, end - start) for start, end in stretches(where)]
    return max(runs, key=lambda run: run[1], default=(0, 0))
