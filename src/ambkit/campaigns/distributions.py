"""Distributions of varied quantities, and their tables in a study."""

from __future__ import annotations

import numbers
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    Field,
    PlainSerializer,
    PlainValidator,
    SerializationInfo,
    ValidationInfo,
    WithJsonSchema,
)
from pydantic_core import PydanticCustomError

from ambkit.base import units
from ambkit.base.arrays import Array
from ambkit.base.config import Part
from ambkit.base.config.quantities import Line, from_folder, to_folder
from ambkit.campaigns.keys import Key

LEAST, MOST = 2.0**-54, 1 - 2.0**-53  #: Range of probabilities for which a quantile is computed.


class InvalidValue(ValueError):
    """An error at one key of a varied quantity."""

    def __init__(self, key: str, text: str) -> None:
        super().__init__(text)
        self.key = key


class _WithoutUnit(float):
    """A number in a file, without unit."""


def _value(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, str):
        return from_folder(value, info) if value.endswith(".toml") else value
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        text = f"must be a number with its unit, is {value!r:.60}"
        raise PydanticCustomError("problem", "{text}", {"text": text})
    return _WithoutUnit(value) if info.context is not None else float(value)


def _written(value: float | str, info: SerializationInfo) -> float | str:
    if isinstance(value, float):
        return float(value)
    return to_folder(value, info) if value.endswith(".toml") else value


Value = Annotated[
    float | str,
    PlainValidator(_value),
    PlainSerializer(_written),
    WithJsonSchema({"anyOf": [{"type": "string", "examples": ["2 mm"]}, {"type": "number"}]}),
]
"""A text with unit, or ``"5 %"`` of the nominal value; in Python also a number in SI."""


class Marginal(ABC):
    """The distribution of one number."""

    @abstractmethod
    def quantile(self, u: Array) -> Array:
        """Return the quantiles at probabilities (n,); for a choice indices."""

    def level(self, u: Array) -> Array:
        """Return grid levels, for `u` equidistant from 0 to 1 with both ends."""
        return self.quantile(u)


@dataclass(frozen=True)
class UniformMarginal(Marginal):
    """Uniform between two ends."""

    low: float
    high: float

    def quantile(self, u: Array) -> Array:
        return self.low + (self.high - self.low) * u


@dataclass(frozen=True)
class NormalMarginal(Marginal):
    """Normal, truncated at `low` and `high`, which may be infinite."""

    mean: float
    std: float
    low: float = -np.inf
    high: float = np.inf

    def quantile(self, u: Array) -> Array:
        from scipy.special import ndtr, ndtri

        a, b = (ndtr((end - self.mean) / self.std) for end in (self.low, self.high))
        z = self.mean + self.std * ndtri(np.clip(a + (b - a) * u, LEAST, MOST))
        return np.asarray(np.clip(z, self.low, self.high))

    def level(self, u: Array) -> Array:
        """Return levels: the ends, or three standard deviations if infinite."""
        low = max(self.low, self.mean - 3 * self.std)
        high = min(self.high, self.mean + 3 * self.std)
        return low + (high - low) * u


@dataclass(frozen=True)
class ChoiceMarginal(Marginal):
    """One of several values, by index."""

    values: tuple[Any, ...]
    weights: tuple[float, ...]

    def quantile(self, u: Array) -> Array:
        """Return indices."""
        ends = np.cumsum(self.weights[:-1]) / np.sum(self.weights)
        return np.searchsorted(ends, u, side="right").astype(float)

    def level(self, u: Array) -> Array:
        return np.round(u * (len(self.values) - 1))


class Varied(Part):
    """A varied quantity."""

    what: Line
    """Key of the machine, such as magnet.air_gap, or of the run, such as
    scenario.disturbance.amplitude.
    """
    levels: Annotated[int, Field(ge=2, le=100_000, strict=True)] | None = None
    """Number of its values on a grid."""

    def marginal(self, key: Key) -> Marginal:
        """Return the distribution."""
        raise NotImplementedError

    def in_units(self, key: Key) -> Varied:
        """Return it with its numbers as texts with units, for a file."""
        if key.unit in ("", "1"):
            return self

        def with_unit(value: Any) -> Any:
            if isinstance(value, tuple):
                return tuple(map(with_unit, value))
            return (
                units.engineering(value, key.unit, digits=None) if type(value) is float else value
            )

        names = [
            n for n in ("low", "high", "tolerance", "mean", "std", "values") if hasattr(self, n)
        ]
        return self.model_copy(update={name: with_unit(getattr(self, name)) for name in names})

    def _number(self, name: str, key: Key, *, about: bool = False) -> float:
        """Return one of the values in SI; a share with `about` is relative to the nominal value."""
        value = getattr(self, name)
        if not key.unit:
            raise InvalidValue("what", f'{self.what} is no number: let it vary by type = "choice"')
        if isinstance(value, _WithoutUnit) and key.unit != "1":
            raise InvalidValue(
                name, f"{value:g} has no unit, write it in {key.unit} or in % of nominal"
            )
        if isinstance(value, float):
            return float(value)
        try:
            if value.strip().endswith("%"):
                share = units.parse(value, "1")
                if not isinstance(key.value, float) or not key.value:
                    raise InvalidValue(
                        name, f"{value}: {self.what} has no nominal value to be a share of"
                    )
                return share * (abs(key.value) if about else key.value)
            return units.parse(value, key.unit)
        except ValueError as error:
            raise InvalidValue(name, str(error)) from None


class Uniform(Varied):
    """Uniform between two ends, or around the nominal value."""

    type: Literal["uniform"] = "uniform"
    low: Value | None = None
    """Lower end."""
    high: Value | None = None
    """Upper end."""
    tolerance: Value | None = None
    """Instead of the ends: maximum deviation from the nominal value, in both directions."""

    def marginal(self, key: Key) -> Marginal:
        if self.tolerance is not None:
            if self.low is not None or self.high is not None:
                raise InvalidValue("tolerance", "give either tolerance, or low and high")
            tolerance = _positive("tolerance", self._number("tolerance", key, about=True))
            nominal = _nominal("tolerance", self.what, key)
            return UniformMarginal(nominal - tolerance, nominal + tolerance)
        for name in ("low", "high"):
            if getattr(self, name) is None:
                raise InvalidValue(name, "missing: give low and high, or tolerance")
        return _between(UniformMarginal, self._number("low", key), self._number("high", key))


class Normal(Varied):
    """Normal distribution."""

    type: Literal["normal"] = "normal"
    mean: Value | None = None
    """Mean. By default the nominal value."""
    std: Value
    """Standard deviation."""

    def marginal(self, key: Key) -> Marginal:
        return NormalMarginal(*self._mean_and_std(key))

    def _mean_and_std(self, key: Key) -> tuple[float, float]:
        std = _positive("std", self._number("std", key, about=True))
        mean = _nominal("mean", self.what, key) if self.mean is None else self._number("mean", key)
        return mean, std


class Truncated(Normal):
    """Truncated normal distribution."""

    type: Literal["truncated"] = "truncated"  # type: ignore[assignment]
    low: Value
    """Lower end."""
    high: Value
    """Upper end."""

    def marginal(self, key: Key) -> Marginal:
        mean, std = self._mean_and_std(key)
        low, high = self._number("low", key), self._number("high", key)
        if low > mean + 8 * std or high < mean - 8 * std:
            raise InvalidValue("low", "all of the distribution lies beyond the ends")
        return _between(lambda a, b: NormalMarginal(mean, std, a, b), low, high)


class Choice(Varied):
    """One of several values, such as kinds of filters."""

    type: Literal["choice"] = "choice"
    values: Annotated[tuple[Value, ...], Field(min_length=1)]
    """The values."""
    weights: tuple[Annotated[float, Field(gt=0)], ...] | None = None
    """Relative frequencies. By default equal."""

    def marginal(self, key: Key) -> Marginal:
        weights = self.weights or (1.0,) * len(self.values)
        if len(weights) != len(self.values):
            raise InvalidValue(
                "weights", f"must be {len(self.values)}, as many as values; are {len(weights)}"
            )
        return ChoiceMarginal(tuple(self._choice(value, key) for value in self.values), weights)

    def _choice(self, value: float | str, key: Key) -> Any:
        if not key.unit:
            return value
        return Normal(what=self.what, std=value, mean=value)._number("mean", key)


Vary = Annotated[Uniform | Normal | Truncated | Choice, Field(discriminator="type")]


def _positive(name: str, value: float) -> float:
    if not value > 0:
        raise InvalidValue(name, "must be greater than 0")
    return value


def _nominal(name: str, what: str, key: Key) -> float:
    if not isinstance(key.value, float):
        raise InvalidValue(name, f"{what} has no nominal value: give its values")
    return key.value


def _between(of: Callable[[float, float], Marginal], low: float, high: float) -> Marginal:
    if not low < high:
        raise InvalidValue("high", "must be greater than low")
    return of(low, high)
