"""Check of the roles given by channel names against the motion.

An estimate has less noise than its original, a command leads the resulting current, and a
controller transmits the noise of its own position only.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ambkit.base.arrays import interpolated
from ambkit.data.reading.candidates import BY_UNIT, Candidate
from ambkit.data.reading.channel_statistics import COMPARED, LOOKED_AT, correlation, seen, slow
from ambkit.data.reading.faults import noise
from ambkit.data.reading.position_search import RELATED

GOES_WITH = 0.3  #: Correlation with what it is of that a role by a single letter needs.
LEADS = 1.2  #: Ratio by which a command leads the current that follows it, in correlations.
LAGS = 6  #: Samples in which a controller passes on the noise of its position.
PASSED = 0.05  #: Part of a control's noise that is that of its position, at least.
OWN = 3.0  #: Ratio of that part to the one of another axis.
RAWER = 0.8  #: Noise of an estimate over that of its original, at most.
LARGEST, SHORT = 0.6, 0.25  #: Shares of a turn that a mark takes, with a name and without one.
STEADY = 0.15  #: Change of the time of a turn from one to the next, over that time.
FOLLOWS = 0.7  #: Correlation of slow parts from which on a current follows a control signal.


def position_of(results: Sequence[Candidate]) -> Candidate | None:
    """Return the first channel that is a measured position."""
    return next((c for c in results if c.role == "y" and not c.estimated), None)


def keep_rawest(results: Sequence[Candidate]) -> None:
    """Of channels named positions that hold one motion keep the one with most noise."""
    places = [c for c in results if c.role == "y" and not c.estimated][:COMPARED]
    noises = {id(c): noise(c.values) for c in places}
    for c, y in permutations(places, 2):
        rough, own = noises[id(y)], noises[id(c)]
        if c.values.shape == y.values.shape and own < RAWER * rough and is_near(c, y, rough):
            c.estimated = True
            c.why.append(f"lies within the noise of {y.label}, with less: an estimate of it")


def is_near(c: Candidate, y: Candidate, rough: float) -> bool:
    """Whether a channel goes with a position, at its size and within its noise."""
    near = np.nanmedian(np.abs(c.values - y.values)) < 3 * rough
    return bool(near) and correlation(c.values, y.values) > RELATED


def check_letters(results: Sequence[Candidate]) -> None:
    """Take from references and velocities by a letter their roles, if y contradicts them."""
    y = position_of(results)
    if y is None:
        return
    for c in results:
        if not c.weak or c.role not in ("r", "v") or c.values.shape != y.values.shape:
            continue
        if c.role == "v":
            what, fits = "the rate of", rate_likeness(c, y) > FOLLOWS
        else:
            what, fits = "a reference of", _is_clean(c, y) and (
                np.ptp(seen(c.values)) == 0
                or abs(correlation(slow(c.values), slow(y.values))) > GOES_WITH
            )  # fmt: skip
        if not fits:
            c.role = ""
            c.why[-1] = f"by its letter perhaps, but not by its motion, {what} {y.label}"


def _is_clean(reference: Candidate, y: Candidate) -> bool:
    """Whether a channel has too little noise for a measurement of what the position does."""
    few = np.unique(seen(reference.values)).size < 0.01 * reference.values.size
    sizes = [max(float(seen(c.values).std()), 1e-300) for c in (reference, y)]
    return few or noise(reference.values) / sizes[0] < 0.3 * noise(y.values) / sizes[1]


def leave_other_axes(results: Sequence[Candidate]) -> None:
    """Of several controls, or currents, keep the one that goes with the noise of y, if one does."""
    y = position_of(results)
    if y is None:
        return
    for role in "ui":
        alike = [c for c in results if c.role == role and c.values.shape == y.values.shape]
        if len(alike) < 2:
            continue
        shares = [_answers(y, c) for c in alike]
        own = alike[int(np.argmax(shares))]
        most, second = sorted(shares)[:-3:-1]
        if most > max(OWN * second, PASSED):
            for c in alike:
                if abs(correlation(slow(c.values), slow(own.values))) > RELATED:
                    continue  # its measurement, or the opposite coil
                c.role = "-"
                c.why.append(f"{own.label} goes with {y.label}: another axis?")


def _answers(y: Candidate, u: Candidate) -> float:
    """Return how much of a channel's noise is that of y, which a controller passes on."""
    # Of second differences, in which hardly any motion is left.
    noise_of_y, rest = (np.diff(interpolated(c.values[:LOOKED_AT]), 2) for c in (y, u))
    lagged = sliding_window_view(noise_of_y, LAGS)
    rest = rest[LAGS - 1 :]
    left = rest - lagged @ np.linalg.lstsq(lagged, rest, rcond=None)[0]
    return 1 - float(left @ left) / max(float(rest @ rest), 1e-300)


def find_commands(results: Sequence[Candidate]) -> None:
    """Of two currents that go together take the one that leads for the demanded one."""
    if any(c.role == "u" and not c.estimated for c in results):
        return
    currents = [c for c in results if c.role == "i" and not c.estimated][:COMPARED]
    for a, b in permutations(currents, 2):
        alike = a.values.shape == b.values.shape
        if not alike or correlation(slow(a.values), slow(b.values)) < RELATED:
            continue
        ahead, behind = (_follows(*pair) for pair in ((a, b), (b, a)))
        if ahead > max(LEADS * behind, GOES_WITH):
            a.role = "u"
            a.why.append(f"leads {b.label}: the demanded current")
            return


def _follows(a: Candidate, b: Candidate) -> float:
    """Return how much the steps of b go with those of a up to three samples before."""
    before, after = (np.diff(interpolated(c.values[:LOOKED_AT])) for c in (a, b))
    return max(correlation(before[:-lag], after[lag:]) for lag in (1, 2, 3))


def eliminate(results: Sequence[Candidate], volts: Sequence[Candidate]) -> None:
    """Take the only channel that is left for the position or the control, beside the other one."""
    mover = next((c for c in results if c.role in ("u", "i") and not c.estimated), None)
    y = position_of(results)
    left = [c for c in results if not c.role and not c.estimated and not marks(c, SHORT)]
    for candidate in volts:
        if candidate in left and mover is None:
            candidate.role = "u"
            candidate.why.append(BY_UNIT)
            return
    if y is None and mover is not None and len(left) == 1:
        left[0].role, what = "y", "position"
    elif y is not None and mover is None:
        # Whose name says command of what, whose unit says volts; or the last that is left.
        left = [c for c in left if c.weak or c in volts or len(left) == 1]
        left = [c for c in left if c.values.shape == y.values.shape]
        shares = [_answers(y, c) for c in left]
        most, second = sorted([*shares, 0.0, 0.0])[:-3:-1]
        if most < max(PASSED, OWN * second):
            return
        left, what = [left[int(np.argmax(shares))]], "control signal"
        left[0].role = "u"
    else:
        return
    left[0].why.append(f"by elimination only: is it the {what}?")


def marks(candidate: Candidate, share: float) -> str:
    """Describe the marks of a channel with two levels, at intervals that a speed explains."""
    values = seen(candidate.values)
    low, high = np.quantile(values, [0.005, 0.995])
    above = values > (low + high) / 2
    if above.all() or not above.any():
        return ""
    lowered = bool(np.mean(above) > 0.5)  # a mark lowers it
    marked = ~above if lowered else above
    levels = np.where(above, np.median(values[above]), np.median(values[~above]))
    rises = np.flatnonzero(marked[1:] & ~marked[:-1])
    far = np.mean(abs(values - levels) > 0.2 * np.ptp(levels))
    if rises.size < 4 or far > 0.03 or np.mean(marked) > share:
        return ""
    apart = np.diff(rises)
    steady = abs(np.diff(apart)) <= np.maximum(2, STEADY * apart[1:])
    if np.median(apart) < 4 or np.mean(steady) < 0.9:
        return ""
    candidate.turned = lowered
    return f"two levels and {rises.size} marks, {np.median(apart):.4g} samples apart"


def rate_likeness(candidate: Candidate, y: Candidate) -> float:
    """Return how much a channel goes with the change of a position, by sample or slowly."""
    step, slope = np.diff(y.values, prepend=y.values[:1]), np.gradient(slow(y.values))
    pairs = (step, candidate.values), (slope, slow(candidate.values))
    return max((correlation(*pair) for pair in pairs), key=abs)
