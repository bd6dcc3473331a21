"""Lift-off and landing, for ``core/include/ambkit/sequence.h``."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Quantity

MOST_COUNTED = 65535  #: Maximum of an unsigned int of 16 bits.


class Mode(IntEnum):
    """Mode of a controller; ``amb_flight_mode``."""

    OFF = 0
    WAITING = 1
    LIFTING = 2
    FLYING = 3
    LANDING = 4
    TRIPPED = 5


class LiftOff(Part):
    """Lift-off and landing: commands, times, and conditions of a trip."""

    # With ``start = "landed"`` the rotor is in contact at the stop in the direction of its weight,
    # and both coils are without current. It lifts from there when the estimate has settled.

    start: Annotated[float, Quantity("s", "50 ms", at_least=0)] = 0.0
    """Time of the command to levitate [s]."""
    stop: Annotated[float, Quantity("s", "0.8 s", at_least=0)] | None = None
    """Time of the command to land [s]. By default never."""
    wait: Annotated[float, Quantity("s", "20 ms", at_least=0)] = 0.02
    """Time for which the estimate must have been settled [s]."""
    lift: Annotated[float, Quantity("s", "0.2 s", above=0)] = 0.2
    """Duration of the rise [s]."""
    land: Annotated[float, Quantity("s", "0.2 s", above=0)] = 0.2
    """Duration of the landing [s]."""
    lost: Annotated[float, Quantity("s", "50 ms", at_least=0)] = 0.05
    """Trip after this time without a usable position [s]."""
    overload: Annotated[float, Quantity("s", "0.1 s", at_least=0)] = 0.1
    """Trip after this time at a current limit [s]."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        stop = read("stop")
        if stop is not None and stop <= read("start"):
            yield "stop", f"must be after start, {read('start'):g} s; is {stop:g} s"

    def fly(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the command to levitate, 1 or 0."""
        # t (n,) [s]
        command = t >= self.start
        return (command if self.stop is None else command & (t < self.stop)).astype(float)

    def in_samples(self, T: float) -> dict[str, Any]:
        """Return the fields of ``amb_sequence``."""
        return {
            "waiting": _samples(self.wait, T),
            "lost": _samples(self.lost, T),
            "overloaded": _samples(self.overload, T),
            "rise": min(1.0, T / self.lift),
            "descent": min(1.0, T / self.land),
        }


def _samples(time: float, T: float) -> int:
    return min(round(time / T), MOST_COUNTED - 1)
