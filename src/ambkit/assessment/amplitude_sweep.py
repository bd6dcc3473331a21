"""Sweeps of the simulated loop: sensitivity with the magnet's nonlinearity, over the amplitude."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ambkit.arguments import LoopArguments, filter_arguments
from ambkit.assessment.assess import MEASUREMENT, assess
from ambkit.assessment.loop import AssessedAxis, AssessedLoop
from ambkit.assessment.sweep_figures import sweep_figure
from ambkit.base.arrays import Array, Complex
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.base.threads import one_thread
from ambkit.base.units import engineering, percent
from ambkit.control.control import as_control
from ambkit.control.linear.closed_loop import Loop
from ambkit.data.signals import signal
from ambkit.estimate.estimate import Estimate, Status
from ambkit.identification.excitation.signals import Excitation, sparse_multisine
from ambkit.judge.loop.loop_builder import ZONES, LoopBuilder, zone_of
from ambkit.machine.machine import Machine
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Disturbance as Load
from ambkit.simulation.scenario import Injection, Reference, Scenario
from ambkit.simulation.waveforms import Constant, Recorded, Sine

Kind = Literal["multisine", "stepped-sine"]

AMPLITUDES = (1e-3, 1e-2, 3e-2)  #: Default amplitudes, over the air gap.
SETTLED = 1e-4  #: Decay of the slowest mode before the measurement.
LONGEST = 2.0  #: Maximum of that time [s].
SLOWEST = 8.0  #: Lowest frequency, over the frequency resolution.
PER_DECADE = {"multisine": 20, "stepped-sine": 10}  #: Density of the frequencies.
SIZE = 20_000  #: Samples of a multisine's period.

STEP, APART = 2000, 1.5
"""Samples of one sine; and minimum number of periods of its beat with the rotation."""


@dataclass(frozen=True, eq=False)
class Swept:
    """The simulated loop's sensitivity at one amplitude."""

    amplitude: float  #: Maximum of the injected signal [m].
    frequency: Array  #: (k,) Frequencies [Hz].
    sensitivity: Complex  #: (k,) S of the simulated, nonlinear loop [1].
    model: Complex | None  #: (k,) S of the linear loop [1]; None if there is none.
    #: Whether the current was limited, the rotor touched a stop, or the filter rejected
    #: measurements as outliers.
    limited: bool

    @property
    def deviation(self) -> float:
        """Largest distance from the linear model, over the model's magnitude [1]; NaN without."""
        if self.model is None:
            return math.nan
        return float(np.max(np.abs(self.sensitivity - self.model) / np.abs(self.model)))

    @property
    def peak(self) -> float:
        """Largest magnitude of S [1]."""
        return float(np.abs(self.sensitivity).max())


SWEPT = ("amplitudes",)  #: Section of a sweep.


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Result):
    """Sweeps of a loop at several amplitudes, with its linear model."""

    machine: Machine  #: The plant.
    axis: int  #: Axis of the injection.
    kind: Kind  #: Injected signal.
    fed_by: str  #: Feedback of the controller.
    loop: AssessedLoop | None  #: Linear model; None for a controller in Python.
    swept: tuple[Swept, ...]  #: One sweep for each amplitude.
    top: float  #: Upper end of the zones' range [Hz].

    @property
    def name(self) -> str:
        """Name of the machine and, if it has several, the axis."""
        return f"{self.machine.name} {self.machine.axes[self.axis].name}".rstrip()

    @property
    def model(self) -> AssessedAxis | None:
        """The axis in the linear model; None if there is none."""
        return None if self.loop is None else list(self.loop.axes.values())[self.axis]

    TITLE = "{0.name}: {0.kind} of the simulated loop, controller fed by {0.fed_by}"

    @property
    def finding(self) -> str:
        if self.loop is None:
            peak = max(item.peak for item in self.swept)
            return f"{self.title}: peak of |S| {peak:.3g}, zone {zone_of(peak)}."
        farthest = max(item.deviation for item in self.swept)
        return f"{self.title}: deviation from the linear model up to {percent(farthest)}."

    @property
    def rows(self) -> list[Row]:
        results = []
        for item in self.swept:
            results += put([
                Row("amplitude", "amplitude", item.amplitude, "m", detail=True),
                Row("peak", "peak of |S|", item.peak, "|S|"),
                Row("zone", "zone", zone_of(item.peak)),
                *([] if item.model is None else [
                    Row("deviation", "maximum deviation from the model", item.deviation, "%")]),
                Row("limited", "at a limit", item.limited),
            ], section=SWEPT, of=engineering(item.amplitude, "m", 4))  # fmt: skip
        if self.model is None:
            return results
        return [*results, *put([
            Row("peak", "peak of |S|", self.model.peak, "|S|"),
            Row("zone", "zone", self.model.zone),
        ], section=SWEPT, of="linear model")]  # fmt: skip

    SECTIONS = {SWEPT: Section("{0.title}", across=True)}

    @property
    def series(self) -> dict[str, Any]:
        return {
            "machine": self.name,
            "kind": self.kind,
            "fed_by": self.fed_by,
            "amplitudes": {
                engineering(item.amplitude, "m", 4): {
                    "frequency": item.frequency.tolist(),
                    "sensitivity": np.abs(item.sensitivity).tolist(),
                }
                | ({} if item.model is None else {"model": np.abs(item.model).tolist()})
                for item in self.swept
            },
        }

    def figures(self) -> list[Figure]:
        swept = [(of.amplitude, of.frequency, of.sensitivity, of.model) for of in self.swept]
        model = None if self.loop is None else self.loop.loop
        return [sweep_figure(self.title, model, self.axis, swept, zones=ZONES, top=self.top)]


@one_thread()
def sweep(
    arguments: LoopArguments,
    *,
    amplitudes: Sequence[QuantityLike] | None = None,
    kind: Kind = "multisine",
    axis: str | None = None,
    orbit: QuantityLike | bool = False,
) -> Sweep:
    """Sweep the simulated loop with a signal added at its measurement."""
    if kind not in get_args(Kind):
        raise AmbkitError(f"kind must be one of {', '.join(get_args(Kind))}, is {kind!r}")
    of, name, loop = _linear(arguments, orbit)
    chosen = axis or (of.axes[0] if loop is None or loop.worst is None else loop.worst.name)
    if chosen not in of.axes:
        raise AmbkitError(
            f"{arguments.machine.name} has no axis {chosen}; there are {', '.join(of.axes)}"
        )
    at = of.axes.index(chosen)
    levels = [part * of.isolated[at].magnet.air_gap for part in AMPLITUDES]
    if amplitudes is not None:
        levels = [in_si("amplitude", amplitude, "m") for amplitude in amplitudes]
    for level in levels:
        if not (math.isfinite(level) and level > 0):
            raise AmbkitError(f"an amplitude must be greater than 0 m, is {level:g} m")
    rig = _NoiselessLoop(of, arguments.filters, None if loop is None else loop.loop, at)
    rig.disturb(arguments.position, arguments.disturbance)
    if loop is None:
        rig.check()
    run = {"multisine": rig.multisine, "stepped-sine": rig.stepped}[kind]
    return Sweep(of.machine, at, kind, name, loop, tuple(map(run, levels)), of.top)


def _linear(arguments: LoopArguments, orbit: Any) -> tuple[LoopBuilder, str, AssessedLoop | None]:
    """Return the axis, its feedback, and the linear model, if there is one."""
    machine, filters, controller, x, load = arguments
    if controller is not None and as_control(controller).custom:
        if orbit is not False:
            raise AmbkitError("orbit needs a linear loop, and a controller in Python has none")
        return LoopBuilder(machine, controller, x, load), next(iter(filters), MEASUREMENT), None
    name, loop = list(assess(arguments, orbit=orbit).loops.items())[-1]
    if loop.worst is None:
        raise AmbkitError(f"{machine.name}, controller fed by {name}: the loop is not stable")
    return loop.of, name, loop


class _NoiselessLoop:
    """The simulated loop, without noise."""

    def __init__(self, of: LoopBuilder, filter: Any, model: Loop | None, axis: int) -> None:
        self.of, self.filter, self.model, self.axis = of, filter, model, axis
        self.machine, self.T = of.machine, of.machine.sampling_time
        self.turns = bool(self.machine.speed)
        self.settling, self.slow = math.ceil(LONGEST / self.T), np.zeros(0, complex)
        if model is not None:
            poles = model.closed.poles()
            rate = -math.log(float(np.abs(poles).max())) / self.T
            self.settling = math.ceil(min(LONGEST, -math.log(SETTLED) / rate) / self.T)
            self.slow = poles[np.abs(poles) ** self.settling > SETTLED]
        fed_by: Literal["estimate", "measurement"] = "estimate" if filter else "measurement"
        self.scenario = Scenario(noise=False, controller=of.control_for(filter).fed_by(fed_by))

    def disturb(self, x: float, load: Mapping[str, float]) -> None:
        """Hold the rotor at x along its axes [m] with constant disturbances [N]."""
        names = self.of.machine.axis_names
        forces: dict[str, Constant | Sine] = {
            name: Constant(value=load.get(name, 0.0)) for name in names
        }
        orbit = self.of.point.orbit
        if (
            orbit is not None and self.machine.rotor.type == "mass"
        ):  # that of several axes follows from its unbalance
            assert self.model is not None
            f = self.machine.speed / (2 * math.pi)
            # Held over each sample, as simulated; its phase is irrelevant.
            size = float(abs(orbit.x[0] / self.model.compliance([f])[0, 0, 0]))
            forces = {"": Sine(amplitude=size, frequency=f, offset=load.get("", 0.0))}
        self.scenario = self.scenario.model_copy(update={
            "reference": tuple(
                Reference(axis=name, position=Constant(value=x)) for name in names if x
            ),
            "disturbance": tuple(Load(axis=name, force=force) for name, force in forces.items()),
        })  # fmt: skip

    def check(self) -> None:
        """Reject a loop that has no linear model and does not levitate the rotor by itself."""
        if self.answer(np.zeros(self.settling), slice(-STEP, None))[1]:
            raise AmbkitError(
                f"{self.machine.name}: without any signal the rotor comes to a stop, or a current "
                "to its limit: the loop is not stable"
            )

    @property
    def inner(self) -> Any:
        """The estimator in the loop, made anew; None if there is none."""
        return next(iter(filter_arguments(self.filter, self.machine).values()), None)

    def answer(self, added: Array, last: slice) -> tuple[Array, bool]:
        """Return the measurement with injected signal (n,) [m], and whether a limit was reached."""
        of, single = self.of, self.machine.single
        t = self.T * np.arange(len(added))
        waveform = Recorded.of(t, added)
        names = of.machine.axis_names
        there = Injection.model_construct(axis=names[self.axis], position=waveform)
        scenario = self.scenario.model_copy(
            update={"duration": float(t[-1]), "injection": (there,)}
        )
        run = simulate_run(
            self.machine, scenario, estimator=self.inner,
            controllers=None if single else of.fed_by(self.filter),
        )  # fmt: skip
        limited = run.samples_at_the_stop > 0 or _refused(run.estimate, last)
        for name, b in zip(names, of.isolated, strict=True):
            iu = run.record["iu"] if single else b.amplifier.gain * run.record[signal("u", name)]
            limited = limited or bool(((iu >= b.current_max) | (iu <= b.current_min))[last].any())
        if single:
            return run.record["y"], limited
        y = np.column_stack([run.record[signal("y", r.name)] for r in of.machine.readings])
        return y @ of.measured[self.axis], limited

    def look(self, period: Array, line: NDArray[np.int_]) -> tuple[Complex, bool]:
        """Inject whole periods, and return S at lines of their spectrum."""
        period_length = len(period)
        last = slice(-period_length, None)
        added = np.tile(period, 1 + math.ceil(self.settling / period_length))
        y, limited = self.answer(added, last)
        if self.turns:
            y = y - self.answer(np.zeros_like(added), last)[0]
        excitation = np.fft.rfft(period)[line] * 2 / period_length
        return np.asarray(self._at_lines(y[last], line) / excitation), limited

    def _at_lines(self, y: Array, line: NDArray[np.int_]) -> Complex:
        """Return the amplitudes of lines of a spectrum, corrected for undamped transients."""
        # A mode that decays too slowly to wait for, such as that of an unbalance which an estimator
        # still learns, would leak into a neighbouring line: it is fitted with the lines.
        n = np.arange(len(y))
        waves = np.exp(2j * np.pi * np.outer(n, line) / len(y))
        slow = np.power.outer(self.slow, n).T
        fitted = [waves.real, -waves.imag, slow.real, slow.imag]
        result = np.linalg.lstsq(np.hstack(fitted), y, rcond=None)[0]
        return np.asarray(result[: len(line)] + 1j * result[len(line) : 2 * len(line)], complex)

    def swept(self, amplitude: float, frequency: Array, parts: list[tuple[Complex, bool]]) -> Swept:
        """Return the sweep from simulated segments."""
        S = np.concatenate([item for item, _ in parts])
        model = None if self.model is None else self.model.of_axis(self.axis, frequency)
        return Swept(amplitude, frequency, S, model, any(limited for _, limited in parts))

    @cached_property
    def _sines(self) -> tuple[Excitation, int, int]:
        """All frequencies at once, with amplitude 1; its samples, and revolutions in them."""
        speed = (self.machine.speed or 0.0) / (2 * math.pi) if self.turns else 0.0
        turn = abs(speed) * self.T
        size = round(max(1, round(SIZE * turn)) / turn) if turn else SIZE  # whole turns
        band = SLOWEST / (size * self.T), 0.45 / self.T
        signal = sparse_multisine(size, self.T, band, per_decade=PER_DECADE["multisine"])
        return signal, size, round(size * turn)

    def multisine(self, amplitude: float) -> Swept:
        """All frequencies at once."""
        signal, size, turns = self._sines
        line = np.round(signal.frequencies * size * self.T).astype(int)
        S, limited = self.look(amplitude * signal.values, line)
        separate = _separate_lines(line, turns)
        return self.swept(amplitude, signal.frequencies[separate], [(S[separate], limited)])

    def stepped(self, amplitude: float) -> Swept:
        """One frequency at a time, each from equilibrium."""
        low, high = SLOWEST / (SIZE * self.T), 0.45 / self.T
        count = round(PER_DECADE["stepped-sine"] * math.log10(high / low)) + 1
        parts = [self.sine(amplitude, float(f)) for f in np.geomspace(low, high, count)]
        return self.swept(amplitude, np.array([f for f, _ in parts]), [part for _, part in parts])

    def sine(self, amplitude: float, f: float) -> tuple[float, tuple[Complex, bool]]:
        """Return the response to one sine near a frequency [Hz], and its exact frequency."""
        # Whole samples in whole periods, some 2000 of them; with rotation enough to separate both.
        turn = abs(self.machine.speed or 0.0) / (2 * math.pi) if self.turns else 0.0
        beat = 1 / max(abs(f - turn) * self.T, 1 / SIZE) if turn else 0.0
        periods = max(1, round(max(STEP, APART * beat) * f * self.T))
        sample_count = round(periods / (f * self.T))
        sine = amplitude * np.sin(2 * np.pi * periods * np.arange(sample_count) / sample_count)
        return periods / (sample_count * self.T), self.look(sine, np.array([periods]))


def _separate_lines(line: NDArray[np.int_], turns: int) -> NDArray[np.bool_]:
    """Return which lines of a spectrum rotation does not mix with others."""
    # Along an orbit the magnets' stiffness varies at the speed and twice the speed, and shifts
    # components by these frequencies.
    isolated_mask = np.ones(len(line), bool)
    for away in (turns, 2 * turns) if turns else ():
        beside = np.concatenate([line + away, np.abs(line - away)])
        isolated_mask &= np.abs(line[:, None] - beside).min(axis=1) > 1
    return isolated_mask


def _refused(estimate: Estimate | None, last: slice) -> bool:
    """Whether a filter rejected measurements as outliers."""
    return estimate is not None and bool((estimate.status[last] & Status.OUTLIER).any())
