"""Lift-off and landing, for ``core/include/ambkit/sequence.h``."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Quantity

MOST_COUNTED = 65535  #: Samples that an unsigned int of 16 bits counts.


class Mode(IntEnum):
    """What a controller is doing; ``amb_flight_mode``."""

    OFF = 0
    WAITING = 1
    LIFTING = 2
    FLYING = 3
    LANDING = 4
    TRIPPED = 5


class LiftOff(Part):
    """When the currents are on: lift-off, landing, and what ends a flight."""

    # With ``start = "landed"`` the rotor lies on the stop to which its weight pulls it, and both
    # coils are without current until it lifts. It lifts when the estimate has settled, from where
    # it lies.

    start: Annotated[float, Quantity("s", "50 ms", at_least=0)] = 0.0
    """When it is told to fly [s]."""
    stop: Annotated[float, Quantity("s", "0.8 s", at_least=0)] | None = None
    """When it is told to land [s]; without, never."""
    wait: Annotated[float, Quantity("s", "20 ms", at_least=0)] = 0.02
    """How long the estimate must have been settled [s]."""
    lift: Annotated[float, Quantity("s", "0.2 s", above=0)] = 0.2
    """How long the way up takes [s]."""
    land: Annotated[float, Quantity("s", "0.2 s", above=0)] = 0.2
    """How long the way down takes [s]."""
    lost: Annotated[float, Quantity("s", "50 ms", at_least=0)] = 0.05
    """How long the controller goes on with what cannot be used, until it trips [s]."""
    overload: Annotated[float, Quantity("s", "0.1 s", at_least=0)] = 0.1
    """How long a current stays at its limit, until it trips [s]."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        stop = read("stop")
        if stop is not None and stop <= read("start"):
            yield "stop", f"must be after start, {read('start'):g} s; is {stop:g} s"

    def fly(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return whether it is told to fly, 1 or 0."""
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
