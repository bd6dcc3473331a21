"""What an estimator of one axis is told, and where it starts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.estimate.noise import FilterNoise, Variances, completed, dwell
from ambkit.estimate.starting import hovering, start_std
from ambkit.machine.bank import bias_forces_of

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.machine.bearing import Bearing
    from ambkit.models.model import Descriptor

Array = NDArray[np.float64]


class OneAxis:
    """A bearing as its estimators see it; `Whole` is the same of a machine."""

    speed: float | None = None
    """Of rotation, which its model does not know."""
    columns: dict[str, Any] = {}  # noqa: RUF012
    """What an estimate is told of the names of axes and readings: there is one of each."""

    def __init__(self, bearing: Bearing) -> None:
        self.bearing = bearing

    def variances(self, noise: FilterNoise) -> Variances:
        """Return what a filter assumes."""
        return completed(self.bearing, noise)

    def settings(
        self, variances: Variances, states: Sequence[Descriptor], noises: Sequence[Descriptor]
    ) -> dict[str, Any]:
        """Return what the core is told but for known forces and limits of judgement."""
        b = self.bearing
        T, travel = b.sampling_time, b.rotor.travel_limit
        return {
            "T": T,
            "K_sen": [b.sensor.gain],
            "lag": [b.sensor_lag],
            "travel": [travel],
            "k_ui": [b.amplifier.gain],
            "iu_min": [b.current_min],
            "iu_max": [b.current_max],
            "x_max": [travel],
            "cap": caps(b, states),
            "var_u": [variances.control],
            "var_d": variances.growth(T, noises),
            "var_y": [variances.measurement],
            "rise": [b.sensor.noise_rise],
            "step": [b.sensor.quantisation or 0.0],
            "dwell": dwell([b]),
        }

    def caps(self, states: Sequence[Descriptor]) -> list[float]:
        """Return the most that each state can be."""
        return caps(self.bearing, states)

    def growth(self, variances: Variances, noises: Sequence[Descriptor]) -> list[float]:
        """Return the variances of a model's noises."""
        return variances.growth(self.bearing.sampling_time, noises)

    def known_forces(self, magnet: Any, *, weight: bool) -> list[float]:
        """Return the force that a filter knows [N]."""
        (bias,) = bias_forces_of(magnet, self.bearing)
        return [(self.bearing.weight if weight else 0.0) + bias]

    def start_std(self, variances: Variances, states: Sequence[Descriptor]) -> tuple[float, ...]:
        """Return the standard deviations with which a filter starts; see `Estimator.reset`."""
        return start_std(self.bearing, variances, states)

    def hover(self, magnet: Any, states: Sequence[Descriptor]) -> tuple[float, float]:
        """Return what `hovering` does."""
        return hovering(self.bearing, magnet, states)

    def at_rest(
        self, states: Sequence[Descriptor], hover: tuple[float, float], x: Any, shown: Any,
        current: Any, precision: str,
    ) -> Array:  # fmt: skip
        """Return the states (n,) or (runs, n) at rest; see `Estimator.at_rest`."""
        # What holds the rotor is in the precision of an exported filter.
        shown = self.bearing.sensor.gain * x if shown is None else shown
        holding = _holding_at(x, hover, precision) if current is None else current
        by_role = {"position": x, "sensor": shown, "current": holding, "past control": holding}
        mean = np.zeros((*np.shape(x), len(states)))
        for place, state in enumerate(states):
            if state.role in by_role:
                mean[..., place] = by_role[state.role]
        return mean

    def at_first(
        self, states: Sequence[Descriptor], hover: tuple[float, float], y: Array, precision: str
    ) -> Array:
        """Return the states at rest at the first measurement within the travel."""
        # y (N,), (runs, N) [m]; returns (n,), (runs, n) [m, m/s, N ...]
        gain = self.bearing.sensor.gain
        limit = gain * self.bearing.rotor.travel_limit

        def first(row: Array) -> float:
            # The whole record is searched only where it must be.
            near = row if row.size and abs(row[0]) <= limit else row[np.abs(row) <= limit]
            return float(near[0]) if near.size else 0.0

        shown: Any = first(y) if y.ndim == 1 else np.array([first(row) for row in y])
        return self.at_rest(states, hover, shown / gain, shown, None, precision)

    def signals(self, record: Record) -> tuple[Array, Array]:
        """Return the measurement (N,) [m] and the control signal (N,) [V] of a record."""
        return record["y"], record["u"]

    def latest(self, of_readings: Any) -> Any:
        """Return what the core says of the last readings: of one its number."""
        return float(of_readings)

    def forecast(self, of_readings: Array) -> Array:
        """Return what it says of readings to come (N, 1): of one (N,) [m]."""
        return of_readings[:, 0]


def _holding_at(x: Any, hover: tuple[float, float], precision: str) -> Any:
    if hover == (0.0, 0.0):
        return 0.0
    at_centre, per_metre = np.array(hover, precision)
    return at_centre + per_metre * np.asarray(x, precision)


class Sizes(NamedTuple):
    """The most that a rotor between its stops can do, for the states' caps."""

    position: float
    velocity: float
    force: float

    @classmethod
    def of(cls, bearing: Bearing) -> Sizes:
        """A tenth of the travel in a sample, and the force that does that within one."""
        T, travel = bearing.sampling_time, bearing.rotor.travel_limit
        velocity = 0.1 * (travel / T)
        return cls(travel, velocity, bearing.rotor.mass * (velocity / T))


def caps(bearing: Bearing, states: Sequence[Descriptor]) -> list[float]:
    """Return the most that each state can be (``ambkit/envelope.h``)."""
    most, current = Sizes.of(bearing), 10 * bearing.amplifier.current_limit
    by_role = {
        "position": most.position,
        "velocity": most.velocity,
        "disturbance force": most.force,
        "sensor": 3 * abs(bearing.sensor.gain) * most.position,
        "current": current,
        "past control": current,
    }
    return [by_role.get(state.role, 30 * state.size) for state in states]
