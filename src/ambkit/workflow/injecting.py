"""The experiment that measures a loop's sensitivity: what to add to its measurement, how much."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.asked import Given, in_si, of_type
from ambkit.base.errors import AmbkitError
from ambkit.base.showing import Shown
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.estimate.estimate import Status
from ambkit.identification.excitation import Limits
from ambkit.identification.excitation.signals import Excitation, sparse_multisine
from ambkit.judge.loop.measured import MeasuredSensitivity, measured_sensitivity
from ambkit.machine.bearing import Bearing
from ambkit.simulation.run import samples, simulate_run
from ambkit.simulation.scenario import Scenario
from ambkit.simulation.waveforms import Recorded
from ambkit.workflow.assessing import assess
from ambkit.workflow.given import given_estimators
from ambkit.workflow.loop_of import end_of_range

if TYPE_CHECKING:
    from ambkit.show.report.figure import Figure
    from ambkit.simulation.run import Run

Array = NDArray[np.float64]

PERIODS = 10
"""Of the signal: the first is left out, as the loop settles in it."""

REST = 0.05
"""Of the experiment, before the signal begins."""

LINEAR = 0.05
"""Of the air gap, how far the rotor goes where nobody says it: magnets are not linear."""

TRIES, SEEDS = 12, 3
"""Simulations in which the amplitude is brought to a limit, and noises under which it keeps it."""

REFUSED = 1e-3
"""Share of the measurements that a filter in the loop may take for outliers: one that refuses the
signal is another loop."""

FILLED = 0.97
"""Part of a limit that is near enough to it."""


@dataclass(frozen=True, eq=False)
class Injection(Shown):
    """An experiment for the sensitivity, and what it would tell.

    Attributes
    ----------
    name : str
        Of the bearing.
    excitation : Excitation
        One period, of amplitude 1.
    added : ndarray (n,)
        What is to be added to the measurement [m].
    band : tuple of float
        Lowest and highest frequency [Hz].
    record : Record
        The experiment, simulated, with the noise of the bearing.
    limits : Limits
        What it keeps within.
    expected : MeasuredSensitivity
        What that record tells.
    """

    _card_by = "workflow.cards:injection"

    name: str
    excitation: Excitation
    added: Array
    band: tuple[float, float]
    record: Record
    limits: Limits
    expected: MeasuredSensitivity

    @property
    def amplitude(self) -> float:
        """Greatest value of the signal [m]."""
        return float(np.abs(self.added).max())

    @property
    def period(self) -> float:
        """How long a period is [s]."""
        return len(self.excitation.values) * self.expected.sampling_time

    @property
    def periods(self) -> int:
        """How often it comes."""
        return PERIODS

    @property
    def error(self) -> Array:
        """Half width (k,) of the expected 95 % interval of abs(S), of its value [1]."""
        low, high = self.expected.interval()
        return np.asarray((high - low) / 2 / np.abs(self.expected.sensitivity))

    def file(self) -> Record:
        """Return the signal as a record, to be saved and run: ``t`` and ``injected``."""
        low, high = self.band
        source = f"ambkit excite --for sensitivity, {low:.4g} to {high:.4g} Hz, for {self.name}"
        return Record(self.record.t, {"injected": self.added}, meta={"source": source})

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        expected, (low, high) = self.expected, self.expected.peak_interval()
        return {
            "bearing": self.name,
            "kind": self.excitation.kind,
            "band": list(self.band),
            "lines": len(self.excitation.frequencies),
            "period": self.period,
            "periods": self.periods,
            "amplitude": self.amplitude,
            "crest_factor": self.excitation.crest_factor,
            "samples": len(self.record),
            "limit_current": self.limits.current,
            "limit_displacement": self.limits.displacement,
            "greatest_current": float(np.abs(self.record["iu"]).max()),
            "greatest_displacement": float(np.abs(self.record["x"]).max()),
            "expected_peak": expected.peak,
            "expected_peak_low": low,
            "expected_peak_high": high,
            "expected_error": float(np.median(self.error)),
        }

    def figure(self) -> Figure:
        """Return the experiment over time, and the error that is expected, as a picture."""
        from ambkit.show.plots.injection import injection_figure

        return injection_figure(self.name, self.record, self.limits, self.expected)


def design_injection(
    bearing: Bearing,
    scenario: Scenario,
    filter: Any = None,
    *,
    current: Given | None = None,
    displacement: Given | None = None,
    band: tuple[float, float] | None = None,
) -> Injection:
    """Design the signal whose answer tells the sensitivity, within limits on current and position.

    A multisine of few lines, so that each has much power, again and again, so that the scatter
    between its periods tells the error. Its lines are away from hum and from orders of the speed.
    They are as high as the noise that comes to the same place, of sensor and amplifier: both are
    passed on by S, and each line is told equally well. Above the peak of S, where current by signal
    grows and S goes to 1, they fall as that current rises.

    Parameters
    ----------
    bearing : Bearing
        The plant.
    scenario : Scenario
        Duration, controller, reference, load, and seed of the noise.
    filter : Estimator, str or path, optional
        What feeds the controller, where the scenario lets an estimate do so.
    current : float or str, optional
        Greatest control current [A]; by default 80 % of what it can be.
    displacement : float or str, optional
        Greatest displacement from the centre [m]; by default 5 % of the air gap beyond where the
        rotor is held, or half of the travel.
    band : tuple of float, optional
        Lowest and highest frequency [Hz]; by default from the lowest that a period tells to the end
        of the range of ISO 14839-3.

    Raises
    ------
    AmbkitError
        The experiment is too short for the band, the loop is not stable, or exceeds a limit even
        without a signal.
    """
    of_type(Bearing, bearing=bearing)
    of_type(Scenario, scenario=scenario)
    current = in_si("current", current, "A")
    displacement = in_si("displacement", displacement, "m")
    return _Experiment(bearing, scenario, filter, current, displacement).designed(band)


class _Experiment:
    """The simulated loop, with noise, and a signal that is added to its measurement."""

    def __init__(
        self, bearing: Bearing, scenario: Scenario, filter: Any, current: float | None,
        displacement: float | None,
    ) -> None:  # fmt: skip
        self.bearing, self.T = bearing, bearing.sampling_time
        pid = scenario.controller.completed(bearing)
        self.scenario = scenario.replace(noise=True, controller=pid)
        self.filter = (filter or "linear") if pid.feedback == "estimate" else None
        self.n = samples(bearing, scenario)
        self.t = self.T * np.arange(self.n)
        self.rest = math.ceil(REST * self.n)
        self.period = (self.n - self.rest) // PERIODS
        held = float(np.abs(scenario.reference.sample(self.t)).max())
        travel = bearing.rotor.travel_limit
        far = min(held + LINEAR * bearing.magnet.air_gap, 0.5 * (held + travel))
        far = far if displacement is None else displacement
        self.limits = Limits.of(bearing, current, far)
        loop = list(assess(bearing, self.filter, pid).loops.values())[-1]
        if not loop.stable:
            raise AmbkitError(
                f"{bearing.name}: the loop is not stable, there is nothing to measure"
            )
        self.loop = loop

    def designed(self, band: tuple[float, float] | None) -> Injection:
        """Return the experiment in a band [Hz]."""
        excitation = self.signal(self.checked(band))
        added = self.at_the_limit(excitation)
        record = self.run(added).record
        ends = float(excitation.frequencies[0]), float(excitation.frequencies[-1])
        expected = measured_sensitivity(record)
        return Injection(self.bearing.name, excitation, added, ends, record, self.limits, expected)

    def checked(self, band: tuple[float, float] | None) -> tuple[float, float]:
        """Return the band, given or not [Hz]."""
        lowest, highest = 1 / (self.period * self.T), 0.45 / self.T
        low, high = band or (lowest, min(end_of_range(self.T, self.bearing.speed), highest))
        if not lowest * (1 - 1e-9) <= low < high <= highest * (1 + 1e-9):
            raise AmbkitError(
                f"the band must rise, from {engineering(lowest, 'Hz')}, one period of the signal "
                f"that comes {PERIODS} times, to {engineering(highest, 'Hz')} at most; "
                f"is {engineering(low, 'Hz')} to {engineering(high, 'Hz')}"
            )
        return low, high

    def signal(self, band: tuple[float, float]) -> Excitation:
        """Return one period in a band [Hz]."""
        loop, bearing = self.loop.loop, self.bearing
        orders = (bearing.speed or 0.0) / (2 * math.pi) * np.arange(1, 21)
        hum = [line.frequency for line in bearing.sensor.hum]
        peak = np.array([self.loop.peak_frequency])
        there = float(np.abs(loop.noise_to_control(peak)).item())

        u_to_y = loop.plant.select(["y"], ["u"])
        of_y, of_u = bearing.sensor.noise_variance, bearing.amplifier.noise_variance

        def weight(f: Array) -> Array:
            current = np.abs(loop.noise_to_control(f)[:, 0, 0])
            noise = 1 + np.abs(u_to_y.response(f)[:, 0, 0]) ** 2 * of_u / (of_y or 1.0)
            return np.sqrt(noise) * np.where(f > peak, np.minimum(1.0, there / current), 1.0)

        found = sparse_multisine(
            self.period, self.T, band, without=[*hum, *orders[orders > 0]], weight=weight
        )
        if len(found.frequencies) < 2:
            raise AmbkitError(
                "the band has no room for two lines: widen it, or make the run longer"
            )
        return found

    def run(self, added: Array, other: int = 0) -> Run:
        """Simulate with a signal (n,) [m], and with other noise than the scenario's seed's."""
        times, values = tuple(self.t.tolist()), tuple(added.tolist())
        signal = Recorded.model_construct(times=times, values=values)
        scenario = self.scenario.model_copy(
            update={"seed": self.scenario.seed + other, "injection": signal}
        )
        inner = next(iter(given_estimators(self.filter, self.bearing).values()), None)
        return simulate_run(self.bearing, scenario, estimator=inner)

    def level(self, added: Array) -> float:
        """How far the loop goes towards its limits under several noises; 1: up to one."""
        most = 0.0
        for other in range(SEEDS):
            run = self.run(added, other)
            current, far = (float(np.abs(run.record[name]).max()) for name in ("iu", "x"))
            most = max(most, current / self.limits.current, far / self.limits.displacement)
            if run.estimate is not None:
                refused = float(np.mean((run.estimate.status & Status.OUTLIER) > 0))
                most = max(most, refused / REFUSED)
        return most

    def at_the_limit(self, excitation: Excitation) -> Array:
        """Return the signal as large as the limits allow, (n,) [m]."""
        unit = np.zeros(self.n)
        whole = np.tile(excitation.values, PERIODS)
        unit[self.rest : self.rest + len(whole)] = whole
        floor = self.level(np.zeros(self.n))
        if not floor < FILLED:
            raise AmbkitError(
                f"even without a signal the loop goes to {100 * floor:.0f} % of a limit, "
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
            raise AmbkitError("no signal was found that keeps within the limits")
        return best * unit
