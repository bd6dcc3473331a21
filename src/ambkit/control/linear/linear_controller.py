"""Controllers of a loop as linear systems to u [V], alone and with an estimator fed by this u."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.control.blocks import sections_of
from ambkit.control.linear.linear_plant import POSITION, VELOCITY, of_axes
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.models.linear import LinearSystem, Signal

ControlLaw = Any  #: `ambkit.control.controllers.Controllers`, which is made of what is here.


def controller(pid: Any, machine: Machine, *, measured: bool) -> LinearSystem:
    """Return the controller of a `PID` as ``core/src/controller.c`` computes it, without limits."""
    T = machine.sampling_time
    gains = pid.kp, pid.ki, pid.kd, pid.derivative_filter, 0.0, pid.setpoint_weight
    result = _passed(_pid(gains, T, measured), sections_of(getattr(pid, "block", ()), T))
    volts = 1 / machine.amplifier.gain
    return replace(result, C=volts * result.C, D=volts * result.D, outputs=(Signal("u", "V"),))


def _pid(gains: Sequence[float], T: float, measured: bool) -> LinearSystem:
    """Return a PID with a current [A] as its output; its gains are those of ``amb_pid``."""
    kp, ki, kd, T_f, _, weight = gains[:6]
    names = ["integral"] if ki > 0 else []
    names += ["derivative", "last"] if measured else []
    units = {"integral": "A", "derivative": "m/s", "last": "m"}
    inputs = (POSITION, *(() if measured else (VELOCITY,)), Signal("r", "m"))
    at = {name: k for k, name in enumerate(names)}
    n, m = len(names), len(inputs)
    A, B, C, D = np.zeros((n, n)), np.zeros((n, m)), np.zeros((1, n)), np.zeros((1, m))
    D[0, 0], D[0, -1] = -kp, kp * weight
    if "integral" in at:
        k = at["integral"]
        A[k, k] = C[0, k] = 1.0
        B[k, 0], B[k, -1] = -T * ki, T * ki
    if measured:
        # velocity += ((x - last) - T velocity)/(T_f + T), and then last = x
        d, last, share = at["derivative"], at["last"], 1 / (T_f + T)
        A[d, d], A[d, last], B[d, 0], B[last, 0] = 1 - T * share, -share, share, 1.0
        C -= kd * A[d]
        D[0, 0] -= kd * share
    else:
        D[0, 1] = -kd
    return LinearSystem(
        A, B, C, D, T, tuple(Signal(name, units[name]) for name in names), inputs,
        (Signal("iu", "A"),),
    )  # fmt: skip


def _passed(system: LinearSystem, sections: Sequence[Sequence[float]]) -> LinearSystem:
    """Return a system whose output passes sections of second order, each of two states."""
    A, B, C, D, states = system.A, system.B, system.C, system.D, system.states
    for k, (b0, b1, b2, a1, a2) in enumerate(sections):
        n = len(A)
        inner = np.array([[b1 - a1 * b0], [b2 - a2 * b0]])
        A = np.block([[A, np.zeros((n, 2))], [inner @ C, np.array([[-a1, 1.0], [-a2, 0.0]])]])
        B = np.vstack([B, inner @ D])
        C, D = np.hstack([b0 * C, [[1.0, 0.0]]]), b0 * D
        states += (Signal(f"section_{k}", "A"), Signal(f"section_{k}_before", "A"))
    return replace(system, A=A, B=B, C=C, D=D, states=states)


def side_by_side(
    pids: Sequence[Sequence[float]], T: float, names: Sequence[str], *, measured: bool
) -> LinearSystem:
    """Return PIDs from all positions, velocities and references to currents [A]."""
    from scipy.linalg import block_diag

    parts = [
        _passed(_pid(pid, T, measured), [pid[k : k + 5] for k in range(8, len(pid), 5)])
        for pid in pids
    ]
    kinds = parts[0].inputs
    order = [k + len(kinds) * at for k in range(len(kinds)) for at in range(len(pids))]
    A, B, C, D = (block_diag(*(getattr(one, name) for one in parts)) for name in "ABCD")
    states = [
        Signal(f"{at.name}_{name}", at.unit)
        for name, one in zip(names, parts, strict=True) for at in one.states
    ]  # fmt: skip
    return LinearSystem(
        A, B[:, order], C, D[:, order], T, tuple(states),
        tuple(signal for kind in kinds for signal in of_axes(kind, names)),
        of_axes(Signal("iu", "A"), names),
    )  # fmt: skip


def controllers(result: ControlLaw, of: Machine, *, measured: bool) -> LinearSystem:
    """Return controllers as ``core/src/controllers.c`` computes them, within their limits."""
    pids = side_by_side(result.pids_at(of.speed), of.sampling_time, result.names, measured=measured)
    A, q = pids.A, len(pids.outputs)
    # Each PID's reference is what it looks at of those of the axes.
    B, D = (np.hstack([M[:, :-q], M[:, -q:] @ result.of_axes]) for M in (pids.B, pids.D))
    C, D = result.spread @ pids.C, result.spread @ D
    axes = of.axis_names
    names = result.names if any(axes) else axes
    kinds = (POSITION,) if measured else (POSITION, VELOCITY)
    input_signals = [signal for kind in kinds for signal in of_axes(kind, names)]
    if not measured:
        p = len(result.spread)
        at = B.shape[1] - p
        B = np.hstack([B[:, :at], np.zeros((len(A), p)), B[:, at:]])
        D = np.hstack([D[:, :at], np.eye(p), D[:, at:]])
        input_signals += of_axes(Signal("fed_back", "A"), axes)
    volts = np.array([1 / b.amplifier.gain for b in isolated_axes(of)])[:, None]
    return LinearSystem(
        A, B, volts * C, volts * D, pids.T, pids.states,
        (*input_signals, *of_axes(Signal("r", "m"), axes)), of_axes(Signal("u", "V"), axes),
    )  # fmt: skip


def fed(result: ControlLaw, states: int, speed: float) -> Array:
    """Return what controllers take of an estimator's states (2 q + p, n), see `controllers`."""
    feedback = result.feedback
    gain = np.zeros((len(result.spread), states))
    for power, name in enumerate(("fed_back", "fed_back_by_speed", "fed_back_by_square")):
        gain += speed**power * feedback.get(name, 0.0)
    rows = np.vstack([feedback["position"], feedback["velocity"], gain])
    if result.unbalance_control is not None:
        motion, current = result.unbalance_control.at(speed)
        at = slice(result.unbalance_control.start, result.unbalance_control.start + motion.shape[1])
        rows[:, at] -= rows[:, : len(motion)] @ motion
        rows[-len(current) :, at] += current
    return rows


def compensator(
    control: LinearSystem,
    estimator: LinearSystem | None,
    transform: Array,
    readings: Sequence[Signal] = (Signal("y", "m"),),
) -> LinearSystem:
    """Return controllers and estimator together, from the measurements to u."""
    # transform (q, m) [1]
    K = control
    if estimator is None:
        p = transform.shape[-2]
        B, D = (_beside(of[..., :p] @ transform, of[..., p:]) for of in (K.B, K.D))
        return replace(K, B=B, D=D, inputs=(*readings, *K.inputs[p:]))
    E = estimator
    m, q = len(E.inputs) - len(K.outputs), len(E.outputs)
    B_y, B_u, D_y = E.B[..., :m], E.B[..., m:], E.D[..., :m]
    Bq, Br, Dq, Dr = K.B[..., :q], K.B[..., q:], K.D[..., :q], K.D[..., q:]
    A = np.block([[E.A + B_u @ Dq @ E.C, B_u @ K.C], [Bq @ E.C, K.A]])
    B = np.block([[B_y + B_u @ Dq @ D_y, B_u @ Dr], [Bq @ D_y, Br]])
    states = tuple(Signal(f"{at.name}_est", at.unit) for at in E.states) + K.states
    return LinearSystem(
        A, B, _beside(Dq @ E.C, K.C), _beside(Dq @ D_y, Dr), K.T, states,
        (*E.inputs[:m], *K.inputs[q:]), K.outputs,
    )  # fmt: skip


def _beside(left: Array, right: Array) -> Array:
    """Return matrices (..., n, m) side by side."""
    return np.concatenate([left, right], axis=-1)
