"""Many closed loops of the nonlinear plant in one call, for Monte Carlo and campaigns."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.data.record import Record
from ambkit.estimate.base import Estimator
from ambkit.estimate.estimate import Estimate, Status
from ambkit.machine.bearing import Bearing
from ambkit.machine.magnets import MagnetModel
from ambkit.simulation.run import Imposed, Run, simulate_run
from ambkit.simulation.scenario import Scenario

Array = NDArray[np.float64]

LEAST = 50
"""Samples that a step, or a load, must be followed by to be judged."""


class Figure(NamedTuple):
    """A number that a run is judged by."""

    unit: str
    """SI."""
    about: str
    """What it is, in a sentence."""


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
    "overshoot": Figure("1", "Overshoot of the last step of the reference, before a load."),
    "settling": Figure("s", "Time after that step until the rotor stays within 5 % of it; infinity "
                       "where it does not."),
    "recovery": Figure("s", "Time after the last change of the load until the rotor stays within "
                       "the band around the reference; infinity where it does not."),
    "load_kept": Figure("N", "Greatest magnitude of the load before the rotor first met a stop."),
    "touched": Figure("1", "Samples in which a stop was touched."),
    "landed": Figure("1", "1 where the rotor touched a stop in the last sample, else 0."),
}  # fmt: skip
"""All figures by name, in the order of the arrays; NaN where one does not apply to a run."""

OF_ESTIMATES = ("x_rms", "v_rms", "f_d_rms", "x_peak", "v_peak", "f_d_peak", "nis")
"""Those that a run without an estimator has not."""

FLAGS = tuple(str(flag.name).lower() for flag in Status)
"""Names of what a step had to say."""


@dataclass(frozen=True, slots=True)
class Planned:
    """One run of many: what is simulated, and with which noise.

    Attributes
    ----------
    bearing, scenario : Bearing, Scenario
        The plant, and what happens to it, the controller among it.
    estimator, magnet, imposed
        As for :func:`ambkit.simulation.run.simulate_run`. The estimator is not changed, and one may
        serve all runs: each begins afresh.
    number : int, optional
        Number of the run, which is with the scenario's seed the key of its noise, in place of
        ``scenario.run``.
    """

    bearing: Bearing
    scenario: Scenario
    estimator: Estimator | None = None
    magnet: MagnetModel | None = None
    imposed: Imposed | None = None
    number: int | None = None

    def simulated(self) -> Run:
        """Simulate it by itself, with every sample kept."""
        scenario = self.scenario
        if self.number is not None:
            scenario = scenario.model_copy(update={"run": self.number})
        return simulate_run(
            self.bearing, scenario, estimator=self.estimator, magnet=self.magnet,
            imposed=self.imposed,
        )  # fmt: skip


@dataclass(frozen=True)
class Many:
    """What many runs gave, in their order.

    Attributes
    ----------
    figures : mapping of str to ndarray (runs,)
        By the names of :data:`FIGURES`, in SI; NaN where one does not apply.
    status : mapping of str to ndarray of int64 (runs,)
        By the names of :class:`ambkit.Status` in lower case: samples at which the estimator said so.
    traces : mapping of int to Run
        Of those that were asked for, by their place, with all samples.
    """

    figures: Mapping[str, Array]
    status: Mapping[str, NDArray[np.int64]]
    traces: Mapping[int, Run] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.figures["touched"])

    def columns(self) -> dict[str, NDArray[np.float64] | NDArray[np.int64]]:
        """Return all figures and, as ``samples_missing`` and so on, the counts of flags."""
        return {**self.figures, **{f"samples_{name}": n for name, n in self.status.items()}}


class Windows(NamedTuple):
    """Where the figures of a run are taken; sample numbers."""

    first: int
    """The first that errors count from."""
    step: tuple[int, int, float] | None
    """The last step of the reference: begin, end (the next change), height [m]."""
    load: int | None
    """The last change of the load."""


def windows(r: Array, f_d: Array, first: int) -> Windows:
    """Find where a step response and a recovery can be seen.

    Parameters
    ----------
    r, f_d : ndarray (n,)
        Reference [m] and load [N].
    first : int
        The first sample that errors count from.
    """
    n = len(r)
    steps, loads = np.flatnonzero(np.diff(r)) + 1, np.flatnonzero(np.diff(f_d)) + 1
    step = load = None
    if steps.size:
        start = int(steps[-1])
        later = loads[loads > start]
        stop = int(later[0]) if later.size else n
        # A load that never rests leaves no step response to be seen.
        if later.size <= 1 and stop - start >= LEAST:
            step = start, stop, float(r[start] - r[start - 1])
    if loads.size and n - loads[-1] >= LEAST and not (steps.size and steps[-1] > loads[-1]):
        load = int(loads[-1])
    return Windows(first, step, load)


def simulate_many(
    runs: Iterable[Planned],
    *,
    settling: float = 0.0,
    band: float = 0.05,
    traces: Collection[int] = (),
    threads: int | None = None,
    instructions: str | None = None,
    done: Callable[[int], None] | None = None,
) -> Many:
    """Simulate many closed loops and judge each by the truth, without keeping its samples.

    The numbers are those of `simulate_run`, run by run and to the last bit, whatever the order, the
    threads, the lanes and what else is in the batch.

    Parameters
    ----------
    runs : iterable of Planned
        Any mixture; taken one after another, so that 10^6 of them need not be there at once.
    settling : float
        Time at the start of each run that errors leave out [s]; the first sample always is.
    band : float
        Control error that a rotor has recovered within, as a share of its travel limit.
    traces : collection of int
        Places of runs whose samples are kept.
    threads : int, optional
        Default: as many as the process may use.
    instructions : str, optional
        One of :func:`ambkit.estimate.batch.instruction_sets`; default: the fastest.
    done : callable, optional
        Called now and then with the number of runs that were finished since the last call.

    Returns
    -------
    Many

    Raises
    ------
    ValueError
        A run has no sample after the settling, or a trace is asked of a run that is not there.

    Examples
    --------
    >>> bearing = ambkit.Bearing.preset("zittau_axial")
    >>> scenario = ambkit.Scenario(duration=0.1, seed=1)
    >>> kalman = ambkit.KalmanFilter(bearing)
    >>> runs = [Planned(bearing, scenario, kalman, number=k) for k in range(20)]
    >>> simulate_many(runs).figures["f_d_rms"].shape
    (20,)
    """
    rows: list[Array] = []
    counts: list[NDArray[np.int64]] = []
    kept: dict[int, Run] = {}
    for place, planned in enumerate(runs):
        run = planned.simulated()
        if place in traces:
            kept[place] = run
        rows.append(_judged(run, planned.bearing, settling, band))
        counts.append(_counted(run.estimate))
        if done is not None:
            done(1)
    if missing := set(traces) - kept.keys():
        raise ValueError(f"traces holds {min(missing)}, and there are {len(rows)} runs")
    table = np.array(rows).reshape(len(rows), len(FIGURES))
    flags = np.array(counts, dtype=np.int64).reshape(len(rows), len(FLAGS))
    return Many(
        dict(zip(FIGURES, table.T.copy(), strict=True)),
        dict(zip(FLAGS, flags.T.copy(), strict=True)),
        kept,
    )


def _judged(run: Run, bearing: Bearing, settling: float, band: float) -> Array:
    """Return the figures of a run in their order."""
    record, estimate, T = run.record, run.estimate, bearing.sampling_time
    first = first_of(settling, T, len(record))
    where = windows(record["r"], record["f_d"], first)
    away, gain = record["r"] - record["x"], bearing.amplifier.gain
    found = dict.fromkeys(FIGURES, np.nan)
    if estimate is not None:
        for name in ("x", "v", "f_d"):
            error = (estimate[name] - record[name])[first:]
            found[f"{name}_rms"], found[f"{name}_peak"] = _rms(error), float(np.abs(error).max())
        nis = estimate.nis[first:][estimate.used[first:]]
        if np.isfinite(nis).any():
            found["nis"] = float(np.nanmean(nis))
    found["tracking_rms"] = _rms(away[first:])
    found["tracking_peak"] = float(np.abs(away[first:]).max())
    found["effort"] = gain * _rms(np.diff(record["u"][first:]))
    found["displacement_peak"] = float(np.abs(record["x"]).max())
    found["current_peak"] = float(np.abs(record["iu"]).max())
    found |= _responses(record, where, band * bearing.rotor.travel_limit)
    return np.array(list(found.values()))


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2))) if error.size else float("nan")


def _responses(record: Record, where: Windows, band: float) -> dict[str, float]:
    """Return what became of the last step and of the last load, and what stops were met."""
    r, x, f_d, T = record["r"], record["x"], record["f_d"], record.sampling_time
    found = {}
    if where.step is not None:
        start, stop, height = where.step
        way = (x[start:stop] - r[start]) / height  # -1 before, 0 there
        found["overshoot"] = max(0.0, float(way.max()))
        found["settling"] = _stays(np.abs(way) > 0.05, T)
    if where.load is not None:
        found["recovery"] = _stays(np.abs(r - x)[where.load :] > band, T)
    bearing = Bearing.from_toml(record.meta["bearing"])
    at_stop = np.abs(x) >= (1 - 1e-12) * bearing.rotor.travel_limit
    met = int(np.argmax(at_stop)) if at_stop.any() else len(record)
    found["load_kept"] = float(np.abs(f_d[: max(met, 1)]).max())
    found["touched"] = float(record.meta["stop_touched"])
    found["landed"] = float(at_stop[-1])
    return found


def _stays(outside: NDArray[np.bool_], T: float) -> float:
    """Return after which time a signal stays inside [s]; infinity: not within the window."""
    last = np.flatnonzero(outside)
    if not last.size:
        return 0.0
    return float("inf") if last[-1] == outside.size - 1 else float((last[-1] + 1) * T)


def first_of(settling: float, T: float, n: int) -> int:
    """Return the first sample that errors count from.

    Parameters
    ----------
    settling, T : float
        What is left out, and the sampling time [s].
    n : int
        Samples.

    Raises
    ------
    ValueError
        There is none.
    """
    first = max(1, round(settling / T))
    if first >= n:
        raise ValueError(
            f"settling must be less than the {(n - 1) * T:g} s of a run, is {settling:g}"
        )
    return first


def _counted(estimate: Estimate | None) -> NDArray[np.int64]:
    if estimate is None:
        return np.zeros(len(FLAGS), dtype=np.int64)
    each = estimate.status[:, None] & np.array([int(flag) for flag in Status], np.uint16)
    return np.asarray(np.count_nonzero(each, axis=0))
