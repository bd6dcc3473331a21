"""Estimator, controllers, lift-off and landing together, for ``core/include/ambkit/control.h``."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array
from ambkit.base.own_class import OwnPart
from ambkit.control.control import MOST_COUNTED, Control, LiftOff, as_control
from ambkit.control.controllers import Controllers, arrays, controllers_of
from ambkit.control.pid import PID
from ambkit.estimate.estimator import Estimator
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, own_time
from ambkit.models.plant import Plant

FLAT = 0.05  #: Share of the clearance within which the stiffnesses of the centre hold.


@dataclass(frozen=True, eq=False)
class Controller:
    """Estimator, controllers, lift-off and landing of a machine."""

    plant: Plant  #: The machine.
    estimator: Estimator  #: Estimator that feeds the controllers, or monitors the sensors.
    law: Controllers  #: Controllers of all axes.
    sequence: LiftOff | None  #: Lift-off and landing; None: levitated from the start.
    fed: bool  #: Whether the estimate feeds the controllers; else the readings do.
    pid: Control = field(default_factory=Control)  #: Complete controller of a single axis.

    @classmethod
    def of_axis(
        cls, machine: Machine, estimator: Estimator, pid: PID, sequence: LiftOff | None = None
    ) -> Controller:
        """Return that of a single axis and its PID."""
        control: Control = as_control(pid).completed(machine)
        plant, fed = Plant(machine), control.feedback == "estimate"
        law = controllers_of(plant, control, estimator if fed else None)
        return cls(plant, estimator, law, sequence, fed, control)

    @property
    def first_axis(self) -> Machine:
        """The first axis, the only one of a single axis."""
        return self.plant.isolated[0]

    @property
    def coils(self) -> int:
        """Number of coils of its magnet: i0 + iu, and of a pair i0 - iu."""
        return 2 if self.first_axis.magnet.type == "two-sided" else 1

    @cached_property
    def down(self) -> Array:
        """Contact position along the axes (p,) [m]."""
        if self.plant.machine.single:
            return np.array([lies_at(self.first_axis)])
        return np.asarray(self.plant.H @ self.plant.resting())

    @cached_property
    def _held(self) -> tuple[Array, Array]:
        """Levitation currents at the centre (p,) [A], and their slope [A/m]."""
        # Of the line through the centre and the contact position.
        nothing, down = np.zeros(len(self.down)), self.down
        (_, middle), (_, lying) = (self.plant.equilibrium(at, nothing) for at in (nothing, down))
        k = [ConstantStiffness.of(item) for item in self.plant.isolated]
        travel = np.array([item.clearance for item in self.plant.isolated])
        slope = np.array([-item.k_s / item.k_i for item in k])
        far = np.abs(down) > FLAT * travel
        slope[far] = (lying - middle)[far] / down[far]
        return middle, slope

    def integrals(self, currents: Array, place: Array) -> Array:
        """Return the integrals (q,) [A] in equilibrium."""
        # currents (p,) [A]; place (p,) [m]
        q = self.estimator.view.placed @ place
        states = np.ravel(self.estimator.equilibrium_state(q, current=currents))
        return self.law.integrals(currents, place, states if self.fed else None)

    def integral(self, current: float, x: float) -> float:
        """Return the integral [A] of a single axis in equilibrium."""
        return float(self.integrals(np.array([current]), np.array([x]))[0])

    @property
    def fields(self) -> dict[str, Any]:
        """Fields of ``amb_control`` and of the structs it points to, by name."""
        e, view, sequence = self.estimator, self.estimator.view, self.sequence
        start, by_reading = view.start_form(e.states, e.levitation_current)
        middle, slope = self._held
        nothing, parts = np.zeros(len(middle)), np.eye(len(middle))
        hold = self.integrals(middle, nothing)
        hold_by = np.column_stack([self.integrals(middle + slope * at, at) - hold for at in parts])
        T = self.plant.machine.sampling_time
        return (
            arrays(self.law, self.plant, e if self.fed else None)
            | ({} if sequence is None else sequence.in_samples(T))
            | {
                "sequenced": sequence is not None,
                "settling": settling_of(e),
                "bound": bound_of(e),
                "std": list(e.default_std()),
                "start": start.tolist(),
                "start_by": by_reading.ravel().tolist(),
                "place": view.along_axes(e.states)[0].ravel().tolist(),
                "down": self.down.tolist(),
                "hold": hold.tolist(),
                "hold_by": hold_by.ravel().tolist(),
            }
        )

    def in_core(self, **other: Any) -> Any:
        """Return the core's controller, with the core's estimator."""
        return self.estimator.engine.core.Control(self.estimator.core, self.fields | other)

    def run(
        self, y: ArrayLike, r: ArrayLike, fly: ArrayLike, *, transferred: float | None = None,
        other: dict[str, Any] | None = None, energised: ArrayLike | None = None,
    ) -> dict[str, NDArray[Any]]:  # fmt: skip
        """Run a single axis along readings from power-on, with the bits of the exported C."""
        # y (n,) [m]; r (n,) [m]; fly, energised (n,)
        number = np.dtype(self.estimator.precision).type
        position, _ = self.estimator.in_si(y, np.zeros(0))
        output: dict[str, Any] = self.in_core(**(other or {})).run(
            np.ascontiguousarray(position, number),
            np.ascontiguousarray(r, number),
            np.ascontiguousarray(fly, number),
            transferred=None if transferred is None else np.array([transferred], number),
            energised=None if energised is None else np.ascontiguousarray(energised, number),
        )
        output["iu"], output["u"] = output["iu"].ravel(), output["u"].ravel()
        bias = number(self.first_axis.magnet.bias_current)
        coils = [bias + output["iu"], bias - output["iu"]][: self.coils]
        return output | {"coil": np.where(output["on"][:, None] > 0, np.stack(coils, 1), number(0))}


def lies_at(machine: Machine) -> float:
    """Return the contact position of a rotor [m]: the stop in the direction of its weight."""
    travel: float = machine.clearance
    return travel if machine.weight > 0 else -travel


def settling_of(estimator: Estimator) -> int:
    """Return the plant's time constant in samples, at least one, at most 16 bits."""
    isolated = isolated_axes(estimator.machine)
    samples = max(own_time(item) for item in isolated) / isolated[0].sampling_time
    return min(max(round(samples), 1), MOST_COUNTED)


def bound_of(estimator: Estimator) -> float:
    """Return the limit of a mean in clearances: ten, or the transients of an observer."""
    far = estimator.core.own.get("far")
    if far is None:
        return 10.0
    return max(10.0, float((far / estimator.core.parameters["set"]["cap"]).max()))


@runtime_checkable
class ControllerProtocol(Protocol):
    """Interface of the user's controller.

    The class is constructed with the machine, or without arguments, for each run. It is named as
    ``file.py:Class``; in Python the class itself is passed.
    """

    def step(self, y: Any, r: Any, estimate: Any) -> ArrayLike:
        """Return the control currents of a sample.

        Parameters
        ----------
        y : float or ndarray (m,)
            Measured position [m]; with several axes all readings.
        r : float or ndarray (p,)
            Reference [m]; with several axes all.
        estimate : ndarray (n,) or None
            State estimate; with one axis the displacement x [m] and velocity v [m/s] are first.
            None with ``feedback = "measurement"``.

        Returns
        -------
        float or array_like (p,)
            Demanded control current [A]; with several axes all. It is limited by the amplifier.
        """


class OwnController(OwnPart):
    """An object with ``step(y, r, estimate)``, for the loop in C; see `ControllerProtocol`."""

    def __init__(self, make: Any, machine: Machine) -> None:
        self._axes = len(machine.axes)
        returns = "the control current" if self._axes == 1 else f"{self._axes} control currents"
        super().__init__(make, machine, "step(y, r, estimate)", f"{returns} [A]")

    def __call__(self, y: list[float], r: list[float], mean: list[float]) -> list[float]:
        """Return the currents (p,) [A]."""
        estimate = np.array(mean) if mean else None
        return self.numbers(self._axes, self.plain(y), self.plain(r), estimate)
