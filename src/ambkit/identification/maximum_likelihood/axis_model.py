"""One axis of a machine with several, for records of the machine.

The filter is that of the machine, with all readings and control signals: the motion of the other
axes is no disturbance force of this one. The likelihood is that of the axis's own reading, given
all earlier measurements.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import ExtendedKalmanFilter
from ambkit.estimate.noise_model import FilterNoise
from ambkit.identification.dead_time import acting
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.machine import geometry
from ambkit.machine.axes import reading_along, weights_of, with_axis
from ambkit.machine.components import BearingAt
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, magnet_of


@dataclass(frozen=True, kw_only=True)
class AxisModel(LoopModel):
    """An axis with free parameters, among others as described."""

    described = MappingProxyType({"mass": "all axes move one rotor, whose mass is described"})
    taken_as_known = (
        "the standard errors do not include errors in the description of the other bearings",
    )

    machine: Machine
    axis: str

    @property
    def signals(self) -> tuple[str, str]:
        reading = self.machine.readings[self.reading]
        return signal("y", reading.name), signal("u", self.axis)

    @property
    def reading(self) -> int:
        return reading_along(self.machine, self.axis)

    def _filter(self, finer: Machine, _magnet: MagnetModel) -> Estimator:
        machine = with_axis(self.machine, self.axis, finer)
        bearings = tuple(
            after if after is not before else self._finer(before)
            for before, after in zip(self.machine.bearings, machine.bearings, strict=True)
        )
        machine = machine.model_copy(update={"bearings": bearings})
        return ExtendedKalmanFilter(
            machine,
            noise=FilterNoise(disturbance=self.disturbance_noise),
            outlier_limit=0,
            synchronous=("unbalance",) if machine.turns else (),
        )

    def _finer(self, bearing: BearingAt) -> BearingAt:
        """Return another bearing with the control noise of a step, as `LoopModel.kalman` does."""
        amplifier = bearing.amplifier
        noise = {"noise_variance": self.substeps * amplifier.noise_variance}
        return bearing.model_copy(update={"amplifier": amplifier.model_copy(update=noise)})

    def run(
        self, record: Record, kalman: Estimator | None = None
    ) -> tuple[dict[str, Any], Array, Estimator]:
        kalman, own = kalman or self.kalman(), self.reading
        y, u = self.acting_signals(record)
        kalman.reset(*self.begin(kalman, y, record["u"][:1]))
        out = kalman.core.run(y, u)
        one = {name: out[name][:, own] for name in ("innovation", "variance")}
        return out | one | {"status": out["health"][:, own]}, u, kalman

    def acting_signals(self, record: Record) -> tuple[Array, Array]:
        u = np.column_stack([self._of_axis(axis.name, record) for axis in self.machine.axes])
        y = np.full((len(u), len(self.machine.readings)), np.nan)
        for k, reading in enumerate(self.machine.readings):
            y[:: self.substeps, k] = record[signal("y", reading.name)]
        y[:: self.substeps, self.reading] = (
            record["y"] - self.position_offset - self.offset_error(record["u"])
        )
        return self.moved(y, u, *self.structures.get(id(record), (0.0, 0.0)))

    def moved(self, y: Array, u: Array, reading: Any, control: Any) -> tuple[Array, Array]:
        y, u = y.copy(), u.copy()
        y[:, self.reading] -= reading
        u[:, self.number] += control
        return y, u

    def _inputs(self, own: Array, u: Array) -> Array:
        # Those of the other axes are as in the record: u (n, axes), from the first of own on.
        m, steps = own.shape
        at = self.substeps * np.arange(m)[:, None] + np.arange(steps)
        inputs = u[np.minimum(at, len(u) - 1)]
        inputs[:, :, self.number] = own
        return np.asarray(inputs.reshape(m * steps, -1))

    def begin(self, kalman: Estimator, y: Array, _u: Array) -> tuple[Array, list[float]]:
        std = dict(zip((s.name for s in kalman.states), kalman.default_std(), strict=True))
        if np.isfinite(self.load_std):
            std |= {name: self.load_std for name in std if name.startswith("f_d")}
        return kalman.initial_state(y[:: self.substeps]), list(std.values())

    @property
    def number(self) -> int:
        return self.machine.axis_names.index(self.axis)

    def _of_axis(self, axis: str, record: Record) -> Array:
        """Return the acting control signal of an axis at the filter's steps [V]."""
        if axis == self.axis:
            return self._delayed_control(record["u"])
        other = LoopModel(
            self.machine.isolated_axis(axis),
            delay=self.delay,
            substeps=self.substeps,
            line=self.line,
        )
        return other._delayed_control(record[signal("u", axis)])

    def with_isolated(self, isolated: Machine) -> Machine:
        return with_axis(self.machine, self.axis, isolated)

    def force_of_others(self, record: Record) -> Array:
        machine, axes = self.machine, self.machine.axes
        share = geometry.compliance(machine.rotor, axes)[self.number]
        share = share / share[self.number]
        force = np.asarray(share @ weights_of(machine) - self.isolated.weight)
        force = np.repeat(force, len(record))
        for axis, part in zip(axes, share.tolist(), strict=True):
            if axis.name == self.axis:
                continue
            one = machine.isolated_axis(axis.name)
            reading = machine.readings[reading_along(machine, axis.name)]
            x = record[signal("y", reading.name)] / one.sensor.gain
            iu = one.amplifier.gain * acting(one, record[signal("u", axis.name)])
            iu = np.clip(iu, one.current_min, one.current_max)
            force += part * magnet_of(one).force(iu, np.clip(x, -one.clearance, one.clearance))
        return force

    def record(self, record: Record) -> Record:
        machine, (y, u) = self.machine, self.signals
        controls = [signal("u", axis.name) for axis in machine.axes]
        needed = [*(signal("y", reading.name) for reading in machine.readings), *controls]
        if lacking := [name for name in needed if name not in record]:
            raise RecordError(
                f"the record has no {', '.join(lacking)}; an axis of {machine.name} is identified "
                "from all of its readings and control signals"
            )
        if not all(np.isfinite(record[name]).all() for name in controls):
            raise RecordError(
                "the record lacks samples of a control signal: cut it to an interval without gaps"
            )
        signals = {name: record[name] for name in record} | {"y": record[y], "u": record[u]}
        units = dict(record.units) | {"y": record.units[y], "u": record.units[u]}
        return replace(record, signals=signals, units=units)
