"""What happens to a whole machine in a run: run-up, loads, noise, and who controls it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from ambkit.base.config import Document, Part
from ambkit.base.config.quantities import Quantity, SignalIn
from ambkit.simulation.controllers import Control
from ambkit.simulation.sequence import LiftOff
from ambkit.simulation.waveforms import Signal


class Disturbance(Part):
    """A force on the rotor along an axis of a bearing."""

    axis: str
    """Name of the axis, such as A1."""
    force: Annotated[Signal, SignalIn("N", "3 N")]
    """The force [N]."""


class Reference(Part):
    """Where the rotor is to be along an axis of a bearing."""

    axis: str
    """Name of the axis, such as A1."""
    position: Annotated[Signal, SignalIn("m", "20 um")]
    """The position [m]."""


class Injection(Part):
    """A signal at the summing point of an axis, where its controller takes its position."""

    axis: str
    """Name of the axis, such as A1."""
    position: Annotated[Signal, SignalIn("m", "1 um")]
    """What is added to the readings, as if the rotor were there [m]."""


class Base(Part):
    """A motion of the foundation, with which bearings and sensors go: earthquake, ship, shock."""

    direction: Literal["x", "y", "z"]
    """Along which direction of the machine."""
    acceleration: Annotated[Signal, SignalIn("m/s^2", "5 m/s^2")]
    """The acceleration [m/s^2]."""


class Flight(Document):
    """A run of a whole machine: how fast it turns, what disturbs it, and who controls it.

    Frozen, and checked as a whole: from TOML (`load`, `from_toml`) or from Python, in SI.
    """

    duration: Annotated[float, Quantity("s", "0.5 s", above=0)] = 0.5
    """How long the run lasts [s]."""
    start: Literal["hover", "rest"] = "hover"
    """At the start: in equilibrium, or lying in the backup bearings without current."""
    noise: Annotated[bool, Field(strict=True)] = True
    """Whether amplifiers and sensors are noisy."""
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 0
    """Seed of the noise."""
    run: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 0
    """Number of the run among those of this seed: with it, the key of the noise."""
    substeps: Annotated[int, Field(strict=True, ge=1, le=1000)] = 4
    """Steps of the integrator in one sample."""
    feedback: Literal["measurement", "estimate"] | None = None
    """What the controllers are fed by: the sensors, or the estimator. Without it the sensors,
    unless default controllers of a machine that turns have far better margins by the estimate."""
    control: Control = Control()
    """The controllers; by default chosen on the margins over the machine's speed range."""
    speed: Annotated[Signal, SignalIn("rad/s", "3000 rpm")] | None = None
    """Speed of rotation, such as a run-up [rad/s]; the machine's own without."""
    disturbance: tuple[Disturbance, ...] = ()
    """Forces on the rotor besides magnets, weight and unbalance."""
    reference: tuple[Reference, ...] = ()
    """Positions that the rotor is to take; else the middle."""
    injection: tuple[Injection, ...] = ()
    """What is added to the readings before controllers and estimator take them."""
    off: Annotated[float, Quantity("s", "0.3 s", at_least=0)] | None = None
    """From when on no magnet has any current, as where the power fails: the rotor drops into its
    backup bearings [s]."""
    sequence: LiftOff | None = None
    """Lift-off and landing, of all axes together, and what looks after the flight; without, it
    flies from the start."""
    base: tuple[Base, ...] = ()
    """How the foundation moves; displacements and readings are relative to it."""

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        lists = ("disturbance", "reference", "injection", "base")
        data = {k: each for k, each in data.items() if k not in lists or each}
        optional = ("sequence", "feedback")
        return {k: each for k, each in data.items() if k not in optional or each is not None}

    def unknown_axes(self, axes: tuple[str, ...]) -> Iterator[str]:
        """Yield what is wrong with the axes that it names.

        Parameters
        ----------
        axes : tuple of str
            Those of the machine.
        """
        named = [(f"disturbance[{at}]", each.axis) for at, each in enumerate(self.disturbance)]
        named += [(f"reference[{at}]", each.axis) for at, each in enumerate(self.reference)]
        named += [(f"injection[{at}]", each.axis) for at, each in enumerate(self.injection)]
        for key, axis in named:
            if axis not in axes:
                yield f"{key}.axis: there is no axis {axis}; there are {', '.join(axes)}"
