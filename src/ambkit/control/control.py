"""The controllers of a machine as a file states them, and lift-off, landing and trips."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Name, Quantity
from ambkit.base.own_class import OwnClass
from ambkit.control.pid import GAINS, PID, overlaid
from ambkit.machine.machine import Machine

MOST_COUNTED = 65535  #: Maximum of an unsigned int of 16 bits.


class Mode(IntEnum):
    """Mode of a controller; ``amb_flight_mode``."""

    OFF = 0
    WAITING = 1
    LIFTING = 2
    FLYING = 3
    LANDING = 4
    TRIPPED = 5


WITH_CURRENT = (Mode.LIFTING, Mode.FLYING, Mode.LANDING)  #: Modes in which magnets have current.


class LiftOff(Part):
    """Lift-off and landing: commands, times, and conditions of a trip."""

    # With ``start = "landed"`` the rotor is in contact at the stop in the direction of its weight,
    # and both coils are without current. It lifts from there when the estimate has settled.

    start: Annotated[float, Quantity("s", "50 ms", at_least=0)] = 0.0
    """Time of the command to levitate [s]."""
    stop: Annotated[float, Quantity("s", "0.8 s", at_least=0)] | None = None
    """Time of the command to land [s]. By default never."""
    wait: Annotated[float, Quantity("s", "20 ms", at_least=0)] = 0.02
    """Time for which the estimate must have been settled [s]."""
    lift: Annotated[float, Quantity("s", "0.2 s", above=0)] = 0.2
    """Duration of the rise [s]."""
    land: Annotated[float, Quantity("s", "0.2 s", above=0)] = 0.2
    """Duration of the landing [s]."""
    lost: Annotated[float, Quantity("s", "50 ms", at_least=0)] = 0.05
    """Trip after this time without a usable position [s]."""
    overload: Annotated[float, Quantity("s", "0.1 s", at_least=0)] = 0.1
    """Trip after this time at a current limit [s]."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        stop = read("stop")
        if stop is not None and stop <= read("start"):
            yield "stop", f"must be after start, {read('start'):g} s; is {stop:g} s"

    def fly(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the command to levitate, 1 or 0."""
        # t (n,) [s]
        command = t >= self.start
        return (command if self.stop is None else command & (t < self.stop)).astype(float)

    def in_samples(self, T: float) -> dict[str, Any]:
        """Return the fields of ``amb_sequence``."""
        return {
            "waiting": _samples(self.wait, T),
            "lost": _samples(self.lost, T),
            "overloaded": _samples(self.overload, T),
            "rise": min(1.0, T / self.lift),
            "descent": min(1.0, T / self.land),
        }


def _samples(time: float, T: float) -> int:
    return min(round(time / T), MOST_COUNTED - 1)


class Control(PID):
    """The controllers of a machine: gains at its top are of all axes, those in `pid` of one."""

    feedback: Literal["measurement", "estimate"] | None = None
    """What the controllers are fed by: the sensors, or the estimator; without, the estimate feeds
    that of one axis, and of several it is chosen with the type."""
    type: Annotated[
        Literal["decentralised", "translation and tilt", "lqg"] | None,
        BeforeValidator(lambda argument: "decentralised" if argument == "pid" else argument),
    ] = None
    """One PID for each axis; one for each translation and tilt of the rotor; or a linear-quadratic
    regulator of the estimator's states. Without a type and gains it is chosen on the margins over
    the machine's speed range, `ambkit.control.default_control`; with gains it is
    decentralised."""
    cross_feedback: Annotated[float, Quantity("1", "0.5", at_least=0)] = 0.0
    """Share of the gyroscopic torques that is taken back, by the estimated tilt velocities [1]."""
    gain_scheduling: Annotated[bool, Field(strict=True)] = False
    """Whether the gains of "lqg" follow the speed of rotation; without, they are those of the
    machine's own speed at any."""
    unbalance: Literal["off", "force-free", "compensation"] = "off"
    """Unbalance control: none, where the controllers answer to synchronous motion as to any other;
    force-free rotation about the axis of inertia, without a synchronous force of the bearings; or
    compensation, which holds the geometric axis. The last two need an estimator with the unbalance
    among its states."""
    unbalance_from: Annotated[float, Quantity("rad/s", "2000 rpm", above=0)] | None = None
    """Speed below which there is no unbalance control [rad/s]; without, 100 rad/s or half the
    machine's own."""
    custom: OwnClass | None = None
    """A controller of one's own in place of all of these: ``"file.py:Class"``, or in Python the
    class; see `ControllerProtocol`."""
    pid: dict[Name, PID] = Field(default_factory=dict)
    """PIDs by what each is of: an axis, or with "translation and tilt" a coordinate of the rotor
    such as x or th_y. What is not said of one is tuned to it."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        yield from super()._contradictions(read)
        if read("feedback") == "measurement":
            if read("type") == "lqg":
                yield "type", '"lqg" regulates the estimate: feedback must be "estimate"'
            if read("feed_forward") > 0:
                yield "feed_forward", 'is made of the estimate: feedback must be "estimate"'
        if read("sees"):
            yield "sees", "is of one axis: give it in pid.NAME"
        if read("unbalance_from") is not None and read("unbalance") == "off":
            yield "unbalance_from", 'needs unbalance = "force-free" or "compensation"'
        if read("gain_scheduling") and read("type") != "lqg":
            yield "gain_scheduling", 'is of the gains of type = "lqg"'
        for key, what in (("block", "behind"), ("schedule", "of")):
            if read(key) and read("type") == "lqg":
                yield key, f'is {what} a PID; type = "lqg" has none'
        pids = read("pid")
        if not isinstance(pids, dict) or not pids:
            return
        if read("type") == "lqg":
            yield "pid", 'type = "lqg" has no PID: its gains are of all states'
        for name, pid in pids.items():
            if pid.sees and read("type") == "translation and tilt":
                yield f"pid.{name}.sees", 'is of an axis: type must be "decentralised"'
            if pid.feed_forward and read("type") == "translation and tilt":
                yield f"pid.{name}.feed_forward", 'is of an axis: type must be "decentralised"'

    def __hash__(self) -> int:
        own = self.type, self.feedback, self.cross_feedback, self.gain_scheduling, self.unbalance
        return hash((*own, self.kp, self.ki, self.kd, self.block, *self.pid.items()))

    @property
    def gains(self) -> PID:
        """What is said of all axes."""
        stated_fields = self.model_fields_set & PID.model_fields.keys()
        return PID(**{key: getattr(self, key) for key in stated_fields})

    @property
    def stated(self) -> dict[str, PID]:
        """The PIDs that are given, by what each is of; x where that is one axis."""
        has_gains = self.model_fields_set >= GAINS
        return {"x": self.gains, **self.pid} if has_gains else self.pid

    def completed(self, machine: Machine) -> Self:
        if self.custom:
            return self.fed_by(self.feedback or "estimate")
        if self.model_fields_set >= GAINS and self.feedback and not self.pid:
            return self
        result = self.model_copy(update={"pid": {}})
        for own in self.pid.values():
            result = overlaid(result, own, machine)
        return super(Control, result).completed(machine).fed_by(self.feedback or "estimate")

    def fed_by(self, feedback: Literal["measurement", "estimate"]) -> Self:
        """Return a copy with this feedback.

        Parameters
        ----------
        feedback : str
            ``"measurement"`` or ``"estimate"``.
        """
        return self if self.feedback == feedback else self.model_copy(update={"feedback": feedback})

    @property
    def needs_estimate(self) -> bool:
        """Whether the measurement alone cannot feed it."""
        return self.type == "lqg" or self.of_estimate is not None

    @property
    def of_estimate(self) -> str | None:
        """What besides a regulator is made of the estimate; None where nothing is."""
        if self.cross_feedback:
            return "cross_feedback"
        if any(pid.feed_forward for pid in (self, *self.pid.values())):
            return "feed_forward"
        return None if self.unbalance == "off" else f'unbalance = "{self.unbalance}"'


def as_control(value: Any) -> Any:
    """Take a PID for that of all axes."""
    if isinstance(value, PID) and not isinstance(value, Control):
        return Control(**{key: getattr(value, key) for key in value.model_fields_set})
    return value
