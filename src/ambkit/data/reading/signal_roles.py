"""Role of each channel of a log: what its name and its unit say, against what it does.

First come the time, the position and its control; what moves as a levitated rotor does goes before
names (`ambkit.data.reading.rotor_roles`). Each other channel is compared with the position: it
keeps the role of its name unless it does not go as that would, and without a name it has the role
that its motion speaks for.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import permutations, takewhile

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.reading.candidates import (
    BY_UNIT,
    TEXT,
    Candidate,
    forget_unit,
    role_from_name,
)  # fmt: skip
from ambkit.data.reading.channel_statistics import COMPARED, correlation, is_few, seen, slow
from ambkit.data.reading.comparison import (
    AT_ONCE,
    FOLLOWS,
    GOES_WITH,
    PASSED,
    RAWER,
    Beside,
    answers,
    drives,
    feeds,
    goes_with,
    is_control,
    is_filter_of,
    leads,
    marks,
)
from ambkit.data.reading.position_search import RELATED, Rotor, in_steps
from ambkit.data.reading.rotor_roles import find_rotor
from ambkit.data.signals import si_unit

OWN = 3.0  #: Ratio of the noise that a control has of its own position to that of another axis.
SAME_UNIT = 1.25  #: Ratio within which the two are counted in one unit: a demanded current.
EVEN = 0.2  #: Part of the usual step by which the steps of a time without a name differ at most.
LENGTH = re.compile(r"[_ ](?:[nuµμ]m|mm|mils?)$", re.I)  #: At the end of a name.
LARGEST, SHORT = 0.6, 0.25  #: Shares of a turn that a mark takes, with a name and without one.


def find_roles(results: list[Candidate]) -> Rotor | None:
    """Give each candidate the role that its name, its unit or its motion speak for."""
    _read_names(results)
    _find_time(results)
    results.sort(key=lambda c: c.role == "y" != c.called)  # a unit says less than a name
    _sort_positions(results)
    _check_names(results)
    _leave_other_axes(results)
    moves = find_rotor(results)
    _check_names(results)
    _find_commands(results)
    _eliminate(results)
    _find_stage(results)
    _settle_references(results)
    y = position_of(results) if moves is None else results[moves.position]
    if y is not None:
        for candidate in results:
            _beside(candidate, y)
    _find_marks(results)
    for c in results:
        forget_unit(c)
    return moves


def _read_names(results: Sequence[Candidate]) -> None:
    """Take the roles that names and units say; a constant has none."""
    planes = not any(LENGTH.search(c.label) for c in results)  # else names end with units
    for c in results:
        c.values = np.where(np.isfinite(c.values), c.values, np.nan)
        role_from_name(c, planes=planes)
        if c.role == "k":
            c.why.append(marks(c, LARGEST) or "without marks of a turn")
            c.role = "k" if c.why[-1][0] == "t" else "-"
    steady = [c for c in results if np.ptp(seen(c.values)) == 0]
    moving = {"ui" if c.role in ("u", "i") else c.role for c in results if c not in steady}
    for c in steady:  # of two currents it is the bias, of two positions no sensor's
        if any(c.role in roles for roles in moving - {"r"}) or not c.role:
            c.why.append(f"is {c.values[0]:g} all the time")
            c.role = "-"


def named(results: Sequence[Candidate], roles: str) -> list[Candidate]:
    """Return the channels that have one of these roles and are no estimates."""
    return [c for c in results if c.role and c.role in roles and not c.estimated]


def position_of(results: Sequence[Candidate]) -> Candidate | None:
    """Return the first channel that is a measured position."""
    return next(iter(named(results, "y")), None)


def _sort_positions(results: Sequence[Candidate]) -> None:
    """Of channels that are named positions, find estimates and references of others."""
    for c, y in permutations(named(results, "yr")[:COMPARED], 2):
        if c.values.shape != y.values.shape or c.role != "y" or is_few(y.values):
            continue
        beside = Beside(c, y)
        if beside.is_reference and (beside.is_few or not beside.is_near):
            c.role, y.role = "r", "y"
            c.why.append(f"moves without noise: the reference of {y.label}")
        elif beside.is_few and c.why[-1] == BY_UNIT:
            c.role = ""
        elif y.role == "y" and beside.is_near and beside.noise < RAWER:
            c.estimated = is_filter_of(c, y)
            what = "an estimate of it" if c.estimated else "a second sensor"
            c.why.append(f"lies within the noise of {y.label}, with less: {what}")


def _check_names(results: Sequence[Candidate]) -> None:
    """Take their roles from velocities, references and estimates that y contradicts."""
    y = position_of(results)
    for c in results:
        if y is None or c is y or c.values.shape != y.values.shape:
            continue
        if c.role not in ("v", "r") and not (c.role == "y" and c.estimated):
            continue
        beside, what = Beside(c, y), ""
        if c.role == "v" and abs(beside.rate) <= (FOLLOWS if c.weak else GOES_WITH):
            what = "the rate of"
        elif c.role == "y" and beside.slowly < GOES_WITH:
            what = "an estimate of"
        elif c.role == "r" and beside.is_estimate:
            c.role, c.estimated = "y", True
            c.why[-1] = f"named like a reference, but lies within the noise of {y.label}"
        elif c.role == "r" and np.ptp(seen(c.values)) > 0:
            carries = c.unit in ("", "V") and not beside.is_few and is_control(c, y)
            carries |= not beside.is_few and (si_unit(y.unit or "V"), c.unit) == ("m", "V")
            what = "a reference of" if carries or (c.weak and not beside.is_reference) else ""
        if what:
            c.role, c.estimated = "", False
            c.why[-1] = f"by its name perhaps, but not by its motion, {what} {y.label}"


def _leave_other_axes(results: Sequence[Candidate]) -> None:
    """Of several controls, or currents, keep the one of the axis of y, by noise or by name."""
    y = position_of(results)
    if y is None:
        return
    axis = own_part(y, named(results, "y"))
    for role in "uir":
        alike = [c for c in named(results, role) if c.values.shape == y.values.shape]
        if len(alike) < 2:
            continue
        shares = [answers(y, c) for c in alike]
        most, second = sorted(shares)[:-3:-1]
        called = [c for c in alike if axis and axis in own_part(c, alike)]
        if most > max(OWN * second, PASSED):
            own, why = alike[int(np.argmax(shares))], "goes with"
        elif called:
            own, why = called[0], "is named like"
        else:
            continue
        for c in alike:
            # What goes with it is its measurement, or the opposite coil.
            if not (goes_with(c, own) if why == "goes with" else c in called):
                c.role = "-"
                c.why.append(f"{own.label} {why} {y.label}: another axis?")


def own_part(c: Candidate, alike: Sequence[Candidate]) -> str:
    """Return the part of a name that others of its kind do not share: ``a x`` of ``A_x_pos``."""
    names = {
        id(item): re.sub(r"[\W_]+", " ", re.sub(r"[\[(].*", "", item.label)).lower().strip()
        for item in alike
    }
    head, tail = _shared(names.values()), _shared(name[::-1] for name in names.values())
    return names[id(c)][head : len(names[id(c)]) - tail].strip()


def _shared(names: Iterable[str]) -> int:
    """Return how many letters all names have in common at their start."""
    return sum(
        1 for _ in takewhile(lambda letters: len({*letters}) == 1, zip(*names, strict=False))
    )


def _find_commands(results: Sequence[Candidate]) -> None:
    """Of two currents that go together take the one that leads for the demanded one."""
    roles = ("i", "", "u") if named(results, "u") else ("i", "")
    y = position_of(results)  # a "raw" channel may be no position
    currents = [
        c for c in results if not c.estimated and c is not y and (c.role or in_steps(c.values))
        and (c.role in roles or (c.role == "y" and c.weak))
    ][:COMPARED]  # fmt: skip
    for a, b in permutations(currents, 2):
        is_pair = b.role != "y" and {a.role, b.role} & {"i", "u"}
        if not is_pair or (b.role == "u" != a.role) or (a.role == "i" and "u" in roles):
            continue
        alike = a.values.shape == b.values.shape
        alike = alike and (b.role == "i" or a.drives or in_one_unit(a, b))  # or a force
        if alike and correlation(slow(a.values), slow(b.values)) > RELATED and leads(a, b):
            b.why += [] if b.role else [f"follows {a.label}: the measured current"]
            a.why += [] if a.role == "u" else [f"leads {b.label}: the demanded current"]
            a.role, b.role = "u", "i"
            return


def _eliminate(results: Sequence[Candidate]) -> None:
    """Find the position, or the control, that has no name: the control carries its noise."""
    mover, y = next(iter(named(results, "ui")), None), position_of(results)
    if mover is not None and y is not None:
        return
    left = [c for c in results if not c.role and not c.estimated and not marks(c, SHORT)]
    volts = [c for c in named(results, "u") if c.drives]  # or of a sensor
    of = [y] if y is not None else [*left, *volts]
    # x_drive may be called a position.
    made = [mover] if mover is not None and not mover.drives else [
        *left, *volts, *(c for c in named(results, "y") if c.weak and c is not y)
    ]  # fmt: skip
    pairs = [(a, b) for a in of[:COMPARED] for b in made[:COMPARED] if a is not b]
    pairs = [(a, b) for a, b in pairs if a.values.shape == b.values.shape]
    least = PASSED if y is not None or mover is not None else AT_ONCE
    loops = [
        (a, b) for a, b in pairs
        if answers(a, b) > least and is_control(b, a) and feeds(a, b) and not feeds(b, a)
    ]  # fmt: skip
    # Of more than two channels without a name, a velocity and a duty may go so, too.
    if not loops or (y is None and mover is None and len(of) > 2):
        return
    a, b = max(loops, key=lambda pair: answers(*pair))
    a.role, b.role = "y", "u" if b.role in ("", "y") else b.role
    if a is not y:
        a.why.append(f"{b.label} carries its noise, as a control does")
    if b is not mover:
        b.why.append(f"carries the noise of {a.label}, as a control does")
    if a is not y and b is not mover:
        a.rivals.append((b, "no name says so; the second carries the noise of the first"))


def _find_stage(results: list[Candidate]) -> None:
    """See whether a control signal drives the current that was measured, in other units."""
    i, y = (next(iter(named(results, role)), None) for role in "iy")
    for c in [c for c in named(results, "u") if c.drives and i and _is_supply(c, i, y)]:
        c.role = "-"
        c.why.append("drives no current: a supply")
    u = next(iter(named(results, "u")), None)
    # V, if it is no velocity; a duty in per cent, or volts.
    u = u or next((c for c in results if not c.role and (c.weak or c.unit in ("%", "V"))), None)
    if u is None or i is None or u.values.shape != i.values.shape:
        return
    if u.drives or u.unit == "A":
        return
    least = GOES_WITH if y is not None and answers(y, u) > PASSED else FOLLOWS
    u.drives = drives(u, i) > least and not in_one_unit(u, i)
    if u.drives:
        ratio, u.role = np.nanmean(i.slow) / np.nanmean(u.slow), "u"
        u.why.append(f"drives {i.label}, {ratio:.3g} A per unit: a duty or a voltage")


def _is_supply(c: Candidate, i: Candidate, y: Candidate | None) -> bool:
    """Whether neither a current nor the noise of a position is in the voltage of a power stage."""
    if c.values.shape != i.values.shape or (y is not None and answers(y, c) > PASSED):
        return False
    return abs(drives(c, i)) < FOLLOWS


def in_one_unit(command: Candidate, current: Candidate) -> bool:
    """Whether a current is as great as its command, by mean or by motion."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = [of(current.values) / of(command.values) for of in (np.nanmean, np.nanstd)]
    return any(1 / SAME_UNIT < ratio < SAME_UNIT for ratio in ratios)


def _settle_references(results: Sequence[Candidate]) -> None:
    """See to it that there is no reference without a position."""
    references = [] if named(results, "y") else named(results, "r")
    weak = [c for c in references if c.weak]
    for c in weak:
        c.role = "y" if c is weak[0] else ""
        c.why += ["by its name, as no other channel is a position"] if c.role else []


def _beside(c: Candidate, y: Candidate) -> None:
    """See whether a channel is a reference, an estimate of the position, or of its velocity."""
    is_position = c.role == "y" and not c.estimated
    if c is y or c.values.shape != y.values.shape or (c.role and not is_position):
        return
    beside = Beside(c, y)
    if (not is_position or c.why[-1] == BY_UNIT) and beside.is_reference:
        c.role = "r"
        c.why.append(f"follows, or leads, {y.label} without its noise")
    elif beside.is_rate and is_filter_of(c, y) and not is_position and c.unit in ("", "V"):
        c.role, c.estimated = "v", True
        c.why.append(f"follows the rate of {y.label} (correlation {beside.rate:.2f})")
    elif not is_position and beside.is_near and beside.noise * RAWER < 1:
        c.role, c.estimated = "y", True
        c.why.append(f"lies within the noise of {y.label}: an estimate or a copy of it")
        if not is_filter_of(c, y):
            c.rivals.append((y, "it may be a second sensor, as its noise is its own"))


def _find_marks(results: Sequence[Candidate]) -> None:
    """Take a channel with marks of a turn for the keyphasor of a position and its control."""
    for c in results if named(results, "y") and named(results, "ui") else ():
        if c.role in ("", "-") and (why := marks(c, SHORT)):
            c.role = "k"
            c.why.append(why)


def _find_time(results: list[Candidate]) -> None:
    """Keep as time what rises; without a name, the first that rises evenly."""
    for candidate in results:
        rising = _rises(candidate.values)
        if candidate.role == "t" and not rising:
            text = candidate.why[0] == TEXT
            candidate.role = "-" if text else ""  # no position either
            candidate.why.append(f"{'' if text else 'named like a time, but '}does not rise")
    if any(candidate.role == "t" for candidate in results):
        return
    free = [c for c in results if c.role in ("", "-") or c.weak]  # X_Value is a time
    free = [c for c in free if not c.unit]
    for counter in [c for c in free if (np.diff(c.values) == 1).all()]:
        counter.role = "-"
        counter.why.append("counts by 1: the number of a sample, or its time in which unit?")
        free.remove(counter)
    even = [c for c in free if _rises(c.values, evenly=True)]
    even = even or [c for c in free if _rises(-c.values, evenly=True)]
    for candidate in even[:1]:
        candidate.role = "t"
        rises = _rises(candidate.values)
        candidate.why.append("rises evenly" if rises else "falls evenly, as a time turned around")
        candidate.turned = not rises
    for other in even[1:]:
        other.role = "-"
        other.why.append(f"rises as evenly as {even[0].label}: which of them is the time?")


def _rises(values: Array, *, evenly: bool = False) -> bool:
    steps = np.diff(values[np.isfinite(values)])
    if steps.size == 0 or np.mean(steps > 0) < 0.9:
        return False
    usual = np.median(steps)
    return not evenly or bool(np.mean(np.abs(steps - usual) < EVEN * usual) > 0.9)
