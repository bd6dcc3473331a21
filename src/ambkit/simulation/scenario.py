"""What happens in a run: reference, disturbance, speed, noise, and who controls it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AliasChoices,
    BeforeValidator,
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    model_serializer,
    model_validator,
)

from ambkit.base.config import Document, Part, Read
from ambkit.base.config.problems import ONE_OR_MORE
from ambkit.base.config.quantities import Quantity, SignalIn
from ambkit.base.config.text_types import Name
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import of_type
from ambkit.machine.machine import Bearing
from ambkit.simulation.blocks import AnyBlock, gain_at_rest, sections_of
from ambkit.simulation.lift_off_sequence import LiftOff
from ambkit.simulation.stabilising_controller import Gains, chosen, textbook, two_digits, weight_of
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
    feed_forward: Annotated[float, Quantity("1", "1", at_least=0)] = 0.0
    """Share of the estimated disturbance force that a current takes back at once [1]."""
    sensor: Name | None = None
    """Of a machine, the reading that it sees, such as one that is not beside its magnet; without,
    the displacement of its axis by all readings."""
    block: tuple[AnyBlock, ...] = ()
    """What its current passes in turn before it is held to the limits, such as a notch."""

    @model_serializer(mode="wrap")
    def _only_what_was_said(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out what was not given: it is tuned to the bearing, whatever that will be."""
        data: dict[str, Any] = handler(self)
        stated_fields = self.model_fields_set
        return {
            key: value
            for key, value in data.items()
            if key in stated_fields and value not in (None, {}, (), [])
        }

    @classmethod
    def for_bearing(cls, bearing: Bearing) -> Self:
        """Return the gains that the margins of a bearing's loop allow, see `holding.chosen`.

        Parameters
        ----------
        bearing : Bearing
            What is to be held.
        """
        of_type(Bearing, bearing=bearing)
        return cls(**chosen(bearing).stated)

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
        return cls(**textbook(bearing).stated)

    def completed(self, bearing: Bearing) -> Self:
        """Return the controller with what was not given tuned to a bearing, see `for_bearing`.

        The set-point weight goes with the proportional gain that is flown, given or not.

        Parameters
        ----------
        bearing : Bearing
            What it is to hold.
        """
        if self.model_fields_set >= GAINS:
            return self
        return type(self).for_bearing(bearing).overlaid(self, bearing)

    def overlaid(self, given: PID, bearing: Bearing) -> Self:
        """Return the controller with what was given of another instead of its own.

        Parameters
        ----------
        given : PID
            The other.
        bearing : Bearing
            What both are to hold: the set-point weight is its, where it was not given.
        """
        overrides = {name: getattr(given, name) for name in given.model_fields_set}
        all_, changed = vars(self) | overrides, {*overrides, "setpoint_weight"}
        if overrides.keys() & {"kp", "ki", "kd"} and "setpoint_weight" not in overrides:
            weight = weight_of(bearing, all_["kp"], all_["ki"], all_["kd"])
            all_["setpoint_weight"] = two_digits(weight)
        return self.model_copy(update={name: all_[name] for name in changed})

    def unseen(self, r: float) -> float:
        """Return the current [A] by which the integral is ahead where the rotor is held at rest.

        Parameters
        ----------
        r : float
            The reference there [m].
        """
        return (1 - self.setpoint_weight) * self.kp * r

    def sections(self, T: float) -> list[list[float]]:
        """Return the sections of second order b0, b1, b2, a1, a2 that its blocks are.

        Parameters
        ----------
        T : float
            The sampling time [s].

        Raises
        ------
        AmbkitError
            There are too many, or nothing passes them at rest.
        """
        return sections_of(self.block, T)

    def integral(self, current: float, r: float, T: float) -> float:
        """Return the integral [A] with which a rotor is held at rest.

        Parameters
        ----------
        current : float
            The current that holds it [A].
        r : float
            The reference there [m].
        T : float
            The sampling time [s].
        """
        return current / gain_at_rest(self.sections(T)) + self.unseen(r)


GAINS = frozenset(Gains._fields)
"""What is to be known of a PID."""

Array = NDArray[np.float64]


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
    the machine's speed range, `ambkit.simulation.default_control`; with gains it is
    decentralised."""
    cross_feedback: Annotated[float, Quantity("1", "0.5", at_least=0)] = 0.0
    """Share of the gyroscopic torques that is taken back, by the estimated tilt velocities [1]."""
    gain_scheduling: Annotated[bool, Field(strict=True)] = False
    """Whether the gains of "lqg" follow the speed of rotation; without, they are those of the
    machine's own speed at any."""
    unbalance: Literal["fought", "force-free", "still"] = "fought"
    """Whether the controllers answer to the synchronous motion as to any other; let the rotor turn
    about its axis of inertia, without a synchronous force of the bearings; or keep its geometric
    axis still. The last two need an estimator with the unbalance among its states."""
    unbalance_from: Annotated[float, Quantity("rad/s", "2000 rpm", above=0)] | None = None
    """Speed below which it is fought all the same [rad/s]; without, 100 rad/s or half the machine's
    own."""
    pid: dict[Name, PID] = Field(default_factory=dict)
    """PIDs by what each is of: an axis, or with "translation and tilt" a coordinate of the rotor
    such as x or th_y. What is not said of one is tuned to it."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("feedback") == "measurement":
            if read("type") == "lqg":
                yield "type", '"lqg" regulates the estimate: feedback must be "estimate"'
            if read("feed_forward") > 0:
                yield "feed_forward", 'is made of the estimate: feedback must be "estimate"'
        if read("sensor") is not None:
            yield "sensor", "is of one axis: give it in pid.NAME"
        if read("unbalance_from") is not None and read("unbalance") == "fought":
            text = 'unbalance = "fought" is so at any speed; give "force-free" or "still"'
            yield "unbalance_from", text
        if read("gain_scheduling") and read("type") != "lqg":
            yield "gain_scheduling", 'is of the gains of type = "lqg"'
        if read("block") and read("type") == "lqg":
            yield "block", 'is behind a PID; type = "lqg" has none'
        pids = read("pid")
        if not isinstance(pids, dict) or not pids:
            return
        if read("type") == "lqg":
            yield "pid", 'type = "lqg" has no PID: its gains are of all states'
        for name, pid in pids.items():
            if pid.sensor and read("type") == "translation and tilt":
                yield f"pid.{name}.sensor", 'is of an axis: type must be "decentralised"'
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

    def own(self, name: str) -> PID:
        """Return what is said of an axis or a coordinate, of it alone or of all.

        Parameters
        ----------
        name : str
            The axis or the coordinate.
        """
        own_pid = self.pid.get(name)
        overrides = (
            {} if own_pid is None else {k: getattr(own_pid, k) for k in own_pid.model_fields_set}
        )
        return self.gains.model_copy(update=overrides)

    def completed(self, bearing: Bearing) -> Self:
        """Return that of a single axis with what was not given tuned to it; see `PID.completed`.

        Parameters
        ----------
        bearing : Bearing
            What it is to hold.
        """
        if self.model_fields_set >= GAINS and self.feedback and not self.pid:
            return self
        result = self.model_copy(update={"pid": {}})
        for own in self.pid.values():
            result = result.overlaid(own, bearing)
        return super(Control, result).completed(bearing).fed_by(self.feedback or "estimate")

    def fed_by(self, feedback: Literal["measurement", "estimate"]) -> Self:
        """Return the same, fed by the one or the other.

        Parameters
        ----------
        feedback : str
            ``"measurement"`` or ``"estimate"``.
        """
        return self.model_copy(update={"feedback": feedback})

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
        return None if self.unbalance == "fought" else f'unbalance = "{self.unbalance}"'

    def check_names(self, known: list[str]) -> None:
        """Refuse PIDs of what the machine has not.

        Parameters
        ----------
        known : list of str
            Names of what it has.

        Raises
        ------
        AmbkitError
            There is such a PID.
        """
        for name in self.pid:
            if name not in known:
                raise AmbkitError(
                    f"controller.pid.{name}: there is no {name}; known: {', '.join(known)}"
                )


def as_control(value: Any) -> Any:
    """Take a PID for that of all axes."""
    if isinstance(value, PID) and not isinstance(value, Control):
        return Control(**{key: getattr(value, key) for key in value.model_fields_set})
    return value


def _merged(controller: Any, control: Any, feedback: Any) -> Any:
    """Return a controller as one table, by the keys of now and of earlier releases."""
    results: dict[str, Any] = {}
    for item in (controller, control):
        if isinstance(item, PID):
            item = {key: getattr(item, key) for key in item.model_fields_set}
        if item is not None and not isinstance(item, dict):
            return item  # whose mistake is told where it is checked
        results |= item or {}
    if feedback is None:
        return results
    if results.get("feedback", feedback) != feedback:
        raise ValueError(f'controller.feedback: contradicts feedback = "{feedback}"')
    return results | {"feedback": feedback}


class Disturbance(Part):
    """A force on the rotor along an axis of a bearing."""

    axis: str
    """Name of the axis, such as A1."""
    force: Annotated[Signal, SignalIn("N", "3 N")]
    """The force [N]."""

    @property
    def signal(self) -> Waveform:
        """What it is over time."""
        return self.force


class Reference(Part):
    """Where the rotor is to be along an axis of a bearing."""

    axis: str
    """Name of the axis, such as A1."""
    position: Annotated[Signal, SignalIn("m", "20 um")]
    """The position [m]."""

    @property
    def signal(self) -> Waveform:
        """What it is over time."""
        return self.position


class Injection(Reference):
    """A signal at the summing point of an axis, where its controller takes its position."""

    position: Annotated[Signal, SignalIn("m", "1 um")]
    """What is added to the readings, as if the rotor were there [m]."""


class Base(Part):
    """A motion of the foundation, with which bearings and sensors go: earthquake, ship, shock."""

    direction: Literal["x", "y", "z"]
    """Along which direction of the machine."""
    acceleration: Annotated[Signal, SignalIn("m/s^2", "5 m/s^2")]
    """The acceleration [m/s^2]."""


_One = Annotated[Signal, Tag(ONE_OR_MORE[0])]
_LIST = Tag(ONE_OR_MORE[1])
_ONE_OR_MORE = Discriminator(lambda raw_value: ONE_OR_MORE[isinstance(raw_value, list | tuple)])

AXES = ("reference", "disturbance", "injection")
"""Signals that an axis has each."""

OF_MACHINE = frozenset({"speed", "off", "base"})
"""Keys of a machine whose rotor is a body."""


OF_BODY = ("cross_feedback", "gain_scheduling", "unbalance", "unbalance_from")
"""Keys of the controllers of such a rotor."""


class Scenario(Document):
    """A run: what is demanded of a machine, what disturbs it, and who controls it.

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
    """At the start: in equilibrium at the reference; or without current, lying in the backup
    bearings. A mass without a sequence is then released at x = 0."""
    noise: Annotated[bool, Field(strict=True)] = True
    """Whether amplifiers and sensors are noisy."""
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 0
    """Seed of the noise."""
    run: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 0
    """Number of the run among those of this seed: with it, the key of the noise."""
    substeps: Annotated[int, Field(strict=True, ge=1, le=1000)] = 4
    """Steps of the integrator in one sample."""
    reference: Annotated[
        _One | Annotated[tuple[Reference, ...], _LIST],
        _ONE_OR_MORE, SignalIn("m", "0.5 mm"),
    ] = Constant(value=0.0)  # fmt: skip
    """Position that the rotor is to take [m]: of the first axis, or a list with axes."""
    disturbance: Annotated[
        _One | Annotated[tuple[Disturbance, ...], _LIST],
        _ONE_OR_MORE, SignalIn("N", "3 N"),
    ] = Constant(value=0.0)  # fmt: skip
    """Force on the rotor besides magnets, weight and unbalance [N]: along the first axis, or a list
    with axes."""
    injection: Annotated[
        _One | Annotated[tuple[Injection, ...], _LIST],
        _ONE_OR_MORE, SignalIn("m", "1 um"),
    ] = Constant(value=0.0)  # fmt: skip
    """What is added to the measurement before controller and estimator take it [m]: of the first
    axis, or a list with axes."""
    controller: Annotated[Control, BeforeValidator(as_control)] = Field(
        default=Control(), validation_alias=AliasChoices("controller", "control")
    )
    """The controllers. Of one axis, what is not said is tuned to it; of several they are chosen on
    the margins over the machine's speed range."""
    speed: Annotated[Signal, SignalIn("rad/s", "3000 rpm")] | None = None
    """Speed of rotation, such as a run-up [rad/s]; the machine's own without."""
    off: Annotated[float, Quantity("s", "0.3 s", at_least=0)] | None = None
    """From when on no magnet has any current, as where the power fails: the rotor drops into its
    touch-down bearings [s]."""
    sequence: LiftOff | None = None
    """Lift-off and landing, of all axes together, and what looks after the flight; without, it
    flies from the start."""
    base: tuple[Base, ...] = ()
    """How the foundation moves; displacements and readings are relative to it."""

    @model_validator(mode="before")
    @classmethod
    def _read_on(cls, data: Any) -> Any:
        """Read the keys of earlier releases: ``control``, and ``feedback`` beside it."""
        if not isinstance(data, dict) or not {"control", "feedback"} & data.keys():
            return data
        legacy_values = [data.get(key) for key in ("controller", "control", "feedback")]
        rest = {key: data[key] for key in data if key not in ("controller", "control", "feedback")}
        return rest | {
            "controller" if legacy_values[0] is not None else "control": _merged(*legacy_values)
        }

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        return {key: value for key, value in data.items() if value is not None and value != ()}

    @property
    def feedback(self) -> Literal["measurement", "estimate"] | None:
        """What is said to feed the controllers."""
        return self.controller.feedback

    def fed(self, feedback: Literal["measurement", "estimate"]) -> Self:
        """Return the same run with controllers that are fed by the one or the other.

        Parameters
        ----------
        feedback : str
            ``"measurement"`` or ``"estimate"``.
        """
        return self.model_copy(update={"controller": self.controller.fed_by(feedback)})

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some values changed, checked like a new one.

        Parameters
        ----------
        **changes
            Values by dotted key, as ``controller__kp``; `feedback` is that of the controllers.
        """
        if {"control", "feedback"} & changes.keys():
            known = changes.pop("controller", self.controller)
            control, feedback = changes.pop("control", None), changes.pop("feedback", None)
            if feedback is not None and isinstance(known, Control):
                known = known.fed_by(feedback)
            changes["controller"] = _merged(known, control, feedback)
        return super().replace(**changes)

    def by_axis(self, what: str, first: str) -> list[tuple[str, Waveform]]:
        """Return the signals at a key that are not zero throughout, each with its axis.

        Parameters
        ----------
        what : str
            The key: reference, disturbance or injection.
        first : str
            Name of the machine's first axis, which a signal without an axis is of.
        """
        waveforms = getattr(self, what)
        if isinstance(waveforms, tuple):
            return [(waveform.axis, waveform.signal) for waveform in waveforms]
        return [] if waveforms == _NOTHING else [(first, waveforms)]

    def along(self, what: str, axes: tuple[str, ...], t: NDArray[np.floating]) -> Array:
        """Return the signals at a key along all axes (n, p) [SI unit of the key].

        Parameters
        ----------
        what : str
            The key: reference, disturbance or injection.
        axes : tuple of str, (p,)
            Names of the machine's axes.
        t : ndarray, (n,)
            Times [s].
        """
        values = np.zeros((len(t), len(axes)))
        for name, waveform in self.by_axis(what, axes[0]):
            values[:, axes.index(name)] += waveform.sample(t)
        return values

    def wrong_for(self, axes: tuple[str, ...], *, body: bool) -> Iterator[str]:
        """Yield what it says that a machine has not.

        Parameters
        ----------
        axes : tuple of str, (p,)
            Names of the machine's axes.
        body : bool
            Whether its rotor is a body, and no mass that moves along one axis.
        """
        for what in AXES:
            for at, (axis, _) in enumerate(self.by_axis(what, axes[0])):
                if axis not in axes:
                    known = f"there are {', '.join(axes)}" if axes[0] else "the one axis has none"
                    yield f"{what}[{at}].axis: there is no axis {axis}; {known}"
        if not body:
            control, usual = self.controller, Control()
            for name in control.pid.keys() - {"x", axes[0]}:
                yield f"controller.pid.{name}: there is no {name}; known: {axes[0] or 'x'}"
            for key in OF_BODY:
                if getattr(control, key) != getattr(usual, key):
                    yield f"controller.{key}: is of a rotor that is a body; this one is a mass"
            if control.type == "translation and tilt":
                yield f'controller.type: "{control.type}" is of a body; this rotor is a mass'
            for key in sorted(OF_MACHINE & self.model_fields_set):
                if getattr(self, key) != type(self).model_fields[key].default:
                    yield f"{key}: is of a rotor that is a body; this one is a mass"

    def check_for(self, axes: tuple[str, ...], *, body: bool) -> None:
        """Raise AmbkitError with all that `wrong_for` yields.

        Parameters
        ----------
        axes, body
            As there.

        Raises
        ------
        AmbkitError
            There is one.
        """
        if wrong := list(self.wrong_for(axes, body=body)):
            raise AmbkitError("; ".join(wrong))

    def of_one_axis(self, bearing: Bearing) -> Self:
        """Return it with its controller complete: what is not said is tuned to the bearing.

        Parameters
        ----------
        bearing : Bearing
            What the controller is to hold.
        """
        result = self.controller.completed(bearing)
        return self if result is self.controller else self.model_copy(update={"controller": result})


_NOTHING = Constant(value=0.0)
