"""The linearised bearing as python-control knows it: plant, and closed loop with a PID."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.machine.magnets import ConstantStiffness

if TYPE_CHECKING:
    import control

    from ambkit.machine.bearing import Bearing
    from ambkit.simulation.scenario import PID


def to_control(bearing: Bearing, pid: PID | None = None) -> control.StateSpace:
    """Return the linearised plant, or closed loop with a PID, for python-control.

    Parameters
    ----------
    bearing : Bearing
        The plant.
    pid : PID, optional
        Controller that closes the loop; without it, the plant alone.

    Returns
    -------
    control.StateSpace
        See `plant` and `closed_loop` for states, inputs and outputs.

    Raises
    ------
    AmbkitError
        Where python-control is not installed (``pip install 'ambkit[control]'``).
    """
    return plant(bearing) if pid is None else closed_loop(bearing, pid)


def plant(bearing: Bearing) -> control.StateSpace:
    """Linearised plant at iu = 0, x = 0, in continuous time (paper, eq. 2, 14, 18).

    Parameters
    ----------
    bearing : Bearing
        Gives stiffnesses, mass, amplifier gain and sensor.

    Returns
    -------
    control.StateSpace
        States ``x`` [m], ``v`` [m/s], ``x_m`` [m]; inputs ``u`` [V] and ``f_d`` [N], both counted
        from hovering at x = 0; outputs ``x`` and ``x_m``. A sensor without lag is taken for one
        that lags a thousandth of a sample.

    Raises
    ------
    AmbkitError
        Where python-control is not installed.
    """
    k, m = ConstantStiffness.of(bearing), bearing.rotor.mass
    lag = bearing.sensor_lag
    A = [[0, 1, 0], [k.k_s / m, 0, 0], [bearing.sensor.gain / lag, 0, -1 / lag]]
    B = [[0, 0], [k.k_i * bearing.amplifier.gain / m, 1 / m], [0, 0]]
    C = [[1, 0, 0], [0, 0, 1]]
    return _library().ss(
        A, B, C, np.zeros((2, 2)), states=["x", "v", "x_m"], inputs=["u", "f_d"],
        outputs=["x", "x_m"], name=_name(bearing),
    )  # fmt: skip


def closed_loop(bearing: Bearing, pid: PID) -> control.StateSpace:
    """Linearised closed loop of plant and PID, in continuous time.

    The controller as the core's (``core/include/ambkit/controller.h``) without its limits: the
    derivative acts on the position only. With ``feedback = "estimate"`` it gets x and v
    themselves, as from an ideal estimator; with ``"measurement"`` the lagged position, and its
    derivative through the filter, which must not be zero.

    Parameters
    ----------
    bearing : Bearing
        The plant.
    pid : PID
        The controller.

    Returns
    -------
    control.StateSpace
        States ``x``, ``v``, ``x_m``, ``integral`` [A], and ``filtered`` [m] where the derivative is
        filtered; inputs ``r`` [m] and ``f_d`` [N]; outputs ``x`` and ``x_m``.

    Raises
    ------
    AmbkitError
        Where python-control is not installed, or the derivative of a measurement has no filter.
    """
    open_loop = plant(bearing)
    A0, b_u, b_f = open_loop.A, open_loop.B[:, :1] / bearing.amplifier.gain, open_loop.B[:, 1:]
    if pid.feedback == "estimate":
        # iu = kp (r - x) + integral - kd v
        position, velocity = np.array([[1.0, 0, 0]]), np.array([[0, 1.0, 0]])
        A = np.block([[A0 - b_u @ (pid.kp * position + pid.kd * velocity), b_u],
                      [-pid.ki * position, np.zeros((1, 1))]])  # fmt: skip
        states = ["x", "v", "x_m", "integral"]
    else:
        if not pid.derivative_filter > 0:
            raise AmbkitError(
                "derivative_filter must be greater than 0 s for a closed loop in continuous time "
                f"that is fed by the measurement, is {pid.derivative_filter:g} s"
            )
        # The derivative is (p - filtered) / T_f, where filtered follows p with T_f.
        p = np.array([[0, 0, 1.0 / bearing.sensor.gain]])
        slope = pid.kd / pid.derivative_filter
        A = np.block([
            [A0 - b_u @ ((pid.kp + slope) * p), b_u, slope * b_u],
            [-pid.ki * p, np.zeros((1, 2))],
            [p / pid.derivative_filter, np.zeros((1, 1)), -np.eye(1) / pid.derivative_filter],
        ])  # fmt: skip
        states = ["x", "v", "x_m", "integral", "filtered"]
    extra = A.shape[0] - 3
    B = np.zeros((A.shape[0], 2))
    B[:3, :1], B[3, 0], B[:3, 1:] = pid.kp * b_u, pid.ki, b_f
    C = np.hstack([open_loop.C, np.zeros((2, extra))])
    return _library().ss(
        A, B, C, np.zeros((2, 2)), states=states, inputs=["r", "f_d"], outputs=["x", "x_m"],
        name=f"{_name(bearing)}_closed_loop",
    )  # fmt: skip


def _name(bearing: Bearing) -> str:
    """Name of the system: letters, digits and underscores."""
    return "".join(c if c.isalnum() else "_" for c in bearing.name)


def _library() -> ModuleType:
    try:
        import control
    except ModuleNotFoundError:
        raise AmbkitError("python-control is needed: pip install 'ambkit[control]'") from None
    library: ModuleType = control
    return library
