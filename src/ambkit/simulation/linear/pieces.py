"""Plant, controller and estimator of one loop as linear systems, at a work point.

The control signal u [V] is what goes between them; the estimator is fed with the u that goes out.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.estimate.adaptive_noise import AdaptiveNoise
from ambkit.estimate.kalman import ExtendedKalmanFilter, KalmanFilter
from ambkit.estimate.low_pass import LowPass
from ambkit.estimate.magnet_scale import AugmentedKalmanFilter
from ambkit.estimate.observer import ExtendedStateObserver, SteadyStateKalmanFilter
from ambkit.estimate.starting import start_std
from ambkit.estimate.unscented import UnscentedKalmanFilter
from ambkit.machine.hovering import hover_current
from ambkit.machine.magnets import MagnetModel, core_module, magnet_of
from ambkit.models import axis_parts
from ambkit.models.linear import LinearSystem, Signal, linearised

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.bearing import Bearing
    from ambkit.models.model import Array

POSITION, VELOCITY = Signal("position", "m"), Signal("velocity", "m/s")


class WorkPoint(NamedTuple):
    """Where a loop is linearised: control current [A] and displacement [m]."""

    iu: float
    x: float

    @classmethod
    def hovering(cls, bearing: Bearing, x: float = 0.0, load: float = 0.0) -> WorkPoint:
        """Return the point at which the magnet carries weight and load.

        Parameters
        ----------
        bearing : Bearing
            The plant.
        x : float, optional
            Displacement [m].
        load : float, optional
            Constant disturbance force [N].

        Raises
        ------
        AmbkitError
            It is beyond the stops, or no current within the amplifier's range holds the rotor
            there.
        """
        travel = bearing.rotor.travel_limit
        if not abs(x) <= travel:
            raise AmbkitError(
                f"the rotor can be held up to its stops at {travel:g} m, not at {x:g} m"
            )
        law = magnet_of(bearing)
        held = law.bias_force + bearing.weight + load
        iu = hover_current(bearing, law, x, held)
        if not bearing.current_min < iu < bearing.current_max:
            raise AmbkitError(
                f"no control current from {bearing.current_min:g} to {bearing.current_max:g} A "
                f"holds the rotor at x = {x:g} m with a load of {load:g} N"
            )
        return cls(iu, x)


def plant(bearing: Bearing, point: WorkPoint, *, continuous: bool = False) -> LinearSystem:
    """Return amplifier, dead time, magnet, rotor and sensor, from u and load to y and x.

    Within the limits of current and voltage, without rounding and noise; of a bent sensor the slope
    at the work point.

    Parameters
    ----------
    bearing : Bearing
        What is linearised.
    point : WorkPoint
        Where.
    continuous : bool, optional
        In continuous time, which needs a bearing without delay.

    Returns
    -------
    LinearSystem
        Inputs ``u`` [V] and ``f_d`` [N], outputs ``y`` and ``x`` [m].

    Raises
    ------
    ValueError
        In continuous time, with a delay.
    """
    sensor, law = bearing.sensor, magnet_of(bearing)
    slope = 1 + (2 * sensor.quadratic + 3 * sensor.cubic * point.x) * point.x
    k_i, k_s = (float(k) for k in law.tangent(point.iu, point.x))
    seen = bearing if slope == 1 else bearing.replace(sensor__gain=sensor.gain * slope)
    parts = axis_parts(seen, noise=False)
    system = linearised(parts, bearing.sampling_time, k_i, k_s, continuous=continuous)
    B = system.B.copy()
    B[:, 0] *= bearing.amplifier.gain
    return replace(system, B=B, inputs=(Signal("u", "V"), *system.inputs[1:]))


class _Gains(Protocol):
    """What is known of a PID: `ambkit.simulation.scenario.PID`, or what is to become one."""

    @property
    def kp(self) -> float: ...
    @property
    def ki(self) -> float: ...
    @property
    def kd(self) -> float: ...
    @property
    def derivative_filter(self) -> float: ...
    @property
    def setpoint_weight(self) -> float: ...
    @property
    def feedback(self) -> str: ...


def controller(pid: _Gains, bearing: Bearing) -> LinearSystem:
    """Return the controller as ``core/src/controller.c`` computes it, within its limits.

    Parameters
    ----------
    pid : PID
        Its gains; ``feedback`` says whether it is fed by the measurement or by an estimate.
    bearing : Bearing
        Gives sampling time, sensor gain and amplifier gain.

    Returns
    -------
    LinearSystem
        Inputs ``position`` [m] and, with an estimate, ``velocity`` [m/s], then the reference ``r``
        [m]; output ``u`` [V].
    """
    T, measured = bearing.sampling_time, pid.feedback == "measurement"
    names = ["integral"] if pid.ki > 0 else []
    names += ["derivative", "last"] if measured else []
    units = {"integral": "A", "derivative": "m/s", "last": "m"}
    inputs = (POSITION, *(() if measured else (VELOCITY,)), Signal("r", "m"))
    at = {name: k for k, name in enumerate(names)}
    n, m = len(names), len(inputs)
    A, B, C, D = np.zeros((n, n)), np.zeros((n, m)), np.zeros((1, n)), np.zeros((1, m))
    D[0, 0], D[0, -1] = -pid.kp, pid.kp * pid.setpoint_weight
    if "integral" in at:
        k = at["integral"]
        A[k, k] = C[0, k] = 1.0
        B[k, 0], B[k, -1] = -T * pid.ki, T * pid.ki
    if measured:
        # velocity += ((x - last) - T velocity)/(T_f + T), and then last = x
        d, last, share = at["derivative"], at["last"], 1 / (pid.derivative_filter + T)
        A[d, d], A[d, last], B[d, 0], B[last, 0] = 1 - T * share, -share, share, 1.0
        C -= pid.kd * A[d]
        D[0, 0] -= pid.kd * share
    else:
        D[0, 1] = -pid.kd
    volts = 1 / bearing.amplifier.gain
    return LinearSystem(
        A, B, volts * C, volts * D, T, tuple(Signal(name, units[name]) for name in names), inputs,
        (Signal("u", "V"),),
    )  # fmt: skip


def tells(estimator: Estimator) -> bool:
    """Whether an estimator of this kind settles to a gain, with which `estimator_at` has it."""
    inner = estimator.inner if isinstance(estimator, AdaptiveNoise) else estimator
    return isinstance(inner, _BY_RICCATI + _OF_CONSTANT_GAIN)


_BY_RICCATI = (KalmanFilter, ExtendedKalmanFilter, UnscentedKalmanFilter, AugmentedKalmanFilter)
_OF_CONSTANT_GAIN = (ExtendedStateObserver, SteadyStateKalmanFilter, LowPass)


def estimator_at(estimator: Estimator, point: WorkPoint) -> LinearSystem:
    """Return an estimator at a work point, with the gain that it settles to.

    The force in its mean is linearised by the tangents of what it knows of its magnet; covariances
    of the linear and the adaptive filter grow by the stiffnesses through the origin, as they do in
    the core. A filter that finds its noise online has the noise that it starts from, one that
    learns its magnet the known one.

    Parameters
    ----------
    estimator : Estimator
        Of a kind that settles to a gain.
    point : WorkPoint
        Where.

    Returns
    -------
    LinearSystem
        Inputs ``y`` [m] and ``u`` [V], outputs ``position`` [m] and ``velocity`` [m/s], with what y
        of the same sample says; u acts from this sample on.

    Raises
    ------
    AmbkitError
        Its kind does not settle to a gain, or its model has none.
    """
    if isinstance(estimator, AdaptiveNoise):
        return estimator_at(estimator.inner, point)
    if isinstance(estimator, LowPass):
        return _low_pass(estimator)
    if not tells(estimator):
        raise AmbkitError(f"{estimator.name}: it does not settle to a gain, and has no margins")
    model = estimator.model
    linear = estimator.linear_model(*_asked(estimator.magnet, "tangent", point))
    A, B, H, states = linear.A, linear.B, linear.H, model.states
    if isinstance(estimator, ExtendedStateObserver | SteadyStateKalmanFilter):
        K = estimator.gain[:, None]
    else:
        K, kept = _settled(estimator, point)
        A, B, H = A[np.ix_(kept, kept)], B[kept], H[:, kept]
        states = tuple(states[k] for k in kept)
    left = np.eye(len(states)) - K @ H
    roles = [at.role for at in states]
    told = [roles.index("position"), roles.index("velocity")]
    return LinearSystem(
        A @ left, np.hstack([A @ K, B]), left[told],
        np.hstack([K[told], np.zeros((len(told), B.shape[1]))]), model.T,
        tuple(Signal(at.name, at.unit) for at in states),
        (*(Signal(at.name, at.unit) for at in model.measurements), Signal("u", "V")),
        (POSITION, VELOCITY),
    )  # fmt: skip


def _settled(estimator: Estimator, point: WorkPoint) -> tuple[Array, Array]:
    """Return the gain (n, m) that a Kalman filter settles to, and the states that it moves (n,).

    A state of noise or load that nothing drives is found once, and its gain goes to zero: it is
    none of them.
    """
    from scipy.linalg import solve_discrete_are

    states = estimator.model.states
    kind = "through_origin" if isinstance(estimator, KalmanFilter) else "tangent"
    model = estimator.linear_model(*_asked(estimator.magnet, kind, point))
    follows = ("disturbance force", "noise", "noise in quadrature")
    Q = model.Q
    kept = np.array([k for k, at in enumerate(states) if at.role not in follows or Q[k, k] > 0])
    block = np.ix_(kept, kept)
    # The states are counted in their own units, or the equation loses its digits between newtons
    # and micrometres.
    units = np.array(start_std(estimator.bearing, estimator.variances, states))[kept]
    A, noise = model.A[block] * units / units[:, None], Q[block] / np.outer(units, units)
    unit = math.sqrt(model.R)  # and the measurement in its noise
    H, R = model.H[:, kept] * units / unit, np.eye(1)
    try:
        P = solve_discrete_are(A.T, H.T, noise, R)
    except np.linalg.LinAlgError:
        raise AmbkitError(f"{estimator.name}: it does not settle to a gain") from None
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    return units[:, None] * K / unit, kept


def _low_pass(estimator: LowPass) -> LinearSystem:
    """Position and velocity of ``core/src/low_pass.c``; its force is beside them."""
    T, gain = estimator.bearing.sampling_time, estimator.bearing.sensor.gain
    a, b = (-np.expm1(-estimator.corners[name] * T) for name in ("position", "velocity"))
    # x += a (y/K - x) =: dx, then v += b (dx/T - v)
    A = np.array([[1 - a, 0.0], [-a * b / T, 1 - b]])
    B = np.array([[a / gain, 0.0], [a * b / (T * gain), 0.0]])
    return LinearSystem(
        A, B, A, B, T, (Signal("x", "m"), Signal("v", "m/s")),
        (Signal("y", "m"), Signal("u", "V")), (POSITION, VELOCITY),
    )  # fmt: skip


def _asked(magnet: MagnetModel, method: str, point: WorkPoint) -> tuple[float, float]:
    """Ask what an estimator knows of its magnet for k_i [N/A] and k_s [N/m] at a work point."""
    found = getattr(magnet.in_core(core_module()), method)(
        np.array([point.iu]), np.array([point.x])
    )
    return float(found[0][0]), float(found[1][0])


def compensator(control: LinearSystem, estimator: LinearSystem | None, gain: float) -> LinearSystem:
    """Return controller and estimator together, from the measurement to u.

    Parameters
    ----------
    control : LinearSystem
        Of `controller`.
    estimator : LinearSystem or None
        Of `estimator_at`, for a controller that is fed by it; None: it is fed by the measurement.
    gain : float
        Of the sensor [1], by which the measurement is divided then.

    Returns
    -------
    LinearSystem
        Inputs ``y`` and ``r`` [m], output ``u`` [V].
    """
    if estimator is None:
        scale = np.array([1 / gain, 1.0])
        inputs = (Signal("y", "m"), Signal("r", "m"))
        return replace(control, B=control.B * scale, D=control.D * scale, inputs=inputs)
    E, K = estimator, control
    m, q = len(E.inputs) - 1, len(E.outputs)
    B_y, B_u, D_y = E.B[:, :m], E.B[:, m:], E.D[:, :m]
    Bq, Br, Dq, Dr = K.B[:, :q], K.B[:, q:], K.D[:, :q], K.D[:, q:]
    A = np.block([[E.A + B_u @ Dq @ E.C, B_u @ K.C], [Bq @ E.C, K.A]])
    B = np.block([[B_y + B_u @ Dq @ D_y, B_u @ Dr], [Bq @ D_y, Br]])
    states = tuple(Signal(f"{at.name}_est", at.unit) for at in E.states) + K.states
    return LinearSystem(
        A, B, np.hstack([Dq @ E.C, K.C]), np.hstack([Dq @ D_y, Dr]), K.T, states,
        (*E.inputs[:m], *K.inputs[q:]), K.outputs,
    )  # fmt: skip
