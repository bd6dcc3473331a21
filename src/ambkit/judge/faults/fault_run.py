"""One simulation with a fault, and its evaluation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, rms
from ambkit.control.control import Control, as_control
from ambkit.control.pid import PID
from ambkit.data.record import Record
from ambkit.data.signals import displacement, signal
from ambkit.estimate.estimate import Estimate, Status
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.machine_model import View
from ambkit.judge.comparison.criteria import errors_along
from ambkit.judge.faults.faults import Channel, Fault, mixture
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import Precision, own_time
from ambkit.machine.parts import GRAVITY
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import Run, simulate_run
from ambkit.simulation.scenario import Disturbance, Reference, Scenario
from ambkit.simulation.waveforms import Sine

Mask = NDArray[np.bool_]

BEFORE, AFTER = 50.0, 160.0  #: Duration before and after a fault, in time constants of the plant.
SETTLED = 30.0  #: Start of the evaluation of a fault-free run [time constants].
QUIET = 120.0  #: Duration without a fault between two mixtures [time constants].

TIMES = 5.0
"""Recovered means errors within this multiple of the fault-free run's 99 % quantile."""

LAST = 0.2  #: Share of the time after a fault by whose end all errors must have recovered for good.


@dataclass(frozen=True)
class Band:
    """Errors of a fault-free run."""

    #: By x, v, f_d: 99 % quantile of the magnitude of the estimation error [m], [m/s], [N].
    errors: dict[str, float]
    rms: dict[str, float]  #: Their root mean squares.
    control: float  #: 99 % quantile of the control error |r - x| [m].


@dataclass(frozen=True)
class Outcome:
    """Outcome of one run."""

    fault: str  #: Name of the fault.
    estimator: str
    precision: str
    #: Whether it fed the controller, or the true measurement did.
    setting: Literal["closed loop", "open loop"]
    seed: int  #: Seed of noise and fault.
    samples: int  #: Number of samples.
    #: Whether mean, covariance, innovation and its variance were finite in every sample.
    finite: bool
    #: Whether the rotor touched a stop, and whether it stayed there.
    levitation: Literal["kept", "touched", "lost"]
    at_stop: float  #: Time in contact [s].
    #: Samples until estimate and, in the loop, rotor had recovered for good; the maximum over all
    #: faults of the run. Counted from the end of the fault, or of contact or, in open loop, of the
    #: rotor's excursion. Infinity: never; NaN: the rotor did not recover, so that there is nothing
    #: to evaluate.
    recovery: float
    worst_x: float  #: Greatest error of the estimate from the fault's begin on [m], [N].
    worst_f_d: float
    after_x: float  #: The same from the point on from which recovery is counted.
    after_f_d: float
    #: Root mean square error over the last tenth of the run, over that of the fault-free run [1].
    final_x: float
    held: bool  #: Whether the estimator was held at the end.

    @property
    def recovered(self) -> bool:
        """Whether all was finite, nothing was held, and errors recovered where that is known."""
        return self.finite and not self.held and self.recovery != math.inf


@dataclass(frozen=True)
class Flight:
    """Setup of a run: machine, controller, estimator and noise."""

    machine: Machine  #: Plant, and prior of the estimator.
    #: Controller gains; its input is set here. None: the default controllers of several axes.
    controller: PID | None
    #: Whether the estimate feeds the controller; in open loop the true measurement does.
    in_loop: bool
    seed: int  #: Seed of noise and fault.
    precision: Precision = "float64"  #: Precision of the estimator.
    reading: int = 0  #: Index of the reading with the faults.
    plant: Any = None  #: The user's plant in place of the machine, see `Scenario`.

    @property
    def view(self) -> View:
        """Axes and readings."""
        return View(self.machine)

    @property
    def at(self) -> int:
        """Axis with the largest share in the reading: other faults act there."""
        return int(np.argmax(np.abs(self.view.measured)[:, self.reading]))

    @property
    def axis(self) -> Machine:
        """That isolated axis, the scale of all faults."""
        return self.view.isolated[self.at]

    def _own(self, times: float) -> int:
        return max(1, round(times * own_time(self.axis) / self.machine.sampling_time))

    def through(self, fault: Fault) -> tuple[Channel, list[slice]]:
        """Return the run's channel with one fault, and its window."""
        before, length = self._own(BEFORE), fault.length(self.axis)
        start = 0 if fault.name == "lift-off" else before
        channel = self._channel(before + length + self._own(AFTER))
        window = slice(start, start + length)
        fault.put(channel, window)
        return channel, [window]

    def mixed(self, steps: int) -> tuple[Channel, list[slice]]:
        """Return a channel of so many samples with mixtures of faults, and their windows."""
        before = self._own(BEFORE)
        channel = self._channel(steps)
        longest = self._own(1.0 if self.in_loop else 30.0)
        return channel, mixture(channel, before, self._own(QUIET), 1, max(2, longest))

    def _channel(self, n: int) -> Channel:
        return Channel(self.axis, n, self.precision, beside=not self.in_loop, seed=self.seed)

    def fly(self, channel: Channel, estimator: Estimator | None) -> Run:
        """Simulate; without an estimator the faulty measurement feeds the controller."""
        axis = self.axis
        weight, period = axis.rotor.mass * GRAVITY, own_time(axis)
        duration = (channel.n - 1) * axis.sampling_time
        reference = Sine(amplitude=0.1 * axis.clearance, frequency=1 / (40 * period))
        disturbance = Sine(amplitude=0.2 * weight, frequency=1 / (90 * period))
        feedback: Any = "estimate" if self.in_loop and estimator else "measurement"
        machine, k, controller = self.machine, self.at, self.controller or Control()
        p, name = len(machine.axes), machine.axes[k].name
        force = np.outer(channel.force, np.arange(p) == k)
        faults = channel.faults.among(self.reading, len(machine.readings), k, p)
        scenario = Scenario(
            duration=duration, seed=self.seed, plant=self.plant,
            reference=(Reference(axis=name, position=reference),),
            disturbance=(Disturbance(axis=name, force=disturbance),),
            controller=as_control(controller).fed_by(feedback),
        )  # fmt: skip
        external_inputs = ExternalInputs(force, faults=faults, place=channel.place)
        return simulate_run(machine, scenario, estimator=estimator, external_inputs=external_inputs)

    def _errors(self, run: Run) -> dict[str, Array]:
        """Return magnitudes of the estimation errors, the maximum over the axes (n,)."""
        if run.estimate is None:
            return {}
        with np.errstate(over="ignore", invalid="ignore"):
            result = errors_along(run.estimate, run.record, self.view)
            return {name: np.abs(item).max(axis=0) for name, item in result.items()}

    def _off(self, record: Record) -> Array:
        """Return the distance of the axis from its reference (n,) [m]."""
        name = self.view.machine.axes[self.at].name
        return np.asarray(np.abs(record[signal("r", name)] - self._places(record)[self.at]))

    def _places(self, record: Record) -> Array:
        """Return the rotor's displacements along the axes (p, n) [m]."""
        return np.array([record[displacement(axis.name)] for axis in self.view.machine.axes])

    def _stopped(self, record: Record) -> Mask:
        """Return contact (n,)."""
        places = self._places(record)
        shares = [place / axis.clearance
                  for place, axis in zip(places, self.view.isolated, strict=True)]  # fmt: skip
        of = [item.bearing.name for item in self.view.machine.axes]
        rings = [np.linalg.norm([s for s, at in zip(shares, of, strict=True) if at == name], axis=0)
                 for name in dict.fromkeys(of)]  # fmt: skip
        return np.asarray(np.max(rings, axis=0) >= 1 - 1e-6)

    def band(self, run: Run) -> Band:
        """Return the errors of a fault-free run."""
        first, record = self._own(SETTLED), run.record
        errors = {name: e[first:] for name, e in self._errors(run).items()}
        control = self._off(record)[first:]
        return Band(
            {name: float(np.quantile(e, 0.99)) for name, e in errors.items()},
            {name: rms(e) for name, e in errors.items()},
            float(np.quantile(control, 0.99)),
        )

    def evaluate(
        self, run: Run, windows: Sequence[slice], band: Band, *, fault: str, estimator: str
    ) -> Outcome:
        """Evaluate a run."""
        record, n = run.record, len(run.record)
        errors = self._errors(run)
        off_rotor = self._off(record) > TIMES * band.control
        stopped = self._stopped(record)
        out = np.zeros(n, dtype=bool)
        for name, error in errors.items():
            out |= ~(error <= TIMES * band.errors[name])  # NaN counts as out
        if self.in_loop:
            out |= off_rotor
        begins = _begins(windows, n, stopped if self.in_loop else stopped | off_rotor)
        first = windows[0].start if windows else 0
        late = max((begin for begin, _ in begins if begin >= 0), default=n)
        recoveries = [_recovery(out[begin:end]) for begin, end in begins if begin >= 0]
        last = slice(n - max(1, n // 10), n)
        after = slice(late, n)
        final_x = math.nan
        if "x" in errors:
            with np.errstate(over="ignore"):
                final_x = float(np.sqrt(np.mean(errors["x"][last] ** 2)) / band.rms["x"])
        tail = slice(n - max(1, round(LAST * (n - (windows[-1].stop if windows else 0)))), n)
        lost = bool(stopped[tail].any())
        return Outcome(
            fault=fault,
            estimator=estimator,
            precision=self.precision,
            setting="closed loop" if self.in_loop else "open loop",
            seed=self.seed,
            samples=n,
            finite=run.estimate is None or _finite(run.estimate),
            levitation="lost" if lost else "touched" if stopped.any() else "kept",
            at_stop=float(stopped.sum() * self.machine.sampling_time),
            recovery=max(recoveries, default=math.nan),
            worst_x=_greatest(errors, "x", slice(first, n)),
            worst_f_d=_greatest(errors, "f_d", slice(first, n)),
            after_x=_greatest(errors, "x", after),
            after_f_d=_greatest(errors, "f_d", after),
            final_x=final_x,
            held=run.estimate is not None and _held(run.estimate),
        )


def _begins(windows: Sequence[slice], n: int, disturbed: Mask) -> list[tuple[int, int]]:
    """Return start and end of the evaluation of each fault; -1 if the rotor never recovered."""
    results = []
    for place, window in enumerate(windows):
        end = windows[place + 1].start if place + 1 < len(windows) else n
        after = np.flatnonzero(disturbed[window.stop : end])
        begin = window.stop + (int(after[-1]) + 1 if after.size else 0)
        room = end - begin >= LAST * (end - window.stop)
        results.append((begin if room else -1, end))
    return results


def _recovery(out: Mask) -> float:
    """Return the samples until all errors are within for good; infinity if not at the end."""
    where = np.flatnonzero(out)
    last = int(where[-1]) + 1 if where.size else 0
    return math.inf if last > (1 - LAST) * out.size else float(last)


def _finite(estimate: Estimate) -> bool:
    series = [estimate.mean, estimate.innovation, estimate.innovation_variance]
    series += [item for item in (estimate.covariance, estimate.scale) if item is not None]
    return all(bool(np.isfinite(item).all()) for item in series)


def _held(estimate: Estimate) -> bool:
    return bool((estimate.status[-10:] & np.uint16(Status.HELD)).all())


def _greatest(errors: dict[str, Array], name: str, where: slice) -> float:
    """Return the largest error; infinity if one is not finite, NaN if there is none."""
    if name not in errors or errors[name][where].size == 0:
        return math.nan
    result = float(np.max(errors[name][where]))
    return result if math.isfinite(result) else math.inf


BASELINE = "measurement"
"""Name of the loop without an estimator: the measurement feeds the controller."""

SETTINGS = ("open loop", "closed loop")


def recovery_text(outcomes: Sequence[Outcome]) -> str:
    """Return the recovery over the seeds, as a word or a number of samples."""
    if not outcomes:
        return ""
    if any(not outcome.finite for outcome in outcomes):
        return "not finite"
    if any(outcome.levitation == "lost" for outcome in outcomes):
        return "lost"
    if any(outcome.held for outcome in outcomes):
        return "held"
    worst = float(np.max([outcome.recovery for outcome in outcomes]))
    if math.isnan(worst):
        return "lost"
    return "never" if math.isinf(worst) else f"{worst:.0f}"
