"""Role of each channel of a log: from names and units if it has them, else from physics.

Position and current come first (`ambkit.data.reading.position_search`). A velocity is the
derivative of the position, a reference follows the position without its noise, an estimate lies
within that noise. If no channel moves as a rotor does, nothing is guessed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ambkit.base.arrays import Array, interpolated
from ambkit.data.reading.candidates import BY_UNIT, LENGTH_AT_END, TEXT, Candidate, role_from_name
from ambkit.data.reading.channel_statistics import (
    COMPARED,
    LOOKED_AT,
    correlation,
    is_few,
    seen,
    slow,
)
from ambkit.data.reading.derived_channels import same_numbers
from ambkit.data.reading.faults import noise
from ambkit.data.reading.position_search import RELATED, Rotor, in_steps, rotor
from ambkit.data.reading.roles_by_motion import (
    FOLLOWS,
    GOES_WITH,
    LARGEST,
    SHORT,
    answers,
    check_names,
    eliminate,
    find_commands,
    is_near,
    keep_rawest,
    leads,
    leave_other_axes,
    marks,
    position_of,
    rate_likeness,
)
from ambkit.data.signals import si_unit

SAME_UNIT = 1.25  #: Ratio within which the two are counted in one unit: a demanded current.
SETTLES = 2.0  #: Slope, over 1, of a position on a stepped reference.
EVEN = 0.2  #: Part of the usual step by which the steps of a time without a name differ at most.


def find_roles(results: list[Candidate]) -> Rotor | None:
    """Give each candidate the role that its name, its unit or its motion speak for."""
    in_amperes = any(LENGTH_AT_END.search(c.label) for c in results)
    numbered = len(results) > 2 and len({re.sub(r"\d+", "", c.label) for c in results}) == 1
    for candidate in results:
        candidate.values = np.where(np.isfinite(candidate.values), candidate.values, np.nan)
        if not numbered or candidate.unit:  # V1, V2, V3 are no names
            role_from_name(candidate, in_amperes)
    _find_time(results)
    keep_rawest(results)
    check_names(results)
    find_commands(results)
    leave_other_axes(results)
    letters, volts = _doubtful_roles(results)
    for candidate in results:
        if candidate.role == "k":
            candidate.why.append(marks(candidate, LARGEST) or "without marks of a turn")
            candidate.role = "k" if candidate.why[-1][0] == "t" else "-"
        if not candidate.role and np.ptp(seen(candidate.values)) == 0:
            candidate.why.append(f"is {candidate.values[0]:g} all the time")
            candidate.role = "-"
    moves = _find_rotor(results)
    check_names(results)
    find_commands(results, ("i", ""))
    eliminate(results, volts)
    _find_stage(results)
    _settle_references(results, letters)
    y = position_of(results)
    y = y if moves is None else results[moves.position]
    if y is not None:
        size = _size(y)
        for candidate in results:
            if candidate is not y and candidate.values.shape == y.values.shape:
                _beside(candidate, y, size)
    if y is not None and any(c.role in ("u", "i") and not c.estimated for c in results):
        for candidate in results:
            if candidate.role in ("", "-") and (why := marks(candidate, SHORT)):
                candidate.role = "k"
                candidate.why.append(why)
    return moves


def _doubtful_roles(results: list[Candidate]) -> tuple[list[Candidate], list[Candidate]]:
    """Take the role from references by a letter and from volts, if none is named a position."""
    if any(c.role == "y" and not c.estimated for c in results):
        return [], []
    letters = [c for c in results if c.role == "r" and c.weak]
    volts = [c for c in results if c.role == "u" and c.why[-1] == BY_UNIT]  # of a sensor, perhaps
    for candidate in [*letters, *volts]:
        candidate.role = ""
        candidate.why.pop()
    return letters, volts


def _find_stage(results: list[Candidate]) -> None:
    """See whether a control signal drives the current that was measured, in other units."""
    u, i = (next((c for c in results if c.role == role and not c.estimated), None) for role in "ui")
    # V, if it is no velocity; or a duty in per cent.
    u = u or next((c for c in results if not c.role and (c.weak or c.unit == "%")), None)
    if u is None or i is None or u.values.shape != i.values.shape:
        return
    command, current = slow(u.values), slow(i.values)
    likeness = correlation(command, current)
    y = position_of(results)
    if u.role and abs(likeness) < GOES_WITH:
        less = i if y is None or y.values.shape != i.values.shape else min(
            (i, u), key=lambda c: answers(y, c))  # fmt: skip
        less.role = "-"
        less.why.append(f"does not go with {(u if less is i else i).label}")
    if u.drives or u.unit == "A" or not likeness > GOES_WITH:
        return
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = [of(current) / of(command) for of in (np.nanmean, np.nanstd)]
    in_one_unit = any(1 / SAME_UNIT < ratio < SAME_UNIT for ratio in ratios)
    ratio, u.drives = ratios[0], likeness > FOLLOWS and not in_one_unit
    if u.drives:
        u.role = "u"
        u.why.append(f"drives {i.label}, {ratio:.3g} A per unit: a duty or a voltage")


def _settle_references(results: list[Candidate], letters: Sequence[Candidate]) -> None:
    """See to it that there is no reference without a position."""
    if any(c.role == "y" and not c.estimated for c in results):
        return
    free = [c for c in letters if not c.role]
    for candidate in free[:1]:
        candidate.role = "y"
        candidate.why.append("by its name, as no other channel is a position")
    for candidate in results:
        if candidate.role == "r" and not free:
            candidate.role = "-"
            candidate.why.append("the reference of no position that is logged")


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
    for candidate in results:
        if candidate.role in ("u", "i") and _rises(candidate.values, evenly=True):
            candidate.role = "t"
            candidate.why.append("rises evenly")
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


def _find_rotor(results: list[Candidate]) -> Rotor | None:
    """Find position and control by how they move; names, where there are any, come first."""
    named = {
        role: next((c for c in results if c.role == role and not c.estimated), None)
        for role in "yui"
    }
    y, control = named["y"], named["u"] or named["i"]
    compared = _compared(results, y, [c for c in named.values() if c is not None])
    if len(compared) < 2:
        return None
    rows = np.array([interpolated(c.values[:LOOKED_AT]) for c in compared])
    copies = same_numbers(rows)
    for k, same in copies.items():
        is_control = compared[k].role in ("u", "i") and compared[same] is y and np.ptp(rows[k])
        if not compared[k].role or is_control:  # no control is a copy of the position
            compared[k].role = "-"
            control = None if compared[k] is control else control
            compared[k].why.append(f"holds the same numbers as {compared[same].label}")
    distinct = [k for k in range(len(compared)) if k not in copies and np.ptp(rows[k]) > 0]
    channels, rows = [compared[k] for k in distinct], rows[distinct]
    places = {id(c): n for n, c in enumerate(channels)}
    moves = rotor(rows, places.get(id(y)), places.get(id(control)))
    if moves is None and (measured := places.get(id(named["i"]))) is not None:
        moves = rotor(rows, places.get(id(y)), measured)
    if moves is None and (y is not None or control is not None):
        # A "command" may be the reference's.
        roles = tuple("yuirv") if y is not None else tuple("yuirv-")
        others = (c for c in results if c.role in roles and not c.estimated)
        channels += [
            c for c in others if c.values.shape == compared[0].values.shape and id(c) not in places
        ]
        if len(channels) < 2:
            return None
        moves = rotor(np.array([interpolated(c.values[:LOOKED_AT]) for c in channels[:COMPARED]]))
        # Two bands do not outweigh a name, neither of a position nor of a current.
        named_so = y is not None or (control is not None and control.role == "i")
        if moves is None or (named_so and not moves.fit.sure):
            _say_unconfirmed(y, channels, moves)
            return None
        _rename(channels, moves, y, control)
    if moves is None or si_unit(channels[moves.position].unit or "m") not in ("m", "V", "1"):
        return None
    _name_rotor(moves, channels)
    index = {id(c): n for n, c in enumerate(results)}
    return moves.renumbered([index[id(c)] for c in channels])


def _say_unconfirmed(
    y: Candidate | None, channels: Sequence[Candidate], moves: Rotor | None
) -> None:
    """Say of a position that its motion does not confirm its name."""
    if y is None:
        return
    y.why.append("its motion neither confirms nor refutes that")
    if moves is not None and channels[moves.position] is not y:
        position, mover = channels[moves.position], channels[moves.control]
        y.why[-1] = (
            f"though {position.label} moves with {mover.label} as a levitated rotor does, in two "
            "bands of frequency only: is that the position?"
        )


def _rename(
    channels: Sequence[Candidate], moves: Rotor, y: Candidate | None, control: Candidate | None
) -> None:
    """Take the roles from channels that do not move as named: physics goes first."""
    position, mover = channels[moves.position], channels[moves.control]
    moved = f"{position.label} moves with {mover.label} as a levitated rotor does"
    for named, right, what in ((y, position, "a position"), (control, mover, "a control signal")):
        if named is not None and named is not right:
            named.role = ""
            named.why[-1] = f"named like {what}, but {moved}"
    for channel, roles in ((position, "y"), (mover, "ui")):
        if channel.role and channel.role not in roles:
            channel.why[-1] = "its name says otherwise"
            channel.role = ""


def _compared(
    results: list[Candidate], y: Candidate | None, named: Sequence[Candidate]
) -> list[Candidate]:
    """Return the channels of one length that may be position and control."""
    unnamed = [c for c in results if not c.role and not c.estimated]
    if y is not None:
        unnamed = [c for c in unnamed if c.values.shape == y.values.shape and c.clock == y.clock]
    if y is None and unnamed:
        unnamed = [c for c in unnamed if c.values.shape == unnamed[0].values.shape]
    if y is None and not unnamed:  # a name may be wrong
        unnamed = [c for c in results if c.role == "-" and np.ptp(seen(c.values)) > 0]
    compared = [*named, *unnamed]
    return [c for c in compared if c.values.shape == compared[0].values.shape][:COMPARED]


def _name_rotor(moves: Rotor, channels: Sequence[Candidate]) -> None:
    """Give the channels of a rotor their roles, and say why."""
    position, mover = channels[moves.position], channels[moves.control]
    kind, role = "current", "i"
    how = f"{100 * moves.fit.explained:.0f} % of its acceleration explained"
    how += "" if moves.fit.sure else ", in two bands of frequency only: to be verified"
    if moves.fit.voltage:
        kind, role, how = "voltage", "u", "third order, its current lags behind"
    if not position.role:
        position.role = "y"
        position.why.append(f"moves as a levitated rotor does, with {mover.label}: {how}")
    if not mover.role:
        mover.role, mover.drives = role, moves.fit.voltage
        mover.why.append(f"moves {position.label} as the {kind} of a levitated rotor does")
    for rows_of, first, role in (
        (moves.positions, position, "y"), (moves.controls, mover, mover.role),
    ):  # fmt: skip
        for estimate in [channels[k] for k in rows_of]:
            referred = role == "y" and _is_reference(estimate, first, _size(first))
            is_led = leads(first, estimate) or leads(estimate, first)
            apart = estimate.unit != first.unit or (is_led and in_steps(estimate.values))
            if estimate.role or referred or (role != "y" and apart):
                continue
            estimate.role, estimate.estimated = role, True
            rawer = "less in steps" if in_steps(first.values) else "with less noise"
            estimate.why.append(f"moves as {first.label}, {rawer}: an estimate of it")
    for a, b in moves.others:
        for k, other in ((a, b), (b, a)):
            label = channels[other].label
            channels[k].why.append(f"moves as a levitated rotor does with {label}: another axis?")


def _size(y: Candidate) -> tuple[float, float]:
    """Return how much a channel moves, and its noise."""
    there = y.values[np.isfinite(y.values)]
    return max(float(there.std()) if there.size else 0.0, 1e-300), noise(y.values)


def _is_reference(candidate: Candidate, y: Candidate, size: tuple[float, float]) -> bool:
    """Whether a channel goes with the position, at its size (`_size`), without its noise."""
    scale = float(np.nanstd(candidate.values)) / size[0]
    likeness = correlation(candidate.values, y.values)
    if not scale > 0 or abs(likeness) < GOES_WITH:
        return False
    # The position settles on each level of a stepped reference.
    few = is_few(candidate.values)
    if abs(likeness) < RELATED:
        return few and 1 / SETTLES < likeness / scale < SETTLES
    return few or noise(candidate.values) < min(0.1 * size[1], 1e-4 * size[0]) * scale


def _beside(candidate: Candidate, y: Candidate, size: tuple[float, float]) -> None:
    """See whether a channel is a reference, an estimate of the position, or of its velocity."""
    named = candidate.role == "y" and not candidate.estimated
    if candidate.role and not named:
        return
    if (not named or candidate.why[-1] == BY_UNIT) and _is_reference(candidate, y, size):
        candidate.role = "r"
        candidate.why.append(f"follows, or leads, {y.label} without its noise")
        return
    likeness = correlation(candidate.values, y.values)
    if abs(likeness) < RELATED:
        # A current damps the motion: it goes against the rate.
        if (likeness := rate_likeness(candidate, y)) > (RELATED if named else FOLLOWS):
            candidate.role, candidate.estimated = "v", True
            candidate.why.append(f"follows the rate of {y.label} (correlation {likeness:.2f})")
    elif not named and is_near(candidate, y, size[1]):
        candidate.role, candidate.estimated = "y", True
        candidate.why.append(f"lies within the noise of {y.label}: an estimate or a copy of it")
