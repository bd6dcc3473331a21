"""The linearised loop for python-control: plant, controller, estimator, closed loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import of_type
from ambkit.control.control import as_control
from ambkit.control.linear import linear_controller as control_of
from ambkit.control.linear import linear_plant, steady_state_filter
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_plant import OperatingPoint
from ambkit.estimate.estimator import Estimator
from ambkit.models.linear import LinearSystem, Signal

if TYPE_CHECKING:
    import control

    from ambkit.control.control import Control
    from ambkit.control.pid import PID
    from ambkit.machine.machine import Machine


def to_control(
    machine: Machine,
    pid: PID | None = None,
    filter: Estimator | None = None,
    *,
    sampled: bool | None = None,
    point: OperatingPoint | None = None,
) -> control.StateSpace:
    """Return the linearised plant, or closed loop with a PID, for python-control.

    Signals are named; their SI units are in the system's attribute ``units``, by name, until
    python-control derives another system.

    Parameters
    ----------
    machine : Machine
        The plant, with amplifier and sensor.
    pid : PID, optional
        Controller that closes the loop, with omitted settings tuned to the machine; without it, the
        plant alone.
    filter : Estimator, optional
        Filter that feeds the controller, sampled; `estimator` returns its system alone.
    sampled : bool, optional
        Exactly sampled, with dead time and hold; or in continuous time, which requires a machine
        without delay. By default sampled if there is a delay or a filter.
    point : OperatingPoint, optional
        Control current [A] and displacement [m] of the linearisation; by default the equilibrium at
        the centre.

    Returns
    -------
    control.StateSpace
        See `plant` and `closed_loop` for states, inputs and outputs.

    Raises
    ------
    AmbkitError
        python-control is not installed (``pip install 'ambkit[control]'``); continuous time with a
        delay or a filter; a filter without a controller, or without a steady-state gain.
    """
    if filter is not None and pid is None:
        raise AmbkitError("a filter closes no loop without a controller: give pid as well")
    if pid is None:
        return plant(machine, sampled=sampled, point=point)
    return closed_loop(machine, pid, filter, sampled=sampled, point=point)


def plant(
    machine: Machine, *, sampled: bool | None = None, point: OperatingPoint | None = None
) -> control.StateSpace:
    """Linearised plant at an operating point (paper, eq. 2, 14, 18)."""
    continuous = not _is_sampled(machine, sampled, None)
    point = point or OperatingPoint.equilibrium(machine)
    return _state_space(linear_plant.plant(machine, point, continuous=continuous), _name(machine))


def controller(machine: Machine, pid: PID) -> control.StateSpace:
    """Sampled controller, as in ``core/src/controller.c``, without its limits."""
    tuned = as_control(pid).completed(machine)
    return _state_space(
        control_of.controller(tuned, machine, measured=tuned.feedback == "measurement"),
        f"{_name(machine)}_pid",
    )


def estimator(filter: Estimator, *, point: OperatingPoint | None = None) -> control.StateSpace:
    """Sampled estimator with its steady-state gain at an operating point."""
    of_type(Estimator, filter=filter)
    point = point or OperatingPoint.equilibrium(filter.machine)
    return _state_space(
        steady_state_filter.estimator_at(filter, point), f"{_name(filter.machine)}_estimator"
    )


def closed_loop(
    machine: Machine,
    pid: PID,
    filter: Estimator | None = None,
    *,
    sampled: bool | None = None,
    point: OperatingPoint | None = None,
) -> control.StateSpace:
    """Linearised closed loop of plant, PID and estimator."""
    # The controller is the core's (``core/include/ambkit/controller.h``) without its limits: the
    # derivative acts on the position only. In continuous time and with ``feedback = "estimate"``
    # its inputs are x and v, as from an ideal estimator; with ``"measurement"`` the lagged
    # position, and its derivative through the filter, which must not be zero.
    name, law = f"{_name(machine)}_closed_loop", as_control(pid).completed(machine)
    point = point or OperatingPoint.equilibrium(machine)
    if not _is_sampled(machine, sampled, filter):
        return _state_space(_continuous_loop(machine, law, point), name)
    linear_estimator = None if filter is None else steady_state_filter.estimator_at(filter, point)
    transform = np.array([[1 / machine.sensor.gain]])
    K = control_of.compensator(
        control_of.controller(law, machine, measured=filter is None), linear_estimator, transform
    )
    return _state_space(Loop(linear_plant.plant(machine, point), K).closed, name)


def _is_sampled(machine: Machine, sampled: bool | None, filter: Estimator | None) -> bool:
    """Return whether the system is a sampled one; checked against its parts."""
    needed = "a filter" if filter is not None else "a delay" if machine.delay else ""
    if needed and sampled is False:
        raise AmbkitError(f"{machine.name}: {needed} has no continuous state space: sampled=True")
    return bool(needed) if sampled is None else sampled


def _continuous_loop(machine: Machine, pid: Control, point: OperatingPoint) -> LinearSystem:
    """Return plant and PID in continuous time."""
    if pid.block:
        raise AmbkitError("a PID with blocks has no continuous state space: sampled=True")
    P = linear_plant.plant(machine, point, continuous=True)
    names = [at.name for at in P.states]
    n, b_u, b_f = len(names), P.B[:, :1] / machine.amplifier.gain, P.B[:, 1:]
    if pid.feedback == "estimate":
        # iu = kp (weight r - x) + integral - kd v
        velocity = np.eye(n)[[names.index("v")]]
        A = np.block([[P.A - b_u @ (pid.kp * P.C[1:] + pid.kd * velocity), b_u],
                      [-pid.ki * P.C[1:], np.zeros((1, 1))]])  # fmt: skip
        extra: tuple[Signal, ...] = (Signal("integral", "A"),)
    else:
        if not pid.derivative_filter > 0:
            raise AmbkitError(
                "derivative_filter must be greater than 0 s for a closed loop in continuous time "
                f"that is fed by the measurement, is {pid.derivative_filter:g} s"
            )
        # The derivative is (p - filtered) / T_f, with filtered following p with T_f.
        p = P.C[:1] / machine.sensor.gain
        slope = pid.kd / pid.derivative_filter
        A = np.block([
            [P.A - b_u @ ((pid.kp + slope) * p), b_u, slope * b_u],
            [-pid.ki * p, np.zeros((1, 2))],
            [p / pid.derivative_filter, np.zeros((1, 1)), -np.eye(1) / pid.derivative_filter],
        ])  # fmt: skip
        extra = (Signal("integral", "A"), Signal("filtered", "m"))
    B = np.zeros((len(A), 2))
    B[:n, :1], B[n, 0], B[:n, 1:] = pid.kp * pid.setpoint_weight * b_u, pid.ki, b_f
    C = np.hstack([P.C, np.zeros((2, len(extra)))])
    return LinearSystem(
        A, B, C, np.zeros((2, 2)), None, P.states + extra, (Signal("r", "m"), P.inputs[1]),
        P.outputs,
    )  # fmt: skip


def _state_space(system: LinearSystem, name: str) -> control.StateSpace:
    try:
        import control
    except ModuleNotFoundError:
        raise AmbkitError("python-control is needed: pip install 'ambkit[control]'") from None
    result = control.ss(
        system.A, system.B, system.C, system.D, 0 if system.T is None else system.T,
        states=[at.name for at in system.states], inputs=[at.name for at in system.inputs],
        outputs=[at.name for at in system.outputs], name=name,
    )  # fmt: skip
    result.units = dict((*system.states, *system.inputs, *system.outputs))
    return result


def _name(machine: Machine) -> str:
    return "".join(c if c.isalnum() else "_" for c in machine.name)
