"""Who takes part: the registry's kinds, and the user's own from a Python file."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.estimate.estimate import Estimate, Status
from ambkit.estimate.filter_file import FilterFile
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.noise import FilterNoise
from ambkit.estimate.registry import FILTER_SUFFIX, KINDS, Tunable
from ambkit.machine.machine import Machine, as_machine

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.machine.bearing import Bearing
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
class Contender:
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
        return {each.name: each.default for each in self.tunable}


def contenders(
    names: Sequence[str],
    bearing: Bearing | Machine,
    magnets: Mapping[str, MagnetModel] | None = None,
    custom: Mapping[str, Callable[..., Any]] | None = None,
) -> dict[str, Contender]:
    """Return who takes part, by name."""
    found = {}
    for name in names:
        if name in KINDS:
            found[name] = contender_of_kind(name, bearing, (magnets or {}).get(name))
        elif name.endswith(FILTER_SUFFIX):
            file = FilterFile.load_for(name, bearing)
            label = f"{KINDS[file.kind].label} ({Path(name).stem})"
            found[name] = Contender(name, label, file.make)
        elif ".py:" in name:
            own_name, make = load_class(name)
            found[own_name] = _of_user(own_name, make, bearing)
        else:
            raise _unknown(name)
    for own_name, make in (custom or {}).items():
        found[own_name] = _of_user(own_name, make, bearing)
    return found


def suited(names: Sequence[str], bearing: Bearing | Machine) -> list[str]:
    """Return the names; where all kinds are named without those that take a single axis only."""
    if as_machine(bearing).single or not set(KINDS) <= set(names):
        return list(names)
    return [name for name in names if name not in KINDS or KINDS[name].estimator.several_axes]


def expand(text: str) -> list[str]:
    """Split a list of names, such as ``linear,my.py:MyFilter``; ``all`` is every kind."""
    found: dict[str, None] = {}
    for name in filter(None, map(str.strip, text.split(","))):
        if name == "all":
            found |= dict.fromkeys(KINDS)
        elif name in KINDS or ".py:" in name or name.endswith(FILTER_SUFFIX):
            found[name] = None
        else:
            raise _unknown(name)
    if not found:
        raise AmbkitError(f"no estimator is named; known: all, {', '.join(KINDS)}")
    return list(found)


def _unknown(name: str) -> AmbkitError:
    return AmbkitError(
        f'there is no estimator "{name}"; known: all, {", ".join(KINDS)}, a filter from its '
        "file (.toml), or one of your own as file.py:Class"
    )


def contender_of_kind(
    name: str, bearing: Bearing | Machine, magnet: MagnetModel | None = None, *, whole: bool = False
) -> Contender:
    """Return a kind of estimator as one who takes part."""
    kind = KINDS[name]

    def build(**values: float) -> Any:
        noise: dict[str, Any] = {
            key.removeprefix("noise."): v for key, v in values.items() if "noise." in key
        }
        own = KalmanFilter(bearing).variances._asdict() if noise else {}
        for key, each in own.items():  # of several axes all are scaled alike
            if key in noise and isinstance(each, tuple):
                scale = noise[key] / means[key]
                noise[key] = tuple(scale * variance for variance in each)
        rest = {key: value for key, value in values.items() if "noise." not in key}
        try:
            return kind.make(bearing, magnet, noise=FilterNoise(**noise), **rest)
        except ValueError as error:  # not every kind is of several axes
            raise AmbkitError(str(error)) from error

    free = {t.name: t for t in kind.tunable}
    if not whole and {"noise.control", "noise.disturbance"} <= free.keys():
        free.pop("noise.measurement", None)
    ranges = tuple(_range(t, bearing) for t in free.values())
    means = {each.name.removeprefix("noise."): each.default for each in ranges}
    return Contender(name, kind.label, build, ranges)


def _range(tunable: Tunable, bearing: Any) -> Range:
    default, reach = tunable.default(bearing), 10**tunable.decades
    return Range(tunable.name, tunable.unit, default, default / reach, default * reach)


# ---- the user's own ----


def load_class(text: str) -> tuple[str, Callable[..., Any]]:
    """Return name and class of an estimator in a Python file."""
    path, _, name = text.rpartition(":")
    if not Path(path).is_file():
        raise AmbkitError(f"{path}: there is no such file")
    module_name = f"ambkit_own_{Path(path).stem}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None  # it ends with .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # dataclasses look it up
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise AmbkitError(f"{path}: {type(error).__name__}: {error}") from error
    make = getattr(module, name, None)
    if not callable(make):
        there = [key for key, value in vars(module).items() if isinstance(value, type)]
        hint = f"; it has {', '.join(there)}" if there else ""
        raise AmbkitError(f"{path}: there is no class {name}{hint}")
    return name, make


def _of_user(name: str, make: Callable[..., Any], bearing: Any) -> Contender:
    import inspect

    try:
        takes = len(inspect.signature(make).parameters)
    except (TypeError, ValueError):
        takes = 1

    def build() -> PythonEstimator:
        try:
            made = make(bearing) if takes else make()
        except Exception as error:
            given = "with the bearing" if takes else "without arguments"
            raise AmbkitError(
                f"{name}: it is made {given}, and fails: {type(error).__name__}: {error}"
            ) from error
        return PythonEstimator(made, bearing, name)

    build()  # what is wrong with it is told before the work begins
    return Contender(name, name, build, in_loop=False)


@dataclass
class PythonEstimator:
    """An object with ``step(y, u)``, run along a record sample by sample."""

    #: ``step(y, u)`` takes the measured position [m] and the control signal that acted since the
    #: last sample [V], of several axes arrays of them, and returns the first states of the linear
    #: filter up to the sensors', of one axis x [m], v [m/s], f_d [N], x_m [m]. What it does not
    #: estimate is NaN. If it has ``reset(mean, std)``, it gets its start, as all others do.
    wrapped: Any
    bearing: Bearing | Machine  #: What is filtered.
    name: str  #: Its name.

    def __post_init__(self) -> None:
        if not callable(getattr(self.wrapped, "step", None)):
            raise AmbkitError(f"{self.name}: an estimator needs a method step(y, u)")

    def run(self, record: Record, *, covariance: bool = False) -> Estimate:
        """Run along a record; at the first sample, u is the record's first."""
        other = KalmanFilter(self.bearing)
        view = other.view
        last = max(k for k, state in enumerate(other.states) if state.role == "sensor")
        states = other.states[: last + 1]
        y, u = view.signals(record)
        if callable(getattr(self.wrapped, "reset", None)):
            start, std = other.at_first(y), np.array(other.default_std())
            self.wrapped.reset(start[: len(states)], std[: len(states)])
        mean = np.empty((len(y), len(states)))
        readings, acted = (each.tolist() if view.single else list(each) for each in (y, u))
        acted = [acted[0], *acted[:-1]]
        for k in range(len(y)):
            try:
                found = np.asarray(self.wrapped.step(readings[k], acted[k]), float)
                if found.shape != (len(states),):
                    raise ValueError(f"it returned an array of shape {found.shape}")
            except Exception as error:
                names = ", ".join(state.name for state in states)
                raise AmbkitError(
                    f"{self.name}: step(y, u) at sample {k}: {type(error).__name__}: {error}; it "
                    f"must return the {len(states)} numbers {names}"
                ) from error
            mean[k] = found
        unknown: NDArray[np.float64] = np.full(y.shape, np.nan)
        stiffness: NDArray[np.float64] = np.full(u.shape, np.nan)
        status = np.full(len(y), Status.OK, dtype=np.uint16)
        axes, measured = (
            () if view.single else tuple(each.name for each in of)
            for of in (view.machine.axes, view.machine.readings)
        )
        return Estimate(
            record.t, mean, unknown, unknown, stiffness, stiffness, status, None, self.name,
            states, axes=axes, readings=measured,
        )  # fmt: skip
