"""The kinds of estimators by name: how each is made, called in C, and what can be tuned in it.

A new kind is a C file with its binding, a Python file, and a line of `KINDS`; commands, exports and
comparisons take theirs from here. Classes stand as names: the commands show the kinds in their help
and must not wait for numpy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any

from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import MARK
from ambkit.estimate import DEFAULT
from ambkit.estimate.estimator import Estimator
from ambkit.machine.axes import Bank, bank_of, constants_of, laws_of
from ambkit.machine.force_law import MagnetModel
from ambkit.machine.machine import Machine


@dataclass(frozen=True)
class InCore:
    """How a kind is called in the core (``ambkit/estimator.h``)."""

    binding: str  #: Class of ``ambkit._core``; in C the same with underscores.
    #: Whether it has numbers that only this kind has, and so a file of its own.
    has_own: bool = True
    #: Whether its state is more than an ``amb_kalman_state``; it has a file of its own then, too.
    has_state: bool = False
    base: str = ""  #: Where in such a state the members of ``amb_kalman_state`` are.
    #: Where the covariance is that the others of such a state follow from; by default the base's.
    covariance: str = ""
    calls: tuple[str, ...] = ()  #: Files that it calls besides.

    @property
    def methods(self) -> str:
        """The name of its ``amb_estimator_methods``."""
        return f"amb_{self._stem}_methods"

    @property
    def source(self) -> str:
        """The C file that it is in, without suffix."""
        return self.casts[0] if self.casts else "estimator"

    @property
    def casts(self) -> tuple[str, ...]:
        """The files that cast its state or what is its own back from ``void *``."""
        return (self._stem,) if self.has_own or self.has_state else ()

    @property
    def state(self) -> str:
        """The C type of its state."""
        return f"amb_{self._stem}_state" if self.has_state else "amb_kalman_state"

    @property
    def own(self) -> str:
        """The C type of what only this kind has; empty where it has nothing."""
        return f"amb_{self._stem}" if self.has_own else ""

    @property
    def _stem(self) -> str:
        return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", self.binding).lower()


PAPER = InCore("Kalman", has_own=False)
"""The paper's filter, linear or adaptive by its magnet; its own step is faster."""

_OBSERVER = InCore("Observer")
_EXTENDED = InCore("Extended", has_own=False)
_ADAPTIVE_NOISE = InCore("AdaptiveNoise", has_state=True, base="inner.base.")


@dataclass(frozen=True)
class Tunable:
    """A positive parameter that tuning may change by some decades."""

    #: Of the argument of :meth:`Kind.make`, or ``noise.measurement``, ``noise.control``,
    #: ``noise.disturbance`` for the variances of :class:`ambkit.FilterNoise`.
    name: str
    unit: str  #: Of the argument.
    default: Callable[[Machine], float]  #: Its value for a bearing.
    decades: float = 2.0  #: How far from the default the search goes, to either side.


def _noise(name: str) -> Callable[[Machine], float]:
    def value(machine: Machine) -> float:
        from ambkit.estimate.kalman import KalmanFilter

        own = getattr(KalmanFilter(machine).variances, name)
        if not isinstance(own, tuple):
            return float(own)
        return math.exp(math.fsum(map(math.log, own)) / len(own))  # of a machine, their mean

    return value


NOISE = (
    Tunable("noise.measurement", "m^2", _noise("measurement")),
    Tunable("noise.control", "V^2", _noise("control")),
    Tunable("noise.disturbance", "N^2/s", _noise("disturbance"), decades=3.0),
)


@dataclass(frozen=True)
class Kind:
    """A kind of estimator."""

    name: str  #: As the commands know it.
    label: str  #: In words, for reports.
    of: str  #: Its class, by module and name in ``ambkit.estimate``.
    core: InCore  #: How the core calls it.
    #: What it knows of a bearing's magnet; None where the caller gives that, as a trained expert or
    #: a table.
    magnet: Callable[[Any], MagnetModel] | None
    tunable: tuple[Tunable, ...] = NOISE  #: What tuning may change.
    #: Around the class comes an :class:`ambkit.AdaptiveNoise` with these options.
    finds_noise: Mapping[str, Any] | None = None
    ratios: tuple[str, ...] = ()  #: Options that are numbers without a unit, and not tuned.
    given: str = ""  #: The class of magnet by which it is told from others of its class.

    def make(
        self, machine: Machine, magnet: MagnetModel | None = None, **options: Any
    ) -> Estimator:
        """Build one."""
        if magnet is None and self.magnet is not None:
            magnet = self.magnet(machine)
        of: Any = self.estimator
        if self.finds_noise is None:
            return of(machine, magnet, **options)  # type: ignore[no-any-return]
        from ambkit.estimate.adaptive_noise import AdaptiveNoise

        outer = {name: options.pop(name) for name in _OUTER if name in options}
        return AdaptiveNoise(of(machine, magnet, **options), **self.finds_noise, **outer)

    @property
    def estimator(self) -> type[Estimator]:
        """Its class; around it may come an :class:`ambkit.AdaptiveNoise`."""
        module, called = self.of.split(".")
        result: type[Estimator] = getattr(import_module(f"ambkit.estimate.{module}"), called)
        return result

    @property
    def option_units(self) -> dict[str, str]:
        """SI unit of each option that a file may have, by name; empty of a word."""
        known = {item.name: item.unit for item in self.tunable if "noise." not in item.name}
        outer = {} if self.finds_noise is None else {"window": "s", "most": "1"}
        return known | dict.fromkeys(self.ratios, "1") | outer


_OUTER = ("memory", "window", "most")  # options of AdaptiveNoise, not of the filter inside

MEMORY = Tunable("memory", "s", lambda _bearing: 0.5, decades=1.0)


def _constant_velocity(function: str) -> Callable[[Machine], Any]:
    """Return what calls a function of a module that is imported then."""
    module = "ambkit.estimate.constant_velocity"
    return lambda machine: getattr(import_module(module), function)(machine)


def _corner(name: str) -> Callable[[Machine], float]:
    def value(machine: Machine) -> float:
        made: Any = KINDS["low-pass"].make(machine)
        return float(made.corners[name])

    return value


def _bandwidth(machine: Machine) -> float:
    made: Any = KINDS["observer"].make(machine)
    return float(made.bandwidth)


KINDS = {
    kind.name: kind
    for kind in (
        Kind(
            "low-pass", "low-pass and derivative",
            "low_pass.LowPass", InCore("LowPass", has_state=True, base="base."), constants_of,
            (
                Tunable("position", "rad/s", _corner("position")),
                Tunable("velocity", "rad/s", _corner("velocity")),
                Tunable("force", "rad/s", _corner("force")),
            ),
        ),
        Kind(
            "constant-velocity", "Kalman filter, constant velocity",
            "constant_velocity.ConstantVelocity", PAPER, _constant_velocity("no_force_of"),
            (
                Tunable("noise.measurement", "m^2", _noise("measurement")),
                Tunable("acceleration", "m^2/s^3", _constant_velocity("usual_acceleration"),
                        decades=4.0),
            ),
        ),
        Kind(
            "observer", "extended state observer",
            "observer.ExtendedStateObserver", _OBSERVER, constants_of,
            (Tunable("bandwidth", "rad/s", _bandwidth, decades=1.0),),
        ),
        Kind("linear", "linear Kalman filter", "kalman.KalmanFilter", PAPER, constants_of),
        Kind(
            "steady-state", "steady-state Kalman filter",
            "observer.SteadyStateKalmanFilter", _OBSERVER, constants_of,
        ),
        Kind(
            "table", "Kalman filter, stiffness table",
            "kalman.AdaptiveKalmanFilter", PAPER, None, given="StiffnessMap",
        ),
        Kind(
            "adaptive", "adaptive Kalman filter, fuzzy expert",
            "kalman.AdaptiveKalmanFilter", PAPER, None, given="Expert",
        ),
        Kind(
            "closed-law", "Kalman filter, closed law",
            "kalman.AdaptiveKalmanFilter", PAPER, laws_of,
        ),
        Kind(
            "extended", "extended Kalman filter",
            "kalman.ExtendedKalmanFilter", _EXTENDED, laws_of,
        ),
        Kind(
            "ud", "UD-factorised Kalman filter",
            "kalman.UDKalmanFilter",
            InCore("UD", has_own=False, has_state=True, base="base."), laws_of,
        ),
        Kind(
            "augmented", "augmented-state extended Kalman filter",
            "augmented.AugmentedKalmanFilter",
            InCore(
                "Augmented", has_state=True, base="base.", covariance="cov", calls=("excitation",)
            ),
            laws_of,
            (*NOISE, Tunable("wander", "1/s", lambda _: 0.01)),
            ratios=("scale_std", "excitation", "least", "most"),
        ),
        Kind(
            "multiple-model", "interacting multiple models",
            "augmented.MultipleModelFilter",
            InCore("MultipleModel", has_state=True, base="base.", calls=("excitation",)), laws_of,
            (*NOISE, Tunable("sojourn", "s", lambda _: 1.0, decades=1.0)),
            ratios=("scales", "excitation"),
        ),
        Kind(
            "unscented", "unscented Kalman filter",
            "unscented.UnscentedKalmanFilter", InCore("Unscented"), laws_of,
            ratios=("alpha", "beta", "kappa"),
        ),
        Kind(
            "contact", "extended Kalman filter, contact with stops",
            "contact.ContactKalmanFilter", InCore("Contact"), laws_of, ratios=("scatter",),
        ),
        Kind(
            "linear-adaptive-noise", "linear Kalman filter, R found online",
            "kalman.KalmanFilter", _ADAPTIVE_NOISE, constants_of, (*NOISE, MEMORY),
            {"method": "sage-husa", "adapts": "measurement"},
        ),
        Kind(
            "extended-adaptive-noise", "extended Kalman filter, R and Q found online",
            "kalman.ExtendedKalmanFilter", _ADAPTIVE_NOISE, laws_of, (*NOISE, MEMORY),
            {"method": "innovation", "adapts": "both"},
        ),
    )
}  # fmt: skip
"""All kinds, from the simplest on."""

FILTER_SUFFIX = ".toml"  #: Of a filter's file, which may stand wherever an estimator is named.


def kind_called(name: str) -> Kind:
    """Return a kind by its name."""
    if not isinstance(name, str) or name not in KINDS:
        raise AmbkitError(f'there is no filter "{name}"; known: {", ".join(KINDS)}')
    return KINDS[name]


def default_filter(machine: Machine) -> Estimator:
    """Return the filter of a machine for which none is named."""
    return KINDS[DEFAULT].make(machine)


def check_named(name: str) -> None:
    """Refuse what is neither a kind, ``"all"`` of them, a filter's file, nor a user's class."""
    is_kind = name == "all" or name.partition("@")[0].partition("+")[0] in KINDS
    if not (is_kind or name.endswith((FILTER_SUFFIX, ".json", ".csv", ".parquet")) or MARK in name):
        known = (
            f"known: {', '.join(KINDS)}, all, the file of a filter ({FILTER_SUFFIX}), of an expert "
            "(.json) or a force map (.csv), or a class of your own as file.py:Class"
        )
        raise AmbkitError(f'there is no filter "{name}"; {known}')


_OF_BINDING = {kind.core.binding: kind.core for kind in KINDS.values()}


def in_core_of(estimator: Estimator) -> InCore | None:
    """Return how the core calls an estimator's kind; None for one that is of no kind here."""
    return _OF_BINDING.get(type(estimator.core).__name__)


def kind_of(estimator: Estimator) -> str:
    """Return the name of an estimator's kind."""
    # Of the kinds that share a class, what the estimator knows of its magnet tells which it is.

    inner = getattr(estimator, "inner", estimator)
    of = f"{type(inner).__module__.rpartition('.')[2]}.{type(inner).__name__}"
    around = inner is not estimator
    results = [
        k.name for k in KINDS.values() if k.of == of and (k.finds_noise is not None) == around
    ]
    magnet: Any = estimator.magnet
    if isinstance(magnet, Bank):  # the axes of a machine are asked alike
        magnet = magnet.models[0]
    if not results:
        raise AmbkitError(f"the {estimator.name} is of no kind that a file can name")
    return next((k for k in results if KINDS[k].given == type(magnet).__name__), results[-1])


def learned_magnet(name: str, machine: Machine) -> MagnetModel | None:
    """Return what a kind that must be given its magnet knows of it where nobody says otherwise."""
    if KINDS[name].magnet is not None:
        return None
    from ambkit.machine.stiffness import stiffness_map

    learn: Callable[[Machine], MagnetModel] = stiffness_map if name == "table" else _trained
    learned: dict[str, MagnetModel] = {}
    for axis in machine.axes:
        if axis.bearing.name not in learned:  # both axes of a bearing have one magnet
            learned[axis.bearing.name] = learn(machine.isolated_axis(axis.name))
    return bank_of([learned[axis.bearing.name] for axis in machine.axes], machine)


@lru_cache(maxsize=64)
def _trained(axis: Machine) -> MagnetModel:
    """Return the default expert of an axis."""
    from ambkit.fuzzy.training import train

    return train(axis, weights=True)
