"""Plant and controller of a loop as linear systems, at a work point: of one axis, or of several.

The control signals u [V] are what goes between them; an estimator is fed with those that go out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.estimate.whole import Whole
from ambkit.machine.bank import alone_of
from ambkit.machine.hovering import hover_current
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of
from ambkit.models import axis_parts
from ambkit.models.linear import Complex, LinearSystem, Signal, linearised
from ambkit.models.machine import machine_parts, place
from ambkit.models.parts import SynchronousForce
from ambkit.simulation.plant import Plant

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing, Sensor
    from ambkit.models.model import Array
    from ambkit.models.plan import Part

POSITION, VELOCITY = Signal("position", "m"), Signal("velocity", "m/s")


class WorkPoint(NamedTuple):
    """Where a loop is linearised: control current [A] and displacement [m].

    Numbers of one axis; of a whole machine arrays (p,), one for each axis.
    """

    iu: Any
    x: Any

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

    @classmethod
    def of_machine(cls, machine: Machine, load: Mapping[str, float] | None = None) -> WorkPoint:
        """Return the point at which the magnets carry the rotor in the middle, and loads.

        Parameters
        ----------
        machine : Machine
            The plant.
        load : mapping of str to float, optional
            Constant disturbance forces, by the names of the axes [N].

        Raises
        ------
        AmbkitError
            There is no such axis, or no current within an amplifier's range holds the rotor.
        """
        names, given = [axis.name for axis in machine.axes], dict(load or {})
        for name in given:
            if name not in names:
                raise AmbkitError(f"load: there is no axis {name}; there are {', '.join(names)}")
        pushed = np.array([given.get(name, 0.0) for name in names])
        q, currents = Plant(machine).hovering(np.zeros(len(names)), pushed)
        for name, b, iu in zip(names, alone_of(machine), currents, strict=True):
            if not b.current_min < iu < b.current_max:
                raise AmbkitError(
                    f"no control current from {b.current_min:g} to {b.current_max:g} A of axis "
                    f"{name} holds the rotor of {machine.name} with its weight and load"
                )
        return cls(currents, Whole(machine).H @ q)


def of_axes(signal: Signal, axes: Sequence[str]) -> tuple[Signal, ...]:
    """Return a signal once for each axis, with its name at the end; without axes itself alone."""
    return tuple(Signal(f"{signal.name}_{axis}", signal.unit) for axis in axes) or (signal,)


def plant(of: Bearing | Machine, point: WorkPoint, *, continuous: bool = False) -> LinearSystem:
    """Return amplifiers, dead time, magnets, rotor and sensors, from u and load to y and x.

    Within the limits of current and voltage, without rounding and noise; of a bent sensor the slope
    at the work point.

    Parameters
    ----------
    of : Bearing or Machine
        What is linearised; a machine at its speed.
    point : WorkPoint
        Where.
    continuous : bool, optional
        In continuous time, which needs a plant without delay.

    Returns
    -------
    LinearSystem
        Inputs ``u`` [V] and ``f_d`` [N], outputs ``y`` and ``x`` [m]; of a machine ``u_NAME`` and
        ``f_d_NAME`` of each axis, ``y_NAME`` of each reading and the displacements ``s_NAME`` of
        each axis.

    Raises
    ------
    ValueError
        In continuous time, with a delay.
    """
    machine = isinstance(of, Machine)
    parts = machine_parts(of, noise=False) if machine else axis_parts(of, noise=False)
    system = _linear(of, parts, point, continuous=continuous)
    B, C, alone = system.B.copy(), system.C, alone_of(of)
    B[:, : len(alone)] *= [b.amplifier.gain for b in alone]
    if isinstance(of, Machine):
        whole, m = Whole(of), len(of.readings)
        seen = np.linalg.pinv(whole.H @ whole.shown) @ point.x / whole.gains
        sensors: list[Sensor] = [r.sensor for r in of.readings]
        stands = {state.name: k for k, state in enumerate(system.states)}
        along = np.zeros((len(alone), len(stands)))
        for k, axis in enumerate(of.axes):
            for q, value in axis.line.form.items():
                along[k, stands[q]] = value
        C = np.vstack([C[:m], along])
        names = [axis.name for axis in of.axes]
        positions = of_axes(Signal("s", "m"), names)
        inputs = (*of_axes(Signal("u", "V"), names), *system.inputs[len(names) :])
    else:
        m, seen, positions = 1, [point.x], system.outputs[1:]
        sensors = [of.sensor]
        inputs = (Signal("u", "V"), *system.inputs[1:])
    bent = [
        1 + (2 * at.quadratic + 3 * at.cubic * x) * x for at, x in zip(sensors, seen, strict=True)
    ]
    C = np.vstack([np.array(bent)[:, None] * C[:m], C[m:]])
    return replace(
        system, B=B, C=C, D=np.zeros((len(C), B.shape[1])), inputs=inputs,
        outputs=(*system.outputs[:m], *positions),
    )  # fmt: skip


def unbalance_columns(machine: Machine, point: WorkPoint, places: Sequence[float]) -> Complex:
    """Return what a sample of unbalance of 1 kg m leaves in the plant's states (n, planes).

    Each turns with the rotor, from x towards y: its force within the sample does.

    Parameters
    ----------
    machine : Machine
        The plant, which turns.
    point : WorkPoint
        Where it is linearised.
    places : sequence of float
        Of the planes [m].
    """
    turning: list[Part] = [
        SynchronousForce(
            1.0, 1.0, machine.speed, f"U{k}", place(machine.line(z, 0.0).form),
            place(machine.line(z, math.pi / 2).form),
        )
        for k, z in enumerate(places)
    ]  # fmt: skip
    A = _linear(machine, [*machine_parts(machine, noise=False), *turning], point).A
    n = len(A) - 2 * len(places)
    return np.asarray(A[:n, n::2] - 1j * A[:n, n + 1 :: 2])


def _linear(
    of: Bearing | Machine, parts: Sequence[Part], point: WorkPoint, *, continuous: bool = False
) -> LinearSystem:
    """Return the parts of a plant with its magnets' tangents at a work point."""
    k_i, k_s = np.array([
        [float(k) for k in magnet_of(b).tangent(float(iu), float(x))]
        for b, iu, x in zip(
            alone_of(of), np.atleast_1d(point.iu), np.atleast_1d(point.x), strict=True
        )
    ]).T  # fmt: skip
    return linearised(parts, of.sampling_time, k_i, k_s, continuous=continuous)


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

    Raises
    ------
    AmbkitError
        It is none, but a regulator, or takes the estimated load back.
    """
    if getattr(pid, "type", "pid") != "pid" or getattr(pid, "feed_forward", 0):
        raise AmbkitError(
            f'{bearing.name}: margins are those of a PID; controller.type must be "pid" and '
            "controller.feed_forward 0"
        )
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


def controllers(pids: Sequence[_Gains], machine: Machine) -> LinearSystem:
    """Return the controllers of a machine's axes beside each other, see `controller`.

    Parameters
    ----------
    pids : sequence of PID (p,)
        Of each axis; all fed by the measurement, or all by an estimate.
    machine : Machine
        Gives sampling time and gains.

    Returns
    -------
    LinearSystem
        Inputs the positions of all axes [m], with an estimate their velocities [m/s], then the
        references [m]; outputs the control signals [V].
    """
    from scipy.linalg import block_diag

    each = [controller(pid, b) for pid, b in zip(pids, alone_of(machine), strict=True)]
    names = [axis.name for axis in machine.axes]
    kinds, p = each[0].inputs, len(each)
    order = [k + len(kinds) * axis for k in range(len(kinds)) for axis in range(p)]
    A, B, C, D = (block_diag(*(getattr(one, name) for one in each)) for name in "ABCD")
    states = [
        Signal(f"{at.name}_{name}", at.unit)
        for name, one in zip(names, each, strict=True) for at in one.states
    ]  # fmt: skip
    inputs = [signal for kind in kinds for signal in of_axes(kind, names)]
    return LinearSystem(
        A, B[:, order], C, D[:, order], machine.sampling_time, tuple(states), tuple(inputs),
        of_axes(Signal("u", "V"), names),
    )  # fmt: skip


def compensator(
    control: LinearSystem,
    estimator: LinearSystem | None,
    shown: Array,
    readings: Sequence[Signal] = (Signal("y", "m"),),
) -> LinearSystem:
    """Return controllers and estimator together, from the measurements to u.

    Parameters
    ----------
    control : LinearSystem
        Of `controller` or `controllers`.
    estimator : LinearSystem or None
        Of `estimator_at`, for controllers that are fed by it; None: they are fed by the
        measurements.
    shown : ndarray (p, m)
        Positions of the axes by the measurements [1], which controllers are fed with then.
    readings : sequence of Signal (m,)
        The measurements.

    Returns
    -------
    LinearSystem
        Inputs the measurements and the references [m], outputs the control signals [V].
    """
    K = control
    if estimator is None:
        p = len(shown)
        B, D = (np.hstack([of[:, :p] @ shown, of[:, p:]]) for of in (K.B, K.D))
        return replace(K, B=B, D=D, inputs=(*readings, *K.inputs[p:]))
    E = estimator
    m, q = len(E.inputs) - len(K.outputs), len(E.outputs)
    B_y, B_u, D_y = E.B[:, :m], E.B[:, m:], E.D[:, :m]
    Bq, Br, Dq, Dr = K.B[:, :q], K.B[:, q:], K.D[:, :q], K.D[:, q:]
    A = np.block([[E.A + B_u @ Dq @ E.C, B_u @ K.C], [Bq @ E.C, K.A]])
    B = np.block([[B_y + B_u @ Dq @ D_y, B_u @ Dr], [Bq @ D_y, Br]])
    states = tuple(Signal(f"{at.name}_est", at.unit) for at in E.states) + K.states
    return LinearSystem(
        A, B, np.hstack([Dq @ E.C, K.C]), np.hstack([Dq @ D_y, Dr]), K.T, states,
        (*E.inputs[:m], *K.inputs[q:]), K.outputs,
    )  # fmt: skip
