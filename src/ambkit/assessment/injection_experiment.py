"""Design of an experiment that measures a loop's sensitivity: signal and amplitude."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ambkit.arguments import NONE, filter_arguments, loop_arguments
from ambkit.assessment.assess import assess
from ambkit.assessment.assess_log import of_one_axis
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.quantity_arguments import QuantityLike, in_si, of_type
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.data.signals import displacement as displacement_of
from ambkit.data.signals import signal
from ambkit.estimate.estimate import Estimate, Status
from ambkit.estimate.registry import default_name
from ambkit.identification.excitation.design import Limits, check_band
from ambkit.identification.excitation.excitation_figure import panels_within
from ambkit.identification.excitation.signals import Excitation, sparse_multisine
from ambkit.judge.loop.measured_sensitivity import MeasuredSensitivity, measured_sensitivity
from ambkit.machine.axes import axis_named
from ambkit.machine.machine import Machine
from ambkit.machine.rotors.modes import max_frequency
from ambkit.result.report import Axis, Band, Figure, Line, Panel, Points
from ambkit.result.result import Result
from ambkit.result.row import Row, Section
from ambkit.simulation.run import samples, simulate_run
from ambkit.simulation.scenario import Injection as Added
from ambkit.simulation.scenario import Scenario, along, by_axis, settled_scenario
from ambkit.simulation.waveforms import Recorded

PERIODS = 10  #: Periods of the signal: the first is excluded, because the loop settles in it.


@dataclass(frozen=True, eq=False, repr=False)
class Injection(Result):
    """An experiment that measures the sensitivity, and its expected result."""

    name: str  #: Name of the machine and, if it has several, the axis.
    axis: str  #: Axis of the injection if the machine has several; else empty.
    excitation: Excitation  #: One period, of amplitude 1.
    added: Array  #: (n,) Signal to add to the measurement [m].
    band: tuple[float, float]  #: Lowest and highest frequency [Hz].
    #: Experiment simulated with noise: ``y``, ``injected``, ``iu`` and ``x`` of the axis.
    record: Record
    limits: Limits  #: Limits.
    expected: MeasuredSensitivity  #: Sensitivity from that record.

    @property
    def amplitude(self) -> float:
        """Maximum of the signal [m]."""
        return float(np.abs(self.added).max())

    @property
    def period(self) -> float:
        """Duration of a period [s]."""
        return len(self.excitation.values) * self.expected.sampling_time

    @property
    def periods(self) -> int:
        """Number of periods."""
        return PERIODS

    @property
    def error(self) -> Array:
        """Expected half width (k,) of the 95 % interval of abs(S), relative [1]."""
        low, high = self.expected.interval()
        return np.asarray((high - low) / 2 / np.abs(self.expected.sensitivity))

    def file(self) -> Record:
        # With several axes ``injected_NAME``.
        low, high = self.band
        source = f"ambkit excite sensitivity, {low:.4g} to {high:.4g} Hz, for {self.name}"
        name = signal("injected", self.axis) if self.axis else "injected"
        return Record(self.record.t, {name: self.added}, {name: "m"}, meta={"source": source})

    TITLE = "Experiment for the sensitivity of {0.name}"

    @property
    def finding(self) -> str:
        low, high = self.expected.peak_interval()
        return (
            f"{self.name}: with {engineering(self.amplitude, 'm', 4)} added to the measurement the "
            f"expected interval of the peak of |S| is {low:.3f} to {high:.3f}."
        )

    @property
    def rows(self) -> list[Row]:
        record, expected = self.record, self.expected
        return [
            Row("duration", "duration", float(record.t[-1]), "s"),
            Row("samples", "  samples", len(record)),
            Row("period", "period", self.period, "s"),
            Row("periods", "  repetitions", self.periods),
            Row("lines", "frequencies", len(self.excitation.frequencies)),
            Row("band", "  of them", self.band, "Hz", 3),
            Row("amplitude", "amplitude added to the measurement", self.amplitude, "m"),
            Row("crest_factor", "  crest factor", self.excitation.crest_factor, digits=3),
            *self.limits.rows(record),
            Row("expected_peak", "expected peak of |S|", expected.peak, "|S|",
                interval=expected.peak_interval()),
            Row("expected_error", "median half width of the 95 % interval",
                float(np.median(self.error)), "%"),
            Row("maximum_expected_error", "  maximum", float(np.max(self.error)), "%"),
        ]  # fmt: skip

    SECTIONS = {(): Section("Sensitivity of {0.name}: {0.excitation.kind}")}

    @property
    def series(self) -> dict[str, Any]:
        return {"machine": self.name, "kind": self.excitation.kind}

    def figures(self) -> list[Figure]:
        return [injection_figure(self.name, self.record, self.limits, self.expected)]


def injection_figure(
    name: str, record: Record, limits: Limits, expected: MeasuredSensitivity
) -> Figure:
    """Plot an injection experiment over time, and the expected interval."""
    added = Line(record.t, record["injected"], signal="reference", label="added to the measurement")
    f, (low, high) = expected.frequency, expected.interval()
    S = np.abs(expected.sensitivity)
    frequency = Axis("frequency", "Hz", scale="log", limits=(0.8 * f[0], 1.25 * f[-1]))
    return Figure(
        "injection",
        f"Experiment for the sensitivity of {markdown(name)}",
        "Simulated with the noise of the machine. Below: what this record determines.",
        [
            *panels_within(record, limits, added),
            Panel(frequency, Axis("sensitivity |S|", limits=(0.0, 1.2 * float(high.max()))), [
                Band(f, low, high, signal="estimate", label="95 % interval"),
                Points(f, S, signal="estimate", label="told"),
            ]),
        ],
    )  # fmt: skip


REST = 0.05  #: Share of the experiment before the signal begins.
LINEAR = 0.05  #: Default limit of the displacement over the air gap, because magnets are nonlinear.

TRIES, SEEDS = 12, 3
"""Simulations that adjust the amplitude to the limits, and noise seeds that must keep them."""

REFUSED = 1e-3
"""Maximum share of measurements that a filter in the loop may reject: a filter that rejects the
signal is a different loop.
"""

FILLED = 0.97  #: Share of a limit that is close enough to it.
DURATION = 5.0  #: Default duration of an experiment [s].


def design_injection(
    machine: Machine,
    scenario: Scenario,
    filter: Any = None,
    *,
    axis: str | None = None,
    current: QuantityLike | None = None,
    displacement: QuantityLike | None = None,
    band: tuple[float, float] | None = None,
) -> Injection:
    """Design a signal that measures the sensitivity, within limits on current and displacement."""
    # A periodic multisine with few lines, so that each has much power, and the scatter between
    # periods shows the error. Its lines avoid line noise and orders of the speed. Their amplitudes
    # follow the noise of sensor and amplifier at the same point: S passes on both, so all lines
    # have the same relative error. Above the peak of S, where the current per signal grows and S
    # tends to 1, they fall as that current rises.
    of_type(Machine, machine=machine)
    current = in_si("current", current, "A")
    displacement = in_si("displacement", displacement, "m")
    of_type(Scenario, scenario=scenario)
    return _Experiment(machine, scenario, filter, axis, current, displacement).designed(band)


class _Run(NamedTuple):
    """One simulation: the axis's record, its utilisation of the limits, and the estimate."""

    record: Record
    level: float
    estimate: Estimate | None


class _Experiment:
    """The simulated loop, with noise, and a signal added to its measurement."""

    def __init__(
        self, machine: Machine, scenario: Scenario, filter: Any, axis: str | None,
        current: float | None, displacement: float | None,
    ) -> None:  # fmt: skip
        scenario = self.scenario = settled_scenario(machine, scenario.replace(noise=True))
        self.filter = (filter or default_name(machine)) if scenario.feedback == "estimate" else None
        result = assess(loop_arguments(machine, self.filter or NONE, scenario.controller))
        self.machine: Any = result.machine
        self.T, self.n = self.machine.sampling_time, samples(machine, scenario)
        self.t = self.T * np.arange(self.n)
        self.names = tuple(of.name for of in machine.axes)
        held = float(np.abs(along(scenario, "reference", self.names, self.t)).max())
        self.rest = math.ceil(REST * self.n)
        self.period = (self.n - self.rest) // PERIODS
        loop = list(result.loops.values())[-1]
        if loop.worst is None:
            raise AmbkitError(
                f"{self.machine.name}: the loop is not stable, there is nothing to measure"
            )
        self.loop, axes = loop, list(loop.axes)
        chosen = loop.worst.name if axis is None else axis_named(machine, axis)
        self.at = axes.index(chosen)
        self.axis = chosen if len(result.of.axes) > 1 else ""
        self.name = f"{self.machine.name} {self.axis}".strip()
        self.all_limits = [_limits(b, held, current, displacement) for b in result.of.isolated]
        self.limits = self.all_limits[self.at]

    def designed(self, band: tuple[float, float] | None) -> Injection:
        """Return the experiment in a band [Hz]."""
        excitation = self.signal(self.checked(band))
        added = self.at_the_limit(excitation)
        record = self.run(added).record
        ends = float(excitation.frequencies[0]), float(excitation.frequencies[-1])
        expected = measured_sensitivity(record)
        return Injection(
            self.name, self.axis, excitation, added, ends, record, self.limits, expected
        )

    def checked(self, band: tuple[float, float] | None) -> tuple[float, float]:
        """Return the band [Hz], by default the complete one."""
        lowest, highest = 1 / (self.period * self.T), 0.45 / self.T
        band = band or (lowest, min(max_frequency(self.T, self.machine.speed), highest))
        period = f", one period of the signal that comes {PERIODS} times,"
        check_band(band, (lowest, period), (highest, " at most"))
        return band

    def signal(self, band: tuple[float, float]) -> Excitation:
        """Return one period in a band [Hz]."""
        loop, of, k = self.loop.loop, self.loop.of, self.at
        orders = (self.machine.speed or 0.0) / (2 * math.pi) * np.arange(1, 21)
        sensors = of.machine.sensors
        hum = [line.frequency for sensor in sensors for line in sensor.hum]
        peak = self.loop.axes[list(self.loop.axes)[k]].peak_frequency
        m, p = loop.measurements, len(of.isolated)
        seen, shaken = of.measured[k], of.added[:, k]
        if not self.axis:  # the only reading
            seen = shaken = np.ones(1)

        def demanded(f: Array) -> Array:
            return np.asarray(np.abs(loop.noise_to_control(f)[:, k] @ shaken))

        of_y, of_u = (np.array(item) for item in of.noise())
        there, sensed = float(demanded(np.array([peak]))[0]), float(seen**2 @ of_y)

        def weight(f: Array) -> Array:
            by_u = np.abs(seen @ loop.plant.response(f)[:, :m, :p]) ** 2 @ of_u
            noise = 1 + by_u / (sensed or 1.0)
            return np.asarray(
                np.sqrt(noise) * np.where(f > peak, np.minimum(1.0, there / demanded(f)), 1.0)
            )

        result = sparse_multisine(
            self.period, self.T, band, without=[*hum, *orders[orders > 0]], weight=weight
        )
        if len(result.frequencies) < 2:
            raise AmbkitError("the band has fewer than two lines: widen it, or make the run longer")
        return result

    def run(self, added: Array, other: int = 0) -> _Run:
        """Simulate with a signal (n,) [m], and with another noise seed."""
        there = Added.model_construct(axis=self.axis, position=Recorded.of(self.t, added))
        others = (
            Added.model_construct(axis=name, position=item)
            for name, item in by_axis(self.scenario, "injection", self.names[0])
        )
        scenario = self.scenario.model_copy(
            update={"seed": self.scenario.seed + other, "injection": (*others, there)}
        )
        inner = next(iter(filter_arguments(self.filter, self.machine).values()), None)
        run = simulate_run(self.machine, scenario, estimator=inner)
        record = run.record
        level = max(
            max(float(np.abs(record[signal("iu", name)]).max()) / of.current,
                float(np.abs(record[displacement_of(name)]).max()) / of.displacement)
            for name, of in zip(self.names, self.all_limits, strict=True)
        )  # fmt: skip
        if self.axis:
            _, own = of_one_axis(record, self.machine)
            own_signals = {"iu": record[signal("iu", self.axis)], "x": record[f"s_{self.axis}"]}
            record = Record(record.t, {name: own[name] for name in own} | own_signals)
        return _Run(record, level, run.estimate)

    def level(self, added: Array) -> float:
        """Return the utilisation of the loop's limits with several noise seeds; 1 is a limit."""
        most = 0.0
        for other in range(SEEDS):
            run = self.run(added, other)
            most = max(most, run.level)
            if run.estimate is not None:
                refused = float(np.mean((run.estimate.status & Status.OUTLIER) > 0))
                most = max(most, refused / REFUSED)
        return most

    def at_the_limit(self, excitation: Excitation) -> Array:
        """Return the signal with the largest permitted amplitude, (n,) [m]."""
        unit = np.zeros(self.n)
        periods = np.tile(excitation.values, PERIODS)
        unit[self.rest : self.rest + len(periods)] = periods
        floor = self.level(np.zeros(self.n))
        if not floor < FILLED:
            raise AmbkitError(
                f"even without a signal the loop reaches {100 * floor:.0f} % of a limit, "
                f"{engineering(self.limits.current, 'A')} and "
                f"{engineering(self.limits.displacement, 'm')}: there is no room for one"
            )
        amplitude, best = 0.2 * self.limits.displacement, 0.0
        for _ in range(TRIES):
            level = self.level(amplitude * unit)
            if level <= 1:
                best = max(best, amplitude)
                if level >= FILLED:
                    break
            rise = max(level - floor, 1e-3)
            amplitude *= min(max((0.985 - floor) / rise, 0.5), 4.0)
        if best == 0:
            raise AmbkitError("no signal keeps the limits")
        return best * unit


def _limits(
    machine: Machine, held: float, current: float | None, displacement: float | None
) -> Limits:
    """Return the limits of an axis; by default of displacements with nearly linear magnets."""
    far = min(held + LINEAR * machine.magnet.air_gap, 0.5 * (held + machine.clearance))
    return Limits.of(machine, current, far if displacement is None else displacement)
