"""Observers with a constant gain: from observer poles, or from the Riccati equation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
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

FAST_SENSOR = 0.05
"""Transition of a sensor over a sample below which it counts as one without lag."""

QUICK_SENSOR = 0.5  #: Transition below which its pole is not slowed down for very coarse steps.

WANDER = 0.01
"""Assumed relative bandwidth of a line with zero width: a constant gain could not track it
otherwise.
"""

LEAST_BANDWIDTH = 2.4
"""Poles with very coarse steps, over the unstable pole: a loop with a slower estimate oscillates
over tens of steps.
"""

DOUBLINGS = 40  #: Doublings of the steps after which a constant gain has settled.

BANDWIDTHS = tuple(2 ** (n / 4) for n in range(-4, 41))
"""Candidate observer poles, over the unstable pole: selected is the least stated position error."""

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

    def _gain(self, model: LinearModel, states: Sequence[Descriptor], *, coarse: bool) -> Array:
        """Return the gain (n,) of all states of a model."""
        # coarse: the estimate is limited to very coarse steps.
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
        L = self._gain(small._replace(R=R), full_model.states, coarse=coarse)
        slow = math.exp(-LEAST_BANDWIDTH * unstable_pole(self.machine) * settings["T"])
        errors = small.A - np.outer(L, small.H @ small.A)
        if coarse and np.abs(np.linalg.eigvals(errors)).max() > slow:
            # The estimate is limited to its step, so its rounding counts as white.
            R = held_rounding(variance, step, 1.0)
            L = self._gain(small._replace(R=R), full_model.states, coarse=coarse)
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

    All poles of the estimation error are at ``exp(-bandwidth T)``, except that of a sensor faster
    than a third of a sample. Currents that lag the controls follow the model. Coloured and line
    noise are not among the states, and only included in the covariance.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Magnet model; by default the constant stiffnesses at the origin, for which the gain is
        always computed.
    bandwidth : float or str, optional
        Bandwidth of the estimation error [rad/s]. Default: the minimum of the stated position error
        for the variances of measurement, control and disturbance; 0.5 to 1000 times the unstable
        pole.
    **options
        As for :class:`KalmanFilter`.

    Raises
    ------
    ValueError
        The bandwidth is not positive and finite.

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
        **options: Any,
    ) -> None:
        bandwidth = in_si("bandwidth", bandwidth, "rad/s")
        if bandwidth is not None and not (math.isfinite(bandwidth) and bandwidth > 0):
            raise ValueError(f"bandwidth must be greater than 0 rad/s, got {bandwidth!r}")
        self.bandwidth = bandwidth
        super().__init__(machine, magnet, **options)

    def _gain(self, model: LinearModel, states: Sequence[Descriptor], *, coarse: bool) -> Array:
        placed_states = [i for i, state in enumerate(states) if state.role in PLACED]
        A, H = _placed_subsystem(model.A, placed_states), model.H[:, placed_states]

        def gain(bandwidth: float) -> Array:
            pole = math.exp(-bandwidth * self.machine.sampling_time)
            result = np.zeros(len(states))
            result[placed_states] = placed(model._replace(A=A, H=H), pole, keep_sensor=coarse)
            return result

        if self.bandwidth is None:
            k = [state.role for state in states].index("position")
            pole = unstable_pole(self.machine)

            def error(bandwidth: float) -> float:
                return float(_steady(model, gain(bandwidth))[0][k, k])

            self.bandwidth = min((n * pole for n in BANDWIDTHS), key=error)
        return gain(self.bandwidth)


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

    def _gain(self, model: LinearModel, states: Sequence[Descriptor], *, coarse: bool) -> Array:
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


def placed(model: LinearModel, pole: float, *, keep_sensor: bool = False) -> Array:
    """Return the update gain (4,) that places all poles of ``(I - L H) A`` together."""
    # A fast sensor's own pole is kept if the estimate is limited to very coarse steps: with gains
    # that slow it down each limitation would cause a large transient. For the states x, v, f_d,
    # x_m, by Ackermann's formula (Ackermann 1972) for the pair A, H A. For a sensor lag below a
    # third of a sample the lagged position is its last measurement: its pole is zero, and the other
    # three are placed. Slowing it down as well would need gains that let an initial error grow by
    # three thousand before it decays.
    A, H = model.A, model.H @ model.A
    n = 4
    if A[3, 3] < FAST_SENSOR:
        A, H, n = A[:3, :3], model.H[:, 3:] @ model.A[3:, :3], 3
    observability = np.vstack([H @ np.linalg.matrix_power(A, i) for i in range(n)])
    last = np.eye(n)[:, -1]
    error = np.linalg.matrix_power(A - pole * np.eye(n), n)
    if keep_sensor and n == 4 and A[3, 3] < QUICK_SENSOR:
        error = np.linalg.matrix_power(A - pole * np.eye(n), 3) @ (A - A[3, 3] * np.eye(n))
    L = np.zeros(4)
    L[:n] = error @ np.linalg.solve(observability, last)
    if n == 3:
        L[3] = 1 / model.H[0, 3]
    return L


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
