"""The magnet constant from a record, sample by sample, with k as a state too."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.quantity_arguments import of_type
from ambkit.base.units import figure
from ambkit.data.record import Record
from ambkit.estimate.augmented import AugmentedKalmanFilter
from ambkit.estimate.estimate import Estimate, Status
from ambkit.identification.online.adaline import (
    CONFIDENCE,
    CONSTANT,
    Adaline,
    AdalineResult,
    OnlineResult,
)
from ambkit.identification.online.rls import RecursiveLeastSquares
from ambkit.machine.force_laws import axis_of
from ambkit.machine.machine import Machine
from ambkit.result.report import Axis, Figure, Line, Panel, Rule
from ambkit.result.result import Result
from ambkit.result.row import Row
from ambkit.result.signal_styles import TIME


@dataclass(frozen=True, eq=False)
class AugmentedResult(OnlineResult):
    """What the filter learned along a record, n samples; the rest as :class:`OnlineResult`."""

    error: Array  #: (n,) Standard deviation of k as the filter believes it [N m^2/A^2].
    load: Array  #: (n,) Estimated force on the rotor that was not known [N].
    estimate: Estimate  #: All that the filter said.

    @property
    def magnet_constant(self) -> float:
        """Where k ended, which holds all that was learned [N m^2/A^2]."""
        return float(self.k[-1])

    @property
    def settled(self) -> bool:
        """Whether k moved in the last quarter by no more than its own error, or hardly."""
        return super().settled or abs(self.drift) <= CONFIDENCE * self.standard_error

    @property
    def standard_error(self) -> float:
        """Standard deviation of k as the filter believes it at the end [N m^2/A^2]."""
        # NaN where k was never learned: what the filter began with is no finding.
        return math.nan if self.held.all() else float(self.error[-1])


class AugmentedIdentifier:
    """Magnet constant by :class:`ambkit.AugmentedKalmanFilter`, beside its four other states."""

    # It takes the load for one that wanders, and needs no word of it; so a load that is known is
    # only taken off what it found.

    def __init__(self, bearing: Machine, *, start: float | None = None, **options: Any) -> None:
        if start is None:
            start = bearing.magnet.magnet_constant
        if not 0 < start < math.inf:
            raise ValueError(f"start must be greater than 0 N m^2/A^2 and finite, got {start!r}")
        self.bearing = bearing.replace(**bearing.magnet.with_constant(start))
        self.kalman = AugmentedKalmanFilter(self.bearing, **options)

    def run(self, record: Record, *, disturbance: ArrayLike | None = None) -> AugmentedResult:
        """Learn along a record."""
        # disturbance (n,) [N]
        start = self.bearing.magnet.magnet_constant
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


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """What a record says about a bearing."""

    bearing: Machine  #: The one that was given, with the identified magnet constant.
    #: Mean and standard deviation of k over the last quarter of the record [N m^2/A^2]; of
    #: ``augmented`` the k at its end.
    magnet_constant: float
    spread: float
    #: How k was learned: an :class:`~ambkit.identification.online.adaline.AdalineResult`, a
    #: :class:`~ambkit.identification.online.rls.LeastSquaresResult`, or an
    #: :class:`~ambkit.identification.online.magnet_constant.AugmentedResult`.
    history: OnlineResult

    TITLE = "Identification of {0.bearing.name}"

    @property
    def finding(self) -> str:
        """The magnet constant, and whether it settled."""
        value_text = figure(self.magnet_constant, CONSTANT)
        settled = "" if self.history.settled else "; it still drifts: a longer record may settle it"
        return f"{self.bearing.name}: the magnet constant is {value_text}{settled}."

    @property
    def rows(self) -> list[Row]:
        """What was learned, and how sure it is."""
        return self.history.rows()

    def figures(self) -> list[Figure]:
        """Return what was learned over the record."""
        return [identification_figure(self, float(self.history.k[0]))]


Learner = type[Adaline] | type[RecursiveLeastSquares] | type[AugmentedIdentifier]

ONLINE: Mapping[str, Learner] = {
    "adaline": Adaline,
    "rls": RecursiveLeastSquares,
    "augmented": AugmentedIdentifier,
}
"""What learns a magnet constant sample by sample, by the names that users call it."""


def identify_online(
    record: Record,
    bearing: Machine,
    *,
    method: str = "adaline",
    disturbance: ArrayLike | None = None,
    **options: Any,
) -> Identification:
    """Identify the magnet constant along a record (paper, eq. 22-25, Fig. 6).

    What can be told from one record is the ratio of k to the mass: a mass that is 10 % wrong moves
    k by as much. A constant load that is not known moves ADALINE's k by its share of the force,
    and does nothing to that of least squares and of the Kalman filter, which need motion in return.
    :func:`~ambkit.identification.online.comparison.compare_online` runs all beside each other.

    Parameters
    ----------
    record : Record
        With ``y`` [m] and ``u`` [V].
    bearing : Machine
        With one axis: mass, gap, bias current, sensor, amplifier; its magnet constant is the start.
    method : {"adaline", "rls", "augmented"}
        Who learns: ADALINE, recursive least squares, or the extended Kalman filter with k.
    disturbance : array_like (n,), optional
        Disturbance force as far as it is known [N].
    **options
        As for :class:`ambkit.Adaline`, :class:`ambkit.RecursiveLeastSquares` or
        :class:`ambkit.AugmentedKalmanFilter`: start, bandwidth, learning rates, forgetting, noise.

    Raises
    ------
    AmbkitError
        An unknown method; or where the record never excited the magnet enough to learn from, or
        what was learned is no magnet constant.
    """
    of_type(Record, record=record)
    bearing = axis_of(bearing)
    if method not in ONLINE:
        raise AmbkitError(f'there is no method "{method}"; known: {", ".join(ONLINE)}')
    history: OnlineResult = ONLINE[method](bearing, **options).run(record, disturbance=disturbance)
    return identified(bearing, history)


def identified(bearing: Machine, history: OnlineResult) -> Identification:
    """Make a bearing of what was learned."""
    if history.held.all():
        seen = (
            f"excitation stayed at {history.excitation.max():.2g}, below the least at which the "
            "magnet constant is learned"
            if isinstance(history, AdalineResult)
            else "the magnet constant could nowhere be told from a load"
        )
        raise AmbkitError(f"{seen}: let the rotor move, or the magnet carry a known load")
    k = history.magnet_constant
    if not k > 0:
        raise AmbkitError(
            f"the identified magnet constant is {k:.3g} N m^2/A^2, which no magnet has: is the "
            "sign of y or u turned round, or a large disturbance force left out?"
        )
    result = bearing.replace(**bearing.magnet.with_constant(k))
    return Identification(result, k, history.spread, history)


def identification_figure(result: Identification, start: float) -> Figure:
    """Show how the magnet constant was learned along a record, from `start` [N m^2/A^2]."""
    history = result.history
    panels = [
        Panel(TIME, Axis("magnet constant $k$", "N mm²/A²", 1e6), [
            Rule(start, signal="reference", label="start"),
            Rule(result.magnet_constant, signal="bound", label="result"),
            Line(history.t, history.k, signal="identified"),
        ]),
    ]  # fmt: skip
    if isinstance(history, AdalineResult):
        force = Line(history.t, history.force, signal="force", label="identified force")
        excitation = Line(history.t, history.excitation, signal="control", label="")
        panels.append(Panel(TIME, Axis("magnet force", "N"), [force]))
        panels.append(Panel(TIME, Axis("excitation"), [excitation]))
    return Figure(
        id="identification",
        title=f"Identification of {markdown(result.bearing.name)}",
        caption="Where the excitation is too small, the magnet constant is held.",
        panels=panels,
    )
