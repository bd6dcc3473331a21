"""Which channel each signal of a record has, where several have the role."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ambkit.data.reading.candidates import Candidate
from ambkit.data.reading.channel_statistics import correlation, seen
from ambkit.data.reading.clock import examine
from ambkit.data.reading.comparison import rate_likeness
from ambkit.data.reading.position_search import Rotor

_NAMES = {"i": "current", "k": "keyphasor"}


@dataclass(frozen=True)
class ProposedMap:
    """Channels of one length, and what tells the rotor among them."""

    channels: list[Candidate]  #: The channels, with their roles.
    moves: Rotor | None  #: What tells position and control, where something floats.

    def score(self) -> tuple[int, int, bool, bool, int]:
        """By physics, then by names, then by the length."""
        named = sum(
            any(c.role in roles and not c.estimated for c in self.channels) for roles in ("y", "ui")
        )
        physics = 0 if self.moves is None else 1 + self.moves.fit.sure
        time = any(c.role == "t" or c.clock for c in self.channels)
        by_name = any("by its name" in c.why for c in self.channels)
        return physics, named, time, by_name, self.channels[0].values.size


def choose(results: list[Candidate], moves: Rotor | None) -> dict[str, Candidate]:
    """Give each signal of a record its channel; the estimates of the rig are logged signals."""
    chosen: dict[str, Candidate] = {}
    if moves is not None and not results[moves.position].estimated:
        chosen["y"] = results[moves.position]
    for role in ("t", "y", "u", "i", "r", "k"):
        there = [c for c in results if c.role == role and not c.estimated]
        if role == "t":
            clocks = {id(c): examine("t", seen(c.values)) for c in there}
            there.sort(key=lambda c: clocks[id(c)].jumps.size + clocks[id(c)].gaps.size)
        if there:
            chosen.setdefault(role, there[0])
    if "u" not in chosen and "i" in chosen:
        chosen["u"] = chosen.pop("i")
    elif "i" in chosen and chosen["u"].drives:
        chosen["control"], chosen["u"] = chosen["u"], chosen.pop("i")
    for role, name in (("y", "x_logged"), ("v", "v_logged")):
        logged = [c for c in results if c.role == role and (c.estimated or role == "v")]
        logged = [c for c in logged if "y" not in chosen or _is_of(chosen["y"], c, results)]
        x = chosen.get("x_logged", chosen.get("y"))
        if logged:
            chosen[name] = max(logged, key=lambda c: (c.estimated, x is not None and _goes(c, x)))
    if "y" not in chosen and "x_logged" in chosen:
        chosen["y"] = chosen.pop("x_logged")
    order = ("t", "y", "u", "control", "r", "i", "x_logged", "v_logged", "k")
    return {_NAMES.get(role, role): chosen[role] for role in order if role in chosen}


def _is_of(y: Candidate, c: Candidate, results: Sequence[Candidate]) -> bool:
    """Whether an estimate, or a velocity, goes with a position no less than with another one."""
    others = [item for item in results if item.role == "y" and not item.estimated]
    return _goes(c, y) >= max((_goes(c, item) for item in others), default=0.0)


def _goes(c: Candidate, y: Candidate) -> float:
    """Return how much an estimate goes with a position, or a velocity with its rate."""
    if c.values.shape != y.values.shape:
        return 0.0
    return abs(rate_likeness(c, y) if c.role == "v" else correlation(c.values, y.values))


def from_others(results: list[Candidate], others: Sequence[ProposedMap]) -> dict[str, Candidate]:
    """Return y or u of another length, with a time there, where these channels have none."""
    lacking = {
        "y": not any(c.role == "y" and not c.estimated for c in results),
        "u": not any(c.role in ("u", "i") and not c.estimated for c in results),
    }
    timed = [other.channels for other in others if any(c.role == "t" for c in other.channels)]
    if not any(c.role == "t" for c in results) or all(lacking.values()):
        return {}
    there = {}
    for signal, roles in (("y", ("y",)), ("u", ("u", "i"))):
        named = [
            c for role in roles for group in timed for c in group
            if c.role == role and not c.estimated and "by its name" in c.why
        ]  # fmt: skip
        if lacking[signal] and named:
            there[signal] = named[0]
    return there
