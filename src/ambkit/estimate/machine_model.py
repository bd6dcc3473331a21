"""A machine for its estimators: settings of the core, and initial states."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.config.quantities import InOther
from ambkit.base.errors import AmbkitError
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.noise_model import FilterNoise, Variances, check_variances
from ambkit.machine import geometry
from ambkit.machine.axes import bias_forces, isolated_axes, models_of, weights_of
from ambkit.machine.loading import levitation_current
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, MagnetModel, core_module, typical_stiffness
from ambkit.models.model import ENUMERATORS, ROLES, Descriptor
from ambkit.models.parts.synchronous import VAGUE


class View:
    """A machine for its estimators: scalars for a single axis, arrays for several."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.single = machine.single
        self.isolated = isolated_axes(machine)
        positions = machine.positions
        self.H = geometry.matrix([axis.line for axis in machine.axes], positions)
        self.C = geometry.matrix([r.line for r in machine.readings], positions)
        self.gains = np.array([r.sensor.gain for r in machine.readings])
        self.rigid = len(machine.rigid_coordinates)

    @property
    def speed(self) -> float | None:
        """Speed of rotation [rad/s]; None if the model does not depend on it."""
        return None if self.machine.rotor.type == "mass" else self.machine.speed

    @property
    def columns(self) -> dict[str, Any]:
        """Names of axes and readings for an estimate."""
        return {
            "axes": tuple(axis.name for axis in self.machine.axes if axis.name),
            "readings": tuple(r.name for r in self.machine.readings if r.name),
        }

    @cached_property
    def placed(self) -> Array:
        """Coordinates (q, p) of a rigid rotor by displacements along the axes."""
        return geometry.rigid_motion(self.H, self.rigid)

    @cached_property
    def travel(self) -> Array:
        """Clearance of each rigid-body coordinate [m] or [rad]."""
        clearances = np.array([item.clearance for item in self.isolated])
        return np.asarray(np.abs(self.placed[: self.rigid]) @ clearances)

    @cached_property
    def travel_seen(self) -> Array:
        """Clearance at each reading, without its gain (m,) [m]."""
        clearances = np.array([item.clearance for item in self.isolated])
        moved = self.C[:, : self.rigid] @ self.placed[: self.rigid]
        return np.asarray(np.abs(moved) @ clearances)

    @cached_property
    def seen(self) -> Array:
        """Coordinates (q, m) of a rigid rotor that fit the sensors' directions best."""
        return geometry.rigid_motion(self.C, self.rigid)

    @cached_property
    def steps(self) -> Array:
        """Quantisation of each reading (m,) [m]; 0 if unknown."""
        return np.array([r.sensor.quantisation or 0.0 for r in self.machine.readings])

    @cached_property
    def displayed(self) -> Array:
        """Coordinates (q, m) of a rigid rotor that fit the readings best."""
        return geometry.rigid_motion(self.gains[:, None] * self.C, self.rigid)

    @property
    def measured(self) -> Array:
        """Displacements along the axes (p, m) of that rigid rotor, by the readings."""
        return np.asarray(self.H[:, : self.rigid] @ self.displayed[: self.rigid])

    def along_axes(self, states: Sequence[Descriptor]) -> tuple[Array, Array]:
        """Return displacements and velocities along the axes, by the states (p, n)."""
        return self.along(self.H, states)

    def along(self, lines: Array, states: Sequence[Descriptor]) -> tuple[Array, Array]:
        """Return displacements and velocities along rows of coordinates, by the states."""
        # lines (rows, q)
        results = []
        for roles in (("position", "bending"), ("velocity", "bending velocity")):
            rows = np.zeros((len(lines), len(states)))
            rows[:, [k for k, state in enumerate(states) if state.role in roles]] = lines
            results.append(rows)
        return results[0], results[1]

    def rows_along(self, states: Sequence[Descriptor]) -> tuple[Array, Array, Array]:
        """Return displacements, velocities and disturbances along the axes, by the states."""
        names = [state.name for state in states]
        loads = np.zeros((len(self.isolated), len(names)))
        for k, axis in enumerate(self.machine.axes):
            if signal("f_d", axis.name) in names:
                loads[k, names.index(signal("f_d", axis.name))] = 1.0
        return (*self.along_axes(states), loads)

    def variances(self, noise: FilterNoise) -> Variances:
        """Return the variances assumed by a filter, one for each reading and axis."""
        for name, text in self.count_of(noise):
            raise ValueError(f"{name} {text}")
        readings, axes = self.machine.readings, self.isolated
        full = Variances(
            self._variances(noise.measurement, readings, lambda item: item.sensor.noise_variance),
            self._variances(noise.control, axes, lambda axis: axis.amplifier.noise_variance),
            self._variances(noise.disturbance, axes, None),
        )
        check_variances(full)
        return full

    def count_of(self, noise: FilterNoise) -> Iterator[tuple[str, str]]:
        """Yield variances of a noise in a wrong number, by key."""
        axes = len(self.isolated)
        for name, count in zip(Variances._fields, (len(self.gains), axes, axes), strict=True):
            variances = getattr(noise, name)
            if isinstance(variances, tuple) and len(variances) != count:
                numbers = "one number" if count == 1 else f"one number or {count}"
                yield f"noise.{name}", f"must be {numbers}, is {len(variances)}"
        control = noise.control if isinstance(noise.control, tuple) else (noise.control,)
        if self.machine.control_unit == "V" and any(isinstance(v, InOther) for v in control):
            yield "noise.control", "is in A^2; the control signal is in V"

    def _variances(
        self, variances: Any, items: Sequence[Any], usual: Callable[[Any], float] | None
    ) -> Any:
        """Return the variances of a noise for readings or axes, or the defaults."""
        if variances is None:
            variances = tuple(map(usual, items) if usual else core_module().intensity(self.seen_by))
        return self.plain(variances if isinstance(variances, tuple) else (variances,) * len(items))

    def plain(self, values: Sequence[Any]) -> Any:
        """Return a tuple, or for a single axis its number."""
        return values[0] if self.single else tuple(values)

    def growth(self, variances: Variances, noises: Sequence[Descriptor]) -> list[float]:
        """Return the variances of a model's noises, of disturbances per sample [N^2]."""
        T, p = self.machine.sampling_time, len(self.isolated)
        return [
            *(T * item for item in several(variances.disturbance)),
            *(noise.size**2 for noise in noises[p:]),
        ]

    def settings(
        self, variances: Variances, states: Sequence[Descriptor], noises: Sequence[Descriptor]
    ) -> dict[str, Any]:
        """Return the settings of the core except for known forces and limits."""
        machine, axes = self.machine, self.isolated
        return {
            "T": machine.sampling_time,
            "K_sen": self.gains.tolist(),
            "lag": [machine.lag_of(r.sensor) for r in machine.readings],
            "travel": self.travel_seen.tolist(),
            "k_ui": [b.amplifier.gain for b in axes],
            "iu_min": [b.current_min for b in axes],
            "iu_max": [b.current_max for b in axes],
            "x_max": [b.clearance for b in axes],
            "cap": self.caps(states),
            "var_u": several(variances.control),
            "var_d": self.growth(variances, noises),
            "var_y": several(variances.measurement),
            "rise": [reading.sensor.position_noise for reading in self.machine.readings],
            "step": self.steps.tolist(),
            "dwell": core_module().dwell(self.seen_by),
        }

    @cached_property
    def seen_by(self) -> dict[str, Any]:
        """Basis of the default settings: ``amb_view`` (``sim/settings.h``)."""
        machine, axes, sensors = self.machine, self.isolated, self.machine.readings
        return {
            "T": machine.sampling_time,
            "mass": [axis.rotor.mass for axis in axes],
            "clearance": [axis.clearance for axis in axes],
            "stiffness": list(map(typical_stiffness, axes)),
            "k_i": [ConstantStiffness.of(axis).k_i for axis in axes],
            "k_ui": [axis.amplifier.gain for axis in axes],
            "current_limit": [axis.amplifier.current_limit for axis in axes],
            "var_u": [axis.amplifier.noise_variance for axis in axes],
            "K_sen": self.gains.tolist(),
            "lag": [r.sensor.lag for r in sensors],
            "step": self.steps.tolist(),
            "var_y": [r.sensor.noise_variance for r in sensors],
            "range": self.travel_seen.tolist(),
            "run_out": [0.0] * len(sensors),
            "travel": self.travel.tolist(),
            "seen": self.seen[: self.rigid].ravel().tolist(),
            "bent": [0.0] * self.rigid,
        }

    def caps(self, states: Sequence[Descriptor]) -> list[float]:
        """Return the maximum of each state (``ambkit/envelope.h``)."""
        none = [0.0] * len(self.gains)
        return list(core_module().caps_and_start(self.seen_by, *self.sized(states), none)[0])

    def start_std(self, variances: Variances, states: Sequence[Descriptor]) -> tuple[float, ...]:
        """Return the initial standard deviations of a filter; see `Estimator.reset`."""
        by_states = {"run_out": self._run_out(states), "bent": self.bent(states)}
        seen_by = self.seen_by | {name: item.tolist() for name, item in by_states.items()}
        var_y = several(variances.measurement)
        return tuple(core_module().caps_and_start(seen_by, *self.sized(states), var_y)[1])

    def bent(self, states: Sequence[Descriptor]) -> Array:
        """Return the variances of the rigid coordinates due to bending, by the readings (q,)."""
        sizes = np.array([state.size for state in states if state.role == "bending"])
        return np.asarray((self.seen[: self.rigid] @ self.C[:, self.rigid :]) ** 2 @ sizes**2)

    def sized(self, states: Sequence[Descriptor]) -> tuple[list[Any], ...]:
        """Return states for ``amb_view_states``: roles, indices, sizes."""
        seen: dict[str, int] = {}
        indices = []
        for state in states:
            k = seen[state.role] = seen.get(state.role, -1) + 1
            own = state.role in ("position", "velocity", "disturbance force", "sensor")
            known = state.role in ("current", "past control")
            indices.append(k if own else self.axis_of(state) if known else -1)
        return (
            [ENUMERATORS.index(ROLES[state.role]) for state in states],
            indices,
            [state.size for state in states],
            [state.start for state in states],
        )

    def _run_out(self, states: Sequence[Descriptor]) -> Array:
        """Return the variance of a start from readings with runout, if that is a state [m^2]."""
        # Vague: the start covariance is diagonal, and the first reading, which is the start, would
        # halve that of the runout, which nothing corrects at a constant speed.
        result = np.zeros(len(self.gains))
        for state in states:
            if state.role == "runout" and state.name.endswith("_c"):
                of = state.name.removesuffix("_c")
                seen = [signal(of[:2], r.sensor.name) == of for r in self.machine.readings]
                result[seen] += (VAGUE * self.gains[seen] * state.size) ** 2
        return result

    def axis_of(self, state: Descriptor) -> int:
        """Return the axis of a current or a past control."""
        names = self.machine.axis_names
        return 0 if len(names) == 1 else names.index(state.name.split("_")[1])

    def known_forces(self, magnet: Any, *, weight: bool) -> list[float]:
        """Return the known forces along the axes [N]."""
        weights = weights_of(self.machine) if weight else [0.0] * len(self.isolated)
        bias = bias_forces(magnet, self.machine)
        return [w + b for w, b in zip(weights, bias, strict=True)]

    def levitation_current(self, magnet: Any, states: Sequence[Descriptor]) -> Any:
        """Return the levitation current of each axis at the centre, and its slope."""
        if not {"current", "past control"} & {state.role for state in states}:  # not needed
            return self.plain([(0.0, 0.0)] * len(self.isolated))
        # The weight acts, whether it is known or part of the disturbance.
        known = self.known_forces(magnet, weight=True)
        axes = zip(self.isolated, models_of(magnet), known, strict=True)
        return self.plain([_levitation_current(*axis) for axis in axes])

    def equilibrium_state(
        self, states: Sequence[Descriptor], levitation_current: Any, x: Any, readings: Any = None,
        currents: Any = None, precision: str = "float64",
    ) -> Array:  # fmt: skip
        """Return the states (n,) or (runs, n) in equilibrium: `Estimator.equilibrium_state`."""
        q, y, i = (self._last(item) for item in (x, readings, currents))
        q = np.broadcast_to(q, (*q.shape[:-1], self.H.shape[1]))
        if y is None:
            y = self.gains * _times(self.C, q)
        if i is None:  # levitation current in the precision of an exported filter
            i0, slope = np.atleast_2d(levitation_current).astype(precision).T
            i = i0 + slope * _times(self.H, q).astype(precision)
        columns = {"position": q.T, "sensor": y.T}
        column_index = dict.fromkeys(columns, 0)
        mean = np.zeros((*q.shape[:-1], len(states)))
        for k, state in enumerate(states):
            role = "position" if state.role == "bending" else state.role
            if role in columns:
                mean[..., k] = columns[role][column_index[role]].T
                column_index[role] += 1
            elif role in ("current", "past control"):
                mean[..., k] = i[..., self.axis_of(state)]
        return mean

    def initial_state(
        self, states: Sequence[Descriptor], levitation_current: Any, y: Array, precision: str
    ) -> Array:
        """Return the equilibrium states (n,) or (runs, n) at the first valid readings."""
        # y (N, m), for a single axis (N,) or (runs, N). In the precision and order of an exported
        # filter.
        if self.single:
            rows = y.reshape(-1, y.shape[-1], 1)
            first = np.array([self.first(row) for row in rows], precision).reshape(y.shape[:-1])
            x = first / self.gains.astype(precision)[0]
            return self.equilibrium_state(states, levitation_current, x, first, precision=precision)
        first = self.first(y)
        constant, by_reading = self.start_form(states, levitation_current)
        start: NDArray[Any] = constant.astype(precision)
        for column, seen in zip(by_reading.T, first, strict=True):
            start = start + column.astype(precision) * np.dtype(precision).type(seen)
        return start.astype(float)

    def _last(self, values: Any) -> Any:
        """Return an array with the coordinates, readings or axes last."""
        if values is None:
            return None
        a = np.asarray(values, float)
        return a[..., None] if self.single or a.ndim == 0 else a

    def column(self, signals: NDArray[Any]) -> NDArray[Any]:
        """Return signals (N, k), for a single axis its one (N,)."""
        return np.ascontiguousarray(signals[:, 0]) if self.single else signals

    def start_form(
        self, states: Sequence[Descriptor], levitation_current: list[tuple[float, float]]
    ) -> tuple[Array, Array]:
        """Return the equilibrium states as an affine function of the readings y."""
        # returns (n,), (n, m)
        zero, one = np.zeros(self.H.shape[1]), np.eye(len(self.gains))
        constant = self.equilibrium_state(states, levitation_current, zero).ravel()
        columns = [
            self.equilibrium_state(states, levitation_current, q, y).ravel() - constant
            for y, q in zip(one, self.displayed.T, strict=True)
        ]
        return constant, np.column_stack(columns)

    def first(self, y: Array) -> Array:
        """Return the first readings (m,) of a record (N, m) that are all within the clearance."""
        limit = self.limits.astype(y.dtype)  # as compared by an exported filter
        if len(y) and bool((np.abs(y[0]) <= limit).all()):
            return np.asarray(y[0])
        good = np.flatnonzero((np.abs(y) <= limit).all(axis=1))
        return np.asarray(y[good[0]]) if good.size else np.zeros(len(limit))

    @cached_property
    def limits(self) -> Array:
        """Readings (m,) at the ends of the clearance [m]."""
        return np.asarray(np.abs(self.gains) * self.travel_seen)

    def signals(self, record: Record) -> tuple[Array, Array]:
        """Return readings (N, m) [m] and control signals (N, p) [V] of a record."""
        y = [record[signal("y", r.name)] for r in self.machine.readings]
        u = [record[signal("u", axis.name)] for axis in self.machine.axes]
        for axis in self.machine.axes:
            name, takes = signal("u", axis.name), axis.bearing.amplifier.control_unit
            if record.units[name] == "A" and takes == "V":
                raise AmbkitError(
                    f"{name} of the record is in A, and the amplifier of {self.machine.name} takes "
                    "V: give its gain in A/A"
                )
        return (y[0], u[0]) if self.single else (np.column_stack(y), np.column_stack(u))


def several(values: Any) -> list[Any]:
    """Return numbers as a list, for a single axis too."""
    return list(values) if isinstance(values, tuple | list) else [values]


def _times(A: Array, x: Array) -> Array:
    """Return A x of vectors x (..., n)."""
    return np.asarray((A @ x[..., None])[..., 0])


def _levitation_current(axis: Machine, magnet: MagnetModel, known: float) -> tuple[float, float]:
    """Return the levitation current at the centre [A], and its slope there [A/m]."""
    step = 0.1 * axis.clearance
    less, middle, more = (levitation_current(axis, magnet, x, known) for x in (-step, 0.0, step))
    return middle, (more - less) / (2 * step)
