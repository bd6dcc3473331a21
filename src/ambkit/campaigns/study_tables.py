"""Tables of a study: what is kept, which machines are good, when it is enough."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from ambkit.base import units
from ambkit.base.config import Part, unknown_key
from ambkit.base.config.quantities import Quantity
from ambkit.base.config.text_types import Line, Name
from ambkit.campaigns.distributions import Value
from ambkit.data.signals import signal
from ambkit.simulation.run_figures import FIGURES

ZONES = ("A", "B", "C", "D")  #: Zones of ISO 14839-3, the best first.

TRACES = ("r", "y", "u", "x", "v", "f_d", "x_m", "iu", "f_mag")
"""Signals of a run, and with ``_estimate`` behind it each state of its estimator."""

UNITS = {name: figure.unit for name, figure in FIGURES.items()} | {"peak_S": "1"}
"""Of the figures of a run."""


def traces_of(plant: Any) -> tuple[str, ...]:
    """Return the signals that a run of a machine has."""
    if plant is None or plant.single:
        return TRACES
    axes = [axis.name for axis in plant.axes]
    results = [f"{of}_{name}" for of in ("s", "r", "u", "iu", "f_mag", "f_d") for name in axes]
    results += [signal("y", reading.name) for reading in plant.readings]
    return (*results, *(f"q_{name}" for name in plant.positions), "speed")


class Correlated(Part):
    """Two quantities that vary together."""

    between: tuple[Line, Line]
    """Their keys."""
    coefficient: Annotated[float, Field(gt=-1, lt=1)]
    """Correlation of their normal scores; of normal ones their own."""


class Recorded(Part):
    """What is kept of a run besides its figures."""

    margins: Annotated[bool, Field(strict=True)] = True
    """Whether the peak of the sensitivity is found, and its zone."""
    traces: tuple[Line, ...] = ()
    """Signals that are kept, such as x or f_d_estimate."""
    every: Annotated[int, Field(ge=1, strict=True)] = 100
    """Of each so many runs one has its traces kept."""
    settling: Annotated[float, Quantity("s", "20 ms", at_least=0)] = 0.0
    """At the start of a run, how long errors do not count [s]."""
    band: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Share of the travel within which a rotor has recovered from a load."""


class Passes(Part):
    """What a machine must be to count as good."""

    zone: Literal["A", "B", "C"] | None = None
    """Worst zone of ISO 14839-3 that is allowed; without it, any."""
    contact: Annotated[bool, Field(strict=True)] = False
    """Whether the rotor may touch a stop."""
    at_most: dict[Name, Value] = Field(default_factory=dict)
    """Limits of figures, by their names, such as recovery = "50 ms"."""


class Stop(Part):
    """When fewer runs are enough."""

    width: Annotated[float, Quantity("1", "0.02", above=0)]
    """The confidence interval of the yield is no wider than this [1]."""
    least: Annotated[int, Field(ge=1, strict=True)] = 1000
    """But so many runs at least."""


def limit_of(name: str, limit: float | str) -> float:
    """Return a limit of a figure in SI."""
    if name not in UNITS:
        raise ValueError(unknown_key(name, UNITS))
    unit = UNITS[name]
    if isinstance(limit, str):
        return units.parse(limit, unit)
    if unit != "1" and type(limit) is not float:  # out of a file
        raise ValueError(f"{limit:g} has no unit, write it in {unit}")
    return float(limit)
