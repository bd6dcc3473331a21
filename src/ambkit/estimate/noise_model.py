"""Noise of an estimator, and its linear prediction model as matrices."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ambkit.base import units
from ambkit.base.arrays import Array
from ambkit.base.config.quantities import InOther
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.models.model import Descriptor, Model


class LinearModel(NamedTuple):
    """``X(k+1) = A X(k) + B u(k) + E f_0``, ``y(k) = H X(k)`` (paper, eq. 15-21); all in SI."""

    # For one axis and one sensor, or several.

    A: Array  # (n, n)
    B: Array  # (n, controls)
    E: Array  # (n, forces), by 1 N
    H: Array  # (sensors, n)
    Q: Array  # (n, n)
    R: Any  # scalar for one sensor; for several (sensors,)

    @classmethod
    def of(cls, model: Model, k_i: Any, k_s: Any, settings: Mapping[str, Any]) -> LinearModel:
        """Return a model with the noise of the core's settings, at an operating point."""
        gain, var_u = np.array(settings["k_ui"]), np.array(settings["var_u"])
        R = with_rounding(settings["var_y"], settings["step"], settings["dwell"])
        return cls(
            A=model.jacobian(k_i, k_s),
            B=model.input_matrix(k_i) * gain,
            E=model.b.copy(),
            H=model.c.copy(),
            Q=model.process_noise(k_i, gain**2 * var_u, settings["var_d"]),
            R=R[0] if len(R) == 1 else np.array(R),
        )

    def scaled(self, units: Array) -> LinearModel:
        """Return the model with states in other units (n,), for numerical reasons."""
        D, inverse = np.diag(units), np.diag(1 / units)
        return self._replace(
            A=inverse @ self.A @ D,
            B=inverse @ self.B,
            E=inverse @ self.E,
            H=self.H @ D,
            Q=inverse @ self.Q @ inverse,
        )


COARSE, VERY_COARSE = 4.0, 121.0
"""AMB_COARSE and AMB_VERY_COARSE of the core: square of a step over the variance of the noise."""

UNITS = {"measurement": "m^2", "control": "V^2", "disturbance": "N^2/s"}  #: Of each variance.


@dataclass(frozen=True, init=False)
class FilterNoise:
    """Variances assumed by a filter; ``None`` means the machine's.

    Parameters
    ----------
    measurement : float or str, or sequence of them, optional
        R, variance of the measured position [m^2], such as ``"83 µm^2"``.
    control : float or str, or sequence of them, optional
        Variance of the control signal [V^2], or [A^2] if that is a current; enters as ``B var B'``
        (paper, below eq. 21).
    disturbance : float or str, or sequence of them, optional
        Process noise intensity, growth of the disturbance force's variance [N^2/s]. Default ``(2 m
        g)^2``: a random walk of twice the rotor's weight in a second; less if a low-noise sensor
        would give the filter a bandwidth beyond one over its lag. The paper leaves it to
        experiment: a larger value follows the force faster and transmits more noise.

    With several axes a single number applies to all readings or axes, several to each.

    Raises
    ------
    AmbkitError
        A value is neither a number nor a text with its unit.
    """

    measurement: float | tuple[float, ...] | None = None
    control: float | tuple[float, ...] | None = None
    disturbance: float | tuple[float, ...] | None = None

    def __init__(
        self,
        measurement: QuantityLike | Sequence[QuantityLike] | None = None,
        control: QuantityLike | Sequence[QuantityLike] | None = None,
        disturbance: QuantityLike | Sequence[QuantityLike] | None = None,
    ) -> None:
        arguments = {"measurement": measurement, "control": control, "disturbance": disturbance}
        for name, unit in UNITS.items():
            entry: Any = arguments[name]
            several = isinstance(entry, Sequence) and not isinstance(entry, str)
            value = (
                tuple(_read(name, item, unit) for item in entry)
                if several
                else _read(name, entry, unit)
            )
            object.__setattr__(self, name, value)


def _read(name: str, value: QuantityLike | None, unit: str) -> float | None:
    """Return a variance in SI; that of a control signal may be of a current."""
    if isinstance(value, InOther):
        return value
    if name == "control" and isinstance(value, str):
        with suppress(ValueError):
            return InOther.of(units.parse(value, "A^2"), "A^2")
    return in_si(f"noise.{name}", value, unit)


class Variances(NamedTuple):
    """Variances of a filter: R [m^2], control signal [V^2], disturbance intensity [N^2/s]."""

    # Scalars for one axis; tuples for a machine, for each reading or axis.

    measurement: Any
    control: Any
    disturbance: Any

    def growth(self, T: float, noises: Sequence[Descriptor]) -> list[float]:
        """Variances of a model's noises: of disturbances per sample [N^2], of others their own."""
        _, *others = noises
        return [T * self.disturbance, *(noise.size**2 for noise in others)]


def with_rounding(
    variances: Sequence[float], steps: Sequence[float], samples: float
) -> list[float]:
    """Return variances of white noise including quantisation [m^2]."""
    # As in ``core/include/ambkit/kalman.h``.
    return [
        v + q**2 / 12 * (samples if q**2 > VERY_COARSE * v else 1.0)
        for v, q in zip(variances, steps, strict=True)
    ]


def held_rounding(variance: float, step: float, samples: float) -> float:
    """Return the variance [m^2] for a constant gain, of a rotor that moves less than a step."""
    # The part of the rounding that the noise does not average out, its first harmonic, persists for
    # so many samples (Widrow & Kollar 2008, quantisation noise with a Gaussian input).
    if step**2 <= COARSE * variance or step**2 > VERY_COARSE * variance:
        return with_rounding([variance], [step], samples)[0]
    share = 6 / math.pi**2 * math.exp(-4 * math.pi**2 * variance / step**2)
    return variance + step**2 / 12 * (1 + share * (samples - 1))


def check_variances(variances: Variances) -> None:
    """Raise ValueError for variances that are negative or not finite."""
    for name, unit in UNITS.items():
        variance = getattr(variances, name)
        for value in variance if isinstance(variance, tuple) else (variance,):
            if not math.isfinite(value) or value < 0 or (name == "measurement" and value == 0):
                limit = "greater than 0" if name == "measurement" else "0 or greater"
                raise ValueError(f"noise.{name} must be {limit} {unit}, got {value!r}")
