"""A plant of the user's: an object with ``step(iu, f_d)`` in place of the machine."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.own_step import OwnStep
from ambkit.machine.machine import Machine


@runtime_checkable
class PlantProtocol(Protocol):
    """What a plant of one's own has: a step.

    Its class is made with the machine, or without arguments, anew for each run. It is named as
    ``file.py:Class``, in Python its class is given. Noise, quantisation and limits of the currents
    are those of the machine that is described.
    """

    def step(self, iu: Any, f_d: Any) -> ArrayLike:
        """Move the rotor on to the next sample.

        Parameters
        ----------
        iu : float or ndarray (p,)
            Control current, with noise and limits, held over the sample [A]; of several axes all.
        f_d : float or ndarray (p,)
            Disturbance force, held over the sample [N].

        Returns
        -------
        array_like (3,) or (2 q + m,)
            Displacement x [m], velocity v [m/s] and what the sensor shows without noise, x_m [m];
            of several axes the displacements and the velocities by the coordinates of the rotor,
            `Machine.positions`, and what each sensor shows. The run begins where the machine that
            is described does.
        """


class OwnPlant(OwnStep):
    """An object with ``step(iu, f_d)``, for the loop in C; see `PlantProtocol`."""

    def __init__(self, make: Any, machine: Machine) -> None:
        self._single = machine.single
        self._count = 2 * len(machine.positions) + len(machine.readings)
        super().__init__(
            make, machine, "step(iu, f_d)", f"{self._count} numbers, see PlantProtocol"
        )

    def __call__(self, iu: list[float], f_d: list[float], _: list[float]) -> list[float]:
        """Return displacements, velocities and readings, and that no stop was touched."""
        arguments = (iu[0], f_d[0]) if self._single else (np.array(iu), np.array(f_d))
        return [*self.numbers(self._count, *arguments), 0.0]
