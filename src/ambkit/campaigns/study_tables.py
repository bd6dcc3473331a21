"""Tables of a study: stored data, criteria of a good machine, stopping criterion."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from ambkit.base import units
from ambkit.base.config import Part, unknown_key
from ambkit.base.config.quantities import Line, Name, Quantity
from ambkit.campaigns.distributions import Value
from ambkit.data.signals import signal
from ambkit.simulation.run_figures import FIGURES

ZONES = ("A", "B", "C", "D")  #: Zones of ISO 14839-3, best first.

TRACES = ("r", "y", "u", "x", "v", "f_d", "x_m", "iu", "f_mag")
"""Signals of a run; with suffix ``_estimate`` each state of its estimator."""

UNITS = {name: figure.unit for name, figure in FIGURES.items()} | {"peak_S": "1"}
"""Of the figures of a run."""


def traces_of(plant: Any) -> tuple[str, ...]:
    """Return the signals of a machine's run."""
    if plant is None or plant.single:
        return TRACES
    axes = plant.axis_names
    results = [f"{of}_{name}" for of in ("s", "r", "u", "iu", "f_mag", "f_d") for name in axes]
    results += [signal("y", reading.name) for reading in plant.readings]
    return (*results, *(f"q_{name}" for name in plant.positions), "speed")


class Correlated(Part):
    """Correlation of two varied quantities."""

    between: tuple[Line, Line]
    """Their keys."""
    coefficient: Annotated[float, Field(gt=-1, lt=1)]
    """Correlation of their normal scores; for normal distributions their own."""


class Recorded(Part):
    """Data of a run that is stored besides its metrics."""

    margins: Annotated[bool, Field(strict=True)] = True
    """Whether to compute the sensitivity peak and its zone."""
    traces: tuple[Line, ...] = ()
    """Signals to store, such as x or f_d_estimate."""
    every: Annotated[int, Field(ge=1, strict=True)] = 100
    """Store the signals of one run in so many."""
    settling: Annotated[float, Quantity("s", "20 ms", at_least=0)] = 0.0
    """Initial time of a run that is not evaluated [s]."""
    band: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Share of the clearance within which a rotor has recovered from a disturbance."""


class Criteria(Part):
    """Criteria of a good machine."""

    zone: Literal["A", "B", "C"] | None = None
    """Worst permissible zone of ISO 14839-3. By default any."""
    contact: Annotated[bool, Field(strict=True)] = False
    """Whether the rotor may touch a stop."""
    at_most: dict[Name, Value] = Field(default_factory=dict)
    """Limits of metrics by name, such as recovery = "50 ms"."""


class Stop(Part):
    """Criterion for an early end."""

    width: Annotated[float, Quantity("1", "0.02", above=0)]
    """Maximum width of the confidence interval of the yield [1]."""
    least: Annotated[int, Field(ge=1, strict=True)] = 1000
    """Minimum number of runs."""


def limit_of(name: str, limit: float | str) -> float:
    """Return a limit of a figure in SI."""
    if name not in UNITS:
        raise ValueError(unknown_key(name, UNITS))
    unit = UNITS[name]
    if isinstance(limit, str):
        return units.parse(limit, unit)
    if unit != "1" and type(limit) is not float:  # from a file
        raise ValueError(f"{limit:g} has no unit, write it in {unit}")
    return float(limit)
