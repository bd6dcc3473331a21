"""What a run is given from outside: loads, noise, a magnet that drifts, and faults."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Faults:
    """What is wrong between plant, controller and estimator, one value a sample, all (n,)."""

    # Of several axes (n, readings) of what is measured, and (n, axes) of the rest.

    #: The measurement is that of so many samples ago, 0 or more; between two of them on the line
    #: through both. One that grows by 1 a sample is a sensor that is stuck [samples].
    late: NDArray[np.float64]
    #: It is then multiplied by the one [1] and added to the other [m].
    y_times: NDArray[np.float64]
    y_plus: NDArray[np.float64]
    #: The same for the control signal that the estimator is told [1], [V]; the amplifier gets the
    #: true one.
    u_times: NDArray[np.float64]
    u_plus: NDArray[np.float64]
    #: Share of the amplifier's range that is left, which nobody is told [1].
    current: NDArray[np.float64]
    #: Whether the controller, where it is fed by the measurement, gets the true one.
    beside: bool = False

    @classmethod
    def none(cls, n: int, *, beside: bool = False) -> Faults:
        """Return n samples without a fault."""
        zero, one = np.zeros(n), np.ones(n)
        return cls(zero, one, zero.copy(), one.copy(), zero.copy(), one.copy(), beside=beside)

    def among(self, reading: int, readings: int, axis: int, axes: int) -> Faults:
        """Return the same faults of one of several readings, and of one of several axes."""
        none = {"late": 0.0, "y_times": 1.0, "y_plus": 0.0, "u_times": 1.0, "u_plus": 0.0,
                "current": 1.0}  # fmt: skip
        found = {}
        for name, series in self.series.items():
            of_reading = name.startswith(("late", "y_"))
            k, columns = (reading, readings) if of_reading else (axis, axes)
            found[name] = np.full((len(series), columns), none[name])
            found[name][:, k] = series
        return Faults(**found, beside=self.beside)

    @property
    def series(self) -> dict[str, NDArray[np.float64]]:
        """All that has one value a sample, by name."""
        return {name: each for name, each in vars(self).items() if name != "beside"}


@dataclass(frozen=True, eq=False)
class Imposed:
    """Series that a run is given from outside, one value a sample."""

    #: (n,) Force on the rotor, added to the scenario's [N].
    disturbance: NDArray[np.float64] | None = None
    #: (n,) Noise on the measured position, in place of all that the bearing's sensor has [m].
    sensor_noise: NDArray[np.float64] | None = None
    #: (n,) Factor on the force of the plant's magnet, such as that of a drifting magnet constant
    #: [1]. Where the rotor hovers at the start, it is held as if the factor were 1.
    magnet_scale: NDArray[np.float64] | None = None
    #: Faults of sensor, control signal and amplifier. The record's y and u are those that the
    #: estimator gets, with NaN for infinity.
    faults: Faults | None = None
    #: Where the rotor lies at the start [m]. Neither controller nor estimator is told: they start
    #: as if it hovered at the reference.
    place: float | None = None


def series_of(imposed: Imposed) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """All that has one value a sample, by name."""
    for name in ("disturbance", "sensor_noise", "magnet_scale"):
        if getattr(imposed, name) is not None:
            yield name, getattr(imposed, name)
    if imposed.faults is not None:
        yield from ((f"fault {name}", values) for name, values in imposed.faults.series.items())
