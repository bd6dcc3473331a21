"""Online identification of the magnet constant by recursive least squares, beside ADALINE's."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ambkit.base.arrays import Array
from ambkit.base.quantity_arguments import Given
from ambkit.identification.online.adaline import AdalineResult, OnlineIdentifier, first_element
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module


@dataclass(frozen=True, eq=False)
class LeastSquaresResult(AdalineResult):
    """What least squares learned along a record, n samples; the rest as :class:`AdalineResult`."""

    # excitation (n,) Root mean square of what k is learned from: the regressor, or where the load
    # is learned too its deviation from what looks like a load; relative to iu = i0, x = 0 [1].

    #: (n,) Identified force on the rotor that was not known [N]; zero where it is not learned.
    load: Array


class RecursiveLeastSquares(OnlineIdentifier[LeastSquaresResult]):
    """Magnet constant, and a load that nobody knows, by least squares with forgetting.

    ADALINE's first element finds the force of the magnet from the motion (eq. 24). Where its
    second one takes a gradient step (eq. 25), this one keeps the least squares fit of
    ``F = load + k phi`` over the last ``1 / (1 - forgetting)`` samples or so: at once where a
    gradient needs many steps, and without taking a constant load for k. What is not excited is
    held and not forgotten into thin air; see ``core/include/ambkit/rls.h``.

    Parameters
    ----------
    bearing : Machine
        Mass, weight, gap, bias current, lag and limits are taken from it; its magnet constant is
        where learning starts.
    start, bandwidth, rate_force : float, optional
        As for :class:`ambkit.Adaline`.
    forgetting : float
        Weight of a sample against the next one, between 0 and 1. ``1 - rate_k`` of an ADALINE
        leaves as much of the noise.
    least_excitation : float
        k is held while the excitation is below this.
    load : {"unknown", "known"}
        ``"unknown"``: a constant force on the rotor is learned beside k, and k only from what
        moves. ``"known"``: there is none besides that given to `run`; k is learned from the weight
        too, as ADALINE does.

    Raises
    ------
    ValueError
        Where an argument is outside its range.
    """

    _learned, _more = LeastSquaresResult, ("load",)

    def __init__(
        self,
        bearing: Machine,
        *,
        start: Given | None = None,
        bandwidth: Given | None = None,
        rate_force: float = 0.05,
        forgetting: float = 0.998,
        least_excitation: float = 0.02,
        load: str = "unknown",
    ) -> None:
        if not 0 < forgetting < 1:
            raise ValueError(
                f"forgetting must be greater than 0 and less than 1, got {forgetting!r}"
            )
        if load not in ("unknown", "known"):
            raise ValueError(f"load must be 'unknown' or 'known', got {load!r}")
        settings = first_element(bearing, start, bandwidth, rate_force, least_excitation)
        self.bearing = bearing
        self.forgetting, self.memory = forgetting, 1 / (1 - forgetting)
        self.core = core_module().MagnetRls(
            **settings,
            forgetting=forgetting,
            with_load=load == "unknown",
            # ADALINE's force starts from the start of k, and forgets it as (1 - rate)^n.
            settling=math.ceil(8 / rate_force),
        )
