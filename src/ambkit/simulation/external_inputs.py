"""External inputs of a run: disturbance forces, noise, faults, and a plant of the user."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.base.own_class import OwnPart
from ambkit.machine.machine import Machine

NONE = {"late": 0.0, "y_times": 1.0, "y_plus": 0.0, "u_times": 1.0, "u_plus": 0.0, "current": 1.0}
"""Values of `Faults` without a fault."""


@dataclass(frozen=True, eq=False)
class Faults:
    """What is wrong between plant, controller and estimator, one value a sample, all (n,)."""

    # Of several axes (n, readings) of what is measured, and (n, axes) of the rest.

    #: The measurement is that of so many samples ago, 0 or more; between two of them on the line
    #: through both. One that grows by 1 a sample is a sensor that is stuck [samples].
    late: Array
    #: It is then multiplied by the one [1] and added to the other [m].
    y_times: Array
    y_plus: Array
    #: The same for the control signal that the estimator is told [1], [V]; the amplifier gets the
    #: true one.
    u_times: Array
    u_plus: Array
    #: Share of the amplifier's range that is left, which nobody is told [1].
    current: Array
    #: Whether the controller, where it is fed by the measurement, gets the true one.
    beside: bool = False

    @classmethod
    def none(cls, n: int, *, beside: bool = False) -> Faults:
        """Return n samples without a fault."""
        return cls(**{name: np.full(n, value) for name, value in NONE.items()}, beside=beside)

    def among(self, reading: int, readings: int, axis: int, axes: int) -> Faults:
        """Return the same faults of one of several readings, and of one of several axes."""
        if readings == axes == 1:
            return self
        results = {}
        for name, series in self.series.items():
            of_reading = name.startswith(("late", "y_"))
            k, columns = (reading, readings) if of_reading else (axis, axes)
            results[name] = np.full((len(series), columns), NONE[name])
            results[name][:, k] = series
        return Faults(**results, beside=self.beside)

    @property
    def series(self) -> dict[str, Array]:
        """All that has one value a sample, by name."""
        return {name: item for name, item in vars(self).items() if name != "beside"}


@dataclass(frozen=True, eq=False)
class ExternalInputs:
    """Series that a run is given from outside, one value a sample."""

    # Of p axes and m readings; of a single axis each is (n,) or (n, 1).

    #: (n, p) Force on the rotor, added to the scenario's [N].
    disturbance: Array | None = None
    #: (n, m) Noise on the measured positions, in place of all that the sensors have [m].
    sensor_noise: Array | None = None
    #: (n,) Factor on the force of the plant's magnets, such as that of a drifting magnet constant
    #: [1]. Where the rotor hovers at the start, it is held as if the factor were 1.
    magnet_scale: Array | None = None
    #: Faults of sensors, control signals and amplifiers. The record's y and u are those that the
    #: estimator gets, with NaN for infinity.
    faults: Faults | None = None
    #: Where the rotor is at the start [m], of several axes (p,). Neither controller nor estimator
    #: is told: they start as if it hovered at the reference.
    place: float | Array | None = None
    #: (n, m) Added to the measured positions [m]; NaN: lost.
    readings: Array | None = None
    #: (n, p) Added to the references after the start [m]; NaN: none.
    references: Array | None = None
    #: (n,) With a sequence, whether it is told to fly [1]; by default as the sequence says.
    fly: Array | None = None
    #: As exported: fields of ``amb_control`` of another value than the sequence's, and an estimator
    #: that starts where its first readings show the rotor.
    exported: dict[str, Any] | None = None


_OF_READINGS = ("sensor_noise", "readings", "fault late", "fault y_times", "fault y_plus")


def columns(name: str, axes: int, readings: int) -> int:
    """Return how many columns a series has."""
    if name in ("magnet_scale", "fly"):
        return 1
    return readings if name in _OF_READINGS else axes


def series_of(external_inputs: ExternalInputs) -> Iterator[tuple[str, Array]]:
    """All that has one value a sample and must be a number, by name."""
    for name in ("disturbance", "sensor_noise", "magnet_scale", "readings", "references", "fly"):
        if getattr(external_inputs, name) is not None:
            yield name, getattr(external_inputs, name)
    if external_inputs.faults is not None:
        yield from (
            (f"fault {name}", values) for name, values in external_inputs.faults.series.items()
        )


@runtime_checkable
class PlantProtocol(Protocol):
    """What a plant of one's own has: a step.

    Its class is made with the machine, or without arguments, anew for each run. It is named as
    ``file.py:Class``, in Python its class is given. Noise, quantisation and limits of the currents
    are those of the machine that is described.
    """

    def step(self, iu: Any, f_d: Any) -> ArrayLike:
        """Move the rotor on to the next sample.

        Parameters
        ----------
        iu : float or ndarray (p,)
            Control current, with noise and limits, held over the sample [A]; of several axes all.
        f_d : float or ndarray (p,)
            Disturbance force, held over the sample [N].

        Returns
        -------
        array_like (3,) or (2 q + m,)
            Displacement x [m], velocity v [m/s] and what the sensor shows without noise, x_m [m];
            of several axes the displacements and the velocities by the coordinates of the rotor,
            `Machine.positions`, and what each sensor shows. The run begins where the machine that
            is described does.
        """


class OwnPlant(OwnPart):
    """An object with ``step(iu, f_d)``, for the loop in C; see `PlantProtocol`."""

    def __init__(self, make: Any, machine: Machine) -> None:
        self._count = 2 * len(machine.positions) + len(machine.readings)
        super().__init__(
            make, machine, "step(iu, f_d)", f"{self._count} numbers, see PlantProtocol"
        )

    def __call__(self, iu: list[float], f_d: list[float], _: list[float]) -> list[float]:
        """Return displacements, velocities and readings, and that no stop was touched."""
        return [*self.numbers(self._count, self.plain(iu), self.plain(f_d)), 0.0]
