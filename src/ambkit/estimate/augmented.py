"""Filters that estimate the magnet constant in addition to the states, as a factor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.estimate.core_model import Engine
from ambkit.estimate.estimator import Arguments, Estimator
from ambkit.estimate.observer import unstable_pole
from ambkit.machine.axes import bias_forces, ideal_laws
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel


class AugmentedKalmanFilter(Estimator):
    """Extended Kalman filter with the factor on the magnet constant as its fifth state.

    In equilibrium the magnet constant and a constant disturbance force cannot be distinguished. The
    filter then holds the constant, with :attr:`Status.UNEXCITED`; until it has learned, its bits
    are those of :class:`ExtendedKalmanFilter`. It learns from motion: a few steps of the position
    are sufficient. An oscillating disturbance is compensated by the controller with an equal force,
    and does not contribute. The known constant must be accurate to 50 %.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Magnet model; by default the machine's force law.
    scale_std : float, optional
        Initial and maximum standard deviation of the scale [1].
    wander : float, optional
        Random walk of the scale, growth of its variance [1/s].
    excitation : float, optional
        The scale is learned while the measurements of one window, the time constant of the plant,
        would determine it to this standard deviation [1]; infinity: always, with drift in
        equilibrium.
    least, most : float, optional
        Limits of the scale [1].
    **options
        As for :class:`KalmanFilter`.

    Raises
    ------
    ValueError
        A parameter is out of its range.

    References
    ----------
    Friedland, Treatment of bias in recursive filtering, 1969; Ljung, Asymptotic behavior of the
    extended Kalman filter as a parameter estimator for linear systems, 1979.
    """

    name = "augmented-state extended Kalman filter"
    binding = "Augmented"
    _default_magnet = staticmethod(ideal_laws)
    steady = "tangent"

    def __init__(
        self,
        machine: Machine,
        magnet: MagnetModel | None = None,
        *,
        scale_std: float = 0.2,
        wander: float = 0.01,
        excitation: float = 1 / 3,
        least: float = 0.2,
        most: float = 5.0,
        **options: Any,
    ) -> None:
        if not (math.isfinite(scale_std) and scale_std > 0):
            raise ValueError(f"scale_std must be greater than 0, got {scale_std!r}")
        if not (math.isfinite(wander) and wander >= 0):
            raise ValueError(f"wander must be 0 1/s or more, got {wander!r}")
        if not (0 < least <= 1 <= most < math.inf):
            raise ValueError(f"limits must be 0 < least <= 1 <= most, got {least!r}, {most!r}")
        self.scale_std = scale_std
        self._own: dict[str, Any] = {
            "std": scale_std,
            "var_k": wander * machine.sampling_time,
            "min": least,
            "max": most,
            **_learning(machine, excitation),
        }
        super().__init__(machine, magnet, **options)

    def _arguments(self, engine: Engine, settings: dict[str, Any]) -> Arguments:
        return (), self._own | {"bias": _bias(self)}


class MultipleModelFilter(Estimator):
    """Interacting multiple models: parallel extended filters, each with its own constant.

    They are weighted by their predictions of the measurement; a jump of the magnet constant is
    detected within milliseconds of motion. In equilibrium the weights are held, with the flag of
    :class:`AugmentedKalmanFilter` and for the same reason. If motion shows a constant a fifth or
    more beyond all models, the status contains :attr:`Status.OUTSIDE`.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Magnet model; by default the machine's force law.
    scales : sequence of float, optional
        Magnet constants relative to the known one, 2 to 5 [1].
    sojourn : float, optional
        Mean time between changes of the constant, during motion [s].
    excitation : float, optional
        As for :class:`AugmentedKalmanFilter` [1].
    **options
        As for :class:`KalmanFilter`.

    Raises
    ------
    ValueError
        A parameter is out of its range.

    References
    ----------
    Blom & Bar-Shalom, The interacting multiple model algorithm for systems with Markovian switching
    coefficients, 1988.
    """

    name = "interacting multiple models"
    binding = "MultipleModel"
    _default_magnet = staticmethod(ideal_laws)

    def __init__(
        self,
        machine: Machine,
        magnet: MagnetModel | None = None,
        *,
        scales: Sequence[float] = (0.7, 0.85, 1.0, 1.15, 1.3),
        sojourn: QuantityLike = 1.0,
        excitation: float = 1 / 3,
        **options: Any,
    ) -> None:
        T, sojourn = machine.sampling_time, in_si("sojourn", sojourn, "s")
        if not (2 <= len(scales) <= 5 and all(math.isfinite(s) and s > 0 for s in scales)):
            raise ValueError(f"scales must be 2 to 5 positive numbers, got {tuple(scales)!r}")
        if not (math.isfinite(sojourn) and sojourn >= 2 * T):
            raise ValueError(f"sojourn must be two samples or more [s], got {sojourn!r}")
        self.scales = tuple(float(s) for s in scales)
        self.scale_std = float(np.std(self.scales))
        self._own = {"leave": T / sojourn, **_learning(machine, excitation)}
        super().__init__(machine, magnet, **options)

    def _arguments(self, engine: Engine, settings: dict[str, Any]) -> Arguments:
        return [np.array(self.scales, self.precision)], self._own | {"bias": _bias(self)}

    @property
    def weights(self) -> dict[float, float]:
        """Probabilities of the factors."""
        return dict(zip(self.scales, map(float, self.core.weights), strict=True))


def _bias(filter: Estimator) -> Array:
    """Return the forces of its magnets at their origin [N], for the core."""
    return np.array(bias_forces(filter.magnet, filter.machine), filter.precision)


def _learning(machine: Machine, excitation: float) -> dict[str, float]:
    """Return the conditions for learning the factor, for the core (``ambkit/excitation.h``)."""
    if not excitation > 0:
        raise ValueError(f"excitation must be greater than 0, got {excitation!r}")
    fresh = min(1.0, machine.sampling_time * unstable_pole(machine))
    return {"fresh": fresh, "least": fresh / excitation**2}
