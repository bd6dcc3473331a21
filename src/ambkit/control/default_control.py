"""Default controllers of a rotating machine, selected by the margins over its speed range."""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.control.control_candidates import ERRORS, PIDS, Candidate, Candidates, Feedback, name_of
from ambkit.control.pid import PID
from ambkit.control.stabilising_controller import ENOUGH
from ambkit.machine.machine import Machine

AS_GOOD = 1.1  #: Ratio to the lowest peak within which, in zone A, the simplest is selected.
EQUAL = 1.01  #: The same ratio beyond zone A, where the lowest peak is selected.

ZONES = (("A", 3.0), ("B", 4.0), ("C", 5.0))
"""Zones of ISO 14839-3, and the upper limits of abs(S); D is beyond."""

ZONE_A = ZONES[0][1]  #: Peak of abs(S) at which zone A ends.


def zone_of(peak: float) -> str:
    """Return the zone of a peak of abs(S) [1], A to D; ``"unstable"`` if infinite."""
    if math.isinf(peak):
        return "unstable"
    return next((name for name, limit in ZONES if peak < limit), "D")


@dataclass(frozen=True)
class DefaultControl:
    """Default controllers of a machine."""

    machine: str  #: Name of the machine.
    fastest: float  #: End of the speed range [rad/s].
    chosen: Candidate  #: Selected candidate; decentralised control if none holds the rotor.
    candidates: tuple[Candidate, ...] = ()  #: All candidates, in order.

    @property
    def held(self) -> bool:
        """Whether the rotor is held over the evaluated speed range."""
        return not self.candidates or self.chosen.stable

    @property
    def summary(self) -> str:
        """Selection and its peak, or what was tried without success."""
        span = f"from 0 to {abs(self.fastest) * 30 / math.pi:,.0f} rpm"
        if not self.candidates:
            return f"default controller: {name_of(self.chosen.control)}"
        if self.held:
            others = [candidate for candidate in self.candidates if candidate is not self.chosen]
            beside = f"; also tried{_listed(others)}" if others else ""
            known = poor = simplest = ""
            if (error := self.chosen.inertia_error) < ERRORS[0]:
                within = f"within {100 * error:g} %"
                known = within if error else f"to better than {100 * ERRORS[-1]:g} %"
                known = f" if the polar inertia is known {known}"
            if (zone := zone_of(self.chosen.peak)) != "A":
                poor = (
                    f", which is poor: zone {zone} of ISO 14839-3, where zone A ends at {ZONE_A:g}"
                )
            if self.chosen.peak > EQUAL * min(item.peak for item in self.candidates):
                simplest = f", the simplest within {100 * (AS_GOOD - 1):.0f} % of the lowest peak"
            return (
                f"default controller: {name_of(self.chosen.control)}, fed by the "
                f"{self.chosen.feedback}, with a peak of |S| of {self.chosen.peak:.3g} {span}"
                f"{known}{poor}{simplest}{beside}"
            )
        return (
            f"no default controller stabilises the rotor of {self.machine} {span}; "
            f"tried{_listed(self.candidates)}; lower the speed, the dead time or the "
            "sampling time, or give another controller in [controller]"
        )


def _listed(candidates: Iterable[Candidate]) -> str:
    """Return candidates in words, by their feedback."""
    groups = itertools.groupby(candidates, key=lambda item: item.feedback)
    parts = (f", fed by the {fed_by}: {', '.join(map(str, of))}" for fed_by, of in groups)
    return ";".join(parts).replace(";,", ";")


def default_control(
    machine: Machine, feedback: Feedback = "estimate", max_speed: float = 0.0
) -> DefaultControl:
    """Return the default controllers of a machine up to its speed or a higher one."""
    # A machine at standstill has decentralised PIDs. For a rotating one the structures are tried in
    # turn, from simple to linear-quadratic, by the peak of abs(S) of the worst axis with all others
    # closed, from standstill to the highest speed [rad/s], with gyroscopics, dead time and the
    # linear Kalman filter with default noise in the loop: selected is the first with a peak of at
    # most `ENOUGH`, or that of `best_of`.
    max_speed = max(abs(machine.speed), max_speed)
    if not max_speed or machine.rotor.type == "mass":
        return DefaultControl(machine.name, 0.0, Candidate(PIDS[0], feedback, math.nan, 0.0))
    return _chosen(machine.model_copy(update={"unbalance": ()}), feedback, max_speed)


def is_default(control: Control) -> bool:
    """Return whether the structure of controllers is left open."""
    if control.custom:
        return False
    stated_gains = control.model_fields_set & PID.model_fields.keys()
    return control.type is None and not (stated_gains or control.pid or control.cross_feedback)


def settled(
    machine: Machine, control: Control, feedback: Feedback, max_speed: float = 0.0
) -> Control:
    """Return controllers with their type, and for a single axis with all gains; held or not."""
    if machine.single:
        control = control.fed_by(control.feedback or feedback).completed(machine)
    if control.type is not None:
        return control
    if not is_default(control):
        return control.model_copy(update={"type": "decentralised"})
    chosen = default_control(machine, feedback, max_speed).chosen.control
    return control.model_copy(update={k: getattr(chosen, k) for k in chosen.model_fields_set})


@lru_cache(maxsize=64)
def _chosen(machine: Machine, feedback: Feedback, max_speed: float) -> DefaultControl:
    try:
        loops = Candidates(machine, max_speed)
    except AmbkitError:  # no levitation at the centre
        nothing = Candidate(PIDS[0], feedback, math.nan, 0.0)
        return DefaultControl(machine.name, max_speed, nothing)
    results = tuple(loops.in_turn(feedback))
    return DefaultControl(machine.name, max_speed, best_of(results), results)


def best_of(candidates: Sequence[Candidate]) -> Candidate:
    """Return the first with a low peak, of candidates from simple to complicated."""
    # Low means `ENOUGH`, else close to the lowest in zone A; beyond, the lowest.
    lowest = min(item.peak for item in candidates)
    limit = max(ENOUGH, EQUAL * lowest, min(AS_GOOD * lowest, ZONE_A))
    return next(item for item in candidates if item.peak <= limit)
