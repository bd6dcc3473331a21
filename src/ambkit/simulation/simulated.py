"""A simulated run, and what it came to."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.units import figure
from ambkit.control.lift_off_sequence import Mode
from ambkit.data.record import Record
from ambkit.data.signals import by_name, signal
from ambkit.estimate.errors import errors_along
from ambkit.estimate.estimate import Estimate
from ambkit.machine.force_laws import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import At, Row, Section
from ambkit.simulation.run_figure import simulation_figure

ERRORS = ("rmse",)
TURNING = ("synchronous",)  #: Sections of its rows.


@dataclass(frozen=True, eq=False, repr=False)
class Run(Result):
    """A simulated run: what happened, and what the estimator said meanwhile."""

    machine: Machine  #: What was simulated.
    #: Measurements and control signals, and the truth. Of one axis ``y``, ``u``, ``r``, ``x``,
    #: ``v``, ``x_m``, ``iu``, ``f_mag``, ``f_d``. Of several each reading ``y_NAME`` [m], each
    #: axis's ``u_NAME`` [V], displacement ``s_NAME`` [m], current ``iu_NAME`` [A], magnet force
    #: ``f_mag_NAME`` [N] and load ``f_d_NAME`` [N]; the rotor's coordinates and velocities; the
    #: speed of rotation [rad/s]. With lift-off and landing the ``mode``,
    #: `ambkit.control.lift_off_sequence.Mode`.
    record: Record
    estimate: Estimate | None  #: What the estimator said meanwhile.
    status: NDArray[np.uint16]  #: (n,) The sum of the flags of estimator and controllers, `Status`.
    #: (n,) With lift-off and landing, whether what feeds the controllers could be used.
    usable: NDArray[np.bool_] | None = None
    #: What its estimator says of unbalance and runout at the end, where it flies then.
    turning: Sequence[Any] = ()
    #: Returns the critical speeds near the speed at the end, see `ambkit.campbell`.
    near_critical: Callable[[], Any] | None = None
    #: Returns whether its filter may fly, and what may help where the rotor does not as it should.
    judge: Callable[[Any], tuple[Sequence[Any], Sequence[str]]] | None = None

    @cached_property
    def _judged(self) -> tuple[Sequence[Any], Sequence[str]]:
        return ((), ()) if self.judge is None else self.judge(self)

    @property
    def adequacy(self) -> Sequence[Any]:
        """Whether its filter may fly, where that is judged."""
        return self._judged[0]

    @property
    def title(self) -> str:
        """Of what machine, how long."""
        t, seed = self.record.t, self.record.meta["seed"]
        return f"{self.machine.name}, seed {seed}: {figure(t[-1], 's')} simulated, {len(t)} samples"

    @property
    def finding(self) -> str:
        """Whether it flew without touching a stop, and how well it was estimated."""
        contact_text = "contact with a stop" if self.samples_at_the_stop else "no contact"
        if self.estimate is None:
            return f"{self.title}; {contact_text}."
        return f"{self.title}; {contact_text}, mean NIS {self.nis:.3f} ({self.estimate.estimator})."

    @cached_property
    def rows(self) -> list[Row]:
        """Greatest displacement and current, errors of the estimate, and what turns."""
        record, t, at = self.record, self.record.t, self.first_touch
        modes = [f"{mode['mode']} from {figure(mode['since'], 's')}" for mode in self.modes]
        # It is there by the end of the sample.
        touch = None if at is None else At("first_touch", t[min(at + 1, len(t) - 1)], "s")
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
        errors = errors_along(self.estimate, record, *self._in_flight)
        results += [
            Row("estimator", "filter", self.estimate.estimator),
            Row("nis", "  mean NIS (1: consistent)", self.nis),
            *(Row(name, name, error, units[name], section=ERRORS)
              for name, error in errors.items()),
        ]  # fmt: skip
        if self._in_flight[1] is None:
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
        """Modes of lift-off and landing, critical speeds near the speed at the end."""
        results: dict[str, Any] = {"machine": self.machine.name}
        if "mode" in self.record:
            results["modes"] = self.modes
        if self.turning and self._in_flight[1] is None:
            results["synchronous"] = {
                item.name: {"covariance": item.covariance.tolist()} for item in self.turning
            }
        return results

    @property
    def notes(self) -> list[str]:
        """What is to be said of its speed, and of the controller where it tripped."""
        remarks = [self._apart.sentence()] if self._apart else []
        if any(mode["mode"] == "tripped" for mode in self.modes):
            remarks.append("The sequence tripped: see lost and overload in [sequence].")
        return [*remarks, *self._judged[1]]

    def file(self) -> Record:
        """Return the record, which is what is written as ``.csv`` and ``.parquet``."""
        return self.record

    def figures(self) -> list[Figure]:
        """Return its figure: of several axes with orbits."""
        return [simulation_figure(self)]

    @property
    def modes(self) -> list[dict[str, Any]]:
        """What lift-off and landing did, and since when [s]."""
        if "mode" not in self.record:
            return []
        t, mode = self.record.t, self.record["mode"]
        changed = np.flatnonzero(np.diff(mode, prepend=-1.0))
        return [{"mode": Mode(int(mode[k])).name.lower(), "since": float(t[k])} for k in changed]

    @property
    def final_speed(self) -> float:
        """The speed at the end [rad/s]."""
        return float(self.record["speed"][-1]) if "speed" in self.record else self.machine.speed

    @cached_property
    def _apart(self) -> Any:
        """The critical speeds near the speed at the end."""
        return () if self.near_critical is None else self.near_critical()

    @property
    def nis(self) -> float:
        """Mean normalised innovation squared in flight; NaN without an estimate."""
        if self.estimate is None:
            return math.nan
        first, end = self._in_flight
        return float(np.mean(self.estimate.nis[first:end][1:]))

    def _by_axis(self, values: Mapping[str, Any]) -> Any:
        return by_name(list(values), [float(value) for value in values.values()])

    @property
    def _currents(self) -> dict[str, NDArray[np.float64]]:
        """The control currents of each axis (n,) while magnets have any [A]."""
        return {axis: self.record[signal("iu", axis)][self.fed] for axis in self.axes}

    @property
    def _at_the_limit(self) -> int:
        limits = [
            (isolated_axis.current_min, isolated_axis.current_max)
            for isolated_axis in isolated_axes(self.machine)
        ]
        parts = zip(self._currents.values(), limits, strict=True)
        return int(np.any([(iu >= high) | (iu <= low) for iu, (low, high) in parts], axis=0).sum())

    @cached_property
    def _in_flight(self) -> tuple[int, int | None]:
        """The first sample in which the rotor flew, and the one after it last did."""
        # A rotor that lies has the touch-down bearings' forces, which no filter knows, and a filter
        # takes the magnets for switched on; so it is after a power failure. 0 and None: all of the
        # record.
        if "mode" not in self.record:
            return 0, self.fed.stop
        mode = self.record["mode"]
        flew = np.flatnonzero(mode == Mode.FLYING)
        if not flew.size:
            return 0, len(mode)
        end = int(flew[-1]) + 1
        return int(flew[0]), None if end == len(mode) else end

    @property
    def axes(self) -> list[str]:
        """The names of the axes; a single one has none."""
        return [axis.name for axis in self.machine.axes]

    def displacement(self, axis: str) -> str:
        """Return the name of the signal of the displacement along an axis."""
        return signal("s", axis) if axis else "x"

    @property
    def fed(self) -> slice:
        """The samples in which magnets have current: up to where the power fails."""
        # From then on no control current says so: it takes from one side what it gives the other.
        off = self.record.meta.get("scenario", {}).get("off")
        return slice(None) if off is None else slice(int(np.searchsorted(self.record.t, off)))

    @property
    def samples_at_the_stop(self) -> int:
        """Samples in which a stop was touched."""
        return int(self.record.meta["stop_touched"])

    @property
    def first_touch(self) -> int | None:
        """The first of those samples; None where there is none."""
        result = self.record.meta["first_touch"]
        return None if result is None else int(result)
