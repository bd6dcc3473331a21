"""Position and control of a log by the motion of a levitated rotor, which goes before names.

Channels that are named so are held; where they do not move as a rotor does, all are searched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ambkit.base.arrays import interpolated
from ambkit.data.reading.candidates import Candidate
from ambkit.data.reading.channel_statistics import COMPARED, LOOKED_AT, correlation, seen
from ambkit.data.reading.comparison import Beside, feeds, goes_with, is_filter_of, leads
from ambkit.data.reading.derived_channels import same_numbers
from ambkit.data.reading.position_search import Rotor, in_steps, rotor
from ambkit.data.signals import si_unit


def find_rotor(results: list[Candidate]) -> Rotor | None:
    """Find position and control by how they move; names, where there are any, come first."""
    named = {
        role: min(
            (c for c in results if c.role == role and not c.estimated),
            key=lambda c: c.weak,
            default=None,
        )
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
    places: dict[Candidate | None, int] = {c: n for n, c in enumerate(channels)}
    moves = rotor(rows, places.get(y), places.get(control))
    if moves is None and (measured := places.get(named["i"])) is not None:
        moves = rotor(rows, places.get(y), measured)
    if moves is None and (y is not None or control is not None):
        # A "command" may be the reference's.
        roles = tuple("yuirv") if y is not None else tuple("yuirv-")
        others = (c for c in results if c.role in roles and not c.estimated)
        channels += [
            c for c in others if c.values.shape == compared[0].values.shape and c not in places
        ]
        if len(channels) < 2:
            return None
        moves = rotor(np.array([interpolated(c.values[:LOOKED_AT]) for c in channels[:COMPARED]]))
        # Two bands do not outweigh a name, neither of a position nor of a current.
        named_so = y is not None or (control is not None and control.role == "i")
        if moves is None or (named_so and not moves.fit.sure):
            if moves is not None and y not in (None, channels[moves.position]):
                with_ = channels[moves.control].label
                why = f"it moves with {with_} as a levitated rotor does, in two bands of frequency"
                y.rivals.append((channels[moves.position], why))
            return None
        position, mover = channels[moves.position], channels[moves.control]
        if named_so and mover.called == "y" and not feeds(position, mover):
            return None  # the position of another axis of the same rotor
        if control is not None and goes_with(control, mover) and feeds(position, control):
            sign = np.sign(correlation(control.values, mover.values))  # mover follows it
            moves = replace(moves, control=channels.index(control), gain=sign * moves.gain)
        _rename(channels, moves, y, control)
    if moves is None or si_unit(channels[moves.position].unit or "m") not in ("m", "V", "1"):
        return None
    if si_unit(channels[moves.control].unit or "A") not in ("A", "V", "1"):
        return None
    if channels[moves.position].role not in ("", "y"):  # the voltage of a sensor
        _rename(channels, moves, y, control)
    _name_rotor(moves, channels)
    return moves.renumbered([results.index(c) for c in channels])


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
            right.rivals.append((named, "the other is named so, but does not move so"))
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
            beside = Beside(estimate, first)
            is_estimate = beside.is_near and not beside.is_reference
            is_led = leads(first, estimate) or leads(estimate, first)
            apart = estimate.unit != first.unit or (is_led and in_steps(estimate.values))
            if role == "y" and not (is_estimate and is_filter_of(estimate, first)):
                continue
            if estimate.role or (role != "y" and apart):
                continue
            estimate.role, estimate.estimated = role, True
            rawer = "less in steps" if in_steps(first.values) else "with less noise"
            estimate.why.append(f"moves as {first.label}, {rawer}: an estimate of it")
    for a, b in moves.others:
        for k, other in ((a, b), (b, a)):
            label = channels[other].label
            channels[k].why.append(f"moves as a levitated rotor does with {label}: another axis?")
