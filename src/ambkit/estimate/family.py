"""The kinds of estimators by name: how each is made, and what can be tuned in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ambkit.estimate.adaptive_noise import AdaptiveNoise
from ambkit.estimate.base import Estimator
from ambkit.estimate.kalman import (
    AdaptiveKalmanFilter,
    ExtendedKalmanFilter,
    KalmanFilter,
    UDKalmanFilter,
)
from ambkit.estimate.low_pass import LowPass
from ambkit.estimate.magnet_scale import AugmentedKalmanFilter, MultipleModelFilter
from ambkit.estimate.observer import ExtendedStateObserver, SteadyStateKalmanFilter, unstable_pole
from ambkit.estimate.unscented import UnscentedKalmanFilter
from ambkit.machine.magnets import StiffnessSource, magnet_of

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing


@dataclass(frozen=True)
class Tunable:
    """A positive parameter that tuning may change by some decades.

    Attributes
    ----------
    name : str
        Of the argument of :meth:`Kind.make`, or ``noise.measurement``, ``noise.control``,
        ``noise.disturbance`` for the variances of :class:`ambkit.FilterNoise`.
    unit : str
        Of the argument.
    default : callable
        Its value for a bearing.
    decades : float
        How far from the default the search goes, to either side.
    """

    name: str
    unit: str
    default: Callable[[Bearing], float]
    decades: float = 2.0


def _noise(name: str) -> Callable[[Bearing], float]:
    return lambda bearing: float(getattr(KalmanFilter(bearing).variances, name))


NOISE = (
    Tunable("noise.measurement", "m^2", _noise("measurement")),
    Tunable("noise.control", "V^2", _noise("control")),
    Tunable("noise.disturbance", "N^2/s", _noise("disturbance"), decades=3.0),
)


@dataclass(frozen=True)
class Kind:
    """A kind of estimator.

    Attributes
    ----------
    name : str
        As the commands know it.
    label : str
        In words, for reports.
    of : type
        Its class.
    source : callable or None
        What it asks of the magnet for a bearing; None where the caller gives the source, as a
        trained expert or a table.
    tunable : tuple of Tunable
        What tuning may change.
    """

    name: str
    label: str
    of: Callable[..., Estimator]
    source: Callable[[Bearing], StiffnessSource] | None
    tunable: tuple[Tunable, ...] = NOISE

    def make(
        self, bearing: Bearing, source: StiffnessSource | None = None, **options: Any
    ) -> Estimator:
        """Build one.

        Parameters
        ----------
        bearing : Bearing
            What is filtered.
        source : optional
            What it asks; by default the kind's own.
        **options
            Of the kind: what is tunable, and those of :class:`ambkit.KalmanFilter`.
        """
        if source is None and self.source is not None:
            source = self.source(bearing)
        return self.of(bearing, source, **options)


MEMORY = Tunable("memory", "s", lambda _bearing: 0.5, decades=1.0)


def _finding_noise(of: Callable[..., Estimator], **found: Any) -> Callable[..., Estimator]:
    """Put :class:`AdaptiveNoise` around a class; its own options go there, the others inside."""

    def make(bearing: Bearing, source: StiffnessSource | None = None, **options: Any) -> Estimator:
        own = {name: options.pop(name) for name in ("memory", "window", "most") if name in options}
        return AdaptiveNoise(of(bearing, source, **options), **found, **own)

    return make


def _constant(bearing: Bearing) -> StiffnessSource:
    from ambkit.machine.magnets import ConstantStiffness

    return ConstantStiffness.of(bearing)


def _poles(factor: float) -> Callable[[Bearing], float]:
    return lambda bearing: factor * unstable_pole(bearing)


KINDS = {
    kind.name: kind
    for kind in (
        Kind(
            "low-pass", "low-pass and derivative", LowPass, _constant,
            (
                Tunable("position", "rad/s", _poles(20)),
                Tunable("velocity", "rad/s", _poles(10)),
                Tunable("force", "rad/s", _poles(2)),
            ),
        ),
        Kind(
            "observer", "extended state observer", ExtendedStateObserver, _constant,
            (Tunable("bandwidth", "rad/s", _poles(8), decades=1.0),),
        ),
        Kind("linear", "linear Kalman filter", KalmanFilter, _constant),
        Kind("steady-state", "steady-state Kalman filter", SteadyStateKalmanFilter, _constant),
        Kind("table", "Kalman filter, stiffness table", AdaptiveKalmanFilter, None),
        Kind("adaptive", "adaptive Kalman filter, fuzzy expert", AdaptiveKalmanFilter, None),
        Kind("closed-law", "Kalman filter, closed law", AdaptiveKalmanFilter, magnet_of),
        Kind("extended", "extended Kalman filter", ExtendedKalmanFilter, magnet_of),
        Kind("ud", "UD-factorised Kalman filter", UDKalmanFilter, magnet_of),
        Kind(
            "augmented", "augmented-state extended Kalman filter", AugmentedKalmanFilter, magnet_of,
            (*NOISE, Tunable("wander", "1/s", lambda _: 0.01)),
        ),
        Kind(
            "multiple-model", "interacting multiple models", MultipleModelFilter, magnet_of,
            (*NOISE, Tunable("sojourn", "s", lambda _: 1.0, decades=1.0)),
        ),
        Kind("unscented", "unscented Kalman filter", UnscentedKalmanFilter, magnet_of),
        Kind(
            "linear-adaptive-noise", "linear Kalman filter, R found online",
            _finding_noise(KalmanFilter, method="sage-husa", adapts="measurement"), _constant,
            (*NOISE, MEMORY),
        ),
        Kind(
            "extended-adaptive-noise", "extended Kalman filter, R and Q found online",
            _finding_noise(ExtendedKalmanFilter, method="innovation", adapts="both"), magnet_of,
            (*NOISE, MEMORY),
        ),
    )
}  # fmt: skip
"""All kinds, from the simplest on."""


def learned_source(name: str, bearing: Bearing) -> StiffnessSource | None:
    """Return what a kind that must be given its source asks where nobody says otherwise.

    Parameters
    ----------
    name : str
        Of the kind.
    bearing : Bearing
        Its magnet is what is learned.

    Returns
    -------
    StiffnessSource or None
        A table of nodes, or a trained expert; None for a kind that has a source of its own.
    """
    if KINDS[name].source is not None:
        return None
    if name == "table":
        from ambkit.machine.stiffness import stiffness_map

        return stiffness_map(bearing)
    from ambkit.fuzzy.training import train

    return train(bearing, weights=True)
