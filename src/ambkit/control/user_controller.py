"""A controller of the user: an object with ``step(y, r, estimate)`` in place of the PIDs."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.own_class import OwnPart
from ambkit.machine.machine import Machine


@runtime_checkable
class ControllerProtocol(Protocol):
    """Interface of the user's controller.

    Its class is made with the machine, or without arguments, anew for each run. It is named as
    ``file.py:Class``, in Python its class is given.
    """

    def step(self, y: Any, r: Any, estimate: Any) -> ArrayLike:
        """Return the control currents of a sample.

        Parameters
        ----------
        y : float or ndarray (m,)
            Measured position [m], of several readings all of them.
        r : float or ndarray (p,)
            Reference [m], of several axes all of them.
        estimate : ndarray (n,) or None
            States of the filter, whose first are the displacement x [m] and velocity v [m/s] of one
            axis; None where ``feedback = "measurement"``.

        Returns
        -------
        float or array_like (p,)
            Control current that is demanded [A], of several axes all of them; it is held to the
            limits of the amplifier.
        """


class OwnController(OwnPart):
    """An object with ``step(y, r, estimate)``, for the loop in C; see `ControllerProtocol`."""

    def __init__(self, make: Any, machine: Machine) -> None:
        self._axes = len(machine.axes)
        returns = "the control current" if self._axes == 1 else f"{self._axes} control currents"
        super().__init__(make, machine, "step(y, r, estimate)", f"{returns} [A]")

    def __call__(self, y: list[float], r: list[float], mean: list[float]) -> list[float]:
        """Return the currents (p,) [A]."""
        estimate = np.array(mean) if mean else None
        return self.numbers(self._axes, self.plain(y), self.plain(r), estimate)
