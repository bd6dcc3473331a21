"""Controllers and a filter for a whole machine, chosen on the margins of its loop; and the C."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base import files
from ambkit.base.asked import names_in, of_type
from ambkit.base.errors import AmbkitError
from ambkit.base.showing import Shown
from ambkit.base.units import engineering
from ambkit.data.reading import load_filled
from ambkit.estimate.kalman import KalmanFilter
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.loop.loop_of import ZONE_A, LoopOf, zone_of
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import own_time
from ambkit.result.page import write_result
from ambkit.simulation.control_candidates import name_of
from ambkit.simulation.controllers import Control
from ambkit.simulation.default_control import default_control
from ambkit.simulation.flight import Flight
from ambkit.simulation.holding import TIMES, holding, overshoot_of
from ambkit.simulation.scenario import GAINS, PID
from ambkit.workflow.assessing import assess
from ambkit.workflow.design_candidates import exported_filter, tuned_within
from ambkit.workflow.over_speed import assess_over_speed
from ambkit.workflow.tuned_filter import BUDGET, RUNS, Tuned
from ambkit.workflow.tuning_tasks import JUDGED, RAW

if TYPE_CHECKING:
    from ambkit.export.c import CExport
    from ambkit.workflow.assessed_loop import AssessedLoop
    from ambkit.workflow.assessment import Assessment

KINDS_TRIED = ("linear", "extended")
"""Who is tried where nobody says it: with the constant and with the exact stiffness."""

DIGITS = 3
"""Of the gains that are written down."""

AS_GOOD = 0.01
"""By how much a simpler filter may be worse and is taken all the same."""

FILES = {
    "machine.toml": "the machine",
    "filter.toml": "the filter to fly",
    "candidates": "the filters that were tried, tuned",
    "flight.toml": "its controllers, with all their gains",
    "verdict.html": "the verdict on the loop, to be signed off",
    "c": "filter and controllers as C, from readings to currents",
}


@dataclass(frozen=True, eq=False)
class MachineDesign(Shown):
    """Controllers and a filter for a whole machine, and what their loop comes to."""

    folder: Path  #: Where all of it lies.
    machine: Machine  #: The machine.
    control: Control  #: The controllers, with all their gains.
    tuned: Mapping[str, Tuned]  #: The filters that were tried, by kind.
    chosen: str  #: The kind that is to fly.
    #: The loop with it, and the one with the same controllers on the measurement.
    assessed: Assessment
    overshoot: float  #: Of a step of a reference, of all axes the greatest [1].
    objections: tuple[str, ...]  #: What speaks against flying it; empty if nothing does.
    exported: CExport | None  #: The C; None where objections kept it from being written.
    made: Mapping[str, str]  #: Its files in the folder, and what they are.
    notes: tuple[str, ...] = ()  #: What is to be known of it.

    @property
    def loop(self) -> AssessedLoop:
        """The loop with the chosen filter."""
        return self.assessed.loops[self.chosen]

    @property
    def why(self) -> str:
        """Which filter is to fly, and what the loop comes to, in a sentence."""
        return (
            f"Fly the {self.chosen} filter with {name_of(self.control)} control: the peak of |S| "
            f"is {self.loop.peak:.4g}, zone {self.loop.zone} of ISO 14839-3, and a step overshoots "
            f"by {100 * max(0.0, self.overshoot):.2g} %."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        return {
            "folder": str(self.folder),
            "machine": self.machine.name,
            "chosen": self.chosen,
            "why": self.why,
            "objections": list(self.objections),
            "peak": self.loop.peak,
            "zone": self.loop.zone,
            "overshoot": self.overshoot,
            "control": {"type": self.control.type, "cross_feedback": self.control.cross_feedback,
                        "gain_scheduling": self.control.gain_scheduling},
            "controllers": {name: {key: getattr(pid, key) for key in sorted(GAINS)}
                            for name, pid in self.control.pid.items()},
            "candidates": {
                kind: {"kept": each.kept, "by": each.by, "peak": each.peak,
                       "unseen": {name: b for name, (_, b) in each.unseen.items()}}
                for kind, each in self.tuned.items()
            },
            "exported": self.exported is not None,
            "files": list(self.made),
        }  # fmt: skip


def design_machine(
    machine: Machine,
    logs: Sequence[str | os.PathLike[str]],
    folder: str | os.PathLike[str],
    *,
    channels: str | os.PathLike[str] | None = None,
    validate: Sequence[str | os.PathLike[str]] = (),
    kinds: Sequence[str] | None = None,
    max_sensitivity: float | None = ZONE_A,
    precision: str = "float",
    prefix: str | None = None,
    anyway: bool = False,
    seed: int = 0,
    runs: int = RUNS,
    budget: int = BUDGET,
    note: Callable[[str], None] = lambda _text: None,
) -> MachineDesign:
    """Choose controllers and a filter for a machine on the margins of its loop, and export both.

    The controllers are those that `ambkit.simulation.default_control` chooses for an estimate, on
    the margins over the machine's speed range. Each kind of filter is then tuned in the
    loop with them below `max_sensitivity`, by its logs or by simulated flights, and of those the
    best on what they did not see is taken. The folder gets ``flight.toml`` and ``filter.toml``,
    which `ambkit.assess` and the simulation read back, ``verdict.html`` and ``c/``.

    Parameters
    ----------
    machine : Machine
        As it is known.
    logs : sequence of path
        Records of the loop; without any the filters are tuned on simulated flights.
    folder : path
        Where all of it goes.
    channels : path, optional
        Channel map of the logs.
    validate : sequence of path, optional
        Logs to judge by; without them the second half of each log.
    kinds : sequence of str, optional
        Estimators that are tried; by default `KINDS_TRIED`.
    max_sensitivity : float, optional
        What the peak of abs(S) in the loop is to stay below [1], see `ambkit.tune`; None for no
        limit. A kind that cannot be held to it is tuned without.
    precision, prefix : str
        Of the exported C.
    anyway : bool
        Export also what is worse than the raw sensors or out of zone A.
    seed, runs, budget : int
        Of all that is drawn; simulated flights, and evaluations of each kind, see `ambkit.tune`.
    note : callable
        Told what is done next.

    Returns
    -------
    MachineDesign
        What was chosen, and why.

    Raises
    ------
    AmbkitError
        A log cannot be read, a kind is unknown or of one axis, no controller was found that holds
        the rotor, or the folder cannot be written.
    """
    of_type(Machine, machine=machine)
    records = [load_filled(path, channels) for path in logs]
    others = [load_filled(path, channels) for path in validate]
    place = files.make_folder(folder)
    note("choosing the controllers")
    control = control_for(machine)
    machine.save(place / "machine.toml")
    tuned = {}
    for kind in KINDS_TRIED if kinds is None else names_in(kinds=kinds):
        note(f"tuning the {kind} filter")

        tuned[kind] = tuned_within(
            max_sensitivity, machine, records, kind, validate=others, controller=control,
            seed=seed, runs=runs, budget=budget,
            source=", ".join(Path(path).name for path in logs),
        )  # fmt: skip
        files.make_folder(place / "candidates")
        tuned[kind].save(place / f"candidates/{kind}.toml", bearing=place / "machine.toml")
    chosen = _best(tuned)
    estimator = tuned[chosen].estimator
    estimator.save(place / "filter.toml", bearing=place / "machine.toml")
    flight = Flight(feedback="estimate", control=control)
    flight.save(place / "flight.toml")
    note("assessing the loop")
    assessed = assess(machine, {chosen: estimator}, control)
    loop = assessed.loops[chosen]
    if loop.stable:
        note("looking at one speed after the other")
        over = assess_over_speed(machine, {chosen: estimator}, control)
        write_result([assessed, over], place / "verdict.html", signed=True)
    step = _overshoot(loop, control)
    judged = judge_adequacy(estimator, machine, Flight(feedback="estimate", control=control))
    fatal = sentences([each for each in judged if each.fatal and each.name != "peak of |S|"])
    objections = (*_objections(loop, max_sensitivity), *_beside_raw(tuned[chosen]), *fatal)
    exported = None
    if anyway or not objections:
        note("exporting")
        exported = exported_filter(machine, place, precision, prefix, flight)
    made = {name: what for name, what in FILES.items() if (place / name).exists()}
    return MachineDesign(
        place, machine, control, tuned, chosen, assessed, step, objections, exported, made
    )


def control_for(machine: Machine) -> Control:
    """The default controllers of a machine that an estimate feeds, as they are written down."""
    found = default_control(machine, "estimate")
    if not found.held:
        raise AmbkitError(found.summary)
    control = found.chosen.control
    if control.type == "decentralised" and not control.pid:
        names = [axis.name for axis in machine.axes]
        each = dict(zip(names, holding(machine, "estimate").pids, strict=True))
    else:
        each = LoopOf(machine, control).pids(KalmanFilter(machine))
    pids = {
        name: PID(**{key: float(f"{getattr(pid, key):.{DIGITS}g}") for key in GAINS})  # type: ignore[arg-type]
        for name, pid in each.items()
    }
    return control.model_copy(update={"pid": pids})


def _overshoot(loop: AssessedLoop, control: Control) -> float:
    """Return how far an axis goes beyond a step of its reference, of all axes the most [1]."""
    machine = loop.of.machine
    assert machine is not None
    if control.type == "decentralised" and not control.cross_feedback:
        return overshoot_of(machine, list(control.pid.values()), "estimate")
    closed, p = loop.loop.closed, len(loop.of.axes)
    n, m = len(closed.A), loop.loop.measurements
    samples = max(1, round(30 * max(map(own_time, loop.of.alone)) / loop.loop.T / TIMES))
    step = np.block([[closed.A, closed.B[:, -p:]], [np.zeros((p, n)), np.eye(p)]])
    several, state = np.linalg.matrix_power(step, samples), np.eye(n + p)[:, n:]
    most = 0.0
    for _ in range(TIMES):
        state = several @ state
        most = max(most, float(np.diagonal(closed.C[m : m + p] @ state[:n]).max()) - 1)
    return most


def _best(tuned: Mapping[str, Tuned]) -> str:
    """Return the kind that does best on what it was not tuned on; of equals the first."""
    each = {kind: one.unseen[JUDGED[one.by]][1] for kind, one in tuned.items()}
    least = min(each.values())
    return next(kind for kind, cost in each.items() if cost <= least + AS_GOOD * abs(least))


def _objections(loop: AssessedLoop, ceiling: float | None) -> list[str]:
    """Return what speaks against flying a loop."""
    if not loop.stable:
        return ["the loop is not stable"]
    said = []
    if zone_of(loop.peak) != "A":
        said.append(f"the peak of |S| is {loop.peak:.3g}, zone {zone_of(loop.peak)} of ISO 14839-3")
    elif ceiling is not None and loop.peak >= ceiling:
        said.append(f"the peak of |S| is {loop.peak:.3g}, and is to be below {ceiling:g}")
    return said


def _beside_raw(tuned: Tuned) -> list[str]:
    """Return what speaks against a filter that errs more than the raw sensors."""
    taken = 1 if tuned.kept else 0
    if RAW not in tuned.unseen or tuned.unseen["error of x"][taken] < tuned.unseen[RAW][taken]:
        return []
    error, raw = (
        engineering(tuned.unseen[name][taken], "m", digits=3) for name in ("error of x", RAW)
    )
    return [f"its position errs by {error}, and that of the raw sensors by {raw}"]
