"""Many closed loops of whole machines, each judged by its truth, for campaigns.

Each is a run of :func:`~ambkit.simulation.machine.simulate_machine`, in threads: while one is in C,
another is got ready.
"""

from __future__ import annotations

import math
import pickle
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.data.signals import signal
from ambkit.estimate.batch import processors
from ambkit.estimate.estimate import Status
from ambkit.machine import geometry
from ambkit.models.parts.rotor import velocity_of
from ambkit.simulation.machine import simulate_machine
from ambkit.simulation.many import FIGURES as OF_ONE_AXIS
from ambkit.simulation.many import FLAGS, Figure, Many, first_of
from ambkit.simulation.run import Run

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.machine import Machine
    from ambkit.simulation.controllers import Controllers
    from ambkit.simulation.scenario import Scenario

Array = NDArray[np.float64]

_ALONG = ("x_rms", "v_rms", "f_d_rms", "x_peak", "v_peak", "f_d_peak", "nis", "tracking_rms",
          "tracking_peak", "effort", "displacement_peak", "current_peak", "recovery")  # fmt: skip

FIGURES: dict[str, Figure] = {
    name: Figure(OF_ONE_AXIS[name].unit, f"{OF_ONE_AXIS[name].about[:-1]}, of the worst axis.")
    for name in _ALONG if name != "nis"
} | {
    "nis": Figure("1", "Mean normalised innovation squared of all readings taken in."),
    "orbit_peak": Figure("m", "Farthest that the rotor was from the middle of a bearing at a "
                         "sample, both axes together, after the settling."),
    "orbit_share": Figure("1", "The same as a share of the travel in that bearing, of the worst "
                          "bearing."),
    "load_kept": Figure("N", "Greatest magnitude of the loads together before the rotor first met "
                        "a backup bearing."),
    "touched": Figure("1", "Samples in which a backup bearing was touched."),
}  # fmt: skip
"""All figures of a run of a machine by name; NaN where one does not apply."""


@dataclass(frozen=True, slots=True)
class PlannedMachine:
    """One run of many."""

    machine: Machine  #: The plant, and what happens to it: seed and run are the key of its noise.
    scenario: Scenario
    estimator: Estimator | None = None  #: In the loop or beside it; it is not changed.
    controllers: Controllers | None = None  #: Where they are made already.

    def simulated(self) -> Run:
        """Simulate it by itself, with every sample kept."""
        own = None if self.estimator is None else _copied(self.estimator)
        return simulate_machine(
            self.machine, self.scenario, estimator=own, controllers=self.controllers
        )


def simulate_machines(
    runs: Iterable[PlannedMachine],
    *,
    settling: float = 0.0,
    band: float = 0.05,
    threads: int | None = None,
    done: Callable[[int], None] | None = None,
) -> Many:
    """Simulate many machines and judge each by the truth."""
    # The numbers follow from each run alone, whatever the threads and what else is there.
    own = threading.local()  # an estimator has a state: each thread has its own

    def fly(planned: PlannedMachine) -> tuple[list[float], list[int]]:
        if not hasattr(own, "estimators"):
            own.estimators = {}
        estimator = planned.estimator
        if estimator is not None:
            known = own.estimators.get(id(estimator))
            estimator = known or own.estimators.setdefault(id(estimator), _copied(estimator))
        run = simulate_machine(
            planned.machine, planned.scenario, estimator=estimator, controllers=planned.controllers
        )
        found = figures_of(run, planned.estimator, settling, band)
        return [found[name] for name in FIGURES], _flags(run)

    rows, flags = [], []
    with ThreadPoolExecutor(threads or processors()) as pool:
        for row, said in pool.map(fly, runs):
            rows.append(row)
            flags.append(said)
            if done is not None:
                done(1)
    figures = np.array(rows).reshape(-1, len(FIGURES))
    counts = np.array(flags, np.int64).reshape(-1, len(FLAGS))
    return Many(
        {name: figures[:, k] for k, name in enumerate(FIGURES)},
        {name: counts[:, k] for k, name in enumerate(FLAGS)},
    )


def _copied(estimator: Estimator) -> Estimator:
    found: Estimator = pickle.loads(pickle.dumps(estimator))
    return found


def figures_of(
    run: Run, estimator: Estimator | None, settling: float = 0.0, band: float = 0.05
) -> dict[str, float]:
    """Return what a run is judged by."""
    machine, record = run.machine, run.record
    names = [axis.name for axis in machine.axes]
    travel = np.array([axis.bearing.travel_limit for axis in machine.axes])
    first = first_of(settling, machine.sampling_time, len(record))
    s, r, iu, f_d = (np.column_stack([record[f"{of}_{name}"] for name in names])
                     for of in ("s", "r", "iu", "f_d"))  # fmt: skip
    off = r - s
    found = dict.fromkeys(FIGURES, math.nan)
    found |= {
        "tracking_rms": _rms(off[first:]),
        "tracking_peak": float(np.abs(off[first:]).max()),
        "effort": _rms(np.diff(iu, axis=0)[first - 1 :]),
        "displacement_peak": float(np.abs(s).max()),
        "current_peak": float(np.abs(iu).max()),
        "recovery": _recovery(off / travel, f_d, band, machine.sampling_time),
        "load_kept": float(np.linalg.norm(f_d[: run.first_touch], axis=1).max(initial=0.0)),
        "touched": float(run.samples_at_the_stop),
    }
    orbits = _orbits(machine, s[first:])
    found["orbit_peak"] = max(float(far.max()) for far, _ in orbits)
    found["orbit_share"] = max(float(far.max()) / travel for far, travel in orbits)
    estimate = run.estimate
    if estimate is not None and estimator is not None:
        errors = errors_of(run, estimator)
        for name, each in errors.items():
            found[f"{name}_rms"] = _rms(each[first:])
            found[f"{name}_peak"] = float(np.abs(each[first:]).max())
        nis = np.asarray(estimate.nis[first:])
        told = nis[np.isfinite(nis)]
        found["nis"] = float(told.mean()) if told.size else math.nan
    return found


def errors_of(run: Run, estimator: Estimator) -> dict[str, Array]:
    """Return the errors of x, v and f_d along the axes, sample by sample (n, p) [m], [m/s], [N]."""
    # Without f_d where the estimator has no loads among its states.
    machine, record, estimate = run.machine, run.record, run.estimate
    assert estimate is not None
    assert estimator.whole is not None
    names = [axis.name for axis in machine.axes]
    x, v = (
        np.asarray(estimate.mean) @ rows.T for rows in estimator.whole.along_axes(estimate.states)
    )
    velocities = [record[f"q_{velocity_of(position)}"] for position in machine.positions]
    H = geometry.matrix([axis.line for axis in machine.axes], machine.positions)
    found = {
        "x": x - np.column_stack([record[signal("s", name)] for name in names]),
        "v": v - np.column_stack(velocities) @ H.T,
    }
    loads = {state.name for state in estimate.states if state.role == "disturbance force"}
    if {signal("f_d", name) for name in names} <= loads:
        wrong = [estimate[signal("f_d", name)] - record[signal("f_d", name)] for name in names]
        found["f_d"] = np.column_stack(wrong)
    return found


def _rms(of_axes: Array) -> float:
    """Return the root mean square of the worst axis of signals (n, p)."""
    return float(np.sqrt(np.max(np.mean(of_axes**2, axis=0), initial=0.0)))


def _orbits(machine: Machine, s: Array) -> list[tuple[Array, float]]:
    """Return of each bearing how far the rotor is from its middle (n,), and the travel [m]."""
    found, at = [], 0
    for bearing in machine.bearings:
        axes = 2 if bearing.type == "radial" else 1
        found.append((np.linalg.norm(s[:, at : at + axes], axis=1), bearing.travel_limit))
        at += axes
    return found


def _recovery(off: Array, f_d: Array, band: float, T: float) -> float:
    """Return the time after the last change of a load until all axes stay within the band [s]."""
    changes = np.flatnonzero((np.diff(f_d, axis=0) != 0).any(axis=1)) + 1
    if not changes.size or len(off) - changes[-1] < 2:
        return math.nan
    beyond = np.flatnonzero((np.abs(off[changes[-1] :]) > band).any(axis=1))
    if not beyond.size:
        return 0.0
    last = int(beyond[-1]) + 1
    return math.inf if changes[-1] + last >= len(off) else T * last


def _flags(run: Run) -> list[int]:
    """Return in how many samples the estimator said each flag."""
    if run.estimate is None:
        return [0] * len(FLAGS)
    said: Any = np.asarray(run.estimate.status)
    return [int(np.count_nonzero(said & Status[name.upper()])) for name in FLAGS]
