"""Who takes part: the registry's kinds, and the user's own from a Python file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.named import FromFile, factories
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import KINDS, Tunable, check_named
from ambkit.estimate.user_filter import OwnEstimator
from ambkit.machine.machine import Machine

if TYPE_CHECKING:
    from ambkit.machine.magnets import MagnetModel


@dataclass(frozen=True)
class Range:
    """Where tuning looks for a value, evenly in its logarithm."""

    name: str  #: As its kind calls it: ``noise.disturbance``, ``bandwidth``.
    unit: str  #: SI.
    default: float  #: Greater than 0.
    low: float
    high: float


@dataclass(frozen=True)
class Candidate:
    """An estimator that takes part."""

    name: str  #: As the user calls it.
    label: str  #: As it stands in pictures.
    #: ``build(**values)`` makes a fresh one, with values of its tunables.
    build: Callable[..., Any]
    tunable: tuple[Range, ...] = ()  #: What can be tuned of it.
    #: Whether it can be in the simulated loop, which is C; one in Python runs beside it.
    in_loop: bool = True

    @property
    def defaults(self) -> dict[str, float]:
        """Values of the tunables as they are without tuning."""
        return {item.name: item.default for item in self.tunable}


def candidates(
    names: Sequence[str],
    bearing: Machine,
    magnets: Mapping[str, MagnetModel] | None = None,
    custom: Mapping[str, Any] | None = None,
) -> dict[str, Candidate]:
    """Return who takes part, by name."""
    results = {}
    for name in names:
        if name in KINDS:
            results[name] = candidate_of_kind(name, bearing, (magnets or {}).get(name))
            continue
        (build,) = factories([name], bearing).values()
        if isinstance(build, FromFile):
            label = f"{KINDS[build.file.kind].label} ({Path(name).stem})"
            results[name] = Candidate(name, label, build)
        else:
            own_name = name.rpartition(":")[2]
            results[own_name] = Candidate(own_name, own_name, build, in_loop=False)
    for own_name, build in factories(custom or {}, bearing).items():
        in_core = not isinstance(build(), OwnEstimator)
        results[own_name] = Candidate(own_name, own_name, build, in_loop=in_core)
    return results


def suited(names: Sequence[str], bearing: Machine) -> list[str]:
    """Return the names; where all kinds are named without those that take a single axis only."""
    if bearing.single or not set(KINDS) <= set(names):
        return list(names)
    return [name for name in names if name not in KINDS or KINDS[name].estimator.several_axes]


def expand(text: str) -> list[str]:
    """Split a list of names, such as ``linear,my.py:MyFilter``; ``all`` is every kind."""
    results: dict[str, None] = {}
    for name in filter(None, map(str.strip, text.split(","))):
        if name == "all":
            results |= dict.fromkeys(KINDS)
        else:
            check_named(name)
            results[name] = None
    if not results:
        raise AmbkitError(f"no estimator is named; known: all, {', '.join(KINDS)}")
    return list(results)


def candidate_of_kind(
    name: str, bearing: Machine, magnet: MagnetModel | None = None, *, whole: bool = False
) -> Candidate:
    """Return a kind of estimator as one who takes part."""
    kind = KINDS[name]

    def build(**values: float) -> Any:
        noise: dict[str, Any] = {
            key.removeprefix("noise."): v for key, v in values.items() if "noise." in key
        }
        own = KalmanFilter(bearing).variances._asdict() if noise else {}
        for key, item in own.items():  # of several axes all are scaled alike
            if key in noise and isinstance(item, tuple):
                scale = noise[key] / means[key]
                noise[key] = tuple(scale * variance for variance in item)
        rest = {key: value for key, value in values.items() if "noise." not in key}
        try:
            return kind.make(bearing, magnet, noise=FilterNoise(**noise), **rest)
        except ValueError as error:  # not every kind is of several axes
            raise AmbkitError(str(error)) from error

    free = {t.name: t for t in kind.tunable}
    if not whole and {"noise.control", "noise.disturbance"} <= free.keys():
        free.pop("noise.measurement", None)
    ranges = tuple(_range(t, bearing) for t in free.values())
    means = {range_.name.removeprefix("noise."): range_.default for range_ in ranges}
    return Candidate(name, kind.label, build, ranges)


def _range(tunable: Tunable, bearing: Any) -> Range:
    default, range_factor = tunable.default(bearing), 10**tunable.decades
    return Range(
        tunable.name, tunable.unit, default, default / range_factor, default * range_factor
    )
