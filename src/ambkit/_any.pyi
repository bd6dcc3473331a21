"""The C core with loops over any model: the names of ``ambkit._core``, and a model of its own."""

from typing import Any

from ambkit._core import *

MOST_STATES: int
MOST_FORCES: int
MOST_SENSORS: int

class Model:  # type: ignore[no-redef]
    """Any model (ambkit/loops.h)."""

    def __init__(self, arrays: dict[str, Any]) -> None: ...
    def nodes(self, lowest: int, step: float, still: Any, which: Any, at: Any, grown: Any, by_growth: Any) -> None:
        """
        The numbers that a speed changes, at speeds one after the other, and what they gain there by its growth (ambkit/turning.h); then the model can turn.
        """

    def synchronous(self, arguments: dict[str, Any]) -> None:
        """The states that turn with the rotor, and the error of its speed."""

    def turn(self, speed: float, growth: float) -> None:
        """Take the numbers of a speed [rad/s] that grows [rad/s^2]."""

def stand(estimator: Estimator, model: Model, still: Any) -> None:
    """An estimator and its model as they were before they turned."""

def run_turning(estimator: Estimator, y: Any, u: Any, speed: Any, model: Model, *, covariance: bool = False, measured: bool = False) -> dict[str, Any]:
    """
    A whole record while the speed of rotation changes (n,) [rad/s], or by what is measured of it (n, 8), of its own model.
    """
