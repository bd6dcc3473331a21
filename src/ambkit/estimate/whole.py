"""What an estimator of a whole machine is told, and where it starts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.data.signals import signal
from ambkit.estimate.noise import FilterNoise, Variances, check_variances, dwell
from ambkit.estimate.starting import hovering
from ambkit.machine import geometry
from ambkit.machine.bank import Bank, alone_of, bias_forces_of, weights_of
from ambkit.machine.bearing import GRAVITY
from ambkit.machine.magnets import own_time

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.machine.machine import Machine
    from ambkit.models.model import Descriptor

Array = NDArray[np.float64]

VAGUE = 3.0
"""At the start unbalance and runout are anywhere within so many times what is expected: in a run-up
the speeds tell them, and not the start."""


class Whole:
    """A machine as its estimators see it; `OneAxis` is the same of one axis."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.alone = alone_of(machine)
        positions = machine.positions
        self.H = geometry.matrix([axis.line for axis in machine.axes], positions)
        self.C = geometry.matrix([r.line for r in machine.readings], positions)
        self.gains = np.array([r.sensor.gain for r in machine.readings])
        self.rigid = len(machine.rigid_positions)

    @property
    def speed(self) -> float | None:
        """Of rotation, the machine's own [rad/s]; None where the model does not depend on it."""
        return None if self.machine.rotor.type == "mass" else self.machine.speed

    @property
    def columns(self) -> dict[str, Any]:
        """What an estimate is told of the names of axes and readings."""
        return {
            "axes": tuple(axis.name for axis in self.machine.axes),
            "readings": tuple(r.name for r in self.machine.readings),
        }

    @cached_property
    def travel(self) -> Array:
        """What the backup bearings leave to each coordinate of the rigid body [m] or [rad]."""
        limits = np.array([each.rotor.travel_limit for each in self.alone])
        return np.asarray(np.abs(np.linalg.pinv(self.H[:, : self.rigid])) @ limits)

    @cached_property
    def travel_seen(self) -> Array:
        """And to each reading, without its gain (m,) [m]."""
        limits = np.array([each.rotor.travel_limit for each in self.alone])
        H, C = self.H[:, : self.rigid], self.C[:, : self.rigid]
        return np.asarray(np.abs(C @ np.linalg.pinv(H)) @ limits)

    @cached_property
    def seen(self) -> Array:
        """Coordinates (q, m) that explain best what sensors look at, of a rotor that is rigid."""
        found = np.zeros((self.C.shape[1], len(self.gains)))
        found[: self.rigid] = np.linalg.pinv(self.C[:, : self.rigid])
        return found

    @cached_property
    def steps(self) -> Array:
        """Quantisation of each reading (m,) [m]; 0 where none is known."""
        return np.array([r.sensor.quantisation or 0.0 for r in self.machine.readings])

    @cached_property
    def shown(self) -> Array:
        """Coordinates (q, m) that explain readings best of a rotor that does not bend."""
        found = np.zeros((self.C.shape[1], len(self.gains)))
        found[: self.rigid] = np.linalg.pinv(self.gains[:, None] * self.C[:, : self.rigid])
        return found

    def along_axes(self, states: Sequence[Descriptor]) -> tuple[Array, Array]:
        """Return displacements and velocities along the axes, by the states (p, n)."""
        found = []
        for roles in (("position", "bending"), ("velocity", "bending velocity")):
            rows = np.zeros((len(self.H), len(states)))
            rows[:, [k for k, state in enumerate(states) if state.role in roles]] = self.H
            found.append(rows)
        return found[0], found[1]

    def variances(self, noise: FilterNoise) -> Variances:
        """Return what a filter assumes, one number for each reading and axis."""
        readings, axes = self.machine.readings, self.alone

        def each(name: str, own: Sequence[float]) -> tuple[float, ...]:
            given = getattr(noise, name)
            if isinstance(given, tuple) and len(given) != len(own):
                raise ValueError(f"noise.{name} must be {len(own)} numbers, got {len(given)}")
            if isinstance(given, tuple):
                return given
            return tuple(own) if given is None else (given,) * len(own)

        full = Variances(
            each("measurement", [r.sensor.noise_variance for r in readings]),
            each("control", [b.amplifier.noise_variance for b in axes]),
            each("disturbance", [(2 * b.rotor.mass * GRAVITY) ** 2 for b in axes]),
        )
        check_variances(full)
        return full

    def growth(self, variances: Variances, noises: Sequence[Descriptor]) -> list[float]:
        """Return the variances of a model's noises, the loads' in a sample [N^2]."""
        T, p = self.machine.sampling_time, len(self.alone)
        return [
            *(T * each for each in variances.disturbance),
            *(noise.size**2 for noise in noises[p:]),
        ]

    def settings(
        self, variances: Variances, states: Sequence[Descriptor], noises: Sequence[Descriptor]
    ) -> dict[str, Any]:
        """Return what the core is told but for known forces and limits of judgement."""
        machine, axes = self.machine, self.alone
        return {
            "T": machine.sampling_time,
            "K_sen": self.gains.tolist(),
            "lag": [machine.lag_of(r.sensor) for r in machine.readings],
            "travel": self.travel_seen.tolist(),
            "k_ui": [b.amplifier.gain for b in axes],
            "iu_min": [b.current_min for b in axes],
            "iu_max": [b.current_max for b in axes],
            "x_max": [b.rotor.travel_limit for b in axes],
            "cap": self.caps(states),
            "var_u": list(variances.control),
            "var_d": self.growth(variances, noises),
            "var_y": list(variances.measurement),
            "rise": [each.sensor.noise_rise for each in self.machine.readings],
            "step": self.steps.tolist(),
            "dwell": dwell(self.alone),
        }

    def caps(self, states: Sequence[Descriptor]) -> list[float]:
        """Return the most that each state can be (``ambkit/envelope.h``)."""
        T = self.machine.sampling_time
        fast = 0.1 * (self.travel / T)
        by_role = {
            "position": self.travel,
            "velocity": fast,
            "disturbance force": np.array(
                [b.rotor.mass * (0.1 * (b.rotor.travel_limit / T) / T) for b in self.alone]
            ),
            "sensor": 3 * np.abs(self.gains) * self.travel_seen,
        }
        return self._each(states, by_role, 10.0, [30 * state.size for state in states])

    def start_std(self, variances: Variances, states: Sequence[Descriptor]) -> tuple[float, ...]:
        """Return the standard deviations with which a filter starts; see `Estimator.reset`."""
        sigma = 3 * np.sqrt(np.array(variances.measurement) + self.steps**2 / 12)
        quickest = min(own_time(b) for b in self.alone)
        seen = self.seen[: self.rigid]
        bent = np.array([state.size for state in states if state.role == "bending"])
        unseen = (seen @ self.C[:, self.rigid :]) ** 2 @ bent**2
        spread = np.sqrt(sigma**2 + self._run_out(states)) / np.abs(self.gains)
        by_role = {
            "position": np.sqrt(((seen * spread) ** 2).sum(axis=1) + unseen),
            "velocity": 0.1 * self.travel / quickest,
            "disturbance force": np.array([b.rotor.mass * GRAVITY for b in self.alone]),
            "sensor": sigma,
        }
        others = [(VAGUE if s.role in ("unbalance", "runout") else 1.0) * s.size for s in states]
        return tuple(self._each(states, by_role, 1.0, others))

    def _run_out(self, states: Sequence[Descriptor]) -> Array:
        """Return what runout adds to the readings' variance, where it is among the states [m^2]."""
        # A start from the first readings is no surer than that of where the rotor is; else it would
        # tell unbalance from runout at a constant speed, where nothing does.
        found = np.zeros(len(self.gains))
        for state in states:
            if state.role == "runout" and state.name.endswith("_c"):
                sensor = state.name.split("_", 1)[1].removesuffix("_c")
                seen = [r.sensor.name == sensor for r in self.machine.readings]
                found[seen] += (VAGUE * self.gains[seen] * state.size) ** 2
        return found

    def _each(
        self, states: Sequence[Descriptor], by_role: dict[str, Array], currents: float,
        others: Sequence[float],
    ) -> list[float]:  # fmt: skip
        """Return a number for each state, the k-th of a role its k-th; currents by their limits."""
        seen: dict[str, int] = {}
        found = []
        for state, other in zip(states, others, strict=True):
            k = seen.get(state.role, 0)
            seen[state.role] = k + 1
            if state.role in by_role:
                found.append(float(by_role[state.role][k]))
            elif state.role in ("current", "past control"):
                found.append(currents * self.alone[self.axis_of(state)].amplifier.current_limit)
            else:
                found.append(other)
        return found

    def axis_of(self, state: Descriptor) -> int:
        """Return which axis a current or a past control is of."""
        names = [axis.name for axis in self.machine.axes]
        return 0 if len(names) == 1 else names.index(state.name.split("_")[1])

    def known_forces(self, magnet: Any, *, weight: bool) -> list[float]:
        """Return the forces along the axes that a filter knows [N]."""
        weights = weights_of(self.machine) if weight else [0.0] * len(self.alone)
        bias = bias_forces_of(magnet, self.machine)
        return [w + b for w, b in zip(weights, bias, strict=True)]

    def hover(self, magnet: Bank, states: Sequence[Descriptor]) -> list[tuple[float, float]]:
        """Return for each axis what `hovering` does."""
        known = self.known_forces(magnet, weight=True)
        return [
            hovering(b, model, states, balance)
            for b, model, balance in zip(self.alone, magnet.models, known, strict=True)
        ]

    def at_rest(
        self, states: Sequence[Descriptor], hover: list[tuple[float, float]], q: Any,
        shown: Any = None, currents: Array | None = None, precision: str = "float64",
    ) -> Array:  # fmt: skip
        """Return the states (n,) of a rotor at rest at q (q,); see `Estimator.at_rest`."""
        q = np.broadcast_to(np.asarray(q, float), self.H.shape[1])
        along = self.H @ q
        if currents is None:
            currents = np.array([i + slope * s for (i, slope), s in zip(hover, along, strict=True)])
        sensors = iter(self.gains * (self.C @ q) if shown is None else shown)
        places = iter(q)
        mean = np.zeros(len(states))
        for k, state in enumerate(states):
            if state.role in ("position", "bending"):
                mean[k] = next(places)
            elif state.role == "sensor":
                mean[k] = next(sensors)
            elif state.role in ("current", "past control"):
                mean[k] = currents[self.axis_of(state)]
        return mean

    def at_first(
        self, states: Sequence[Descriptor], hover: list[tuple[float, float]], y: Array,
        precision: str,
    ) -> Array:  # fmt: skip
        """Return the states (n,) at rest at the first readings (N, m) within the travel."""
        # In the precision and the order of an exported filter.
        number = np.dtype(precision)
        y = self.first(y)
        if len(self.machine.axes) > 1:  # until the exported C starts by the three stages below
            constant, by_reading = self.start_form(states, hover)
            start: NDArray[Any] = constant.astype(precision)
            for column, seen in zip(by_reading.T, y, strict=True):
                start = start + column.astype(precision) * number.type(seen)
            return start.astype(float)
        looked = y / self.gains  # where the sensors look
        q = _added_up(self.seen, looked)
        along = _added_up(self.H, q).astype(number)
        currents = [
            np.array(i, number) + np.array(slope, number) * s
            for (i, slope), s in zip(hover, along, strict=True)
        ]
        return self.at_rest(states, hover, q, y, np.array(currents, float))

    def latest(self, of_readings: Any) -> Any:
        """Return what the core says of the last readings (m,)."""
        return of_readings

    def forecast(self, of_readings: Array) -> Array:
        """Return what it says of readings to come (N, m) [m]."""
        return of_readings

    def start_form(
        self, states: Sequence[Descriptor], hover: list[tuple[float, float]]
    ) -> tuple[Array, Array]:
        """Return what starts the states at rest where readings y show the rotor."""
        # returns (n,), (n, m)
        zero, one = np.zeros(self.H.shape[1]), np.eye(len(self.gains))
        constant = self.at_rest(states, hover, zero)
        columns = [self.at_rest(states, hover, self.shown @ y, y) - constant for y in one]
        return constant, np.column_stack(columns)

    def first(self, y: Array) -> Array:
        """Return the first readings (m,) of a record (N, m) that are all within the travel."""
        limit = self.limits
        if len(y) and bool((np.abs(y[0]) <= limit).all()):
            return np.asarray(y[0])
        good = np.flatnonzero((np.abs(y) <= limit).all(axis=1))
        return np.asarray(y[good[0]]) if good.size else np.zeros(len(limit))

    @cached_property
    def limits(self) -> Array:
        """Readings (m,) at the ends of the travel [m]."""
        return np.asarray(np.abs(self.gains) * self.travel_seen)

    def signals(self, record: Record) -> tuple[Array, Array]:
        """Return readings (N, m) [m] and control signals (N, p) [V] of a record."""
        y = [record[signal("y", r.name)] for r in self.machine.readings]
        u = [record[signal("u", axis.name)] for axis in self.machine.axes]
        return _columns(y), _columns(u)


def _columns(signals: list[Array]) -> Array:
    """Return signals side by side; a single one is not copied."""
    return signals[0][:, None] if len(signals) == 1 else np.column_stack(signals)


def _added_up(A: Array, x: Array) -> Array:
    """Return A x, added up from the first column on, as the exported C does."""
    total = np.zeros(len(A))
    for column, value in zip(A.T, x, strict=True):
        total = total + column * value
    return total
