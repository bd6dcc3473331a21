"""The controllers of a machine as a file states them: structure, gains, what each sees."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field

from ambkit.base.config import Read
from ambkit.base.config.quantities import Quantity
from ambkit.base.config.text_types import Name
from ambkit.base.own_class import OwnClass
from ambkit.control.pid import GAINS, PID, overlaid
from ambkit.machine.machine import Machine


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
            text = 'needs unbalance = "force-free" or "compensation"'
            yield "unbalance_from", text
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
