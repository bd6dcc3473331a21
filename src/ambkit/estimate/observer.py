"""Observers with a constant gain: from observer poles, or from the Riccati equation."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.estimate.core_model import Engine
from ambkit.estimate.estimator import Arguments, Estimator
from ambkit.estimate.noise_model import VERY_COARSE, LinearModel, held_rounding
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, MagnetModel
from ambkit.models import compose
from ambkit.models.machine_parts import machine_parts
from ambkit.models.model import Descriptor, Model
from ambkit.models.parts.line_noise import Hum

WANDER = 0.01  #: Relative bandwidth of a line without one, which a constant gain cannot track.

LEAST_BANDWIDTH = 2.4
"""Of very coarse steps, over the unstable pole: loops with slower estimates oscillate."""

DOUBLINGS = 40  #: Doublings of the steps after which a constant gain has settled.

START = 4.0, 0.5  #: Bandwidth over the unstable pole and damping at which their search begins.

PLACED = ("position", "velocity", "disturbance force", "sensor")
"""Roles of the states with placed poles; currents follow from the controls."""


class _Observer(Estimator):
    """Constant gain; the kinds differ in its design.

    Its covariance and innovation variance are those for the machine, with sensor noise that is not
    among the observer's states.
    """

    gain: Array  # (n,), for the measurement update
    binding = "Observer"
    several_axes = False
    steady = "constant"

    def _gain(self, model: LinearModel, states: Sequence[Descriptor]) -> Array:
        """Return the gain (n,) of all states of a model."""
        raise NotImplementedError

    def _arguments(self, engine: Engine, settings: dict[str, Any]) -> Arguments:
        k = ConstantStiffness.of(self.machine)
        # States are scaled, because the equations lose their digits between newtons and
        # micrometres.
        full_model = _full_model(engine)
        units = np.array(self.view.start_std(self.variances, full_model.states))
        variance, step, dwell = settings["var_y"][0], settings["step"][0], settings["dwell"]
        intensity = self.view.growth(self.variances, full_model.noises)
        coarse = step**2 > VERY_COARSE * variance
        if coarse:
            # Within its step the force on the rotor is as unknown as its position, for about its
            # time constant.
            intensity[0] += (float(k.k_s) * step / settings["K_sen"][0]) ** 2 / 12 / (2 * dwell)
        small = LinearModel.of(full_model, k.k_i, k.k_s, settings | {"var_d": intensity}).scaled(
            units
        )
        R = held_rounding(variance, step, dwell / 4)
        L = self._gain(small._replace(R=R), full_model.states)
        slow = math.exp(-LEAST_BANDWIDTH * unstable_pole(self.machine) * settings["T"])
        errors = small.A - np.outer(L, small.H @ small.A)
        if coarse and np.abs(np.linalg.eigvals(errors)).max() > slow:
            # The estimate is limited to its step, so its rounding counts as white.
            R = held_rounding(variance, step, 1.0)
            L = self._gain(small._replace(R=R), full_model.states)
        P, S = _steady(small._replace(R=max(R, small.R)), L)
        most = np.array(self.view.caps(full_model.states)) / units
        error = _largest_error(small, L, most) * units
        state_limits = np.minimum(2 * error, np.finfo(np.float32).max)
        own = [full_model.index(state.name) for state in engine.states]
        self.gain, far = (L * units)[own], state_limits[own]
        upper = (P * np.outer(units, units))[np.ix_(own, own)][np.triu_indices(len(own))]
        numbers = (self.gain[np.newaxis], upper, np.array([S]), far)
        return [of.astype(self.precision) for of in numbers], {}


class ExtendedStateObserver(_Observer):
    """Luenberger observer with the disturbance among its states: an extended state observer.

    Poles of the estimation error are ``exp(s T)``, ``s`` from ``(s + bandwidth) (s^2 + 2 damping
    bandwidth s + bandwidth^2) = 0``. The fourth is at ``-bandwidth`` as well, or the sensor's own
    where that is faster. Currents that lag the controls follow the model. Coloured and line noise
    are not among the states, and only included in the covariance.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Magnet model; by default the constant stiffnesses at the origin, for which the gain is
        always computed.
    bandwidth : float or str, optional
        Bandwidth of the estimation error [rad/s]. Default: that of the least stated position error
        for the variances of measurement, control and disturbance.
    damping : float, optional
        Damping ratio of a pair of poles. Default: 1 with a `bandwidth`, which puts all poles in one
        place (Gao); otherwise that of the least stated position error, near the 0.5 of a
        Butterworth polynomial.
    **options
        As for :class:`KalmanFilter`.

    Raises
    ------
    ValueError
        Bandwidth or damping is not positive and finite.

    References
    ----------
    Luenberger, Observing the state of a linear system, 1964; Gao, Scaling and
    bandwidth-parameterization based controller tuning, 2003.
    """

    name = "extended state observer"
    has_noise_estimate = False

    def __init__(
        self,
        machine: Machine,
        magnet: MagnetModel | None = None,
        *,
        bandwidth: QuantityLike | None = None,
        damping: float | None = None,
        **options: Any,
    ) -> None:
        bandwidth = in_si("bandwidth", bandwidth, "rad/s")
        for name, value, unit in (("bandwidth", bandwidth, " rad/s"), ("damping", damping, "")):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be greater than 0{unit}, got {value!r}")
        damping = damping if bandwidth is None else damping or 1.0
        self._placement: tuple[Any, Any] = bandwidth, damping
        super().__init__(machine, magnet, **options)

    def _gain(self, model: LinearModel, states: Sequence[Descriptor]) -> Array:
        placed_states = [i for i, state in enumerate(states) if state.role in PLACED]
        A, H = _placed_subsystem(model.A, placed_states), model.H[:, placed_states]

        def gain(bandwidth: float, damping: float) -> Array:
            root = cmath.sqrt(damping**2 - 1)
            s = bandwidth * np.array([root - damping, -root - damping, -1.0, -1.0])
            poles = np.exp(s * self.machine.sampling_time)
            result = np.zeros(len(states))
            result[placed_states] = placed(model._replace(A=A, H=H), poles)
            return result

        bandwidth, damping = self._placement
        if bandwidth is None:
            k = [state.role for state in states].index("position")
            start = START[0] * unstable_pole(self.machine), damping or START[1]
            free = 1 if damping else 2
            bandwidth, damping = _least(lambda *of: _steady(model, gain(*of))[0][k, k], start, free)
        self.bandwidth, self.damping = bandwidth, damping
        return gain(bandwidth, damping)


class SteadyStateKalmanFilter(_Observer):
    """Kalman filter with its steady-state gain, from the algebraic Riccati equation.

    The stationary solution of Kalman (1960), in the form of Simon (2006, section 7.3) for sampled
    models.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Magnet model; by default the constant stiffnesses at the origin, for which the gain is
        always computed.
    **options
        As for :class:`KalmanFilter`.
    """

    name = "steady-state Kalman filter"

    def _gain(self, model: LinearModel, states: Sequence[Descriptor]) -> Array:
        from scipy.linalg import solve_discrete_are

        predicted = solve_discrete_are(model.A.T, model.H.T, model.Q, np.array([[model.R]]))
        PH = predicted @ model.H.T
        return np.asarray((PH / (model.H @ PH + model.R)).ravel())


def _full_model(engine: Engine) -> Model:
    """Return the model of the machine with all sensor noise."""
    sensor = engine.machine.sensors[0]
    if not sensor.hum and (engine.noise or not sensor.coloured_noise):
        return engine.model
    parts = [
        replace(part, bandwidth=part.bandwidth or WANDER * part.frequency)
        if isinstance(part, Hum)
        else part
        for part in machine_parts(engine.machine)
    ]
    return compose(parts, engine.machine.sampling_time, name="axial")


def _placed_subsystem(A: Array, kept: list[int]) -> Array:
    """Return the transition of some states, with others that depend on them."""
    others = [k for k in range(len(A)) if k not in kept]
    fast = np.eye(len(others)) - A[np.ix_(others, others)]
    if not A[np.ix_(others, kept)].any():  # they follow from the controls only
        return A[np.ix_(kept, kept)]
    held = np.linalg.lstsq(fast, A[np.ix_(others, kept)])[0]
    return np.asarray(A[np.ix_(kept, kept)] + A[np.ix_(kept, others)] @ held)


def unstable_pole(machine: Machine) -> float:
    """Return the unstable pole of the rotor at the centre, sqrt(k_s / m) [rad/s]."""
    # With several axes that of the fastest isolated one.
    return max(
        math.sqrt(ConstantStiffness.of(isolated_axis).k_s / isolated_axis.rotor.mass)
        for isolated_axis in isolated_axes(machine)
    )


def placed(model: LinearModel, poles: Array) -> Array:
    """Return the update gain (4,) that places the poles (4,) of ``(I - L H) A``."""
    # For the states x, v, f_d, x_m, by Ackermann's formula (Ackermann 1972) for the pair A, H A. A
    # sensor faster than its pole here keeps its own, and is corrected as the others move it: gains
    # that slow it down would let an initial error grow by three thousand before it decays.
    A, H, n, follows = model.A, model.H, 4, np.eye(4)
    if A[3, 3] < poles[3].real:
        n, lag = 3, A[3, 3] * np.eye(3)
        follows = np.vstack([np.eye(3), np.linalg.solve((A[:3, :3] - lag).T, A[3, :3])])
        A, H = A[:3, :3], H @ follows
    observability = np.vstack([H @ np.linalg.matrix_power(A, i + 1) for i in range(n)])
    error = reduce(np.matmul, [A - pole * np.eye(n) for pole in poles[:n]]).real
    return np.asarray(follows @ error @ np.linalg.solve(observability, np.eye(n)[:, -1]))


def _least(cost: Callable[..., float], start: Sequence[float], free: int) -> list[float]:
    """Return positive parameters, the first of them such that the cost is least."""
    from scipy.optimize import minimize

    def scaled(logs: Array) -> Array:
        return start * np.exp(np.pad(logs, (0, len(start) - free)))

    def log_cost(logs: Array) -> float:
        result = cost(*scaled(logs))
        return math.log(result) if 0 < result < math.inf else math.inf

    simplex = 0.5 * np.eye(free + 1, free, -1)
    best = minimize(
        log_cost, np.zeros(free), method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.01, "fatol": 1e-4},
    )  # fmt: skip
    return [float(value) for value in scaled(best.x)]


def _largest_error(model: LinearModel, L: Array, start: Array) -> Array:
    """Return the maximum (n,) of an error that starts within plus or minus ``2 start`` (n,)."""
    # That is the error of a start between the caps, and of a mean limited to them.
    n = len(L)
    step = (np.eye(n) - np.outer(L, model.H)) @ model.A
    now, most = np.eye(n), 2 * start
    for _ in range(10_000):
        now = step @ now
        error = np.abs(now) @ (2 * start)
        most = np.maximum(most, error)
        if (error < 1e-3 * most).all():
            break
    return most


def _steady(model: LinearModel, L: Array) -> tuple[Array, float]:
    """Return the steady-state covariance (n, n) of a constant gain, and the innovation's."""
    left = np.eye(len(L)) - np.outer(L, model.H)
    noise = left @ model.Q @ left.T + model.R * np.outer(L, L)
    P, step = noise, left @ model.A
    # Smith 1968: sum of step^k noise step'^k, doubling the number of terms
    for _ in range(DOUBLINGS):
        P, step = P + step @ P @ step.T, step @ step
    predicted = model.A @ P @ model.A.T + model.Q
    return np.asarray((P + P.T) / 2), (model.H @ predicted @ model.H.T).item() + model.R
