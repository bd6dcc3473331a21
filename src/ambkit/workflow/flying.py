"""A run of a whole machine, and what it came to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.judge.evaluation import errors_along
from ambkit.simulation.controllers import controllers_of
from ambkit.simulation.default_control import settled_flight
from ambkit.simulation.flight import Flight
from ambkit.simulation.plant import Plant
from ambkit.simulation.sequence import Mode
from ambkit.workflow.simulating import LOAD_AT

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.machine import Machine
    from ambkit.simulation.machine import MachineRun
    from ambkit.workflow.harmonics import Harmonic


def plain_control(machine: Machine, flight: Flight, estimator: Estimator | None) -> str | None:
    """Return a sentence on where a flight's unbalance control is plain control."""
    if flight.control.unbalance == "fought" or estimator is None:
        return None
    flight = settled_flight(machine, flight)
    T = machine.sampling_time
    t = T * np.arange(max(2, round(flight.duration / T) + 1) + 1, dtype=float)
    speed = np.abs([machine.speed] if flight.speed is None else flight.speed.sample(t))
    low, high = float(speed.min()), float(speed.max())
    turn = controllers_of(Plant(machine), flight.control, estimator, fastest=high).let_turn
    return None if turn is None else turn.sentence(flight.control.unbalance, low, high)


def flight_for(
    machine: Machine,
    flight: Flight | None = None,
    *,
    duration: float | None = None,
    load: float | None = None,
    seed: int | None = None,
    injection: Path | None = None,
) -> Flight:
    """Return a flight with what the user changed in it."""
    happening = Flight() if flight is None else flight
    if injection is not None:
        happening = _along(injection, machine, happening)
    if duration is not None:
        happening = happening.replace(duration=duration)
    if seed is not None:
        happening = happening.replace(seed=seed)
    if load is not None:
        force = {"type": "step", "amplitude": load, "time": LOAD_AT * happening.duration}
        one = {"axis": machine.axes[0].name, "force": force}
        happening = happening.replace(disturbance=(one,))
    return happening


def _along(path: Path, machine: Machine, flight: Flight) -> Flight:
    """Return a flight that takes what is added from a record."""
    record = Record.load(path)
    names = [signal("injected", axis.name) for axis in machine.axes]
    told = [name for name in names if name in record]
    if not told:
        raise AmbkitError(
            f"{path}: it has none of {', '.join(names)}, which are added at axes of {machine.name}"
        )
    added = [
        {"axis": name.removeprefix("injected_"),
         "position": {"type": "recorded", "file": str(path), "signal": name}}
        for name in told
    ]  # fmt: skip
    return flight.replace(injection=(*flight.injection, *added), duration=float(record.t[-1]))


@dataclass(frozen=True)
class FlightSummary:
    """What a run of a whole machine came to."""

    run: MachineRun  #: The run.
    #: What its estimator says of unbalance and runout at the end, where it flies then.
    turning: Sequence[Harmonic] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        machine, record, estimate = self.run.machine, self.run.record, self.run.estimate
        names, on = [axis.name for axis in machine.axes], self.run.fed
        found: dict[str, Any] = {
            "machine": machine.name,
            "samples": len(record),
            "duration": record.t[-1],
            "seed": record.meta["seed"],
            "greatest_displacement": {n: np.abs(record[signal("s", n)]).max() for n in names},
            "greatest_current": {
                n: np.abs(record[signal("iu", n)][on]).max(initial=0.0) for n in names
            },
            "samples_at_the_stop": self.run.samples_at_the_stop,
        }
        if estimate is not None:
            found["estimator"] = estimate.estimator
            found["rmse"] = errors_along(estimate, record, *self._in_flight())
            late = slice(*self._in_flight())
            found["nis"] = float(np.mean(estimate.nis[late][1:]))
        if self.turning and self._in_flight()[1] is None:
            found["synchronous"] = {each.name: each.to_dict() for each in self.turning}
        if "mode" in record:
            found["modes"] = self._modes()
        return found

    def _in_flight(self) -> tuple[int, int | None]:
        """Return the first sample in which the rotor flew and the one after it last did."""
        # A rotor that lies has the backup bearings' forces, which no estimator knows, and a filter
        # takes the magnets for switched on; so it is after a power failure. 0 and None: all of the
        # record.
        if "mode" not in self.run.record:
            return 0, self.run.fed.stop
        mode = self.run.record["mode"]
        flew = np.flatnonzero(mode == Mode.FLYING)
        if not flew.size:
            return 0, len(mode)
        end = int(flew[-1]) + 1
        return int(flew[0]), None if end == len(mode) else end

    def _modes(self) -> list[dict[str, Any]]:
        """Return what lift-off and landing did, and since when [s]."""
        t, mode = self.run.record.t, self.run.record["mode"]
        changed = np.flatnonzero(np.diff(mode, prepend=-1.0))
        return [{"mode": Mode(int(mode[k])).name.lower(), "since": float(t[k])} for k in changed]
