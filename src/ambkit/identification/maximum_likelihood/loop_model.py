"""Model of a record: a machine, with parameters of the log (delay, offsets, disturbance)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from ambkit.base.arrays import Array, Bools
from ambkit.data.record import Record
from ambkit.estimate.batch import processors, run_many
from ambkit.estimate.estimate import Status
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import ExtendedKalmanFilter
from ambkit.estimate.noise_model import FilterNoise
from ambkit.identification.dead_time import delayed, lag_of, lagged, limited
from ambkit.identification.maximum_likelihood.gaps import filled, run_with_gaps
from ambkit.machine.accessories import LONGEST_DELAY, SHORTEST_LAG
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, MagnetModel, magnet_of
from ambkit.machine.parts import GRAVITY

Innovations = tuple[Array, Array, Bools]
"""Innovations [m] and variances [m^2] of the samples (n,), and whether they count."""


@dataclass(frozen=True)
class LoopModel:
    """A machine with parameters of its log."""

    #: Parameters that its records cannot determine, with reasons.
    described: ClassVar[Mapping[str, str]] = MappingProxyType({})
    taken_as_known: ClassVar[Sequence[str]] = ()  #: What no standard error includes, in sentences.

    isolated: Machine  #: Magnet, rotor, amplifier and sensor.
    #: Time from a logged control signal to its effect in the logged position [s], of the complete
    #: loop; NaN: the machine's own. With a fraction f of a step the mean control of each step is
    #: ``(1 - f) u[k] + f u[k - 1]``, exact for the momentum; of the position see `offset_error`.
    delay: float = math.nan
    #: Time constant from the logged control signal to the acting current [s]: amplifier, coil and
    #: eddy currents; 0: none; NaN: that of the amplifier's bandwidth.
    current_lag: float = math.nan
    position_offset: float = 0.0  #: Measured position of a rotor at x = 0 [m].
    current_offset: float = 0.0  #: Control current at a control signal of zero [A].
    #: Process noise intensity of the disturbance force [N^2/s].
    disturbance_noise: float = math.nan
    #: Prior standard deviation of the initial disturbance, with mean zero [N]; NaN: the weight.
    load_std: float = math.nan
    magnet: MagnetModel | None = None  #: Magnet model, if it is not the machine's own.
    #: Steps of the filter per sample. The magnet force is held over a step: with one per sample the
    #: error would exceed the uncertainty from a second of record.
    substeps: int = 4
    #: Whether the logged control signal is a measured current, interpolated between samples, and
    #: not a held control signal. The half sample between the two is no delay.
    line: bool = False
    #: Correlation time of the current's deviation from the control signal [s], for a current
    #: smoothed from both (``current.py``); 0: white noise on the control.
    memory: float = 0.0
    #: (float, float) Prior of parameters by name: value and standard deviation [SI].
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    #: (Array, Array) What other structures add to reading [m] and control [V], by id(record).
    structures: Mapping[int, tuple[Array, Array]] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        b, weight = self.isolated, self.isolated.rotor.mass * GRAVITY
        own = {
            "delay": b.delay or 0.0,
            "current_lag": lag_of(b),
            "disturbance_noise": (2 * weight) ** 2,
        }
        for name, value in own.items():
            if math.isnan(getattr(self, name)):
                object.__setattr__(self, name, value)

    @property
    def undelayed_machine(self) -> Machine:
        """The machine without current lag, for signals that are delayed already."""
        return _late(self.isolated, 0.0, 0.0)

    def delayed_machine(self, *, delay: bool = True) -> Machine:
        """Return the machine with the model's delay and current lag as its own."""
        T = self.isolated.sampling_time
        held = self.delay - (0.5 * T if self.line else 0.0)  # control of a filter with steps
        known = delay and 0 < held <= LONGEST_DELAY * T
        return _late(self.isolated, held if known else 0.0, self.current_lag)

    def kalman(self) -> Estimator:
        """Return the filter of this model, in the C core, with its steps."""
        b = _late(self.with_mean_force, 0.0, self.memory)
        # Independent in each step, with the same sum; the identified noise includes rounding.
        noise = {"noise_variance": self.substeps * b.amplifier.noise_variance}
        finer = _changed(
            b, amplifier=noise, sensor={"quantisation": None},
            sampling_time=b.sampling_time / self.substeps,
        )  # fmt: skip
        return self._filter(finer, self.magnet or magnet_of(b))

    def has_filter_of(self, other: LoopModel) -> bool:
        """Return whether the filter of another model serves this one, with other signals."""
        own = ("isolated", "substeps", "magnet", "memory", "disturbance_noise")
        return all(getattr(self, name) is getattr(other, name) for name in own)

    def _filter(self, finer: Machine, magnet: MagnetModel) -> Estimator:
        return ExtendedKalmanFilter(
            finer,
            magnet,
            noise=FilterNoise(disturbance=self.disturbance_noise),
            outlier_limit=0,  # rejected samples would favour a wrong model
        )

    @property
    def signals(self) -> tuple[str, str]:
        """Names of its measurement and its control signal in a log."""
        return "y", "u"

    @property
    def reading(self) -> int:
        """Index of its measurement among those of the filter."""
        return 0

    @property
    def with_mean_force(self) -> Machine:
        """The machine with the mean force under current noise as its force."""
        # The force of a coil is quadratic in its current, and a variance V of the current adds to
        # the square as a bias current does, ``i0^2 + V``. The gain decreases accordingly, so that
        # the effect of the control signal is unchanged. The effect is small, 0.2 % of k_s for a
        # noise of 4 % of the bias current, but visible in many records.
        b, i0 = self.isolated, self.isolated.magnet.bias_current
        if self.magnet is not None or b.magnet.force_map is not None or not i0 > 0:
            return b
        raised = math.hypot(i0, b.amplifier.gain * math.sqrt(b.amplifier.noise_variance))
        gain = b.amplifier.gain * i0 / raised
        return _changed(b, magnet={"bias_current": raised}, amplifier={"gain": gain})

    def corrected(self, record: Record) -> Record:
        """Return the record corrected for offsets, delay and current lag."""
        T, b = self.isolated.sampling_time, self.isolated
        acting = delayed(lagged(self.between(record["u"]), T, self.current_lag), self.delay / T)
        signals = {name: record[name] for name in record} | {
            "y": record["y"] - self.position_offset,
            "u": acting + self.current_offset / b.amplifier.gain,
        }
        return Record(record.t, signals, record.units, record.meta)

    def between(self, u: Array) -> Array:
        """Return the mean of a logged control signal (n,) over each sample."""
        if not self.line:
            return u
        following = np.append(u[1:], u[-1:])
        return np.where(np.isfinite(following), 0.5 * (u + following), u)

    def mean_point(self, records: Sequence[Record]) -> tuple[float, float]:
        """Return mean control current [A] and displacement [m] of some records."""
        b, corrected = self.isolated, [self.corrected(record) for record in records]
        u, y = (np.concatenate([one[signal] for one in corrected]) for signal in ("u", "y"))
        return float(b.amplifier.gain * np.nanmean(u)), float(np.nanmean(y) / b.sensor.gain)

    def innovations(self, record: Record, kalman: Estimator | None = None) -> Innovations:
        """Run the filter along a record."""
        out, _, _ = self.run(record, kalman)
        return self._at_samples(out["innovation"], out["variance"], out["status"])

    def _at_samples(self, innovation: Array, variance: Array, status: Any) -> Innovations:
        every = slice(None, None, self.substeps)
        return innovation[every], variance[every], status[every] & NOT_USED == 0

    def states(self, record: Record) -> dict[str, Array]:
        """Return the filtered states along a record by name, (n,) each, SI."""
        out, _, kalman = self.run(record)
        means = out["mean"][:: self.substeps]
        return {state.name: means[:, k] for k, state in enumerate(kalman.states)}

    def predict(self, record: Record, ahead: int) -> Array:
        """Predict the measurement some samples ahead, with the control signals since."""
        # returns (n - ahead,)
        out, u, kalman = self.run(record)
        steps = ahead * self.substeps
        fine = kalman.core.forecast(np.ascontiguousarray(out["mean"]), u, steps)[:, self.reading]
        missed = self.offset_error(record["u"])[ahead:]
        return np.asarray(fine[:: self.substeps][: missed.size]) + self.position_offset + missed

    def predict_with(self, record: Record, ahead: int, controls: Array, past: int) -> Array:
        """Predict the measurement some samples ahead, with given controls."""
        # controls (m, past + f) [V]; returns (m,) [m]
        out, u, kalman = self.run(record)
        count, every, steps = len(controls), self.substeps, ahead * self.substeps
        first = (past - 1) * every
        acting = self._delayed_control(controls.ravel()).reshape(count, -1)[:, first:][:, :steps]
        mean = out["mean"][::every][len(record) - count :]
        begun = np.repeat(np.concatenate([mean, mean[-1:]]), steps, axis=0)
        u = self._inputs(np.vstack([acting, np.zeros(steps)]), u[(len(record) - count) * every :])
        seen = kalman.core.forecast(np.ascontiguousarray(begun), u, steps)[::steps, self.reading]
        missed = self.offset_error(record["u"])[len(record) - count :]
        return np.asarray(seen[:count]) + self.position_offset + missed

    def _inputs(self, own: Array, _u: Array) -> Array:
        """Return the filter's inputs in sequence, given those of its axis (m, steps)."""
        return own.ravel()

    def _delayed_control(self, u: Array) -> Array:
        """Return the acting control at the filter's steps, of a control signal (n,) [V]."""
        h = self.isolated.sampling_time / self.substeps
        return delayed(lagged(self._at_steps(u), h, self.current_lag), self.delay / h)

    def offset_error(self, u: Array) -> Array:
        """Return the difference of the filter's measurement to the true one [m]."""
        # If a held control signal switches within a step, the mean force gives the exact momentum,
        # and a position error of ``f (1 - f)/2 h^2`` times the step of the acceleration. The sum
        # over all previous steps is proportional to the last value of the control signal, through
        # the sensor's lag. It is nanometres; but with a sensor of half a micrometre and a strong
        # excitation k was 0.5 % too small. u (n,) [V]
        b, h = self.isolated, self.isolated.sampling_time / self.substeps
        part = self.delay / h - math.floor(self.delay / h)
        stepless = self.line or self.memory > 0 or self.current_lag >= SHORTEST_LAG * h
        if stepless or part == 0 or b.magnet.force_map is not None or self.magnet is not None:
            return np.zeros(u.size)
        from scipy.signal import lfilter

        stiffness = ConstantStiffness.of(b).k_i / b.rotor.mass * b.amplifier.gain
        steps = np.repeat(filled(u), self.substeps)
        last = delayed(steps, math.floor(self.delay / h) + 1)[:: self.substeps]
        keep = math.exp(-b.sampling_time / b.sensor.lag)
        seen = lfilter([1 - keep], [1.0, -keep], last - last[0])
        return np.asarray(-0.5 * part * (1 - part) * h * h * stiffness * b.sensor.gain * seen)

    def run(
        self, record: Record, kalman: Estimator | None = None
    ) -> tuple[dict[str, Any], Array, Estimator]:
        """Run the filter with its finer steps; between two samples there is no measurement."""
        h = self.isolated.sampling_time / self.substeps
        kalman = kalman or self.kalman()
        y, u = self.acting_signals(record)
        kalman.reset(*self.begin(kalman, y, record["u"][:1]))
        missing = ~np.isfinite(record["u"])
        if not missing.any():
            return kalman.core.run(y, u), u, kalman
        unknown = delayed(np.repeat(missing, self.substeps).astype(float), self.delay / h) > 0
        return run_with_gaps(kalman, self.isolated, y, u, unknown, record["u"], h), u, kalman

    def acting_signals(self, record: Record) -> tuple[Array, Array]:
        """Return the filter's measurements at its steps [m], and the acting control [V]."""
        u = self._delayed_control(record["u"])
        y = np.full(u.size, np.nan)
        y[:: self.substeps] = record["y"] - self.position_offset - self.offset_error(record["u"])
        return self.moved(y, u, *self.structures.get(id(record), (0.0, 0.0)))

    def moved(self, y: Array, u: Array, reading: Any, control: Any) -> tuple[Array, Array]:
        """Return signals without a part of its reading, and with more of its control."""
        return y - reading, u + control

    def begin(self, kalman: Estimator, y: Array, u: Array) -> tuple[Array, list[float]]:
        """Return mean and standard deviations of a filter at rest at its first measurement [m]."""
        # A current that is a state starts at its value in the record, with twice its later
        # variance, because only later samples determine it. If it were unknown, the first
        # measurements would move it by amperes, far outside the linear range of the magnet. y (n,)
        # [m]; u (1,) [V]
        b, known = self.isolated, y[np.isfinite(y)]
        first = float(known[0]) if known.size else 0.0
        std = dict(zip((s.name for s in kalman.states), kalman.default_std(), strict=True))
        if not math.isnan(self.load_std):
            std["f_d"] = self.load_std
        current = None
        if self.memory > 0:
            keep = math.exp(-b.sampling_time / self.memory)
            strays = b.amplifier.noise_variance * (1 - keep) / (1 + keep)
            current = b.amplifier.gain * float(self._within_limits(u)[0])
            std["i"] = abs(b.amplifier.gain) * math.sqrt(2 * strays)
        return kalman.equilibrium_state(first / b.sensor.gain, first, current), list(std.values())

    def _at_steps(self, u: Array) -> Array:
        """Return the filter's input at its steps, from a control signal (n,) [V]."""
        # With a `memory` the filter's current has a lag, by which its deviation is correlated; its
        # input leads to the recorded current at the end of each step.
        if not self.memory > 0:
            return np.repeat(self._within_limits(self.between(filled(u))), self.substeps)
        recorded, at = self._within_limits(u), np.arange(u.size)
        fine = np.interp(np.arange(u.size * self.substeps + 1) / self.substeps, at, recorded)
        keep = math.exp(-self.isolated.sampling_time / self.substeps / self.memory)
        return np.asarray(fine[:-1] + np.diff(fine) / (1 - keep))

    def _within_limits(self, u: Array) -> Array:
        """Return the control signal [V] with its offset, within the current's limits."""
        # The control noise is limited together with the signal: near a limit it acts in one
        # direction only. If only the signal were limited, the force there would be too large by up
        # to 0.4 of the noise's standard deviation, and each closed loop that reaches its limit
        # would bias k, s0 and the offsets.
        b = self.isolated
        gain = b.amplifier.gain
        std = abs(gain) * math.sqrt(b.amplifier.noise_variance)
        iu = limited(gain * u + self.current_offset, std, b.current_min, b.current_max)
        return iu / gain

    def nearest_limit(self, record: Record) -> float:
        """Return the least distance of a record's current from its limits, in deviations."""
        b = self.isolated
        iu = b.amplifier.gain * record["u"] + self.current_offset
        left = min(b.current_max - np.nanmax(iu), np.nanmin(iu) - b.current_min)
        std = abs(b.amplifier.gain) * math.sqrt(b.amplifier.noise_variance)
        return float(left / std) if std > 0 else math.copysign(math.inf, left)

    @property
    def number(self) -> int:
        """Index of its axis among those of the filter."""
        return 0

    def with_isolated(self, isolated: Machine) -> Machine:
        """Return the machine that its axis is of, with other values of that axis."""
        return isolated

    def force_of_others(self, record: Record) -> Array:
        """Return the weight and the other axes' forces as one on its axis (n,) [N]."""
        return np.zeros(len(record))

    def record(self, record: Record) -> Record:
        """Return a record in which y and u are those of its axis."""
        return record

    def replace(self, **changes: object) -> LoopModel:
        """Return the model with other values; ``magnet__air_gap=...`` applies to the machine."""
        own = {name: value for name, value in changes.items() if "__" not in name}
        of_bearing = {name: value for name, value in changes.items() if "__" in name}
        model = replace(self, **own) if own else self  # type: ignore[arg-type]
        if not of_bearing:
            return model
        if "magnet__magnet_constant" in of_bearing:
            constant = float(of_bearing.pop("magnet__magnet_constant"))  # type: ignore[arg-type]
            of_bearing |= self.isolated.magnet.with_constant(constant)
        return replace(model, isolated=self.isolated.replace(**of_bearing))


def _late(machine: Machine, delay: float, current_lag: float) -> Machine:
    """Return a machine with another delay [s] and current lag [s]; 0: none."""
    amplifier, bandwidth = machine.amplifier, None
    if current_lag > SHORTEST_LAG * machine.sampling_time:
        bandwidth = 1 / (2 * math.pi * current_lag)
        if amplifier.bandwidth and math.isclose(bandwidth, amplifier.bandwidth):
            bandwidth = amplifier.bandwidth  # unchanged to the last bit
    if (delay or None, bandwidth) == (machine.delay, amplifier.bandwidth):
        return machine
    changes: dict[str, float | None] = {"bandwidth": bandwidth}
    if bandwidth is None:  # a voltage limit requires a bandwidth
        changes |= {"voltage_limit": None, "resistance": None}
    return _changed(machine, amplifier=changes, delay=delay or None)


def _changed(machine: Machine, **changes: Any) -> Machine:
    """Return a copy with some values changed, in its tables too, unchecked."""
    # Called for each evaluation of the likelihood; checks took most of the time.
    for name, values in changes.items():
        if isinstance(values, dict):
            changes[name] = getattr(machine, name).model_copy(update=values)
    return machine.model_copy(update=changes)


Filter = tuple[LoopModel, Estimator]
"""A model and its filter."""


def innovations(filters: Sequence[Filter], record: Record) -> list[Innovations]:
    """Return the innovations of several models along a record, computed in parallel if possible."""
    kinds = {(kalman.engine.core, *(s.name for s in kalman.states)) for _, kalman in filters}
    alike = len(kinds) == 1 < len(filters) and filters[0][1].machine.single
    if alike and np.isfinite(record["u"]).all():
        most = max(1, MOST_STEPS // (len(record) * filters[0][0].substeps))
        lots = [filters[first : first + most] for first in range(0, len(filters), most)]
        return [run for lot in lots for run in _side_by_side(lot, record)]
    if len(filters) == 1:
        return [filters[0][0].innovations(record, filters[0][1])]
    owner = {id(kalman): model for model, kalman in filters}  # one filter cannot run twice at once
    own = [kalman if owner[id(kalman)] is model else None for model, kalman in filters]
    with ThreadPoolExecutor(processors()) as pool:  # the core runs without Python's lock
        return list(pool.map(lambda one, kalman: one[0].innovations(record, kalman), filters, own))


def _side_by_side(filters: Sequence[Filter], record: Record) -> Iterator[Innovations]:
    """Yield the innovations of filters with one measurement and equal states."""
    signals = [model.acting_signals(record) for model, _ in filters]
    y, u = (np.array(rows) for rows in zip(*signals, strict=True))
    starts = [
        model.begin(kalman, seen, record["u"][:1])
        for (model, kalman), seen in zip(filters, y, strict=True)
    ]
    mean, std = (np.array(rows) for rows in zip(*starts, strict=True))
    out = run_many([kalman for _, kalman in filters], y, u, start=(mean, std), history=HISTORY)
    for (model, _), *run in zip(filters, *(getattr(out, name) for name in HISTORY), strict=True):
        yield model._at_samples(*run)


HISTORY = ("innovation", "innovation_variance", "status")

#: Maximum number of steps of filters in parallel: their arrays have half a gigabyte.
MOST_STEPS = 2**24

NOT_USED = int(Status.MISSING | Status.FROZEN | Status.BAD_VARIANCE | Status.OUTLIER)
"""Flags of unused measurements."""
