"""An estimator in a loop, linear at an operating point, with its steady-state gain."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.linear_plant import POSITION, VELOCITY, OperatingPoint, of_axes
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.noise_model import LinearModel
from ambkit.machine.magnets import core_module
from ambkit.models.linear import LinearSystem, Signal
from ambkit.models.parts import SYNCHRONOUS


def tells(estimator: Estimator) -> bool:
    """Return whether an estimator of this kind has a steady-state gain, as in `estimator_at`."""
    return estimator.nominal.steady is not None


def estimator_at(
    estimator: Estimator,
    point: OperatingPoint,
    outputs: tuple[Array, Sequence[Signal]] | None = None,
) -> LinearSystem:
    """Return an estimator at an operating point, with its steady-state gain."""
    # The force in its mean is linearised by the tangents of its magnet model; covariances of the
    # linear and the adaptive filter use the stiffnesses through the origin, as in the core. A
    # filter with estimated noise has its initial noise, one that estimates its magnet the described
    # one.
    estimator = estimator.nominal
    own = estimator.linear_system()
    if own is not None:
        return own
    if estimator.steady is None:
        raise AmbkitError(
            f"{estimator.name}: it has no steady-state gain, so margins are not defined"
        )
    tangent = tangents_known(estimator.magnet, "tangent", point)
    grown = tangent
    if estimator.steady == "through_origin":
        grown = tangents_known(estimator.magnet, "through_origin", point)
    return _assembled(estimator, tangent, grown, outputs)


def estimators_at(estimator: Estimator, points: Sequence[OperatingPoint]) -> LinearSystem:
    """Return `estimator_at` of one axis at several points, as matrices (points, ...)."""
    inner = estimator.nominal
    magnet = inner.magnet.in_core(core_module())
    iu, x = np.array([(point.iu, point.x) for point in points], float).T.copy()
    tangent, origin = (
        (np.asarray(k_i, float)[:, None], np.asarray(k_s, float)[:, None])
        for k_i, k_s in (magnet.tangent(iu, x), magnet.through_origin(iu, x))
    )
    return _assembled(inner, tangent, origin if inner.steady == "through_origin" else tangent, None)


def _assembled(
    estimator: Estimator,
    tangent: tuple[Any, Any],
    origin: tuple[Any, Any],
    outputs: tuple[Array, Sequence[Signal]] | None,
) -> LinearSystem:
    """Return an estimator by the stiffnesses in its mean, and those in its covariance."""
    model = estimator.model
    linear = estimator.linear_model(*tangent)
    A, B, H, states = linear.A, linear.B, linear.H, model.states
    state_indices: Any = np.arange(len(states))
    gain = getattr(estimator, "gain", None)
    if estimator.steady == "constant" and gain is not None:
        K = gain[:, None]
    else:
        K, state_indices = _settled(estimator, estimator.linear_model(*origin))
        A = A[..., state_indices, :][..., state_indices]
        B = B[..., state_indices, :]
        H = H[:, state_indices]
        states = tuple(states[k] for k in state_indices)
    left = np.eye(len(states)) - K @ H
    axes = estimator.machine.axis_names
    signals: Sequence[Signal] = (*of_axes(POSITION, axes), *of_axes(VELOCITY, axes))
    if outputs is not None:
        rows, signals = outputs[0][:, state_indices], outputs[1]
    else:
        rows = np.vstack(estimator.view.along_axes(states))
    through = rows @ K
    none = np.zeros((*through.shape[:-1], B.shape[-1]))
    return LinearSystem(
        A @ left, np.concatenate([A @ K, B], axis=-1), rows @ left,
        np.concatenate([through, none], axis=-1), model.T,
        tuple(Signal(at.name, at.unit) for at in states),
        (*(Signal(at.name, at.unit) for at in model.measurements),
         *of_axes(Signal("u", "V"), axes)),
        tuple(signals),
    )  # fmt: skip


def settled_gain(estimator: Estimator, point: OperatingPoint) -> tuple[Array, Array]:
    """Return the steady-state gain (n, m) of a Kalman filter at an operating point (`_settled`)."""
    kind = "through_origin" if estimator.steady == "through_origin" else "tangent"
    return _settled(
        estimator, estimator.linear_model(*tangents_known(estimator.magnet, kind, point))
    )


def _settled(estimator: Estimator, model: LinearModel) -> tuple[Array, Array]:
    """Return the steady-state gain (..., n, m) of a Kalman filter, and which states it moves."""
    # A noise or disturbance state without process noise is learned once, and its gain tends to
    # zero: it is excluded (n,). At one speed so is what no reading shows: unbalance and runout at
    # rest, runout beside an unbalance, which has the same effect, and the error of the speed.
    from scipy.linalg import solve_discrete_are

    states = estimator.model.states
    follows = ("disturbance force", "noise", "noise in quadrature")
    Q, roles = model.Q, {at.role for at in states}
    hidden = {"speed error"} | ({"runout"} if "unbalance" in roles else set())
    state_indices = np.array([
        k for k, at in enumerate(states)
        if (at.role not in follows or np.all(Q[..., k, k] > 0)) and at.role not in hidden
        and (at.role not in SYNCHRONOUS or np.any(model.A[..., k, k] != 1))
    ])  # fmt: skip
    # States are scaled, because the equation loses its digits between newtons and micrometres.
    units = np.array(estimator.default_std())[state_indices]
    A, noise = (of[..., state_indices, :][..., state_indices] for of in (model.A, Q))
    A, noise = A * units / units[:, None], noise / np.outer(units, units)
    noisy = np.sqrt(np.atleast_1d(model.R))  # and the measurements by their noise
    H, R = model.H[:, state_indices] * units / noisy[:, None], np.eye(len(noisy))
    try:
        P = _doubled(A, H, noise, R) if A.ndim > 2 else solve_discrete_are(A.T, H.T, noise, R)
    except np.linalg.LinAlgError:
        raise AmbkitError(f"{estimator.name}: it has no steady-state gain") from None
    K = np.swapaxes(np.linalg.solve(H @ P @ H.T + R, H @ P), -1, -2)
    return units[:, None] * K / noisy, state_indices


MOST_DOUBLINGS = 50  #: Doublings: a filter that has not settled after 2^50 samples does not.


def _doubled(A: Array, H: Array, Q: Array, R: Array) -> Array:
    """Return the steady-state covariances (k, n, n) before the measurement of several filters."""
    # By doubling: each step doubles the horizon (Anderson 1978, Second-order convergent algorithms
    # for the steady-state Riccati equation).
    one = np.eye(A.shape[-1])
    back: Array = np.swapaxes(A, -1, -2)
    seen, P = np.broadcast_to(H.T @ np.linalg.solve(R, H), Q.shape), Q
    for _ in range(MOST_DOUBLINGS):
        W = np.linalg.inv(one + seen @ P)
        grown = np.swapaxes(back, -1, -2) @ P @ W @ back
        P, before = P + grown, P
        seen, back = seen + back @ W @ seen @ np.swapaxes(back, -1, -2), back @ W @ back
        P = (P + np.swapaxes(P, -1, -2)) / 2
        if not np.isfinite(P).all():
            break
        own = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
        if (np.abs(P - before) <= 1e-12 * own[..., None] * own[..., None, :]).all():
            return np.asarray(P)
    raise np.linalg.LinAlgError("it does not settle")


def tangents_known(magnet: Any, method: str, point: OperatingPoint) -> tuple[Any, Any]:
    """Return k_i [N/A] and k_s [N/m] at an operating point, by an estimator's magnet models."""
    # Scalars for one axis, arrays (p,) for several.
    held = magnet.in_core(core_module())
    parts = held if isinstance(held, list) else [held]
    results = [
        getattr(one, method)(iu, x) for one, (iu, x) in zip(parts, point.along_orbit(), strict=True)
    ]
    k_i, k_s = (np.array([float(np.mean(of[k])) for of in results]) for k in (0, 1))
    return (k_i, k_s) if isinstance(held, list) else (float(k_i[0]), float(k_s[0]))
