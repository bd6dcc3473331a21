"""A channel map proposed for a log, with a comment on each line that says why."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from ambkit.base.errors import RecordError
from ambkit.base.escaping import one_line
from ambkit.data.files.tables import read_log
from ambkit.data.reading.candidates import Candidate, candidates
from ambkit.data.reading.channel_map_text import toml_lines
from ambkit.data.reading.channel_statistics import seen
from ambkit.data.reading.choice import ProposedMap, choose, from_others
from ambkit.data.reading.plausibility import standstill
from ambkit.data.reading.signal_roles import find_roles

FEW = 10  #: Values up to which a channel is a set point or a status, which lies nowhere.
COARSE = 64  #: Values up to which the steps of a converter hide the acceleration.
UNEVEN = 0.1  #: Share of steps, and their deviation, by which a clock is uneven.


def guess(path: str | os.PathLike[str], progress: Callable[[str], object] = lambda _: None) -> str:
    """Propose a channel map for a log."""
    log = read_log(path, None, progress, lenient=True)
    progress("comparing the channels")
    groups = [group for group in candidates(log) if group]
    if not groups:
        most = max((array.size for array in log.arrays.values()), default=0)
        short = log.arrays and most < 2
        what = f"only {most} sample{'s' * (most != 1)} of" if short else "no channels:"
        raise RecordError(f"{path}: holds {what} {log.contents}")
    assignments = [ProposedMap(group, find_roles(group)) for group in groups]
    best = max(assignments, key=ProposedMap.score)
    damage = next((c.damage for a in assignments for c in a.channels if c.damage), None)
    if damage and not any(c.role == "t" for c in best.channels):
        raise damage
    others = [assignment for assignment in assignments if assignment is not best]
    chosen = choose(best.channels, best.moves) | from_others(best.channels, others)
    if "y" not in chosen:
        unread = [remark for remark in log.remarks if "are not read" in remark]
        raise RecordError(_refusal(os.fspath(path), best.channels, unread))
    if (rises := _only_rises(best)) is not None:
        raise RecordError(
            f"{path}: refused: no channel is its time, and {rises.label}, by its name a position, "
            f"does not move but goes from {rises.values[0]:.4g} to {rises.values[-1]:.4g} "
            f"{rises.unit or 'of its units'} in {rises.values.size} samples, one after the other: "
            "it holds no log of a rotor, but perhaps the calibration of a sensor, or a force map"
        )
    return "\n".join(map(one_line, toml_lines(Path(path).name, log, best, chosen, others))) + "\n"


def _only_rises(best: ProposedMap) -> Candidate | None:
    """Return what is called a position and only rises, or only falls, in a log without a time."""
    if any(c.role == "t" or c.clock for c in best.channels) or best.moves is not None:
        return None
    for c in best.channels:
        steps = np.diff(c.values)
        if c.role == "y" and steps.size and ((steps >= 0).all() or (steps <= 0).all()):
            return c
    return None


def _refusal(path: str, results: list[Candidate], unread: list[str]) -> str:
    """Say why nothing is guessed, and what helps."""
    moving = [c for c in results if not c.role and np.unique(seen(c.values)).size > FEW]
    lying = {c.label: rests for c in moving if (rests := standstill(seen(c.values)))}
    descriptions = [f"{label} is {rests.describe()}" for label, rests in lying.items()]
    lies = (
        f" ({'; '.join(descriptions[:2])}: is the rotor in contact there?)" if descriptions else ""
    )
    return (
        f"{path}: refused: nothing in it is levitated{lies}. Of its {len(results)} channels of "
        f"{results[0].values.size} samples no two move as a rotor and its current do, and no name "
        f"says what is what{'; '.join(['', *unread, *_obstacles(results, moving)])}: write y and u "
        "into a channel map by hand, or cut out a part in which the rotor is levitated"
    )


def _obstacles(results: Sequence[Candidate], moving: Sequence[Candidate]) -> Iterator[str]:
    """Say what in the log hides how its channels move."""
    for t in results:
        steps = np.diff(seen(t.values))
        if steps.size == 0 or steps.min() <= 0:
            continue
        usual = float(np.median(steps))
        if np.mean(abs(steps - usual) > UNEVEN * usual) > UNEVEN:
            yield f"the steps of {t.label} range from {steps.min():.3g} to {steps.max():.3g}"
    for c in results:
        yield from (f"{c.label} {why}" for why in c.why if why.startswith("holds the same numbers"))
    for c in moving:
        if (count := np.unique(seen(c.values)).size) < COARSE:
            yield f"{c.label} takes {count} values only, too coarse for an acceleration"
