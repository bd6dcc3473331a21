"""Design of the most informative experiment within the limits of the loop.

The excitation is added to the reference, an input of every loop, without loss of generality: a PID
transmits it with its gain kp and set-point weight b, so r acts as a control signal ``b kp r /
k_ui``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering, percent
from ambkit.data.record import Record
from ambkit.data.signals import displacement, signal
from ambkit.identification.excitation.excitation_figure import excitation_figure
from ambkit.identification.excitation.signals import KINDS, Band, Excitation
from ambkit.identification.maximum_likelihood.information import Expectation, expect
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import usual
from ambkit.machine.axes import isolated
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness
from ambkit.machine.parts import GRAVITY
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.simulation.run import Sampled, samples, simulate
from ambkit.simulation.scenario import Scenario, along
from ambkit.simulation.waveforms import Recorded

LOWEST, HIGHEST = (1 / 16, 1 / 4, 1.0), (2.0, 4.0, 8.0, 16.0, 32.0)
"""Ends of the candidate bands, over the plant's frequency ``sqrt(k_s/m) / (2 pi)``."""

LEAST_PERIODS = 4  #: Minimum number of periods of the lowest frequency in a record.
FILLED = 0.97  #: Share of a limit that is close enough to it.
TRIES = 8  #: Simulations that adjust an amplitude to the limit.
SEEDS = 5  #: Noise seeds for the final check of the limits.
EXPECTED = ("expected", "parameters")  #: Section of its rows.
CERTAIN = 0.95  #: Correlation above which two parameters are reported as correlated.

CALM = 0.01
"""Assumed random walk of the disturbance in a second, over the rotor's weight."""


@dataclass(frozen=True)
class Limits:
    """Limits of an experiment."""

    #: Maximum control current |iu| [A], including levitation current and noise.
    current: float
    displacement: float  #: Maximum displacement |x| from the centre [m].

    @classmethod
    def of(
        cls, machine: Machine, current: float | None = None, displacement: float | None = None
    ) -> Limits:
        """Return limits, by default 80 % of the current limit and half of the clearance."""
        most = min(machine.current_max, -machine.current_min)
        travel = machine.clearance
        for what, value, end, unit in (
            ("current", current, most, "A"),
            ("displacement", displacement, travel, "m"),
        ):
            if value is not None and not 0 < value <= end:
                raise AmbkitError(
                    f"the limit of the {what} must be greater than 0 and at most "
                    f"{engineering(end, unit)}, what {machine.name} can do; "
                    f"is {engineering(value, unit)}"
                )
        return cls(
            0.8 * most if current is None else current,
            0.5 * travel if displacement is None else displacement,
        )

    def rows(self, record: Record) -> list[Row]:
        """Return the utilisation of the limits in a record of the experiment."""
        current, far = (float(np.max(np.abs(record[name]))) for name in ("iu", "x"))
        return [
            Row("maximum_current", "maximum control current", current, "A", below=self.current),
            Row("maximum_displacement", "maximum displacement", far, "m",
                below=self.displacement),
        ]  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Design(Result):
    """An experiment, and its expected information."""

    excitation: Excitation  #: Signal with amplitude 1.
    reference: Array  #: (n,) Reference of the experiment [m].
    band: Band  #: Frequency band [Hz].
    record: Record  #: Simulated experiment, with noise.
    limits: Limits  #: Its limits.
    expectation: Expectation  #: Expected information.
    candidates: Sequence[tuple[Band, float]]  #: (band, certainty) Candidate bands.
    axis: str = ""  #: Axis of the reference, if there are several.

    @property
    def amplitude(self) -> float:
        """Maximum of the reference [m]."""
        return float(np.max(np.abs(self.reference)))

    def file(self) -> Record:
        """Return the reference as a record, to be saved and run: ``t`` and ``r``, or ``r_NAME``."""
        model = self.expectation.model
        meta = {
            "source": f"ambkit excite, {self.excitation.kind}, {self.band[0]:.4g} to "
            f"{self.band[1]:.4g} Hz, for {model.isolated.name}"
        }
        name = signal("r", self.axis)
        return Record(self.record.t, {name: self.reference}, {name: "m"}, meta=meta)

    TITLE = "{0.excitation.kind} for {0.expectation.model.isolated.name}"

    @property
    def finding(self) -> str:
        expected, positive = self.expectation, []
        for p, error in zip(expected.parameters, expected.errors, strict=True):
            at = p.of(expected.model)
            positive += [(float(error / at), p.name)] if p.positive and at else []
        if not positive:
            return f"{self.title}: no parameter has a relative error."
        return (
            f"{self.title}: expected standard errors from {_relative(*min(positive))} to "
            f"{_relative(*max(positive))}."
        )

    @property
    def rows(self) -> list[Row]:
        record, expected = self.record, self.expectation
        results = [
            Row("duration", "duration", float(record.t[-1]), "s"),
            Row("samples", "  samples", len(record)),
            Row("band", "band", self.band, "Hz", 3),
            Row("amplitude", "maximum reference", self.amplitude, "m"),
            Row("crest_factor", "  crest factor", self.excitation.crest_factor, digits=3),
            *self.limits.rows(record),
        ]
        for p, error in zip(expected.parameters, expected.errors, strict=True):
            at = p.of(expected.model)
            results += put([
                Row("value", "value ± standard error", at, p.unit, error=float(error)),
                Row("share", "relative", float(error / at) if p.positive else None, "%"),
            ], section=EXPECTED, of=p.name)  # fmt: skip
        return results

    SECTIONS = {(): Section("{0.title}"), EXPECTED: Section("Expected errors", across=True)}

    @property
    def notes(self) -> list[str]:
        expected, names = self.expectation, [p.name for p in self.expectation.parameters]
        sentences = [f"{name} is not identifiable: {why}" for name, why in expected.held.items()]
        sentences += [
            f"{names[j]} and {name} are correlated: {expected.correlation[i, j]:+.3f}"
            for i, name in enumerate(names) for j in range(i)
            if abs(expected.correlation[i, j]) > CERTAIN
        ]  # fmt: skip
        return [sentence.replace("_", " ") for sentence in sentences]

    @property
    def series(self) -> dict[str, Any]:
        return {
            "machine": self.expectation.model.isolated.name,
            "kind": self.excitation.kind,
            "limit_current": self.limits.current,
            "limit_displacement": self.limits.displacement,
            "disturbance_noise": self.expectation.model.disturbance_noise,
            "expected": self.expectation.to_dict(),
            "bands": [
                {"band": list(band), "certainty": certainty} for band, certainty in self.candidates
            ],
        }

    def figures(self) -> list[Figure]:
        return [excitation_figure(self)]


def _relative(share: float, name: str) -> str:
    return f"{percent(share)} ({name.replace('_', ' ')})"


def design(
    machine: Machine,
    scenario: Scenario,
    *,
    kind: str = "multisine",
    free: Sequence[str] | None = None,
    limits: Limits | None = None,
    band: Band | None = None,
    load: float | None = None,
    axis: str = "",
    done: Callable[[str], object] = lambda _: None,
) -> Design:
    """Return the experiment that identifies parameters of a machine, or of one axis of it, best."""
    # Each band is scaled to the limits in the simulated loop, including noise; selected is the
    # largest determinant of the information, ``ln det(1 + I)`` (D-optimal, with only each
    # parameter's coarse scale as prior).
    if kind not in KINDS:
        raise AmbkitError(f'there is no excitation "{kind}"; known: {", ".join(KINDS)}')
    several, machine = (None, machine) if machine.single else (machine, isolated(machine, axis))
    limits = limits or Limits.of(machine)
    load = CALM * machine.rotor.mass * GRAVITY if load is None else load
    if not (math.isfinite(load * load) and load > 0):
        raise AmbkitError(
            f"random_walk must be greater than 0 N, and its square finite, is {load:g} N"
        )
    loop = _Loop(machine, scenario, limits, load)
    end = 0.4 / machine.sampling_time, ", two fifths of the sampling rate"
    bands = [band] if band else _bands(machine, loop.duration)
    check_band(bands[0], (1 / loop.duration, ", one period in the record,"), end)
    model = LoopModel(machine, disturbance_noise=load**2)
    free = usual(model) if free is None else free
    best: tuple[Band, Excitation, Array] | None = None
    trials: list[tuple[Band, float]] = []
    for one in bands:
        excitation = KINDS[kind](loop.n, loop.T, one)
        reference = loop.at_the_limit(excitation)
        certainty = expect(loop.run(reference), model, free).certainty
        trials.append((one, certainty))
        if certainty >= max(certainty for _, certainty in trials):
            best = one, excitation, reference
        done(f"{one[0]:.3g} to {one[1]:.3g} Hz")
    assert best is not None
    one, excitation, reference = best
    reference = loop.within_limits(reference)
    if several is not None:  # where the other axes move, too, and the unbalance acts
        reference = _OfSeveral(several, scenario, limits, load, axis).within_limits(reference)
    record = loop.run(reference)
    return Design(
        excitation, reference, one, record, limits, expect(record, model, free), trials, axis
    )


def _bands(machine: Machine, duration: float) -> list[Band]:
    """Return candidate bands around the plant's frequency, limited by duration and sampling."""
    own = math.sqrt(ConstantStiffness.of(machine).k_s / machine.rotor.mass) / (2 * math.pi)
    min_frequency, max_frequency = LEAST_PERIODS / duration, 0.2 / machine.sampling_time
    lows = sorted({max(part * own, min_frequency) for part in LOWEST})
    highs = sorted({min(part * own, max_frequency) for part in HIGHEST})
    bands = [(low, high) for low in lows for high in highs if high >= 2 * low]
    if not bands:
        raise AmbkitError(
            f"{engineering(duration, 's')} are too short: {LEAST_PERIODS} periods of the plant's "
            f"own frequency, {engineering(own, 'Hz')}, last {engineering(LEAST_PERIODS / own, 's')}"
        )
    return bands


def check_band(band: Band, start: tuple[float, str], end: tuple[float, str]) -> None:
    """Reject a band that is not ascending or beyond its limits [Hz]."""
    (lowest, first), (highest, last), (low, high) = start, end, band
    if not lowest * (1 - 1e-9) <= low < high <= highest * (1 + 1e-9):
        raise AmbkitError(
            f"the band must rise, from {engineering(lowest, 'Hz')}{first} to "
            f"{engineering(highest, 'Hz')}{last}; "
            f"is {engineering(low, 'Hz')} to {engineering(high, 'Hz')}"
        )


class _Loop:
    """The simulated loop, with noise and a random-walk disturbance, excited by its reference."""

    axis = ""

    def __init__(self, machine: Machine, scenario: Scenario, limits: Limits, load: float) -> None:
        self.machine, self.limits, self.load = machine, limits, load
        self.scenario = scenario.replace(noise=True)
        self.T = machine.sampling_time
        self.n = samples(machine, scenario)
        self.duration = self.n * self.T
        self.t: Array = self.T * np.arange(self.n, dtype=float)
        self.known = along(scenario, "disturbance", ("",), self.t)[:, 0]
        names = tuple(machine.axis_names)
        self.injected = along(scenario, "injection", names, self.t)

    def _disturbance(self, seed: int) -> Array:
        steps = np.random.default_rng([seed, 1]).normal(size=self.n)
        steps[0] = 0.0
        return np.asarray(self.known + self.load * math.sqrt(self.T) * np.cumsum(steps))

    def run(self, reference: Array) -> Record:
        """Simulate with a reference [m]."""
        disturbance = Recorded.of(self.t, self._disturbance(self.scenario.seed))
        scenario = self.scenario.model_copy(
            update={"reference": Recorded.of(self.t, reference), "disturbance": disturbance}
        )
        return simulate(self.machine, scenario)

    def levels(self, reference: Array, parts: Sequence[slice], other: int = 0) -> Array:
        """Return the utilisation of each limit in each part with a reference [m] (2, parts)."""
        # Optionally with another seed of noise and disturbance. Without the signals in the record's
        # scenario, which take half as long to write as the flight takes.
        seed, names = self.scenario.seed + other, self.machine.axis_names
        signals = np.zeros((2, self.n, len(names)))
        signals[:, :, names.index(self.axis)] = reference, self._disturbance(seed)
        record = simulate(
            self.machine, self.scenario.model_copy(update={"seed": seed}),
            sampled=Sampled(self.t, signals[0], signals[1], self.injected),
        )  # fmt: skip
        used = [
            np.abs(record[signal("iu", self.axis)]) / self.limits.current,
            np.abs(record[displacement(self.axis)]) / self.limits.displacement,
        ]
        return np.array([[np.max(one[part]) for part in parts] for one in used])

    def at_the_limit(self, excitation: Excitation) -> Array:
        """Return the reference that reaches one of the limits in each of its parts."""
        # Current and displacement are nearly linear in it, on top of the noise.
        parts = excitation.parts
        floor = self.levels(np.zeros(self.n), parts)
        self.check_room(floor)
        stiff = ConstantStiffness.of(self.machine)
        kp = max(self.scenario.controller.kp, stiff.k_s / stiff.k_i)
        gain = np.full(len(parts), 0.2 * min(self.limits.displacement, self.limits.current / kp))
        best, reached = np.zeros(self.n), 0.0
        for _ in range(TRIES):
            reference = _scaled(excitation, gain)
            levels = self.levels(reference, parts)
            filled = np.max(levels, axis=0)
            if np.max(filled) <= 1 and np.mean(filled) > reached:
                best, reached = reference, float(np.mean(filled))
                if np.min(filled) >= FILLED:
                    break
            rise = np.maximum(levels - floor, 1e-3)
            gain = gain * np.clip(np.min((0.99 - floor) / rise, axis=0), 0.3, 4.0)
        return best

    def within_limits(self, reference: Array) -> Array:
        """Return the reference, reduced if another noise seed exceeds a limit."""
        floor: Array | None = None
        for _ in range(TRIES):
            levels = self.greatest(reference)
            if np.max(levels) <= 1:
                return reference
            if floor is None:
                floor = self.greatest(0 * reference)
                self.check_room(floor)
            rise = np.maximum(levels - floor, 1e-3)
            reference = reference * min(0.995, float(np.min((0.99 - floor) / rise)))
        least = engineering(float(np.max(np.abs(reference))), "m")
        raise AmbkitError(
            f"even with a reference of {least} the loop reaches {self.beyond(levels)}"
        )

    def greatest(self, reference: Array) -> Array:
        """Return the greatest utilisation of each limit over noise seeds (2, 1)."""
        levels = [self.levels(reference, [slice(0, self.n)], other) for other in range(SEEDS)]
        return np.asarray(np.max(levels, axis=0))

    def check_room(self, floor: Array) -> None:
        """Reject limits that are reached without excitation."""
        if not np.max(floor) < FILLED:
            raise AmbkitError(f"even without excitation the loop reaches {self.beyond(floor)}")

    def beyond(self, levels: Array) -> str:
        """Return current and displacement at a utilisation (2, parts), and their limits."""
        most = self.limits.current, self.limits.displacement
        at, limits = (
            f"{engineering(current, 'A')} and {engineering(far, 'm')}"
            for current, far in (levels.max(axis=1) * most, most)
        )
        return f"{at}; the limits, {limits}, leave no room"


class _OfSeveral(_Loop):
    """The loop of all axes of a machine, as ``ambkit simulate`` has it, excited along one."""

    def __init__(
        self, machine: Machine, scenario: Scenario, limits: Limits, load: float, axis: str
    ) -> None:
        super().__init__(machine, scenario, limits, load)
        self.axis = axis
        self.scenario = Scenario(duration=scenario.duration, seed=scenario.seed)
        self.injected = np.zeros_like(self.injected)


def _scaled(excitation: Excitation, gain: Array) -> Array:
    """Return the signal with its parts scaled."""
    values = np.zeros_like(excitation.values)
    for part, by in zip(excitation.parts, gain, strict=True):
        values[part] = by * excitation.values[part]
    return values
