"""The H-infinity controller of an axis by mixed sensitivities: a baseline for other loops."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.threads import one_thread
from ambkit.data.signals import signal
from ambkit.models.linear import LinearSystem, Signal

if TYPE_CHECKING:
    from ambkit.models.model import Array

PEAK, SLOW, AT_REST = 1.5, 0.3, 1e-4
"""Weight of S: its peak that counts as 1, the bandwidth over the unstable pole, and S at rest."""

STRONG = 10.0
"""Weight of the control signal: how much of it counts as 1, over what the plant asks for at the
frequency of its unstable pole."""


def hinf(plant: LinearSystem) -> LinearSystem:
    """Return the controller that makes the worst of weighted S and K S least."""
    # S is weighted by ``(s/1.5 + 0.3 p)/(s + 3e-5 p)`` with the fastest unstable pole p, K S by 0.1
    # over what the plant answers at p. The sampled plant goes by Tustin's transform to continuous
    # time, and the controller back, which keeps every norm (Chen and Francis 1995). Time is counted
    # in 1/p and signals in what they are at p: in metres and volts the equations lose their digits.
    # Doyle, Glover, Khargonekar, Francis, State-space solutions to standard H2 and H-infinity
    # control problems, 1989; Skogestad, Postlethwaite, Multivariable feedback control, 2005.
    control = _control()
    T = plant.T
    assert T is not None
    one = np.eye(len(plant.A))
    p = math.log(float(np.abs(plant.unstable()).max())) / T
    back = np.linalg.inv(plant.A + one)
    A, B = 2 / (T * p) * back @ (plant.A - one), 2 / math.sqrt(T * p) * back @ plant.B
    C, D = 2 / math.sqrt(T * p) * plant.C @ back, plant.D - plant.C @ back @ plant.B
    size = abs((C @ np.linalg.solve(1j * one - A, B) + D).item())
    G = control.ss(A, B / math.sqrt(size), C / math.sqrt(size), D / size)
    of_S = control.tf([1 / PEAK, SLOW], [1, SLOW * AT_REST])
    of_u = control.ss([], [], [], [[1 / STRONG]])
    try:
        with warnings.catch_warnings(), one_thread():
            warnings.simplefilter("ignore", FutureWarning)  # of its own
            K, _, _ = control.mixsyn(G, of_S, of_u, None)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise AmbkitError(f"there is no H-infinity controller of this plant: {error}") from None
    h = T * p / 2
    k = len(K.A)
    inverse = np.linalg.inv(np.eye(k) - h * K.A)
    return LinearSystem(
        inverse @ (np.eye(k) + h * K.A), math.sqrt(2 * h) * inverse @ K.B,
        -math.sqrt(2 * h) * K.C @ inverse / size, -(K.D + h * K.C @ inverse @ K.B) / size, T,
        tuple(Signal(f"k{j}", "1") for j in range(k)), plant.outputs, plant.inputs,
    )  # fmt: skip


def _control() -> Any:
    """Return python-control, where it can solve H-infinity's equations."""
    try:
        import control
        import slycot  # noqa: F401
    except ImportError:
        raise AmbkitError(
            "H-infinity needs python-control and slycot: pip install ambkit[hinf]"
        ) from None
    return control


def beside_each_other(item: list[LinearSystem], transform: Array, names: list[str]) -> LinearSystem:
    """Return controllers of axes as one, fed by what the readings show of the axes."""
    # shown (p, m)
    from scipy.linalg import block_diag

    A, B, C, D = (block_diag(*(getattr(one, name) for one in item)) for name in "ABCD")
    return LinearSystem(
        A, np.hstack([B @ transform, -B]), C, np.hstack([D @ transform, -D]), item[0].T,
        tuple(Signal(f"k{j}", "1") for j in range(len(A))),
        (*(Signal(f"y{j}", "m") for j in range(len(transform[0]))),
         *(Signal(signal("r", name), "m") for name in names or [""])),
        tuple(Signal(signal("u", name), "V") for name in names or [""]),
    )  # fmt: skip
