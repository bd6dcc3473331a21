"""What a run is judged by, from its truth: figures by name, and how often each flag was said."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.signals import signal
from ambkit.estimate.estimate import Status
from ambkit.machine import geometry
from ambkit.models.parts.rotor import velocity_of

if TYPE_CHECKING:
    from ambkit.estimate.estimator import Estimator
    from ambkit.machine.machine import Machine
    from ambkit.simulation.run import Run


class Figure(NamedTuple):
    """A number that a run is judged by."""

    unit: str
    """SI."""
    about: str
    """What it is, in a sentence; of several axes it is of the worst, where it is of an axis."""
    only: Literal["single", "several", ""] = ""
    """Which runs have it: those of a single axis, those of several, or all."""


FIGURES: dict[str, Figure] = {
    "x_rms": Figure("m", "RMS error of the estimated position."),
    "v_rms": Figure("m/s", "RMS error of the estimated velocity."),
    "f_d_rms": Figure("N", "RMS error of the estimated disturbance force."),
    "x_peak": Figure("m", "Greatest magnitude of the position's error."),
    "v_peak": Figure("m/s", "Greatest magnitude of the velocity's error."),
    "f_d_peak": Figure("N", "Greatest magnitude of the disturbance force's error."),
    "nis": Figure("1", "Mean normalised innovation squared of the measurements taken in."),
    "tracking_rms": Figure("m", "RMS control error, reference less position."),
    "tracking_peak": Figure("m", "Greatest magnitude of the control error."),
    "effort": Figure("A", "RMS change of the current asked for from sample to sample."),
    "displacement_peak": Figure("m", "Farthest that the rotor was from the centre at a sample."),
    "current_peak": Figure("A", "Greatest magnitude of the control current just after a sample."),
    "overshoot": Figure("1", "Overshoot of the last step of the reference, before a load.",
                        "single"),
    "settling": Figure("s", "Time after that step until the rotor stays within 5 % of it; infinity "
                       "where it does not.", "single"),
    "recovery": Figure("s", "Time after the last change of the load until the rotor stays within "
                       "the band around the reference; infinity where it does not."),
    "load_kept": Figure("N", "Greatest magnitude of the loads together before the rotor first met "
                        "a stop."),
    "touched": Figure("1", "Samples in which a stop was touched."),
    "landed": Figure("1", "1 where the rotor touched a stop in the last sample, else 0.", "single"),
    "orbit_peak": Figure("m", "Farthest that the rotor was from the middle of a bearing at a "
                         "sample, both axes together, after the settling.", "several"),
    "orbit_share": Figure("1", "The same as a share of the travel in that bearing, of the worst "
                          "bearing.", "several"),
}  # fmt: skip
"""All figures by name, in the order of the arrays; NaN where one does not apply to a run."""

FLAGS = tuple(str(flag.name).lower() for flag in Status if flag)
"""Names of what a step had to say."""


def figures_for(machine: Machine | None) -> dict[str, Figure]:
    """Return the figures of the runs of a machine; of an unknown one those of a single axis."""
    other = "several" if machine is None or machine.single else "single"
    return {name: figure for name, figure in FIGURES.items() if figure.only != other}


def figures_of(
    run: Run, estimator: Estimator | None, settling: float = 0.0, band: float = 0.05
) -> dict[str, float]:
    """Return what a run is judged by."""
    machine, record = run.machine, run.record
    names = [axis.name for axis in machine.axes]
    travel = np.array([axis.bearing.clearance for axis in machine.axes])
    first = first_of(settling, machine.sampling_time, len(record))
    s, r, iu, f_d = (np.column_stack([record[f"{of}_{name}"] for name in names])
                     for of in ("s", "r", "iu", "f_d"))  # fmt: skip
    off = r - s
    result = dict.fromkeys(figures_for(machine), math.nan)
    result |= {
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
    result["orbit_peak"] = max(float(far.max()) for far, _ in orbits)
    result["orbit_share"] = max(float(far.max()) / travel for far, travel in orbits)
    estimate = run.estimate
    if estimate is not None and estimator is not None:
        errors = errors_of(run, estimator)
        for name, error in errors.items():
            result[f"{name}_rms"] = _rms(error[first:])
            result[f"{name}_peak"] = float(np.abs(error[first:]).max())
        nis = np.asarray(estimate.nis[first:])
        finite_nis = nis[np.isfinite(nis)]
        result["nis"] = float(finite_nis.mean()) if finite_nis.size else math.nan
    return result


def errors_of(run: Run, estimator: Estimator) -> dict[str, Array]:
    """Return the errors of x, v and f_d along the axes, sample by sample (n, p) [m], [m/s], [N]."""
    # Without f_d where the estimator has no loads among its states.
    machine, record, estimate = run.machine, run.record, run.estimate
    assert estimate is not None
    names = [axis.name for axis in machine.axes]
    x, v = (
        np.asarray(estimate.mean) @ rows.T for rows in estimator.view.along_axes(estimate.states)
    )
    velocities = [record[f"q_{velocity_of(position)}"] for position in machine.positions]
    H = geometry.matrix([axis.line for axis in machine.axes], machine.positions)
    results = {
        "x": x - np.column_stack([record[signal("s", name)] for name in names]),
        "v": v - np.column_stack(velocities) @ H.T,
    }
    loads = {state.name for state in estimate.states if state.role == "disturbance force"}
    if {signal("f_d", name) for name in names} <= loads:
        wrong = [estimate[signal("f_d", name)] - record[signal("f_d", name)] for name in names]
        results["f_d"] = np.column_stack(wrong)
    return results


def _rms(of_axes: Array) -> float:
    """Return the root mean square of the worst axis of signals (n, p)."""
    return float(np.sqrt(np.max(np.mean(of_axes**2, axis=0), initial=0.0)))


def _orbits(machine: Machine, s: Array) -> list[tuple[Array, float]]:
    """Return of each bearing how far the rotor is from its middle (n,), and the travel [m]."""
    result, at = [], 0
    for bearing in machine.bearings:
        axes = 2 if bearing.type == "radial" else 1
        result.append((np.linalg.norm(s[:, at : at + axes], axis=1), bearing.clearance))
        at += axes
    return result


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


def flags_of(run: Run) -> list[int]:
    """Return in how many samples the estimator said each flag."""
    if run.estimate is None:
        return [0] * len(FLAGS)
    status: Any = np.asarray(run.estimate.status)
    return [int(np.count_nonzero(status & Status[name.upper()])) for name in FLAGS]


def first_of(settling: float, T: float, n: int) -> int:
    """Return the first sample that errors count from."""
    first = max(1, round(settling / T))
    if first >= n:
        raise ValueError(
            f"settling must be less than the {(n - 1) * T:g} s of a run, is {settling:g} s"
        )
    return first
