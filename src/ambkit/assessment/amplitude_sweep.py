"""Sweeps of the simulated loop: sensitivity with the magnet's nonlinearity, over the amplitude."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ambkit.assessment.arguments import disturbance_argument, filter_arguments
from ambkit.assessment.assess import assess
from ambkit.assessment.assessment import Assessment
from ambkit.assessment.loop import AssessedAxis, AssessedLoop
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import Given, in_si, of_type
from ambkit.base.threads import one_thread
from ambkit.base.units import engineering, percent
from ambkit.control.pid import PID
from ambkit.data.signals import signal
from ambkit.estimate.estimate import Estimate, Status
from ambkit.identification.excitation.signals import sparse_multisine
from ambkit.judge.loop.loop_of import ZONES, zone_of
from ambkit.machine.machine import Machine
from ambkit.models.linear import Complex
from ambkit.result.result import Result
from ambkit.result.row import Row, put
from ambkit.result.sections import Section
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Disturbance as Load
from ambkit.simulation.scenario import Injection, Scenario
from ambkit.simulation.waveforms import Constant, Recorded, Sine

if TYPE_CHECKING:
    from ambkit.result.report.figure import Figure

Kind = Literal["multisine", "stepped-sine"]

AMPLITUDES = (1e-3, 1e-2, 3e-2)
"""Of the air gap, where nobody says how far to go."""

SETTLED = 1e-4
"""To what the slowest mode has decayed before a sweep is looked at."""

LONGEST = 2.0
"""But no longer is waited [s]."""

SLOWEST = 8.0
"""Lowest frequency, of the slowest that the period tells apart."""

PER_DECADE = {"multisine": 20, "stepped-sine": 10}
"""Frequencies of a sweep."""

SIZE = 20_000
"""Samples of a period of a multisine."""

STEP, APART = 2000, 1.5
"""Samples that one sine of many is looked at; and periods of its beat with the rotation, at least.
"""


@dataclass(frozen=True, eq=False)
class Swept:
    """The simulated loop's sensitivity at one amplitude."""

    amplitude: float  #: Greatest value of what was added to the measurement [m].
    frequency: Array  #: (k,) Frequencies [Hz].
    sensitivity: Complex  #: (k,) S of the simulated, nonlinear loop [1].
    model: Complex  #: (k,) S of the linear one [1].
    #: Whether the current came to a limit, the rotor to a stop, or the filter refused what it took
    #: for outliers.
    limited: bool

    @property
    def deviation(self) -> float:
        """Greatest distance from the linear model, of the model's magnitude [1]."""
        return float(np.max(np.abs(self.sensitivity - self.model) / np.abs(self.model)))

    @property
    def peak(self) -> float:
        """Greatest magnitude of S [1]."""
        return float(np.abs(self.sensitivity).max())


SWEPT = ("amplitudes",)
"""Section of a sweep."""


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Result):
    """A loop swept at several amplitudes, beside its linear model."""

    bearing: Machine  #: The plant.
    axis: int  #: Which was swept.
    kind: Kind  #: What was added to the measurement.
    loop: AssessedLoop  #: The linear model.
    swept: tuple[Swept, ...]  #: One for each amplitude.
    top: float  #: End of the range that the zones are taken from [Hz].

    @property
    def name(self) -> str:
        """Of the bearing, or of the machine and its axis."""
        if not self.bearing.single:
            return f"{self.bearing.name} {self.bearing.axes[self.axis].name}"
        return self.bearing.name

    @property
    def model(self) -> AssessedAxis:
        """What the linear model says of the axis."""
        return list(self.loop.axes.values())[self.axis]

    TITLE = "{0.name}, controller fed by {0.loop.name}: {0.kind} of the simulated loop"

    @property
    def finding(self) -> str:
        """How far the loop is from its linear model."""
        farthest = max(item.deviation for item in self.swept)
        return f"{self.title}: at most {percent(farthest)} from the linear model."

    @property
    def rows(self) -> list[Row]:
        """Peaks at each amplitude, and that of the model."""
        results = []
        for item in self.swept:
            results += put([
                Row("amplitude", "amplitude", item.amplitude, "m", detail=True),
                Row("peak", "peak of |S|", item.peak, "|S|"),
                Row("zone", "zone", zone_of(item.peak)),
                Row("deviation", "from the model, at most", item.deviation, "%"),
                Row("limited", "at a limit", item.limited),
            ], section=SWEPT, of=engineering(item.amplitude, "m", 4))  # fmt: skip
        return [*results, *put([
            Row("peak", "peak of |S|", self.model.peak, "|S|"),
            Row("zone", "zone", self.model.zone),
        ], section=SWEPT, of="linear model")]  # fmt: skip

    SECTIONS = {SWEPT: Section("{0.title}", across=True)}

    @property
    def series(self) -> dict[str, Any]:
        """The sensitivity over the frequency."""
        return {
            "bearing": self.name,
            "kind": self.kind,
            "fed_by": self.loop.name,
            "amplitudes": {
                engineering(item.amplitude, "m", 4): {
                    "frequency": item.frequency.tolist(),
                    "sensitivity": np.abs(item.sensitivity).tolist(),
                    "model": np.abs(item.model).tolist(),
                }
                for item in self.swept
            },
        }

    def figures(self) -> list[Figure]:
        """Return the sweeps."""
        return [self.figure()]

    def figure(self) -> Figure:
        """Return the sweeps over the model's curve, and how far they are from it, as a picture."""
        from ambkit.assessment.sensitivity_figure import sweep_figure

        return sweep_figure(
            self.title,
            self.loop.loop,
            self.axis,
            [(item.amplitude, item.frequency, item.sensitivity, item.model) for item in self.swept],
            zones=ZONES,
            top=self.top,
        )


@one_thread()
def sweep(
    bearing: Machine,
    filter: Any = None,
    controller: PID | None = None,
    *,
    amplitudes: Sequence[Given] | None = None,
    kind: Kind = "multisine",
    axis: str | None = None,
    x: Given = 0.0,
    load: Given | Mapping[str, Given] = 0.0,
    orbit: Given | bool = False,
) -> Sweep:
    """Sweep the simulated loop through the summing point at its measurement."""
    of_type(Machine, bearing=bearing)
    if kind not in get_args(Kind):
        raise AmbkitError(f"kind must be one of {', '.join(get_args(Kind))}, is {kind!r}")
    result = assess(bearing, filter, controller, x=x, load=load, orbit=orbit)
    name, loop = list(result.loops.items())[-1]
    if loop.worst is None:
        raise AmbkitError(f"{bearing.name}, controller fed by {name}: the loop is not stable")
    axes = list(loop.axes)
    chosen = loop.worst.name if axis is None else axis
    if chosen not in axes:
        raise AmbkitError(f"{bearing.name} has no axis {chosen}; there are {', '.join(axes)}")
    at = axes.index(chosen)
    levels = [part * result.of.isolated[at].magnet.air_gap for part in AMPLITUDES]
    if amplitudes is not None:
        levels = [in_si("amplitude", amplitude, "m") for amplitude in amplitudes]
    for level in levels:
        if not (math.isfinite(level) and level > 0):
            raise AmbkitError(f"an amplitude must be greater than 0 m, is {level:g} m")
    held = disturbance_argument(bearing, load)
    if not result.machine.single:
        rig: _Rig = _MachineRig(result, filter, loop, at, held)
    else:
        rig = _BearingRig(result, filter, loop, in_si("x", x, "m"), sum(held.values()))
    run = {"multisine": rig.multisine, "stepped-sine": rig.stepped}[kind]
    return Sweep(result.bearing, at, kind, loop, tuple(run(item) for item in levels), result.top)


class _Rig:
    """The simulated loop, without noise."""

    def __init__(self, result: Assessment, filter: Any, loop: AssessedLoop, axis: int) -> None:
        self.found, self.filter, self.loop, self.axis = result, filter, loop, axis
        self.T = result.bearing.sampling_time
        poles = loop.loop.closed.poles()
        rate = -math.log(float(np.abs(poles).max())) / self.T
        self.settling = math.ceil(min(LONGEST, -math.log(SETTLED) / rate) / self.T)
        self.slow = poles[np.abs(poles) ** self.settling > SETTLED]

    @property
    def inner(self) -> Any:
        """The estimator in the loop, made anew; None: there is none."""
        return next(iter(filter_arguments(self.filter, self.found.bearing).values()), None)

    def answer(self, added: Array, last: slice) -> tuple[Array, bool]:
        """Return the measurement with what was added to it (n,) [m], and whether a limit is met."""
        raise NotImplementedError

    @property
    def turns(self) -> bool:
        """Whether the measurement moves by itself."""
        raise NotImplementedError

    def look(self, period: Array, line: NDArray[np.int_]) -> tuple[Complex, bool]:
        """Add whole periods to the measurement, and return S at lines of their spectrum."""
        period_length = len(period)
        last = slice(-period_length, None)
        added = np.tile(period, 1 + math.ceil(self.settling / period_length))
        y, limited = self.answer(added, last)
        if self.turns:
            y = y - self.answer(np.zeros_like(added), last)[0]
        excitation = np.fft.rfft(period)[line] * 2 / period_length
        return np.asarray(self._at_lines(y[last], line) / excitation), limited

    def _at_lines(self, y: Array, line: NDArray[np.int_]) -> Complex:
        """Return the amplitudes of lines of a spectrum, beside what has not decayed yet."""
        # A mode that is slower than anybody waits, such as that of an unbalance that an estimator
        # still learns, would leak into a line nearby: it is fitted with the lines.
        n = np.arange(len(y))
        waves = np.exp(2j * np.pi * np.outer(n, line) / len(y))
        slow = np.power.outer(self.slow, n).T
        fitted = [waves.real, -waves.imag, slow.real, slow.imag]
        result = np.linalg.lstsq(np.hstack(fitted), y, rcond=None)[0]
        return np.asarray(result[: len(line)] + 1j * result[len(line) : 2 * len(line)], complex)

    def swept(self, amplitude: float, frequency: Array, parts: list[tuple[Complex, bool]]) -> Swept:
        """Return what simulated pieces say."""
        S = np.concatenate([item for item, _ in parts])
        model = self.loop.loop.of_axis(self.axis, frequency)
        return Swept(amplitude, frequency, S, model, any(limited for _, limited in parts))

    def multisine(self, amplitude: float) -> Swept:
        """All frequencies at once."""
        speed = (self.found.bearing.speed or 0.0) / (2 * math.pi) if self.turns else 0.0
        turn = abs(speed) * self.T
        size = round(max(1, round(SIZE * turn)) / turn) if turn else SIZE  # whole turns
        band = SLOWEST / (size * self.T), 0.45 / self.T
        signal = sparse_multisine(size, self.T, band, per_decade=PER_DECADE["multisine"])
        line = np.round(signal.frequencies * size * self.T).astype(int)
        S, limited = self.look(amplitude * signal.values, line)
        separate = _alone(line, round(size * turn))
        return self.swept(amplitude, signal.frequencies[separate], [(S[separate], limited)])

    def stepped(self, amplitude: float) -> Swept:
        """One frequency after the other, each from rest."""
        low, high = SLOWEST / (SIZE * self.T), 0.45 / self.T
        count = round(PER_DECADE["stepped-sine"] * math.log10(high / low)) + 1
        parts = [self.sine(amplitude, float(f)) for f in np.geomspace(low, high, count)]
        return self.swept(amplitude, np.array([f for f, _ in parts]), [part for _, part in parts])

    def sine(self, amplitude: float, f: float) -> tuple[float, tuple[Complex, bool]]:
        """Return what one sine of about a frequency [Hz] says, and of which exactly."""
        # A whole number of samples in whole periods, some 2000 of them; beside the rotation enough
        # to tell both apart.
        turn = abs(self.found.bearing.speed or 0.0) / (2 * math.pi) if self.turns else 0.0
        beat = 1 / max(abs(f - turn) * self.T, 1 / SIZE) if turn else 0.0
        periods = max(1, round(max(STEP, APART * beat) * f * self.T))
        sample_count = round(periods / (f * self.T))
        sine = amplitude * np.sin(2 * np.pi * periods * np.arange(sample_count) / sample_count)
        return periods / (sample_count * self.T), self.look(sine, np.array([periods]))


class _BearingRig(_Rig):
    """Of one axis."""

    def __init__(
        self, result: Assessment, filter: Any, loop: AssessedLoop, x: float, load: float
    ) -> None:
        super().__init__(result, filter, loop, 0)
        self.scenario = Scenario(
            controller=result.of.control_for(filter).fed_by(
                "estimate" if filter else "measurement"
            ),
            noise=False,
            reference=Constant(value=x),
            disturbance=Constant(value=load) if loop.of.point.orbit is None
            else self._turning(loop, load),
        )  # fmt: skip

    def _turning(self, loop: AssessedLoop, load: float) -> Sine:
        """Return the load that makes the orbit, about a constant one."""
        bearing, orbit = self.found.bearing, loop.of.point.orbit
        assert orbit is not None
        f = bearing.speed / (2 * math.pi)
        # Held over each sample as it is simulated; its phase does not matter.
        force = abs(orbit.x[0] / loop.loop.compliance([f])[0, 0, 0])
        return Sine(amplitude=float(force), frequency=f, offset=load)

    @property
    def turns(self) -> bool:
        """Whether it has runout, or an orbit."""
        b = self.found.bearing
        return self.loop.of.point.orbit is not None or bool(b.speed and b.sensor.runout)

    def answer(self, added: Array, last: slice) -> tuple[Array, bool]:
        """Simulate the bearing."""
        t = self.T * np.arange(len(added))
        waveform = Recorded.model_construct(times=tuple(t.tolist()), values=tuple(added.tolist()))
        scenario = self.scenario.model_copy(
            update={"duration": float(t[-1]), "injection": waveform}
        )
        run = simulate_run(self.found.bearing, scenario, estimator=self.inner)
        iu, b = run.record["iu"][last], self.found.bearing
        limited = run.record.meta["stop_touched"] or (iu >= b.current_max).any()
        limited = limited or (iu <= b.current_min).any() or _refused(run.estimate, last)
        return run.record["y"], bool(limited)


class _MachineRig(_Rig):
    """Of one axis of a machine, all others closed."""

    def __init__(
        self, result: Assessment, filter: Any, loop: AssessedLoop, axis: int,
        load: Mapping[str, float],
    ) -> None:  # fmt: skip
        super().__init__(result, filter, loop, axis)
        self.scenario = Scenario(
            noise=False,
            controller=result.of.control_for(filter).fed_by(
                "estimate" if filter else "measurement"
            ),
            disturbance=tuple(
                Load(axis=name, force=Constant(value=force)) for name, force in load.items()
            ),
        )

    @property
    def turns(self) -> bool:
        """Whether it turns."""
        return bool(self.found.bearing.speed)

    def answer(self, added: Array, last: slice) -> tuple[Array, bool]:
        """Simulate the machine."""
        of, transform = self.loop.of, self.loop.of.shown
        t = self.T * np.arange(len(added))
        waveform = Recorded.model_construct(times=tuple(t.tolist()), values=tuple(added.tolist()))
        there = Injection.model_construct(axis=of.axes[self.axis], position=waveform)
        scenario = self.scenario.model_copy(
            update={"duration": float(t[-1]), "injection": (there,)}
        )
        run = simulate_run(
            of.machine, scenario, estimator=self.inner, controllers=of.fed_by(self.filter)
        )
        y = np.column_stack([run.record[signal("y", r.name)] for r in of.machine.readings])
        limited = run.samples_at_the_stop > 0 or _refused(run.estimate, last)
        for name, b in zip(of.axes, of.isolated, strict=True):
            u = b.amplifier.gain * run.record[signal("u", name)][last]
            limited = limited or bool(((u >= b.current_max) | (u <= b.current_min)).any())
        return y @ transform[self.axis], limited


def _alone(line: NDArray[np.int_], turns: int) -> NDArray[np.bool_]:
    """Return which lines of a spectrum no other comes to by the rotation."""
    # Along an orbit the magnets' stiffness swings with the rotation and its double, and passes what
    # is at one frequency on to others, so far away.
    isolated_mask = np.ones(len(line), bool)
    for away in (turns, 2 * turns) if turns else ():
        beside = np.concatenate([line + away, np.abs(line - away)])
        isolated_mask &= np.abs(line[:, None] - beside).min(axis=1) > 1
    return isolated_mask


def _refused(estimate: Estimate | None, last: slice) -> bool:
    """Whether a filter took measurements for outliers."""
    return estimate is not None and bool((estimate.status[last] & Status.OUTLIER).any())
