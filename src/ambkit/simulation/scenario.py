"""What happens in a run: reference, disturbance, noise, controller."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from ambkit.base.asked import of_type
from ambkit.base.config import Document, Part, Read
from ambkit.base.config.quantities import Quantity, SignalIn
from ambkit.base.config.texts import Name
from ambkit.machine.bearing import Bearing
from ambkit.simulation.holding import Gains, chosen, textbook, two_digits, weight_of
from ambkit.simulation.sequence import LiftOff
from ambkit.simulation.waveforms import (
    Constant,
    Impulse,
    Ramp,
    Recorded,
    Sequence,
    Signal,
    Sine,
    Step,
    Sum,
    Waveform,
)

__all__ = [
    "PID",
    "Constant",
    "Impulse",
    "Ramp",
    "Recorded",
    "Scenario",
    "Sequence",
    "Sine",
    "Step",
    "Sum",
    "Waveform",
]


class PID(Part):
    """The position controller: its output is the control current that it demands.

    ``iu = kp (b r - position) + ki integral(r - position) - kd velocity`` with the reference r and
    the set-point weight b (Åström and Hägglund 1995). The defaults hold the `zittau_axial` bearing,
    whose gains the paper does not give; a simulation tunes what was not given to its bearing.
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
    """Tracking time: how fast the integral gives way at the current limit [s]."""
    setpoint_weight: Annotated[float, Quantity("1", "0.5", at_least=0)] = 0.5
    """Of the reference, the share that kp sees [1]; the integral always sees all of it."""
    feedback: Literal["measurement", "estimate"] = "estimate"
    """Which position is fed back: the sensor's or the estimator's."""
    type: Literal["pid", "lqg"] = "pid"
    """These gains; or, in their place, a linear-quadratic regulator of the estimator's states."""
    feed_forward: Annotated[float, Quantity("1", "1", at_least=0)] = 0.0
    """Share of the estimated disturbance force that a current takes back at once [1]."""
    sensor: Name | None = None
    """Of a machine, the reading that it sees, such as one that is not beside its magnet; without,
    the displacement of its axis by all readings."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("feedback") != "measurement":
            return
        if read("type") == "lqg":
            yield "type", '"lqg" regulates the estimate: feedback must be "estimate"'
        if read("feed_forward") > 0:
            yield "feed_forward", 'is made of the estimate: feedback must be "estimate"'

    @model_serializer(mode="wrap")
    def _only_what_was_said(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out what was not given: it is tuned to the bearing, whatever that will be."""
        data: dict[str, Any] = handler(self)
        return {name: value for name, value in data.items() if name in self.model_fields_set}

    @classmethod
    def for_bearing(cls, bearing: Bearing) -> Self:
        """Return the gains that the margins of a bearing's loop allow, see `holding.chosen`.

        Parameters
        ----------
        bearing : Bearing
            What is to be held.
        """
        of_type(Bearing, bearing=bearing)
        return cls(**chosen(bearing)._asdict() | {"feedback": cls().feedback})

    @classmethod
    def textbook(cls, bearing: Bearing) -> Self:
        """Return gains by a rule of thumb, with which a step overshoots by a half.

        ``kp = 4 k_s/k_i``, a damping of 0.56, and all of the reference to kp.

        Parameters
        ----------
        bearing : Bearing
            What is to be held.
        """
        of_type(Bearing, bearing=bearing)
        return cls(**textbook(bearing)._asdict() | {"feedback": cls().feedback})

    def completed(self, bearing: Bearing) -> Self:
        """Return the controller with what was not given tuned to a bearing, see `for_bearing`.

        The set-point weight goes with the proportional gain that is flown, given or not.

        Parameters
        ----------
        bearing : Bearing
            What it is to hold.
        """
        if self.model_fields_set >= {*GAINS, "feedback"}:
            return self
        return type(self).for_bearing(bearing).overlaid(self, bearing)

    def overlaid(self, given: Self, bearing: Bearing) -> Self:
        """Return the controller with what was given of another in the place of its own.

        Parameters
        ----------
        given : PID
            The other.
        bearing : Bearing
            What both are to hold: the set-point weight is its, where it was not given.
        """
        said = {name: getattr(given, name) for name in given.model_fields_set}
        all_ = vars(self) | said
        if said.keys() & {"kp", "ki", "kd"} and "setpoint_weight" not in said:
            weight = weight_of(bearing, all_["kp"], all_["ki"], all_["kd"])
            all_["setpoint_weight"] = two_digits(weight)
        return type(self)(**all_)

    def unseen(self, r: float) -> float:
        """Return the current [A] by which the integral is ahead where the rotor is held at rest.

        Parameters
        ----------
        r : float
            The reference there [m].
        """
        return (1 - self.setpoint_weight) * self.kp * r


GAINS = frozenset(Gains._fields) - {"feedback"}
"""What is to be known of a PID."""


class Scenario(Document):
    """A run: what is demanded of the bearing, what disturbs it, and who controls it.

    Frozen, and checked as a whole: from TOML (`load`, `from_toml`) or from Python, in SI.

    Examples
    --------
    >>> scenario = Scenario(
    ...     duration=0.2,
    ...     reference=Step(amplitude=0.5e-3, time=0.02),
    ...     disturbance=Constant(value=-3.0),
    ... )
    >>> scenario.replace(seed=7).seed
    7
    """

    duration: Annotated[float, Quantity("s", "0.5 s", above=0)] = 0.5
    """How long the run lasts [s]."""
    start: Literal["hover", "rest"] = "hover"
    """At the start: in equilibrium at the reference; or without current, released at x = 0, with a
    sequence lying on the stop to which its weight pulls it."""
    noise: Annotated[bool, Field(strict=True)] = True
    """Whether amplifier and sensor are noisy."""
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 0
    """Seed of the noise."""
    run: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 0
    """Number of the run among those of this seed: with it, the key of the noise."""
    substeps: Annotated[int, Field(strict=True, ge=1, le=1000)] = 4
    """Steps of the integrator in one sample."""
    reference: Annotated[Signal, SignalIn("m", "0.5 mm")] = Constant(value=0.0)
    """Position that the rotor is to take [m]."""
    disturbance: Annotated[Signal, SignalIn("N", "3 N")] = Constant(value=0.0)
    """Force on the rotor besides magnet and weight [N]."""
    injection: Annotated[Signal, SignalIn("m", "1 um")] = Constant(value=0.0)
    """What is added to the measurement before controller and estimator take it [m]."""
    controller: PID = PID()
    """The position controller. What is not said of it is tuned to the bearing."""
    sequence: LiftOff | None = None
    """Lift-off and landing, and what looks after the flight; without, it flies from the start."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if isinstance(read("controller.sensor"), str):
            yield "controller.sensor", "is of a machine: an axis alone has one sensor"

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        return {name: value for name, value in data.items() if value is not None}
