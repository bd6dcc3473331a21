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
from ambkit.data.reading.channel_statistics import (
    COMPARED,
    LOOKED_AT,
    correlation,
    is_few,
    seen,
    slow,
)
from ambkit.data.reading.derived_channels import LEAST_SAMPLES, is_filtered
from ambkit.data.reading.faults import noise
from ambkit.data.reading.position_search import RELATED, in_steps

GOES_WITH = 0.3  #: Correlation with what it is of that a role by a single letter needs.
LEADS = 1.2  #: Ratio by which a command leads the current that follows it, in correlations.
LAGS = 6  #: Samples in which a controller passes on the noise of its position.
PASSED = 0.05  #: Part of a control's noise that is that of its position, at least.
OWN = 3.0  #: Ratio of that part to the one of another axis.
ONE_SIZE = 5.0  #: Ratio of their sizes within which two axes of an orbit are.
AT_ONCE = 0.5  #: Part of the noise passed on that a copy passes on in the same sample.
NOISY = 0.02  #: Noise of an estimate over that of its original, at least; a reference has none.
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
    for c in [c for c in places if c.why[-1] == BY_UNIT and is_few(c.values)][: len(places) - 1]:
        c.role = ""  # a reference in metres
        places.remove(c)
    for named in (c for c in results if c.role == "y" and c.estimated):
        for y in places:
            rougher = y.values.shape == named.values.shape and is_near(
                y, named, noise(named.values)
            )
            if rougher and noises[id(y)] < RAWER * noise(named.values):
                y.why.append(f"but {named.label} has more noise: which of them is the reading?")
    for c, y in permutations(places, 2):
        rough, own = noises[id(y)], noises[id(c)]
        if c.values.shape != y.values.shape or c.role != "y" or y.role != "y":
            continue
        if own < RAWER * rough and is_near(c, y, rough):
            # A second sensor has noise of its own, and all of it.
            filtered = is_filtered(interpolated(c.values)) or c.values.size < LEAST_SAMPLES
            c.estimated = filtered or answers(y, c) > PASSED
            c.why.append(
                f"lies within the noise of {y.label}, with less: "
                f"{'an estimate of it' if c.estimated else 'a second sensor?'}"
            )
        elif _is_named_rate(c, y):
            c.role, c.estimated = "v", True
            c.why.append(f"follows the rate of {y.label}")


def _is_named_rate(c: Candidate, y: Candidate) -> bool:
    """Whether a channel goes as the rate of a position, and not as the other axis of an orbit."""
    sizes = [float(seen(item.values).std()) for item in (c, y)]
    in_one_unit = 1 / ONE_SIZE < sizes[0] / max(sizes[1], 1e-300) < ONE_SIZE
    return not in_one_unit and rate_likeness(c, y) > RELATED


def is_near(c: Candidate, y: Candidate, rough: float) -> bool:
    """Whether a channel goes with a position, at its size and within its noise."""
    near = np.nanmedian(np.abs(c.values - y.values)) < 3 * rough
    return bool(near) and correlation(c.values, y.values) > RELATED


def check_names(results: Sequence[Candidate]) -> None:
    """Take their roles from velocities, references and estimates that y contradicts."""
    y = position_of(results)
    for c in results:
        if y is not None and c is not y and c.values.shape == y.values.shape:
            _check_name(c, y)


def _check_name(c: Candidate, y: Candidate) -> None:
    likeness, what = abs(correlation(slow(c.values), slow(y.values))), ""
    if c.role == "v" and abs(rate_likeness(c, y)) <= (FOLLOWS if c.weak else GOES_WITH):
        what = "the rate of"
    elif c.role == "y" and c.estimated and likeness < GOES_WITH:
        what = "an estimate of"
    elif c.role == "r" and _is_estimate(c, y):
        c.role, c.estimated = "y", True
        c.why[-1] = f"named like a reference, but lies within the noise of {y.label}"
    elif c.role == "r" and np.ptp(seen(c.values)) > 0:
        fits = _is_clean(c, y) and likeness > GOES_WITH
        carries = c.unit in ("", "V") and not is_few(c.values) and _is_control(c, y)
        what = "a reference of" if carries or (c.weak and not fits) else ""
    if what:
        c.role, c.estimated = "", False
        c.why[-1] = f"by its name perhaps, but not by its motion, {what} {y.label}"


def _is_estimate(c: Candidate, y: Candidate) -> bool:
    """Whether a channel is within the noise of a position, with some noise of its own."""
    hiss, own = noise(y.values), noise(c.values)
    return NOISY * hiss < own < hiss and not is_few(c.values) and is_near(c, y, hiss)


def _is_clean(reference: Candidate, y: Candidate) -> bool:
    """Whether a channel has too little noise for a measurement of what the position does."""
    sizes = [max(float(seen(c.values).std()), 1e-300) for c in (reference, y)]
    smooth = noise(reference.values) / sizes[0] < 0.3 * noise(y.values) / sizes[1]
    return is_few(reference.values) or smooth


def leave_other_axes(results: Sequence[Candidate]) -> None:
    """Of several controls, or currents, keep the one that goes with the noise of y, if one does."""
    y = position_of(results)
    if y is None:
        return
    for role in "ui":
        alike = [c for c in results if c.role == role and c.values.shape == y.values.shape]
        if len(alike) < 2:
            continue
        shares = [answers(y, c) for c in alike]
        own = alike[int(np.argmax(shares))]
        most, second = sorted(shares)[:-3:-1]
        if most > max(OWN * second, PASSED):
            for c in alike:
                if _goes_with(c, own):
                    continue  # its measurement, or the opposite coil
                c.role = "-"
                c.why.append(f"{own.label} goes with {y.label}: another axis?")


def answers(y: Candidate, u: Candidate, lags: int = LAGS) -> float:
    """Return how much of a channel's noise is that of y, which a controller passes on."""
    # Of second differences, in which hardly any motion is left.
    noise_of_y, rest = (np.diff(interpolated(c.values[:LOOKED_AT]), 2) for c in (y, u))
    lagged = sliding_window_view(noise_of_y, lags)
    rest = rest[lags - 1 :]
    left = rest - lagged @ np.linalg.lstsq(lagged, rest, rcond=None)[0]
    return 1 - float(left @ left) / max(float(rest @ rest), 1e-300)


def find_commands(results: Sequence[Candidate], roles: Sequence[str] = ("i",)) -> None:
    """Of two currents that go together take the one that leads for the demanded one."""
    if any(c.role == "u" and not c.estimated for c in results):
        roles = [*roles, "u"]
    currents = [
        c for c in results if c.role in roles and not c.estimated and (c.role or in_steps(c.values))
    ][:COMPARED]
    for a, b in permutations(currents, 2):
        if {a.role, b.role} == {""} or "u" in (b.role, *(roles if a.role == "i" else ())):
            continue
        alike = a.values.shape == b.values.shape
        if alike and correlation(slow(a.values), slow(b.values)) > RELATED and leads(a, b):
            b.why += [] if b.role else [f"follows {a.label}: the measured current"]
            a.why += [] if a.role == "u" else [f"leads {b.label}: the demanded current"]
            a.role, b.role = "u", "i"
            return


def leads(a: Candidate, b: Candidate) -> bool:
    """Whether a channel is the command of a current."""
    return _follows(a, b) > max(LEADS * _follows(b, a), GOES_WITH)


def _follows(a: Candidate, b: Candidate) -> float:
    """Return how much the steps of b go with those of a up to three samples before."""
    before, after = (np.diff(interpolated(c.values[:LOOKED_AT])) for c in (a, b))
    return max(correlation(before[:-lag], after[lag:]) for lag in (1, 2, 3))


def eliminate(results: Sequence[Candidate], volts: Sequence[Candidate]) -> None:
    """Find the position or the control by what is left beside the other one."""
    mover = next((c for c in results if c.role in ("u", "i") and not c.estimated), None)
    y = position_of(results)
    left = [c for c in results if not c.role and not c.estimated and not marks(c, SHORT)]
    if mover is None and (of_volts := [c for c in volts if c in left]):
        of_volts[0].role = "u"
        of_volts[0].why.append(BY_UNIT)
        return
    known, role, what = (mover, "y", "position") if y is None else (y, "u", "control signal")
    if y is not None:
        left += [c for c in results if c.role == "y" and c.weak and c is not y]  # x_drive
    left = [c for c in left if known is not None and c.values.shape == known.values.shape]
    if (y is None) == (mover is None) or known is None or not left:
        return
    pairs = [(c, known) if role == "u" else (known, c) for c in left[:COMPARED]]
    shares = [answers(position, control) for control, position in pairs]
    place = int(np.argmax(shares))
    best = left[place]
    # The opposite coil, an estimate, and the current that was measured, go with it.
    apart = [s for c, s in zip(left, shares, strict=False) if not _goes_with(c, best)]
    passes_on = max(shares) >= max(PASSED, OWN * max(apart, default=0.0))
    # Whose name says command of what; or the last that is left.
    named = best.role != "y" and (best.weak or len(left) == 1)
    if (passes_on and (named or _is_control(*pairs[place]))) or (role == "y" and len(left) == 1):
        best.role = role
        best.why.append(f"by elimination only: is it the {what}?")


def _is_control(u: Candidate, y: Candidate) -> bool:
    """Whether a channel is what a controller makes of a position: no copy, estimate, or rate."""
    # Over several samples, or more of what is fast; an error is a copy.
    share = answers(y, u)
    if share < PASSED or rate_likeness(u, y) > FOLLOWS:
        return False
    relative = [noise(c.values) / max(float(seen(slow(c.values)).std()), 1e-300) for c in (u, y)]
    amplifies = relative[0] > LEADS * relative[1]
    return amplifies or (not _goes_with(u, y) and answers(y, u, 1) < AT_ONCE * share)


def _goes_with(a: Candidate, b: Candidate) -> bool:
    return abs(correlation(slow(a.values), slow(b.values))) > RELATED


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
    if is_few(candidate.values):
        return 0.0
    step, slope = np.diff(y.values, prepend=y.values[:1]), np.gradient(slow(y.values))
    pairs = (step, candidate.values), (slope, slow(candidate.values))
    return max((correlation(*pair) for pair in pairs), key=abs)
