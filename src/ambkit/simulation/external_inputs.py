"""External inputs of a run: forces, noise, faults, and the user's plant."""

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
    """Faults of sensors, control signals and amplifiers, one value per sample, all (n,)."""

    # With several axes (n, readings) for measurements, and (n, axes) for the rest.

    #: Delay of the measurement in samples, at least 0, interpolated linearly. A delay that grows by
    #: 1 per sample is a stuck sensor [samples].
    late: Array
    #: Factor on the measurement [1], and offset [m].
    y_times: Array
    y_plus: Array
    #: The same for the control signal reported to the estimator [1], [V]; the amplifier gets the
    #: true one.
    u_times: Array
    u_plus: Array
    #: Remaining share of the amplifier's range, unknown to controller and estimator [1].
    current: Array
    #: Whether a controller with measurement feedback gets the true measurement.
    beside: bool = False

    @classmethod
    def none(cls, n: int, *, beside: bool = False) -> Faults:
        """Return n samples without a fault."""
        return cls(**{name: np.full(n, value) for name, value in NONE.items()}, beside=beside)

    def among(self, reading: int, readings: int, axis: int, axes: int) -> Faults:
        """Return the same faults for one of several readings, and for one of several axes."""
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
        """All series by name."""
        return {name: item for name, item in vars(self).items() if name != "beside"}


@dataclass(frozen=True, eq=False)
class ExternalInputs:
    """External series of a run, one value per sample."""

    # With p axes and m readings; for a single axis each is (n,) or (n, 1).

    #: (n, p) Force on the rotor, added to the scenario's [N].
    disturbance: Array | None = None
    #: (n, m) Noise of the measured positions, in place of the sensors' own [m].
    sensor_noise: Array | None = None
    #: (n,) Factor on the force of the plant's magnets, such as a drifting magnet constant [1]. The
    #: initial equilibrium is that for a factor of 1.
    magnet_scale: Array | None = None
    #: Faults of sensors, control signals and amplifiers. The record's y and u are those of the
    #: estimator, with NaN for infinity.
    faults: Faults | None = None
    #: Initial position of the rotor [m], with several axes (p,). Controller and estimator start as
    #: in equilibrium at the reference.
    place: float | Array | None = None
    #: (n, m) Added to the measured positions [m]; NaN: lost.
    readings: Array | None = None
    #: (n, p) Added to the references after the start [m]; NaN: none.
    references: Array | None = None
    #: (n,) With a sequence, the command to levitate [1]; by default as in the sequence.
    fly: Array | None = None
    #: As in an export: fields of ``amb_control`` with values other than the sequence's, and an
    #: estimator that starts at its first readings.
    exported: dict[str, Any] | None = None


_OF_READINGS = ("sensor_noise", "readings", "fault late", "fault y_times", "fault y_plus")


def columns(name: str, axes: int, readings: int) -> int:
    """Return the number of columns of a series."""
    if name in ("magnet_scale", "fly"):
        return 1
    return readings if name in _OF_READINGS else axes


def as_series(external_inputs: ExternalInputs) -> Iterator[tuple[str, Array]]:
    """All series that must be finite, by name."""
    for name in ("disturbance", "sensor_noise", "magnet_scale", "readings", "references", "fly"):
        if getattr(external_inputs, name) is not None:
            yield name, getattr(external_inputs, name)
    if external_inputs.faults is not None:
        yield from (
            (f"fault {name}", values) for name, values in external_inputs.faults.series.items()
        )


@runtime_checkable
class PlantProtocol(Protocol):
    """Interface of the user's plant.

    The class is constructed with the machine, or without arguments, for each run. It is named as
    ``file.py:Class``; in Python the class itself is passed. Noise, quantisation and current limits
    are those of the described machine.
    """

    def step(self, iu: Any, f_d: Any) -> ArrayLike:
        """Move the rotor on to the next sample.

        Parameters
        ----------
        iu : float or ndarray (p,)
            Control current with noise and limits, held over the sample [A]; with several axes all.
        f_d : float or ndarray (p,)
            Disturbance force, held over the sample [N].

        Returns
        -------
        array_like (3,) or (2 q + m,)
            Displacement x [m], velocity v [m/s] and sensor output without noise x_m [m]; with
            several axes displacements and velocities of the rotor's coordinates,
            `Machine.positions`, and all sensor outputs. The run starts at the initial state of the
            described machine.
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
