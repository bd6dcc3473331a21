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

    The class is constructed with the machine, or without arguments, for each run. It is named as
    ``file.py:Class``; in Python the class itself is passed.
    """

    def step(self, y: Any, r: Any, estimate: Any) -> ArrayLike:
        """Return the control currents of a sample.

        Parameters
        ----------
        y : float or ndarray (m,)
            Measured position [m]; with several axes all readings.
        r : float or ndarray (p,)
            Reference [m]; with several axes all.
        estimate : ndarray (n,) or None
            State estimate; with one axis the displacement x [m] and velocity v [m/s] are first.
            None with ``feedback = "measurement"``.

        Returns
        -------
        float or array_like (p,)
            Demanded control current [A]; with several axes all. It is limited by the amplifier.
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
