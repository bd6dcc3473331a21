"""Where names and motion do not both speak for a role, with what else the channel may be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ambkit.data.reading.candidates import Candidate
from ambkit.data.reading.channel_statistics import COMPARED
from ambkit.data.reading.comparison import (
    PASSED,
    RAWER,
    Beside,
    answers,
    feeds,
    goes_with,
    is_control,
    leads,
)
from ambkit.data.reading.position_search import Rotor, in_steps

SWAPPED = 3.0  #: Ratio by which what is named a control has more of what is slow.
BARELY = 2.0  #: Ratio by which the control of another axis has less of the position's noise.

Ambiguity = tuple[str, tuple[Candidate, ...], str]  #: Role, channels that may have it, and why.


def ambiguities(
    chosen: Mapping[str, Candidate], channels: Sequence[Candidate], moves: Rotor | None
) -> Iterator[Ambiguity]:
    """Yield the roles that names and motion give to several channels, or one of both to none."""
    for role, c in chosen.items():
        yield from ((role, (c, other), why) for other, why in c.rivals)
    y, u, current = chosen["y"], chosen.get("u"), chosen.get("current")
    if y.estimated:
        yield "y", (y,), "an estimate, but no channel is its reading"
    alike = [c for c in channels if c.values.shape == y.values.shape and c is not y]
    controls = [c for c in alike if (c.called in ("u", "i") or c.unit == "A") and c is not u]
    for c, why in _readings(y, alike):
        others = () if u is None or answers(c, u) > PASSED else controls[:COMPARED]
        if not any(answers(c, other) > PASSED for other in others):  # of another axis
            yield "y and x_logged" if c is chosen.get("x_logged") else "y", (y, c), why
    if u is None and moves is None:
        sources = [c for c in alike[:COMPARED] if is_control(y, c)]
        yield "y", (y, *sources), "named so, but no motion confirms it"
    if u is None or u.values.shape != y.values.shape:
        return
    rest = [c for c in alike if c not in chosen.values()]
    yield from (("u", (u, c), why) for c, why in _controls(u, y, rest))
    is_driven = "control" in chosen and leads(chosen["control"], u)  # no position is
    is_sure = moves is not None and moves.fit.sure
    if not is_sure and not is_driven and not feeds(y, u):
        swapped = "by its noise the second is the position, the first its control"
        is_swapped = feeds(u, y, SWAPPED)
        if is_swapped or answers(y, u) < PASSED:
            why = swapped if is_swapped else "the motion confirms neither"
            yield "y and u", (y, u), f"named so, but {why}"
    if current is not None and (leads(current, u) or not goes_with(current, u)):
        what = "leads" if leads(current, u) else "goes its own way"
        yield "u and current", (u, current), f"{current.label} {what}"


def _readings(y: Candidate, alike: Sequence[Candidate]) -> Iterator[tuple[Candidate, str]]:
    """Yield what else may be the reading of the position."""
    for c in alike:
        beside, is_copy = Beside(c, y), np.array_equal(c.values, y.values, equal_nan=True)
        if is_copy or not beside.is_near or beside.is_few or c.role not in ("", "y", "r"):
            continue
        if beside.noise > RAWER:
            yield c, "it has the same motion, with as much noise"
        elif c.role == "y" and not c.estimated:
            yield c, "it has the same motion, and less noise, of its own: a second sensor"


def _controls(
    u: Candidate, y: Candidate, alike: Sequence[Candidate]
) -> Iterator[tuple[Candidate, str]]:
    """Yield what else may be the control of the position."""
    own, is_read = answers(y, u), in_steps(u.values)  # by a converter: no estimate
    for c in alike:
        is_like = (c.estimated and c.role in ("u", "i") and not is_read) or (
            not c.unit and leads(u, c)
        )
        if is_like and not c.called and goes_with(c, u):
            yield c, "it goes with it: a command, a measured current or an estimate"
    rivals = [c for c in alike if c.called in ("u", "i") and c.unit == u.unit]
    rivals = [c for c in rivals if not c.estimated and not goes_with(c, u)]
    for c in rivals:
        if answers(y, c) > max(PASSED, own / BARELY):
            yield c, f"it has as much of the noise of {y.label}"
