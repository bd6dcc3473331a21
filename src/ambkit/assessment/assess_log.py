"""Assessment of a loop from a record with an injected signal, compared with the model."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.arguments import LoopArguments
from ambkit.assessment.assess import assess
from ambkit.assessment.assessment import Assessment
from ambkit.assessment.assessment_figure import Curves
from ambkit.assessment.rows import of_loop
from ambkit.assessment.sweep_figures import measured_figure
from ambkit.base.arrays import Complex
from ambkit.base.errors import RecordError
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.machine_model import View
from ambkit.judge.loop.loop_builder import ZONES, zone_of
from ambkit.judge.loop.measured_sensitivity import Logged, MeasuredSensitivity, measured_sensitivity
from ambkit.machine.machine import Machine
from ambkit.machine.rotors.modes import max_frequency
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import At, Row, Section, put

BASIS = (
    "Zones after ISO 14839-3 are those of one record at its frequencies; certification requires "
    "more."
)


MODELS = ("models",)  #: Section of the model's loops.


@dataclass(frozen=True, eq=False, repr=False)
class AssessedLog(Result):
    """A measured sensitivity and its assessment."""

    measured: MeasuredSensitivity  #: Measurement.
    top: float  #: Upper end of the zones' range [Hz].
    peak: float  #: Largest magnitude of S within it [1], and its frequency [Hz].
    peak_frequency: float
    #: Confidence interval of the largest magnitude at the measured frequencies, 95 % or more [1].
    interval: tuple[float, float]
    model: Assessment | None  #: Linear loops of the machine, if it is given.
    axis: int = 0  #: Axis of the machine.

    @property
    def zone(self) -> str:
        """Zone of the measured peak; ``"A or B"`` if its interval covers both."""
        best, worst = (zone_of(end) for end in self.interval)
        return best if best == worst else f"{best} or {worst}"

    @property
    def name(self) -> str:
        """Name of the machine and, if it has several, the axis; empty without machine."""
        if self.model is None:
            return ""
        axes = self.model.of.axes
        axis = f" {axes[self.axis]}" if len(axes) > 1 else ""
        return f"{self.model.machine.name}{axis}"

    @property
    def within(self) -> dict[str, float]:
        """Share of the frequencies at which the interval contains each model's magnitude [1]."""
        low, high = self.measured.interval()
        return {
            name: float(np.mean((low <= np.abs(S)) & (np.abs(S) <= high)))
            for name, S in self._models()
        }

    @property
    def deviation(self) -> dict[str, float]:
        """Median distance of the measured S from each model's, over the model's magnitude [1]."""
        result = self.measured.sensitivity
        return {name: float(np.median(np.abs(result / S - 1))) for name, S in self._models()}

    def _models(self) -> Iterator[tuple[str, Complex]]:
        for name, item in () if self.model is None else self.model.loops.items():
            yield name, item.loop.of_axis(self.axis, self.measured.frequency)

    @property
    def title(self) -> str:
        return f"Measured sensitivity{f' of {self.name}' if self.name else ''}"

    @property
    def finding(self) -> str:
        low, high = self.interval
        return (
            f"Measured sensitivity: zone {self.zone}, peak {self.peak:.3f} ({low:.3f} to "
            f"{high:.3f}) at {engineering(self.peak_frequency, 'Hz', 4)}."
        )

    @property
    def rows(self) -> list[Row]:
        m, top = self.measured, engineering(self.top, "Hz", 4)
        results = [
            Row("zone", "zone of ISO 14839-3", self.zone),
            Row("peak", f"  peak of |S| to {top}", self.peak, "|S|", interval=self.interval,
                at=At("peak_frequency", self.peak_frequency)),
            Row("frequencies", "frequencies", len(m.frequency)),
            Row("range_measured", "  of them", (float(m.frequency[0]), float(m.frequency[-1])),
                "Hz", 3),
            Row("periods", "periods (1 or none: local polynomials)", m.periods),
            Row("least_coherence", "minimum coherence", float(m.coherence.min())),
        ]  # fmt: skip
        loops = {} if self.model is None else self.model.loops
        for name, loop in loops.items():
            rest = [row for row in of_loop(loop) if row.key not in ("zone", "peak")]
            results += put([
                Row("zone", "zone", loop.zone),
                Row("peak", "peak of |S|", loop.peak, "|S|"),
                Row("deviation", "median deviation", self.deviation[name], "%"),
                Row("within", "share within the 95 % intervals", self.within[name], "%"),
                *put(rest, detail=True),
            ], section=MODELS, of=name)  # fmt: skip
        return results

    SECTIONS = {(): Section("Measured sensitivity"), MODELS: Section("Models of {0.name}")}

    @property
    def notes(self) -> list[str]:
        return [BASIS]

    @property
    def series(self) -> dict[str, Any]:
        m, (low, high) = self.measured, self.measured.interval()
        L, spread = m.open_loop()
        return {
            "range": self.top,
            "freedom": m.freedom,
            "frequency": m.frequency.tolist(),
            "sensitivity": np.abs(m.sensitivity).tolist(),
            "low": low.tolist(),
            "high": high.tolist(),
            "coherence": m.coherence.tolist(),
            "open_loop": [[float(at.real), float(at.imag)] for at in L],
            "open_loop_std": spread.tolist(),
        }

    def figures(self) -> list[Figure]:
        models = [] if self.model is None else [
            Curves(name, loop.loop, self.axis)
            for name, loop in self.model.loops.items() if loop.stable
        ]  # fmt: skip
        name = "" if self.model is None else f"{self.name}: "
        title = f"{name}measured sensitivity, zone {self.zone}"
        return [measured_figure(title, self.measured, models, zones=ZONES, top=self.top)]


def assess_log(record: Record, loop: LoopArguments | None, logged: Logged) -> AssessedLog:
    """Assess a loop from a record with a signal added to its measurement."""
    axis = 0
    if loop is not None and not loop.machine.single:
        axis, record = of_one_axis(record, loop.machine)
    result = measured_sensitivity(record, logged)
    speed = None if loop is None else loop.machine.speed
    top = max_frequency(result.sampling_time, speed)
    model = None if loop is None else assess(loop)
    inside = result.frequency <= top
    size = np.where(inside, np.abs(result.sensitivity), -np.inf)
    at = int(size.argmax())
    return AssessedLog(
        measured=result,
        top=top,
        peak=float(size[at]),
        peak_frequency=float(result.frequency[at]),
        interval=result.peak_interval(top=top),
        model=model,
        axis=axis,
    )


def of_one_axis(record: Record, machine: Machine) -> tuple[int, Record]:
    """Return the axis of the injection, and the record of that axis."""
    names = machine.axis_names
    injected_axes = [name for name in names if signal("injected", name) in record]
    if len(injected_axes) != 1:
        there, has = (
            ", ".join(signal("injected", name) for name in of) for of in (names, injected_axes)
        )
        raise RecordError(
            f"the record must have what was injected at one axis of {machine.name}: one of "
            f"{there}; has {has or 'none of them'}"
        )
    lacking = [signal("y", r.name) for r in machine.readings if signal("y", r.name) not in record]
    if lacking:
        raise RecordError(f"the record has no {', '.join(lacking)}, which {machine.name} gives")
    axis, view = names.index(injected_axes[0]), View(machine)
    y = np.column_stack([record[signal("y", r.name)] for r in machine.readings])
    position = y @ view.measured[axis]
    return axis, Record(
        record.t, {"y": position, "injected": record[signal("injected", injected_axes[0])]}
    )
