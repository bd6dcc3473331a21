"""PID controller of one axis, its blocks, and default gains."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, SerializerFunctionWrapHandler, model_serializer

from ambkit.base.arrays import Array
from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Name, Quantity
from ambkit.control.blocks import AnyBlock
from ambkit.control.held_loop import Gains
from ambkit.control.stabilising_controller import chosen, round_to_two_digits, textbook, weight_of
from ambkit.machine.axes import axis_of
from ambkit.machine.machine import Machine

SCHEDULED = ("kp", "ki", "kd", "derivative_filter")  #: Settings that a gain schedule changes.


class ScheduledGains(Part):
    """Gains of a PID at a speed of rotation; omitted ones are the PID's own."""

    speed: Annotated[float, Quantity("rad/s", "6000 rpm", at_least=0)]
    """Speed, in either direction [rad/s]."""
    kp: Annotated[float, Quantity("A/m", "3000 A/m", at_least=0)] | None = None
    """Proportional gain [A/m]."""
    ki: Annotated[float, Quantity("A/(m s)", "20000 A/(m s)", at_least=0)] | None = None
    """Integral gain [A/(m s)]."""
    kd: Annotated[float, Quantity("A s/m", "12 A s/m", at_least=0)] | None = None
    """Derivative gain [A s/m]."""
    derivative_filter: Annotated[float, Quantity("s", "0.2 ms", at_least=0)] | None = None
    """Time constant of the low-pass in the derivative [s]."""


@dataclass(frozen=True)
class GainSchedule:
    """The gains of q PIDs at k speeds, for ``amb_gain_schedule``."""

    speeds: Array  #: (k,) [rad/s].
    gains: Array  #: (k, q, 4) By `SCHEDULED`.

    @classmethod
    def of(cls, pids: Sequence[Any]) -> GainSchedule | None:
        """Return that of several PIDs, with a node at each speed of any; None without any."""
        # A PID's own gains are those at standstill.
        speeds = sorted({0.0, *(row.speed for pid in pids for row in pid.schedule)})
        if len(speeds) == 1 and not any(pid.schedule for pid in pids):
            return None
        gains = np.zeros((len(speeds), len(pids), len(SCHEDULED)))
        for j, pid in enumerate(pids):
            stated = pid.schedule and pid.schedule[0].speed == 0
            rows: list[Any] = list(pid.schedule) if stated else [pid, *pid.schedule]
            at = [getattr(row, "speed", 0.0) for row in rows]
            for k, name in enumerate(SCHEDULED):
                values = [getattr(row, name) for row in rows]
                values = [getattr(pid, name) if v is None else v for v in values]
                gains[:, j, k] = np.interp(speeds, at, values)
        return cls(np.array(speeds), gains)

    def at(self, speed: float) -> Array:
        """Return the gains (q, 4) at a speed [rad/s]."""
        k = int(np.searchsorted(self.speeds[1:], abs(speed), side="right"))
        if k == len(self.speeds) - 1:
            return np.asarray(self.gains[k])
        share = (abs(speed) - self.speeds[k]) / (self.speeds[k + 1] - self.speeds[k])
        return np.asarray(self.gains[k] + share * (self.gains[k + 1] - self.gains[k]))


def schedule_fields(schedule: GainSchedule | None) -> dict[str, Any]:
    """Return the arrays of ``amb_gain_schedule``, None where there is none."""
    if schedule is None:
        return {"schedule_speed": None, "schedule_gain": None}
    speeds, gains = schedule.speeds.tolist(), schedule.gains.ravel().tolist()
    return {"schedule_speed": speeds, "schedule_gain": gains}


class PID(Part):
    """Position controller with the control current as output.

    ``iu = kp (b r - position) + ki integral(r - position) - kd velocity`` with the reference r and
    the set-point weight b (Åström and Hägglund 1995). The defaults hold the `zittau_axial` bearing,
    whose gains the paper does not give; a simulation tunes omitted gains to its machine.
    """

    kp: Annotated[float, Quantity("A/m", "3000 A/m", at_least=0)] = 1700.0
    """Proportional gain [A/m]."""
    ki: Annotated[float, Quantity("A/(m s)", "20000 A/(m s)", at_least=0)] = 7500.0
    """Integral gain [A/(m s)]."""
    kd: Annotated[float, Quantity("A s/m", "12 A s/m", at_least=0)] = 11.0
    """Derivative gain [A s/m]."""
    derivative_filter: Annotated[float, Quantity("s", "0.2 ms", at_least=0)] = 0.3e-3
    """Time constant of the low-pass in the derivative [s]."""
    anti_windup: Annotated[float, Quantity("s", "25 ms", above=0)] = 38e-3
    """Tracking time of the anti-windup: how fast a current limit reduces the integral [s]."""
    setpoint_weight: Annotated[float, Quantity("1", "0.5", at_least=0)] = 0.5
    """Set-point weight: share of the reference that kp acts on [1]."""
    feed_forward: Annotated[float, Quantity("1", "1", at_least=0)] = 0.0
    """Share of the estimated disturbance force that is cancelled [1]."""
    sees: Annotated[
        dict[Name, Annotated[float, Field(allow_inf_nan=False)]],
        BeforeValidator(lambda value: {value: 1.0} if isinstance(value, str) else value),
    ] = Field(default_factory=dict)  # fmt: skip
    """With several axes, its input: a reading, such as a non-collocated one, an estimated
    displacement, or a weighted sum. By default the displacement of its axis.
    """
    block: tuple[AnyBlock, ...] = ()
    """Blocks in series that filter its current before the limits, such as a notch."""

    schedule: tuple[ScheduledGains, ...] = ()
    """Gains at speeds of rotation, with several axes: interpolated linearly, constant beyond the
    last. The gains above are those at standstill.
    """

    @model_serializer(mode="wrap")
    def _set_fields_only(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Omit unset values: they are tuned to the machine, which is not known yet."""
        data: dict[str, Any] = handler(self)
        stated_fields = self.model_fields_set
        return {
            key: value
            for key, value in data.items()
            if key in stated_fields and value not in (None, {}, (), [])
        }

    def __hash__(self) -> int:
        return hash((self.kp, self.ki, self.kd, self.block))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        rows = read("schedule")
        rows = rows if isinstance(rows, tuple) else ()
        for k, (row, later) in enumerate(itertools.pairwise(rows), 1):
            if later.speed <= row.speed:
                yield f"schedule.{k}.speed", "must be above the previous one"

    @classmethod
    def for_bearing(cls, machine: Machine) -> Self:
        """Return gains by the margins of a machine's loop, see `stabilising_controller.chosen`.

        Parameters
        ----------
        machine : Machine
            Machine with one axis.
        """
        return cls(**chosen(axis_of(machine))._asdict())

    @classmethod
    def textbook(cls, machine: Machine) -> Self:
        """Return gains by a rule of thumb, with which a step overshoots by half its height.

        ``kp = 4 k_s/k_i``, a damping ratio of 0.56, and a set-point weight of 1.

        Parameters
        ----------
        machine : Machine
            Machine with one axis.
        """
        return cls(**textbook(axis_of(machine))._asdict())

    def completed(self, machine: Machine) -> Self:
        """Return the controller with unset values tuned to a machine, see `for_bearing`.

        The set-point weight is tuned for the proportional gain in use.

        Parameters
        ----------
        machine : Machine
            Machine with one axis.
        """
        if self.model_fields_set >= GAINS:
            return self
        result: Self = overlaid(type(self).for_bearing(machine), self, machine)
        return result


def overlaid(pid: Any, overrides: PID, machine: Machine) -> Any:
    """Return a PID with the stated values of another, and a consistent set-point weight."""
    stated = {name: getattr(overrides, name) for name in overrides.model_fields_set}
    all_, changed = vars(pid) | stated, {*stated, "setpoint_weight"}
    if stated.keys() & {"kp", "ki", "kd"} and "setpoint_weight" not in stated:
        weight = weight_of(machine, all_["kp"], all_["ki"], all_["kd"])
        all_["setpoint_weight"] = round_to_two_digits(weight)
    return pid.model_copy(update={name: all_[name] for name in changed})


def integral_lead(pid: PID, r: float) -> float:
    """Return the change of the integral's current in equilibrium at r [m]."""
    return (1 - pid.setpoint_weight) * pid.kp * r


GAINS = frozenset(Gains._fields)  #: The gains of a complete PID.
