"""What a whole machine's filter is tuned by: its records, or simulated flights."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.data.signals import signal
from ambkit.estimate.view import View
from ambkit.judge.evaluation import errors_along
from ambkit.machine.bank import weights_of
from ambkit.simulation.flight import Disturbance, Flight
from ambkit.simulation.machine import simulate_machine
from ambkit.simulation.waveforms import Step
from ambkit.workflow.tuning_tasks import ByLikelihood, ByTruth, slowest_time

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.estimate.base import Estimator
    from ambkit.machine.machine import Machine

LENGTH = 40.0
"""Of a simulated flight, in the plant's own time."""

LOADED = 0.2
"""Of what the rotor weighs, the standard deviation of a load's step along an axis."""


class MachineByLikelihood(ByLikelihood):
    """Tuning by the likelihood of a machine's records."""

    bearing: Any

    def figures(self, build: Callable[[], Estimator]) -> dict[str, float]:
        """Return how such filters do on what they were not tuned on."""
        each = [(r, build().run(r)) for r in self.unseen]
        found = {self.judge: self._unlikely(estimate for _, estimate in each)}
        first = round(self.settling / self.bearing.sampling_time)
        found["nis"] = float(np.mean([np.nanmean(estimate.nis[first:]) for _, estimate in each]))
        told = [errors_along(estimate, record, first) for record, estimate in each]
        for name in told[0]:
            found[f"error of {name}"] = float(np.sqrt(np.mean([one[name] ** 2 for one in told])))
        return found


class MachineByTruth(ByTruth):
    """Tuning by the errors against the truth of simulated flights, with steps of load."""

    def __init__(self, machine: Machine, runs: int, seed: int) -> None:
        self.whole = View(machine)
        super().__init__(machine, runs, seed)

    def _trials(self, seed: int) -> Sequence[Record]:
        machine, rng = self.bearing, np.random.default_rng(seed)
        duration = LENGTH * slowest_time(machine)
        weight = machine.rotor.mass * 9.81 / max(1, len(weights_of(machine)))
        flown = []
        for _ in range(self.runs):
            loads = tuple(
                Disturbance(
                    axis=axis.name,
                    force=Step(amplitude=LOADED * weight * float(rng.standard_normal()),
                               time=float(rng.uniform(0.3, 0.7)) * duration),
                )
                for axis in machine.axes
            )  # fmt: skip
            seen = int(rng.integers(2**31))
            flight = Flight(duration=duration, seed=seen, disturbance=loads)
            run = simulate_machine(machine, flight)
            if not run.samples_at_the_stop:
                flown.append(run.record)
        return flown

    def errors(self, build: Callable[[], Estimator], trials: Sequence[Record]) -> Any:
        """Return the errors of x, v and f_d along the axes in each run (runs, 3)."""
        found = np.empty((len(trials), 3))
        for row, record in zip(found, trials, strict=True):
            estimator = build()
            estimate = estimator.run(record)
            truth = np.array([
                record[f"q_{at.name}"] if f"q_{at.name}" in record else 0.0 * record.t
                for at in estimate.states
            ])  # fmt: skip
            error = np.asarray(estimate.mean).T - truth
            x, v = (rows @ error for rows in self.whole.along_axes(estimate.states))
            f_d = np.array(
                [estimate[signal("f_d", a)] - record[signal("f_d", a)] for a in estimate.axes]
            )
            row[:] = [np.sqrt(np.mean(one[:, self.first :] ** 2)) for one in (x, v, f_d)]
        return np.where(np.isfinite(found[:, :1]), found, np.inf)

    def raw(self) -> float:
        """Return what the sensors err by along the axes in the runs that judge [m]."""
        machine, shown = self.bearing, self.whole.H @ self.whole.shown
        errors = []
        for record in self.unseen:
            y = np.array([record[signal("y", r.name)] for r in machine.readings])
            s = np.array([record[signal("s", axis.name)] for axis in machine.axes])
            errors.append(np.sqrt(np.mean((shown @ y - s)[:, self.first :] ** 2)))
        return float(np.mean(errors))


def check_records(machine: Machine, records: Iterable[Record]) -> None:
    """Refuse records that are not of a machine."""
    needed = [signal("y", r.name) for r in machine.readings] + [
        signal("u", a.name) for a in machine.axes
    ]
    for record in records:
        lacking = [name for name in needed if name not in record]
        if lacking:
            raise AmbkitError(f"the record has no {', '.join(lacking)}, which {machine.name} gives")
