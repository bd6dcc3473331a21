"""Result of a simulated run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.units import figure
from ambkit.control.control import Mode
from ambkit.data.record import Record
from ambkit.data.signals import by_name, signal
from ambkit.estimate.errors import rms_errors
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.registry import KINDS
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import At, Row, Section
from ambkit.simulation.run_figure import simulation_figure
from ambkit.simulation.scenario import energised

ERRORS = ("rmse",)
NEARLY = 1 - 1e-6  #: Of a limit; a demanded current at it has rounding errors.
TURNING = ("synchronous",)  #: Sections of its rows.


@dataclass(frozen=True, eq=False, repr=False)
class Run(Result):
    """A simulated run with its estimate."""

    machine: Machine  #: Simulated machine.
    #: Measurements and control signals, and the truth. With one axis ``y``, ``u``, ``r``, ``x``,
    #: ``v``, ``x_m``, ``iu``, ``f_mag``, ``f_d``. With several each reading ``y_NAME`` [m], and for
    #: each axis control signal ``u_NAME`` [V], displacement ``s_NAME`` [m], current ``iu_NAME``
    #: [A], magnet force ``f_mag_NAME`` [N] and disturbance ``f_d_NAME`` [N]; the rotor's
    #: coordinates and velocities; the speed of rotation [rad/s]. With lift-off and landing the
    #: ``mode``, `ambkit.control.control.Mode`.
    record: Record
    estimate: Estimate | None  #: Estimate during the run.
    status: NDArray[np.uint16]  #: (n,) Sum of the flags of estimator and controllers, `Status`.
    #: (n,) With lift-off and landing, whether the controllers' input was usable.
    usable: NDArray[np.bool_] | None = None
    #: Estimated unbalance and runout at the end, if it levitates then.
    turning: Sequence[Any] = ()
    #: Returns the critical speeds near the final speed, see `ambkit.campbell`.
    near_critical: Callable[[], Any] | None = None
    #: Returns the adequacy of its filter, and advice if the rotor does not levitate properly.
    judge: Callable[[Any], tuple[Sequence[Any], Sequence[str]]] | None = None

    @cached_property
    def _judged(self) -> tuple[Sequence[Any], Sequence[str]]:
        return ((), ()) if self.judge is None else self.judge(self)

    @property
    def adequacy(self) -> Sequence[Any]:
        """Adequacy of its filter, if it was judged."""
        return self._judged[0]

    @property
    def title(self) -> str:
        """Machine and duration."""
        t, seed = self.record.t, self.record.meta["seed"]
        return f"{self.machine.name}, seed {seed}: {figure(t[-1], 's')} simulated, {len(t)} samples"

    @property
    def finding(self) -> str:
        """Whether it levitated without contact, and the accuracy of the estimate."""
        contact_text = "contact with a stop" if self.samples_at_the_stop else "no contact"
        if self.estimate is None:
            return f"{self.title}; {contact_text}."
        span = self._evaluated_part and f" {self._evaluated_part}"
        quality = f"mean NIS {self.nis:.3f}{span} ({self.estimate.estimator})"
        return f"{self.title}; {contact_text}, {quality}."

    @cached_property
    def rows(self) -> list[Row]:
        """Maximum displacement and current, errors of the estimate, and synchronous quantities."""
        record, t, at = self.record, self.record.t, self.first_contact
        modes = [f"{mode['mode']} from {figure(mode['since'], 's')}" for mode in self.modes]
        # Contact is recorded at the end of the sample.
        touch = None if at is None else At("first_contact", t[min(at + 1, len(t) - 1)], "s")
        results = [
            Row("samples", "samples", len(record)),
            Row("duration", "duration", float(t[-1]), "s"),
            Row("seed", "noise seed", record.meta["seed"], detail=True),
            Row("maximum_displacement", "maximum displacement", self._by_axis(
                {axis: np.abs(record[self.displacement(axis)]).max() for axis in self.axes}), "m"),
            Row("samples_at_the_stop", "  samples at the stop", self.samples_at_the_stop, at=touch),
            Row("maximum_current", "maximum control current", self._by_axis(
                {axis: np.abs(iu).max(initial=0.0) for axis, iu in self._currents.items()}), "A"),
            Row("samples_at_the_current_limit", "  samples at its limit", self._at_the_limit),
            Row("sequence", "lift-off and landing", ", ".join(modes) or None),
        ]  # fmt: skip
        results += [row for item in self._apart for row in item.rows()]
        if self.estimate is None:
            return results
        units = self.estimate.units
        errors = rms_errors(self.estimate, record, *self._evaluated_samples)
        results += [
            Row("estimator", "filter", self.estimate.estimator),
            Row("evaluated", "  evaluated", self._evaluated_part or None),
            Row("nis", "  mean NIS (1: consistent)", self.nis),
            *(Row(name, name, error, units[name], section=ERRORS)
              for name, error in errors.items()),
        ]  # fmt: skip
        if self._evaluated_samples[1] is None:
            results += [row for item in self.turning for row in item.rows(())]
        return results

    SECTIONS = {
        (): Section("Run"),
        ERRORS: Section("Errors of the estimate, rms"),
        ("critical_speeds",): Section("Separation from critical speeds", across=True),
        TURNING: Section("Synchronous components", across=True),
    }

    @property
    def series(self) -> dict[str, Any]:
        """Modes of lift-off and landing, critical speeds near the final speed."""
        results: dict[str, Any] = {"machine": self.machine.name}
        if "mode" in self.record:
            results["modes"] = self.modes
        if self.turning and self._evaluated_samples[1] is None:
            results["synchronous"] = {
                item.name: {"covariance": item.covariance.tolist()} for item in self.turning
            }
        return results

    @property
    def notes(self) -> list[str]:
        """Remarks on its speed, and on the controller if it tripped."""
        remarks = [self._apart.sentence()] if self._apart else []
        if any(mode["mode"] == "tripped" for mode in self.modes):
            remarks.append("The sequence tripped: see lost and overload in [sequence].")
        return [*remarks, *self._judged[1]]

    def file(self) -> Record:
        """Return the record, for ``.csv`` and ``.parquet``."""
        return self.record

    def figures(self) -> list[Figure]:
        """Return its figure: with several axes with orbits."""
        return [simulation_figure(self)]

    @property
    def modes(self) -> list[dict[str, Any]]:
        """Modes of lift-off and landing, with their times [s]."""
        if "mode" not in self.record:
            return []
        t, mode = self.record.t, self.record["mode"]
        changed = np.flatnonzero(np.diff(mode, prepend=-1.0))
        return [{"mode": Mode(int(mode[k])).name.lower(), "since": float(t[k])} for k in changed]

    @property
    def final_speed(self) -> float:
        """Final speed [rad/s]."""
        return float(self.record["speed"][-1]) if "speed" in self.record else self.machine.speed

    @cached_property
    def _apart(self) -> Any:
        """Critical speeds near the final speed."""
        return () if self.near_critical is None else self.near_critical()

    @property
    def nis(self) -> float:
        """Mean normalised innovation squared during levitation; NaN without an estimate."""
        if self.estimate is None:
            return math.nan
        first, end = self._evaluated_samples
        return float(np.mean(self.estimate.nis[first:end][1:]))

    def _by_axis(self, values: Mapping[str, Any]) -> Any:
        return by_name(list(values), [float(value) for value in values.values()])

    @property
    def _currents(self) -> dict[str, NDArray[np.float64]]:
        """Control currents of each axis (n,) until a power failure [A]."""
        return {axis: self.record[signal("iu", axis)][self.energised] for axis in self.axes}

    @property
    def _at_the_limit(self) -> int:
        """Samples in which a demanded current, which the amplifier follows, is at its limit."""
        reached = []
        for name, axis in zip(self.axes, isolated_axes(self.machine), strict=True):
            demanded = axis.amplifier.gain * self.record[signal("u", name)][self.energised]
            low, high = NEARLY * axis.current_min, NEARLY * axis.current_max
            reached.append((demanded >= high) | (demanded <= low))
        return int(np.any(reached, axis=0).sum())

    @property
    def _evaluated_part(self) -> str:
        """Part of the run in which the estimate is evaluated, in words; empty for all of it."""
        if self._evaluated_samples == (0, None):
            return ""
        return "during levitation" if self.energised.all() else "until the power failure"

    @cached_property
    def _evaluated_samples(self) -> tuple[int, int | None]:
        """First sample of levitation, and the one after its last."""
        # Outside levitation contact forces act and the magnets may be off, which only the filter
        # contact models. 0 and None: all of the record.
        known = self.estimate is not None and KINDS["contact"].label in self.estimate.estimator
        if not known and not self.energised.all():
            return 0, int(np.argmin(self.energised))
        if known or "mode" not in self.record:
            return 0, None
        mode = self.record["mode"]
        flew = np.flatnonzero(mode == Mode.FLYING)
        if not flew.size:
            return 0, len(mode)
        end = int(flew[-1]) + 1
        return int(flew[0]), None if end == len(mode) else end

    @property
    def axes(self) -> list[str]:
        """Names of the axes; empty for a single one."""
        return self.machine.axis_names

    def displacement(self, axis: str) -> str:
        """Return the name of the signal of the displacement along an axis."""
        return signal("s", axis) if axis else "x"

    @cached_property
    def energised(self) -> NDArray[np.bool_]:
        """Where there is no power failure (n,)."""
        # During one the control current, a difference of two coil currents, does not show it.
        scenario, T = self.record.meta.get("scenario", {}), self.record.sampling_time
        return energised(scenario.get("off"), scenario.get("on"), self.record.t, T) > 0

    @property
    def samples_at_the_stop(self) -> int:
        """Samples with contact."""
        return int(self.record.meta["stop_touched"])

    @property
    def first_contact(self) -> int | None:
        """First of those samples; None if there is none."""
        result = self.record.meta["first_contact"]
        return None if result is None else int(result)
