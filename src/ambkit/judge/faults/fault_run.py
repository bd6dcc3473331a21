"""One flight through one fault, and what became of it."""

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

BEFORE, AFTER = 50.0, 160.0  #: Flight before a fault and after it, in the plant's time constants.
SETTLED = 30.0  #: From then on a clean flight counts [time constants].
QUIET = 120.0  #: Flight without a fault between two mixtures [time constants].

TIMES = 5.0
"""An error is back when it is within so many times the 99 % quantile of the clean flight's own."""

LAST = 0.2  #: Share of the flight after a fault by the end of which all must be back, and stay so.


@dataclass(frozen=True)
class Band:
    """What a clean flight keeps within, and its errors."""

    #: By x, v, f_d: 99 % quantile of the magnitude of the estimate's error [m], [m/s], [N].
    errors: dict[str, float]
    rms: dict[str, float]  #: The same errors' root mean squares.
    control: float  #: 99 % quantile of the control error |r - x| [m].


@dataclass(frozen=True)
class Outcome:
    """What became of one flight."""

    fault: str  #: Which.
    estimator: str
    precision: str
    #: Whether the controller was fed by it, or by the true measurement.
    setting: Literal["closed loop", "open loop"]
    seed: int  #: Of noise and fault.
    samples: int  #: Length of the flight.
    #: Whether mean, covariance, innovation and its variance were finite in every sample.
    finite: bool
    #: Whether the rotor met a stop, and whether it met it to the end.
    levitation: Literal["kept", "touched", "lost"]
    at_stop: float  #: Time on a stop [s].
    #: Samples until estimate and, in the loop, rotor were back and stayed so; the most of all
    #: faults in the flight. Counted from the fault's end; where the rotor was on a stop or, beside
    #: the loop, out of its own band, from when that ended. Infinity: never; NaN: the rotor never
    #: came back, so that there is nothing to judge.
    recovery: float
    worst_x: float  #: Greatest error of the estimate from the fault's begin on [m], [N].
    worst_f_d: float
    after_x: float  #: The same from the point on from which recovery is counted.
    after_f_d: float
    #: Root mean square error over the flight's last tenth, over the clean flight's own [1].
    final_x: float
    final_f_d: float
    held: bool  #: Whether the estimator still stood still at the end.

    @property
    def recovered(self) -> bool:
        """Whether all was finite, nothing stood still, and errors came back where that is known."""
        return self.finite and not self.held and self.recovery != math.inf


@dataclass(frozen=True)
class Flight:
    """A flight: who flies, how, and with what noise."""

    machine: Machine  #: The plant, and what the estimator knows.
    #: Its gains; what it is fed by is set here. None: the default of several axes.
    controller: PID | None
    #: Whether the controller is fed by the estimate, or, in open loop, by the true measurement.
    in_loop: bool
    seed: int  #: Of noise and fault.
    precision: Precision = "float64"  #: Of the estimator.
    reading: int = 0  #: Which of several readings the faults are of.
    plant: Any = None  #: A plant of the user's in place of the machine, see `Scenario`.

    @property
    def view(self) -> View:
        """Axes and readings."""
        return View(self.machine)

    @property
    def at(self) -> int:
        """Which axis the reading shows most of: faults that are none of a sensor are of it."""
        return int(np.argmax(np.abs(self.view.H @ self.view.displayed)[:, self.reading]))

    @property
    def axis(self) -> Machine:
        """That axis, alone: the measure of all faults."""
        return self.view.isolated[self.at]

    def _own(self, times: float) -> int:
        return max(1, round(times * own_time(self.axis) / self.machine.sampling_time))

    def through(self, fault: Fault) -> tuple[Channel, list[slice]]:
        """Return the flight's channel with one fault in it, and its window."""
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
        """Fly it; without an estimator the controller is fed by the measurement, fault and all."""
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
        """Return magnitudes of the estimate's errors, of several axes the greatest (n,)."""
        if run.estimate is None:
            return {}
        with np.errstate(over="ignore", invalid="ignore"):
            result = errors_along(run.estimate, run.record, self.view)
            return {name: np.abs(item).max(axis=0) for name, item in result.items()}

    def _off(self, record: Record) -> Array:
        """Return how far the axis is from its reference (n,) [m]."""
        name = self.view.machine.axes[self.at].name
        return np.asarray(np.abs(record[signal("r", name)] - self._places(record)[self.at]))

    def _places(self, record: Record) -> Array:
        """Return the rotor's displacements along the axes (p, n) [m]."""
        return np.array([record[displacement(axis.name)] for axis in self.view.machine.axes])

    def _stopped(self, record: Record) -> Mask:
        """Return where the rotor met a stop (n,)."""
        places = self._places(record)
        shares = [place / axis.clearance
                  for place, axis in zip(places, self.view.isolated, strict=True)]  # fmt: skip
        of = [item.bearing.name for item in self.view.machine.axes]
        rings = [np.linalg.norm([s for s, at in zip(shares, of, strict=True) if at == name], axis=0)
                 for name in dict.fromkeys(of)]  # fmt: skip
        return np.asarray(np.max(rings, axis=0) >= 1 - 1e-6)

    def band(self, run: Run) -> Band:
        """Return what a clean run keeps within."""
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
        """Say what became of a run."""
        record, n = run.record, len(run.record)
        errors = self._errors(run)
        off_rotor = self._off(record) > TIMES * band.control
        stopped = self._stopped(record)
        out = np.zeros(n, dtype=bool)
        for name, error in errors.items():
            out |= ~(error <= TIMES * band.errors[name])  # NaN is out
        if self.in_loop:
            out |= off_rotor
        begins = _begins(windows, n, stopped if self.in_loop else stopped | off_rotor)
        first = windows[0].start if windows else 0
        late = max((begin for begin, _ in begins if begin >= 0), default=n)
        recoveries = [_recovery(out[begin:end]) for begin, end in begins if begin >= 0]
        last = slice(n - max(1, n // 10), n)
        after = slice(late, n)

        def final(name: str) -> float:
            if name not in errors:
                return math.nan
            with np.errstate(over="ignore"):
                return float(np.sqrt(np.mean(errors[name][last] ** 2)) / band.rms[name])

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
            final_x=final("x"),
            final_f_d=final("f_d"),
            held=run.estimate is not None and _held(run.estimate),
        )


def _begins(windows: Sequence[slice], n: int, disturbed: Mask) -> list[tuple[int, int]]:
    """From where to where each fault's aftermath is judged; -1 where the rotor never came back."""
    results = []
    for place, window in enumerate(windows):
        end = windows[place + 1].start if place + 1 < len(windows) else n
        after = np.flatnonzero(disturbed[window.stop : end])
        begin = window.stop + (int(after[-1]) + 1 if after.size else 0)
        room = end - begin >= LAST * (end - window.stop)
        results.append((begin if room else -1, end))
    return results


def _recovery(out: Mask) -> float:
    """Samples until none is out any more; infinity where one still is in the last of them."""
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
    """Greatest error; infinity where one is not finite, NaN where there is none."""
    if name not in errors or errors[name][where].size == 0:
        return math.nan
    result = float(np.max(errors[name][where]))
    return result if math.isfinite(result) else math.inf


BASELINE = "measurement"
"""Stands for the loop without an estimator: the controller is fed by the measurement."""

SETTINGS = ("open loop", "closed loop")


def recovery_text(outcomes: Sequence[Outcome]) -> str:
    """Say in a word or a number of samples what became of the same flight over the seeds."""
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
