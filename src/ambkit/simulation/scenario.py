"""A scenario: reference, disturbance, speed, noise and controllers of a run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    model_serializer,
)

from ambkit.base.arrays import Array
from ambkit.base.config import Document, Part, Read
from ambkit.base.config.problems import ONE_OR_MORE
from ambkit.base.config.quantities import Quantity, SignalIn
from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import OwnClass
from ambkit.control.control import Control, LiftOff, as_control
from ambkit.control.control_candidates import Feedback
from ambkit.control.default_control import DefaultControl, default_control, is_default, settled
from ambkit.machine.machine import Machine
from ambkit.result.showing import Described
from ambkit.simulation.waveforms import Constant, Signal, Waveform


class Disturbance(Part):
    """A force on the rotor along an axis of a bearing."""

    axis: str
    """Name of the axis, such as A1."""
    force: Annotated[Signal, SignalIn("N", "3 N")]
    """The force [N]."""

    @property
    def signal(self) -> Waveform:
        """Its waveform."""
        return self.force


class Reference(Part):
    """Reference position along an axis of a bearing."""

    axis: str
    """Name of the axis, such as A1."""
    position: Annotated[Signal, SignalIn("m", "20 um")]
    """The position [m]."""

    @property
    def signal(self) -> Waveform:
        """Its waveform."""
        return self.position


class Injection(Reference):
    """A signal at the summing point of an axis, where its controller takes its position."""

    position: Annotated[Signal, SignalIn("m", "1 um")]
    """Signal added to the readings, as if the rotor were there [m]."""


class Base(Part):
    """Acceleration of the foundation, with bearings and sensors: earthquake, ship, shock."""

    direction: Literal["x", "y", "z"]
    """Direction in the machine's coordinates."""
    acceleration: Annotated[Signal, SignalIn("m/s^2", "5 m/s^2")]
    """The acceleration [m/s^2]."""


_One = Annotated[Signal, Tag(ONE_OR_MORE[0])]
_LIST = Tag(ONE_OR_MORE[1])
_ONE_OR_MORE = Discriminator(lambda raw_value: ONE_OR_MORE[isinstance(raw_value, list | tuple)])

AXES = ("reference", "disturbance", "injection")  #: Signals of an axis.
OF_MACHINE = frozenset({"speed", "base"})  #: Keys of a machine with several axes.


OF_BODY = {
    key: Control.model_fields[key].default
    for key in ("cross_feedback", "gain_scheduling", "unbalance", "unbalance_from")
}
"""Keys of its controllers, and their defaults."""


class Scenario(Described, Document):
    """A run: reference, disturbances, and controllers of a machine.

    Frozen, with all checks on construction: from TOML (`load`, `from_toml`) or from Python, in SI.

    Examples
    --------
    >>> from ambkit import Constant, Scenario, Step
    >>> scenario = Scenario(
    ...     duration=0.2,
    ...     reference=Step(amplitude=0.5e-3, time=0.02),
    ...     disturbance=Constant(value=-3.0),
    ... )
    >>> scenario.replace(seed=7).seed
    7
    """

    duration: Annotated[float, Quantity("s", "0.5 s", above=0)] = 0.5
    """Duration of the run [s]."""
    start: Literal["levitated", "landed", "released"] = "levitated"
    """Initial state: in equilibrium at the reference; without current in contact with the
    touch-down bearings; or without current at the centre.
    """
    noise: Annotated[bool, Field(strict=True)] = True
    """Whether amplifiers and sensors have noise."""
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 0
    """Seed of the noise."""
    run: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 0
    """Number of the run with this seed; both are the key of the noise."""
    substeps: Annotated[int, Field(strict=True, ge=1, le=1000)] = 4
    """Integration steps per sample."""
    reference: Annotated[
        _One | Annotated[tuple[Reference, ...], _LIST],
        _ONE_OR_MORE, SignalIn("m", "0.5 mm"),
    ] = Constant(value=0.0)  # fmt: skip
    """Reference position [m]: of the first axis, or a list with axes."""
    disturbance: Annotated[
        _One | Annotated[tuple[Disturbance, ...], _LIST],
        _ONE_OR_MORE, SignalIn("N", "3 N"),
    ] = Constant(value=0.0)  # fmt: skip
    """Disturbance force on the rotor [N]: along the first axis, or a list with axes."""
    injection: Annotated[
        _One | Annotated[tuple[Injection, ...], _LIST],
        _ONE_OR_MORE, SignalIn("m", "1 um"),
    ] = Constant(value=0.0)  # fmt: skip
    """Signal added to the measurement at the input of controller and estimator [m]: of the first
    axis, or a list with axes.
    """
    controller: Annotated[Control, BeforeValidator(as_control)] = Control()
    """The controllers. Omitted settings are tuned; with several axes the structure is selected by
    the margins over the machine's speed range.
    """
    speed: Annotated[Signal, SignalIn("rad/s", "3000 rpm")] | None = None
    """Speed of rotation, such as a run-up [rad/s]. By default the machine's."""
    off: Annotated[float, Quantity("s", "0.3 s", at_least=0)] | None = None
    """Time of a power failure, from which on all magnet currents are zero: the rotor drops onto its
    touch-down bearings [s].
    """
    on: Annotated[float, Quantity("s", "0.5 s", above=0)] | None = None
    """Time at which the power returns [s]. By default never. With `sequence` the controller
    trips when the power fails; the command to levitate is withdrawn for a sample when the power
    returns, so that the rotor lifts off as at the start.
    """
    sequence: LiftOff | None = None
    """Lift-off and landing of all axes, and trips. By default levitation from the start."""
    plant: OwnClass | None = None
    """The user's plant in place of the machine: ``"file.py:Class"``, or in Python the class; see
    `PlantProtocol`.
    """
    base: tuple[Base, ...] = ()
    """Motion of the foundation; displacements and readings are relative to it."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        off, on = read("off"), read("on")
        if on is not None and off is None:
            yield "on", "needs off, the time of the power failure"
        elif on is not None and on <= off:
            yield "on", f"must be after off, {off:g} s; is {on:g} s"
        if off is not None and read("plant") is not None:
            yield "off", "acts on the machine's own plant; omit it or plant"

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        return {key: value for key, value in data.items() if value is not None and value != ()}

    @property
    def feedback(self) -> Literal["measurement", "estimate"] | None:
        """Stated feedback of the controllers."""
        return self.controller.feedback

    def fed(self, feedback: Literal["measurement", "estimate"]) -> Self:
        """Return a copy with this feedback of the controllers.

        Parameters
        ----------
        feedback : str
            ``"measurement"`` or ``"estimate"``.
        """
        return self.model_copy(update={"controller": self.controller.fed_by(feedback)})


def energised(off: float | None, on: float | None, t: Array, T: float) -> Array:
    """Return 1 where the magnets are supplied, 0 in a power failure (n,)."""
    # off, on [s]; t (n,) [s], sampled every T [s]
    first, end = (math.inf if at is None else round(at / T) for at in (off, on))
    samples = np.round(t / T)
    return np.where((samples < first) | (samples >= end), 1.0, 0.0)


def fly_command(sequence: LiftOff, t: Array, energised: Array) -> Array:
    """Return the command to levitate (n,), withdrawn for a sample when the power returns."""
    fly = sequence.fly(t)
    fly[1:][np.diff(energised) > 0] = 0.0
    return fly


def by_axis(scenario: Scenario, what: str, first: str) -> list[tuple[str, Any]]:
    """Return the nonzero signals at a key, each with its axis."""
    # first: name of the machine's first axis, which a signal without an axis is of
    waveforms = getattr(scenario, what)
    if isinstance(waveforms, tuple):
        return [(waveform.axis, waveform.signal) for waveform in waveforms]
    nothing = isinstance(waveforms, Constant) and waveforms.value == 0
    return [] if nothing else [(first, waveforms)]


def along(scenario: Scenario, what: str, axes: tuple[str, ...], t: NDArray[np.floating]) -> Array:
    """Return the signals at a key along all axes (n, p) [SI unit of the key], at times (n,) [s]."""
    values = np.zeros((len(t), len(axes)))
    for name, waveform in by_axis(scenario, what, axes[0]):
        values[:, axes.index(name)] += waveform.sample(t)
    return values


def wrong_for(scenario: Scenario, machine: Machine) -> Iterator[str]:
    """Yield keys of a scenario that do not apply to a machine."""
    axes = machine.axis_names
    for what in AXES:
        for at, (axis, _) in enumerate(by_axis(scenario, what, axes[0])):
            if axis not in axes:
                known = f"there are {', '.join(axes)}" if axes[0] else "the one axis has none"
                yield f"{what}[{at}].axis: there is no axis {axis}; {known}"
    if machine.rotor.type != "mass":
        return
    control = scenario.controller
    for name in control.pid.keys() - {"x", axes[0]}:
        yield f"controller.pid.{name}: there is no {name}; known: {axes[0] or 'x'}"
    for key, usual in OF_BODY.items():
        if getattr(control, key) != usual:
            yield f"controller.{key}: is of a rotor that is a body; this one is a mass"
    for key in ("schedule", "sees"):
        if any(getattr(pid, key) for pid in (control, *control.pid.values())):
            yield f"controller.{key}: is of a rotor that is a body; this one is a mass"
    if control.type == "translation and tilt":
        yield f'controller.type: "{control.type}" is of a body; this rotor is a mass'
    for key in sorted(OF_MACHINE & scenario.model_fields_set):
        if getattr(scenario, key) != Scenario.model_fields[key].default:
            yield f"{key}: is of a rotor that is a body; this one is a mass"


def check_for(scenario: Scenario, machine: Machine) -> None:
    """Raise AmbkitError with all that `wrong_for` yields."""
    if wrong := list(wrong_for(scenario, machine)):
        raise AmbkitError("; ".join(wrong))


TIMES = 2001  #: Times of a run at which its speed is evaluated.


def fastest_of(machine: Machine, scenario: Scenario) -> float:
    """Return the highest speed of rotation of a run, or the machine's own if higher [rad/s]."""
    if scenario.speed is None:
        return abs(machine.speed)
    speed = scenario.speed.sample(np.linspace(0.0, scenario.duration, TIMES))
    return max(abs(machine.speed), float(np.abs(speed).max()))


def feedback_of(scenario: Scenario) -> Feedback:
    """Return the feedback of a scenario's controllers: by default the estimate."""
    return scenario.feedback or "estimate"


def default_for(machine: Machine, scenario: Scenario) -> DefaultControl:
    """Return the default controllers of a scenario, over its speed range and the machine's."""
    return default_control(machine, feedback_of(scenario), fastest_of(machine, scenario))


def control_of(machine: Machine, scenario: Scenario) -> Control:
    """Return the controllers of a scenario with their type; held or not."""
    feedback = feedback_of(scenario)
    control = settled(machine, scenario.controller, feedback, fastest_of(machine, scenario))
    return control.fed_by(feedback)


def settled_scenario(machine: Machine, scenario: Scenario) -> Scenario:
    """Return a scenario with controllers and feedback selected where they are omitted."""
    if is_default(scenario.controller):
        result = default_for(machine, scenario)
        if not result.held:
            raise AmbkitError(result.summary)
    control = control_of(machine, scenario)
    if control is scenario.controller:
        return scenario
    return scenario.model_copy(update={"controller": control})
