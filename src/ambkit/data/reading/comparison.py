"""What the motion says of one channel of a log beside another.

An estimate has less noise than its original, a reference has none of it, a command leads the
current that follows, and a controller passes on the noise of its own position only.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ambkit.base.arrays import interpolated
from ambkit.data.reading.candidates import Candidate
from ambkit.data.reading.channel_statistics import LOOKED_AT, correlation, is_few, seen
from ambkit.data.reading.derived_channels import LEAST_SAMPLES, WHITE, colour, is_filtered
from ambkit.data.reading.position_search import RELATED

GOES_WITH = 0.3  #: Correlation that a name needs.
FOLLOWS = 0.7  #: Correlation that speaks without a name.
SETTLES = 2.0  #: Slope, over 1, of a position on a stepped reference.
RAWER = 0.8  #: Noise of an estimate over that of its original, at most.
CLEAN = 0.1  #: The same of a reference, at their sizes.
SMOOTH = 1e-4  #: Noise of a reference over its size, at most.
NOISY = 0.02  #: Noise of an estimate over that of its original, at least.
LEADS = 1.2  #: Ratio by which a command leads the current that follows it, in correlations.
LAGS = 6  #: Samples in which a controller passes on the noise of its position.
PASSED = 0.05  #: Part of a control's noise that is that of its position, at least.
USUAL = 0.99  #: Part of the changes of a channel that are its noise, at least.
AT_ONCE = 0.5  #: Part of the noise passed on that a copy passes on in the same sample.
CHANCE = 4.4  #: Colour that 1 % of white noises exceed, times the root of their samples.
STEADY = 0.15  #: Change of the time of a turn from one to the next, over that time.


class Beside:
    """How a channel goes with a position of the same length; slow parts only where they matter."""

    def __init__(self, c: Candidate, y: Candidate) -> None:
        self.c, self.y = c, y
        self.likeness = correlation(c.values, y.values)  #: Correlation.
        self.scale = c.size / y.size  #: Size, over that of the position.
        self.noise = c.noise / max(y.noise, 1e-300)  #: Noise, over that of the position.
        self.rough = c.noise / c.size  #: Noise, over its own size.

    @property
    def is_near(self) -> bool:
        """Whether it is the same motion within the noise."""
        c, y = self.c, self.y
        most = 3 * max(y.noise, c.noise)
        return bool(self.likeness > RELATED and np.nanmedian(abs(c.values - y.values)) < most)

    @property
    def is_few(self) -> bool:
        """Whether it takes few values."""
        return is_few(self.c.values)

    @property
    def slowly(self) -> float:
        """Correlation of the slow parts, without its sign."""
        return abs(correlation(self.c.slow, self.y.slow))

    @property
    def rate(self) -> float:
        """Correlation with the rate of the position."""
        return rate_likeness(self.c, self.y)

    @property
    def is_reference(self) -> bool:
        """Whether it goes with the position, at its size, without its noise."""
        if abs(self.likeness) < RELATED:  # the position settles on each level of a stepped one
            settles = 1 / SETTLES < self.likeness / self.scale < SETTLES
            return self.is_few and abs(self.likeness) > GOES_WITH and settles
        # An estimate lies within the noise.
        smooth = self.rough < SMOOTH or (1 / SETTLES < self.scale < SETTLES and not self.is_near)
        return self.is_few or (self.noise < CLEAN * self.scale and smooth)

    @property
    def is_estimate(self) -> bool:
        """Whether it is within the noise of the position, with less noise, but some."""
        return self.is_near and NOISY < self.noise < 1 and not self.is_few

    @property
    def is_rate(self) -> bool:
        """Whether it goes as the rate; a current damps the motion and goes against it."""
        return abs(self.likeness) < RELATED and self.rate > FOLLOWS


def rate_likeness(c: Candidate, y: Candidate) -> float:
    """Return how much a channel goes with the change of a position, by sample or slowly."""
    if is_few(c.values):
        return 0.0
    step, slope = np.diff(y.values, prepend=y.values[:1]), np.gradient(y.slow)
    pairs = (step, c.values), (slope, c.slow)
    return max((correlation(*pair) for pair in pairs), key=abs)


def goes_with(a: Candidate, b: Candidate) -> bool:
    """Whether the slow parts of two channels are one, with either sign."""
    return abs(correlation(a.slow, b.slow)) > RELATED


def is_filter_of(c: Candidate, y: Candidate) -> bool:
    """Whether the noise of a channel is made of that of a position; a sensor has its own."""
    filtered = is_filtered(interpolated(c.values)) or c.values.size < LEAST_SAMPLES
    return filtered or answers(y, c) > PASSED


def answers(y: Candidate, u: Candidate, lags: int = LAGS) -> float:
    """Return how much of a channel's noise is that of y, which a controller passes on."""
    # Of second differences, in which hardly any motion is left.
    if y.values.size < 4 * LAGS:
        return 0.0
    changes = [np.diff(interpolated(c.values[:LOOKED_AT]), 2) for c in (y, u)]
    # A jump of a set point is in many channels, and no noise.
    usual = [float(np.quantile(abs(c), USUAL)) or float(abs(c).max()) for c in changes]
    if not all(0 < size < np.inf for size in usual):  # a counter, or no number that is usable
        return 0.0
    noise_of_y, rest = (np.clip(c / size, -1, 1) for c, size in zip(changes, usual, strict=True))
    lagged = sliding_window_view(noise_of_y, lags)
    rest = rest[lags - 1 :]
    if not rest.any():
        return 0.0
    left = rest - lagged @ np.linalg.lstsq(lagged, rest, rcond=None)[0]
    return 1 - float(left @ left) / float(rest @ rest)


def is_control(u: Candidate, y: Candidate) -> bool:
    """Whether a channel is what a controller makes of a position: no copy, estimate, or rate."""
    # Over several samples, or more of what is fast; an error is a copy.
    share = answers(y, u)
    if share < PASSED or (rate_likeness(u, y) > FOLLOWS and not goes_with(u, y)):
        return False
    return amplifies(u, y) or (not goes_with(u, y) and answers(y, u, 1) < AT_ONCE * share)


def feeds(y: Candidate, u: Candidate, ratio: float = LEADS) -> bool:
    """Whether a control is made of a position: by what is fast, or the sensor's white noise."""
    if answers(y, u) < PASSED:
        return False
    pair = [abs(colour(interpolated(c.values))) for c in (y, u)]
    if max(pair) < max(WHITE, CHANCE / y.values.size**0.5):  # what differs is chance
        return amplifies(u, y, ratio)
    whiter = [own < min(WHITE, other / 2) for own, other in (pair, pair[::-1])]
    return whiter[0] or (amplifies(u, y, ratio) and not whiter[1])


def amplifies(u: Candidate, y: Candidate, ratio: float = LEADS) -> bool:
    """Whether a channel has more of what is fast than a position, as a controller's output has."""
    relative = [c.noise / max(float(seen(c.slow).std()), 1e-300) for c in (u, y)]
    return relative[0] > ratio * relative[1]


def drives(u: Candidate, i: Candidate) -> float:
    """Return how much of a voltage is that of the coil of a current, R i + L i'; < 0: opposite."""
    rows = np.array([u.slow, i.slow, np.gradient(i.slow)])
    rows = rows[:, np.isfinite(rows).all(axis=0)]
    rows -= rows.mean(axis=1, keepdims=True)
    size = rows.std(axis=1)
    if not size[:2].all():
        return 0.0
    parts = np.linalg.lstsq(rows[1:].T, rows[0], rcond=None)[0][:, None] * rows[1:]
    more = int(parts[1].std() > parts[0].std())
    return float(np.sign(parts[more] @ rows[1 + more]) * parts.sum(0).std() / size[0])


def leads(a: Candidate, b: Candidate) -> bool:
    """Whether a channel is the command of a current."""
    return _follows(a, b) > max(LEADS * _follows(b, a), GOES_WITH)


def _follows(a: Candidate, b: Candidate) -> float:
    """Return how much the steps of b go with those of a up to three samples before."""
    before, after = (np.diff(interpolated(c.values[:LOOKED_AT])) for c in (a, b))
    return max(correlation(before[:-lag], after[lag:]) for lag in (1, 2, 3))


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
