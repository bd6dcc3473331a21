"""Estimators along a record of a whole machine, and what they say of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.data.signals import signal
from ambkit.estimate.estimate import Status
from ambkit.estimate.noise import FilterNoise
from ambkit.judge.machine import errors_along
from ambkit.simulation.sequence import Mode
from ambkit.workflow.given import of_machine
from ambkit.workflow.harmonics import Harmonic, harmonics

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.estimate.estimate import Estimate
    from ambkit.machine.machine import Machine


@dataclass(frozen=True, eq=False)
class MachineFiltering:
    """Estimators along a record of a whole machine."""

    machine: Machine  #: Of which the record is.
    record: Record  #: What was filtered: of lift-off and landing what lies between.
    estimates: Mapping[str, Estimate]  #: Of each kind, what it says.
    settled: int  #: Sample from which on it counts.
    #: Of each kind, what it says of unbalance and runout at the end of the record.
    turning: Mapping[str, Sequence[Harmonic]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        return {
            "machine": self.machine.name,
            "samples": len(self.record),
            "estimators": {name: self._figures(name) for name in self.estimates},
        }

    def _figures(self, name: str) -> dict[str, Any]:
        estimate = self.estimates[name]
        late = slice(self.settled, None)
        used = estimate.innovation_variance[late] > 0
        flags = int(np.bitwise_or.reduce(estimate.status[late].astype(int)))
        found: dict[str, Any] = {
            "nis": float(np.nanmean(estimate.nis[late])),
            "innovation_std": {
                name: float(np.std(estimate.innovation[late, k][used[:, k]]))
                for k, name in enumerate(estimate.readings)
            },
            "disturbance_mean": {
                axis: float(np.mean(estimate[signal("f_d", axis)][late])) for axis in estimate.axes
            },
            "disturbance_std": {
                axis: float(np.std(estimate[signal("f_d", axis)][late])) for axis in estimate.axes
            },
            "status": [flag.name for flag in Status if flag & flags],
        }
        found["rmse"] = errors_along(estimate, self.record, self.settled)
        turning = self.turning.get(name)
        if turning:
            found["synchronous"] = {each.name: each.to_dict() for each in turning}
        return found


def filter_machine(
    machine: Machine,
    record: Record,
    kinds: Sequence[str] = ("linear", "extended"),
    *,
    synchronous: Sequence[str] = (),
    noise: FilterNoise | None = None,
    settling: float = 0.0,
    smooth: bool = False,
) -> MachineFiltering:
    """Run estimators along a record of a whole machine."""
    lacking = [
        name
        for name in (
            *(signal("y", r.name) for r in machine.readings),
            *(signal("u", axis.name) for axis in machine.axes),
        )
        if name not in record
    ]
    if lacking:
        raise AmbkitError(f"the record has no {', '.join(lacking)}, which {machine.name} gives")
    begin, end = in_flight(record)
    until, flown = record.between(stop=end), record.between(begin, end)
    estimates, turning = {}, {}
    for kind in kinds:
        estimator = of_machine(kind, machine, synchronous=synchronous, noise=noise)
        try:
            estimates[kind] = estimator.smooth(flown) if smooth else estimator.run(flown)
        except ValueError as error:
            raise AmbkitError(str(error)) from error
        turning[kind] = harmonics(estimator, until)
    settled = round(settling / machine.sampling_time)
    last = min(settled, len(flown) - 2)
    return MachineFiltering(machine, flown, estimates, last, turning)


def in_flight(record: Record) -> tuple[float | None, float | None]:
    """From when to when the magnets have currents, in a record of lift-off and landing [s]."""
    # A rotor that lies has the backup bearings' forces, and magnets that are off, which no
    # estimator is told. None and None: a record without a ``mode``, or one that never lifts.
    if "mode" not in record:
        return None, None
    on = np.flatnonzero(np.isin(record["mode"], (Mode.LIFTING, Mode.FLYING, Mode.LANDING)))
    if len(on) < 3:
        return None, None
    end = int(on[-1]) + 1
    return float(record.t[on[0]]), float(record.t[end]) if end < len(record) else None
