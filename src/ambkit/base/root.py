"""A root between two numbers, without SciPy: its `optimize` loads longer than most runs take."""

import math
from collections.abc import Callable
from contextlib import suppress

RELATIVE = 4 * 2.0**-52  #: Tolerance relative to the root, in addition to the absolute one.
MOST = 200  #: Maximum number of steps; ten are typical.

Point = tuple[float, float]


def root(f: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Return the root of f between numbers with opposite signs."""
    # Brent, Algorithms for Minimization without Derivatives, 1973, ch. 4, step by step as SciPy's
    # `brentq` has it: the same bits. `far` is the other side of the root, `last` the point before.
    last, at, f_last, f_at = low, high, f(low), f(high)
    far, f_far, before, step = low, f_last, 0.0, 0.0
    if f_last == 0:
        return low
    for _ in range(MOST):
        if f_last != 0 and f_at != 0 and math.copysign(1, f_last) != math.copysign(1, f_at):
            far, f_far = last, f_last
            before = step = at - last
        if abs(f_far) < abs(f_at):
            last, at, far = at, far, at
            f_last, f_at, f_far = f_at, f_far, f_at
        least, half = (tolerance + RELATIVE * abs(at)) / 2, (far - at) / 2
        if f_at == 0 or abs(half) < least:
            return at
        trial = math.inf
        with suppress(ZeroDivisionError):  # of tiny numbers: no secant
            if abs(before) > least and abs(f_at) < abs(f_last):
                trial = _secant((last, f_last), (at, f_at), (far, f_far))
        good = 2 * abs(trial) < min(abs(before), 3 * abs(half) - least)
        before, step = (step, trial) if good else (half, half)
        last, f_last = at, f_at
        at += step if abs(step) > least else math.copysign(least, half)
        f_at = f(at)
    return at


def _secant(last: Point, at: Point, far: Point) -> float:
    """Return the step from a point to the root of the line, or the hyperbola, through others."""
    (x_last, f_last), (x, f), (x_far, f_far) = last, at, far
    if x_last == x_far:
        return -f * (x - x_last) / (f - f_last)
    of_last, of_far = (f_last - f) / (x_last - x), (f_far - f) / (x_far - x)
    return -f * (f_far * of_far - f_last * of_last) / (of_far * of_last * (f_far - f_last))
