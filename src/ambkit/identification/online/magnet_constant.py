"""Magnet constant from a record: least squares with forgetting, and k as a state."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import QuantityLike
from ambkit.data.record import Record
from ambkit.estimate.augmented import AugmentedKalmanFilter
from ambkit.estimate.estimate import Estimate, Status
from ambkit.identification.online.adaline import (
    CONFIDENCE,
    Adaline,
    AdalineResult,
    OnlineIdentifier,
    OnlineResult,
    first_element,
    start_of,
)
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module


@dataclass(frozen=True, eq=False)
class LeastSquaresResult(AdalineResult):
    """Result of least squares along a record, n samples; the rest as in :class:`AdalineResult`."""

    # excitation (n,) Root mean square excitation of k: the regressor, or with an unknown
    # disturbance its part that is no constant; relative to iu = i0, x = 0 [1].

    #: (n,) Identified disturbance [N]; zero if it is not estimated.
    load: Array


class RecursiveLeastSquares(OnlineIdentifier[LeastSquaresResult]):
    """Magnet constant, and an unknown disturbance, by least squares with forgetting.

    ADALINE's first element identifies the magnet force from the motion (eq. 24). In place of its
    gradient step (eq. 25) this fits ``F = load + k phi`` by least squares over the last ``1 / (1 -
    forgetting)`` samples: it converges immediately, and a constant load does not bias k. Parameters
    without excitation are held, not forgotten; see ``core/include/ambkit/rls.h``.

    Parameters
    ----------
    machine : Machine
        Provides mass, weight, gap, bias current, lag and limits; its magnet constant is the initial
        value.
    start, bandwidth, rate_force : float, optional
        As for :class:`ambkit.Adaline`.
    forgetting : float
        Weight of a sample relative to the next one, between 0 and 1. ``1 - rate_k`` of an ADALINE
        leaves the same noise.
    least_excitation : float
        k is held while the excitation is below this.
    load : {"unknown", "known"}
        ``"unknown"``: a constant force on the rotor is estimated with k, and k only from
        variations. ``"known"``: the only load is that passed to `run`; the weight also contributes
        to k, as in ADALINE.

    Raises
    ------
    ValueError
        An argument is out of range.
    """

    _learned, _more = LeastSquaresResult, ("load",)

    def __init__(
        self,
        machine: Machine,
        *,
        start: QuantityLike | None = None,
        bandwidth: QuantityLike | None = None,
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
        settings = first_element(machine, start, bandwidth, rate_force, least_excitation)
        self.machine = machine
        self.forgetting, self.memory = forgetting, 1 / (1 - forgetting)
        self.core = core_module().MagnetRls(
            **settings,
            forgetting=forgetting,
            with_load=load == "unknown",
            # ADALINE's force starts from the initial k, and forgets it as (1 - rate)^n.
            settling=math.ceil(8 / rate_force),
        )


@dataclass(frozen=True, eq=False)
class AugmentedResult(OnlineResult):
    """Result of the filter along a record, n samples; the rest as in :class:`OnlineResult`."""

    error: Array  #: (n,) Stated standard deviation of k [N m^2/A^2].
    load: Array  #: (n,) Estimated disturbance [N].
    estimate: Estimate  #: The complete estimate.

    @property
    def magnet_constant(self) -> float:
        """Final k, which includes all information [N m^2/A^2]."""
        return float(self.k[-1])

    @property
    def settled(self) -> bool:
        """Whether k changed in the last quarter by no more than its error, or hardly."""
        return super().settled or abs(self.drift) <= CONFIDENCE * self.standard_error

    @property
    def standard_error(self) -> float:
        """Stated standard deviation of the final k [N m^2/A^2]."""
        # NaN if k was never learned: the initial value is no result.
        return math.nan if self.held.all() else float(self.error[-1])


class AugmentedIdentifier:
    """Magnet constant by :class:`ambkit.AugmentedKalmanFilter`, besides its four other states."""

    # It estimates the disturbance as a random walk; a known disturbance is only subtracted from the
    # result.

    def __init__(
        self, machine: Machine, *, start: QuantityLike | None = None, **options: Any
    ) -> None:
        constant = start_of(machine, start)
        self.machine = machine.replace(**machine.magnet.with_constant(constant))
        self.kalman = AugmentedKalmanFilter(self.machine, **options)

    def run(self, record: Record, *, disturbance: ArrayLike | None = None) -> AugmentedResult:
        """Process a record."""
        # disturbance (n,) [N]
        start = self.machine.magnet.magnet_constant
        estimate = self.kalman.run(record)
        assert estimate.scale is not None
        assert estimate.scale_variance is not None
        unlearned = Status.UNEXCITED | Status.MISSING | Status.FROZEN | Status.OUTLIER
        return AugmentedResult(
            t=record.t,
            k=start * estimate.scale,
            held=(estimate.status & np.uint16(unlearned | Status.BAD_VARIANCE)) != 0,
            error=start * np.sqrt(estimate.scale_variance),
            load=estimate.f_d - (0.0 if disturbance is None else np.asarray(disturbance)),
            estimate=estimate,
        )


Learner = type[Adaline] | type[RecursiveLeastSquares] | type[AugmentedIdentifier]

ONLINE: Mapping[str, Learner] = {
    "adaline": Adaline,
    "rls": RecursiveLeastSquares,
    "augmented": AugmentedIdentifier,
}
"""Methods of online identification by name."""


def identified(machine: Machine, history: OnlineResult) -> Machine:
    """Return a machine with the identified magnet constant."""
    if history.held.all():
        seen = (
            f"excitation stayed at {history.excitation.max():.2g}, below the least at which the "
            "magnet constant is learned"
            if isinstance(history, AdalineResult)
            else "the magnet constant was nowhere distinguishable from a load"
        )
        raise AmbkitError(f"{seen}: excite the rotor, or apply a known load")
    k = history.magnet_constant
    if not k > 0:
        raise AmbkitError(
            f"the identified magnet constant is {k:.3g} N m^2/A^2, which is not physical: is "
            "the sign of y or u reversed, or a large disturbance force omitted?"
        )
    return machine.replace(**machine.magnet.with_constant(k))
