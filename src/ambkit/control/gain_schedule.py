"""Gains of PIDs over the speed of rotation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.config import Part
from ambkit.base.config.quantities import Quantity

SCHEDULED = ("kp", "ki", "kd", "derivative_filter")  #: What of a PID follows the speed.


class ScheduledGains(Part):
    """Gains of a PID at a speed of rotation; those that are left out are the PID's own."""

    speed: Annotated[float, Quantity("rad/s", "6000 rpm", at_least=0)]
    """The speed, whichever way the rotor turns [rad/s]."""
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
        """Return that of PIDs, with a node at each speed of any of them; None without any."""
        # The own gains of a PID are those at rest.
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
