"""Registry of the kinds of estimators: construction, C interface, tunables.

A new kind is a C file with its binding, a Python file, and a line of `KINDS`, which commands,
exports and comparisons use. Classes are listed by name, so that the help of a command does not
import numpy.
"""

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
from ambkit.machine.axes import ForceLaws, constant_stiffness, force_laws, ideal_laws
from ambkit.machine.force_law import MagnetModel, core_module
from ambkit.machine.machine import Machine


@dataclass(frozen=True)
class CoreKernel:
    """A kind in the core (``ambkit/estimator.h``)."""

    binding: str  #: Class of ``ambkit._core``; in C the same with underscores.
    #: Whether it has data of its own kind, in a file of its own.
    has_own: bool = True
    #: Whether its state is more than an ``amb_kalman_state``, in a file of its own.
    has_state: bool = False
    base: str = ""  #: Path of ``amb_kalman_state`` in such a state.
    #: Path of the covariance that determines the others of such a state; by default the base's.
    covariance: str = ""
    calls: tuple[str, ...] = ()  #: Further files that it calls.

    @property
    def deenergises(self) -> bool:
        """Whether it predicts without magnet forces where there is no current."""
        return hasattr(getattr(core_module(), self.binding), "deenergise")

    @property
    def methods(self) -> str:
        """Name of its ``amb_estimator_methods``."""
        return f"amb_{self._stem}_methods"

    @property
    def source(self) -> str:
        """Name of its C file, without suffix."""
        return self.casts[0] if self.casts else "estimator"

    @property
    def casts(self) -> tuple[str, ...]:
        """Files that cast its state or data from ``void *``."""
        return (self._stem,) if self.has_own or self.has_state else ()

    @property
    def state(self) -> str:
        """C type of its state."""
        return f"amb_{self._stem}_state" if self.has_state else "amb_kalman_state"

    @property
    def own(self) -> str:
        """C type of its data; empty if it has none."""
        return f"amb_{self._stem}" if self.has_own else ""

    @property
    def _stem(self) -> str:
        return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", self.binding).lower()


PAPER = CoreKernel("Kalman", has_own=False)
"""The paper's filter, linear or adaptive depending on its magnet; its own step is faster."""

_OBSERVER = CoreKernel("Observer")
_EXTENDED = CoreKernel("Extended", has_own=False)
_ADAPTIVE_NOISE = CoreKernel("AdaptiveNoise", has_state=True, base="inner.base.")


@dataclass(frozen=True)
class Tunable:
    """A positive parameter with a tuning range."""

    #: Argument of :meth:`FilterKind.make`, or ``noise.measurement``, ``noise.control``,
    #: ``noise.disturbance`` for the variances of :class:`ambkit.FilterNoise`.
    name: str
    unit: str  #: Unit of the argument.
    default: Callable[[Machine], float]  #: Its default for a machine.
    decades: float = 2.0  #: Range of the search in decades, on both sides of the default.


def _noise(name: str) -> Callable[[Machine], float]:
    def value(machine: Machine) -> float:
        from ambkit.estimate.kalman import KalmanFilter

        own = getattr(KalmanFilter(machine).variances, name)
        if not isinstance(own, tuple):
            return float(own)
        return math.exp(math.fsum(map(math.log, own)) / len(own))  # for several axes, their mean

    return value


NOISE = (
    Tunable("noise.measurement", "m^2", _noise("measurement")),
    Tunable("noise.control", "V^2", _noise("control")),
    Tunable("noise.disturbance", "N^2/s", _noise("disturbance"), decades=3.0),
)


@dataclass(frozen=True)
class FilterKind:
    """A kind of estimator."""

    name: str  #: Name in the commands.
    label: str  #: Label for reports.
    of: str  #: Its class, by module and name in ``ambkit.estimate``.
    core: CoreKernel  #: Its interface in the core.
    #: Its magnet model; None if the caller provides it, as a trained expert or a table.
    magnet: Callable[[Any], MagnetModel] | None
    tunable: tuple[Tunable, ...] = NOISE  #: Parameters that tuning may change.
    #: Options of the surrounding :class:`ambkit.AdaptiveNoise`, if there is one.
    adaptive_noise: Mapping[str, Any] | None = None
    ratios: tuple[str, ...] = ()  #: Dimensionless options that are not tuned.
    magnet_class: str = ""  #: Class of magnet that distinguishes it from others of its class.

    def make(
        self, machine: Machine, magnet: MagnetModel | None = None, **options: Any
    ) -> Estimator:
        """Build one."""
        if magnet is None and self.magnet is not None:
            magnet = self.magnet(machine)
        of: Any = self.estimator
        if self.adaptive_noise is None:
            return of(machine, magnet, **options)  # type: ignore[no-any-return]
        from ambkit.estimate.adaptive_noise import AdaptiveNoise

        outer = {name: options.pop(name) for name in _OUTER if name in options}
        return AdaptiveNoise(of(machine, magnet, **options), **self.adaptive_noise, **outer)

    @property
    def estimator(self) -> type[Estimator]:
        """Its class, without a surrounding :class:`ambkit.AdaptiveNoise`."""
        module, called = self.of.split(".")
        result: type[Estimator] = getattr(import_module(f"ambkit.estimate.{module}"), called)
        return result

    @property
    def option_units(self) -> dict[str, str]:
        """SI unit of each option of a file, by name; empty for a word."""
        known = {item.name: item.unit for item in self.tunable if "noise." not in item.name}
        outer = {} if self.adaptive_noise is None else {"window": "s", "most": "1"}
        return known | dict.fromkeys(self.ratios, "1") | outer


_OUTER = ("memory", "window", "most")  # options of AdaptiveNoise, not of the inner filter

MEMORY = Tunable("memory", "s", lambda _bearing: 0.5, decades=1.0)


def _constant_velocity(function: str) -> Callable[[Machine], Any]:
    """Return a wrapper that imports a function's module when it is called."""
    module = "ambkit.estimate.constant_velocity"
    return lambda machine: getattr(import_module(module), function)(machine)


def _made(kind: str, value: Callable[[Any], float]) -> Callable[[Machine], float]:
    """Return a function for a value of a kind as made for a machine."""
    return lambda machine: value(KINDS[kind].make(machine))


KINDS = {
    kind.name: kind
    for kind in (
        FilterKind(
            "low-pass", "low-pass and derivative",
            "low_pass.LowPass", CoreKernel("LowPass", has_state=True, base="base."),
            constant_stiffness,
            (
                Tunable("position", "rad/s", _made("low-pass", lambda f: f.corners["position"])),
                Tunable("velocity", "rad/s", _made("low-pass", lambda f: f.corners["velocity"])),
                Tunable("force", "rad/s", _made("low-pass", lambda f: f.corners["force"])),
            ),
        ),
        FilterKind(
            "constant-velocity", "Kalman filter, constant velocity",
            "constant_velocity.ConstantVelocity", PAPER, _constant_velocity("no_force_of"),
            (
                Tunable("noise.measurement", "m^2", _noise("measurement")),
                Tunable("acceleration", "m^2/s^3", _constant_velocity("usual_acceleration"),
                        decades=4.0),
            ),
        ),
        FilterKind(
            "observer", "extended state observer",
            "observer.ExtendedStateObserver", _OBSERVER, constant_stiffness,
            (Tunable("bandwidth", "rad/s", _made("observer", lambda f: f.bandwidth), decades=1.0),
             Tunable("damping", "1", _made("observer", lambda f: f.damping), decades=0.5)),
        ),
        FilterKind(
            "linear", "linear Kalman filter", "kalman.KalmanFilter", PAPER, constant_stiffness,
        ),
        FilterKind(
            "steady-state", "steady-state Kalman filter",
            "observer.SteadyStateKalmanFilter", _OBSERVER, constant_stiffness,
        ),
        FilterKind(
            "table", "Kalman filter, stiffness table",
            "kalman.AdaptiveKalmanFilter", PAPER, None, magnet_class="StiffnessMap",
        ),
        FilterKind(
            "adaptive", "adaptive Kalman filter, fuzzy expert",
            "kalman.AdaptiveKalmanFilter", PAPER, None, magnet_class="Expert",
        ),
        FilterKind(
            "closed-law", "Kalman filter, closed law",
            "kalman.AdaptiveKalmanFilter", PAPER, ideal_laws,
        ),
        FilterKind(
            "extended", "extended Kalman filter",
            "kalman.ExtendedKalmanFilter", _EXTENDED, ideal_laws,
        ),
        FilterKind(
            "ud", "UD-factorised Kalman filter",
            "kalman.UDKalmanFilter",
            CoreKernel("UD", has_own=False, has_state=True, base="base."), ideal_laws,
        ),
        FilterKind(
            "augmented", "augmented-state extended Kalman filter",
            "augmented.AugmentedKalmanFilter",
            CoreKernel(
                "Augmented", has_state=True, base="base.", covariance="cov", calls=("excitation",)
            ),
            ideal_laws,
            (*NOISE, Tunable("wander", "1/s", lambda _: 0.01)),
            ratios=("scale_std", "excitation", "least", "most"),
        ),
        FilterKind(
            "multiple-model", "interacting multiple models",
            "augmented.MultipleModelFilter",
            CoreKernel(
                "MultipleModel", has_state=True, base="base.", calls=("excitation", "mixture")
            ),
            ideal_laws,
            (*NOISE, Tunable("sojourn", "s", lambda _: 1.0, decades=1.0)),
            ratios=("scales", "excitation"),
        ),
        FilterKind(
            "unscented", "unscented Kalman filter",
            "unscented.UnscentedKalmanFilter", CoreKernel("Unscented"), ideal_laws,
            ratios=("alpha", "beta", "kappa"),
        ),
        FilterKind(
            "contact", "extended Kalman filter, contact with stops",
            "contact.ContactKalmanFilter",
            CoreKernel("Contact", has_state=True, base="base.", calls=("linear_forces",)),
            ideal_laws, ratios=("scatter",),
        ),
        FilterKind(
            "linear-adaptive-noise", "linear Kalman filter, R found online",
            "kalman.KalmanFilter", _ADAPTIVE_NOISE, constant_stiffness, (*NOISE, MEMORY),
            {"method": "sage-husa", "adapts": "measurement"},
        ),
        FilterKind(
            "extended-adaptive-noise", "extended Kalman filter, R and Q found online",
            "kalman.ExtendedKalmanFilter", _ADAPTIVE_NOISE, ideal_laws, (*NOISE, MEMORY),
            {"method": "innovation", "adapts": "both"},
        ),
    )
}  # fmt: skip
"""All kinds, the simplest first."""

AT = "@"  #: Separator of a kind and the file of its magnet model, as in ``adaptive@expert.json``.
PLUS = "+"  #: Separator of a kind and its synchronous states, as in ``linear+unbalance``.
FILTER_SUFFIX = ".toml"  #: Suffix of a filter file, which may replace the name of an estimator.


def split_name(name: str) -> tuple[str, tuple[str, ...], str]:
    """Return kind, synchronous states and file, as in ``adaptive+unbalance@expert.json``."""
    before, _, file = name.partition(AT)
    kind, *synchronous = before.split(PLUS)
    return kind, tuple(synchronous), file


def make_filter(
    name: str, machine: Machine, magnet: MagnetModel | None = None, **options: Any
) -> Estimator:
    """Build a filter by its name."""
    synchronous = split_name(name)[1]
    own = {"synchronous": synchronous} if synchronous else {}
    return get_kind(name).make(machine, magnet, **options, **own)


def get_kind(name: str) -> FilterKind:
    """Return a kind by the name of a filter."""
    kind = split_name(name)[0] if isinstance(name, str) else name
    if not isinstance(kind, str) or kind not in KINDS:
        raise AmbkitError(f'there is no filter "{name}"; known: {", ".join(KINDS)}')
    return KINDS[kind]


def default_name(machine: Machine, kind: str = DEFAULT) -> str:
    """Return a kind with the unbalance and runout that a machine states, by default the default."""
    if not KINDS[kind].estimator.by_model:
        return kind
    roles = {"unbalance": machine.unbalance, "runout": any(s.runout for s in machine.sensors)}
    return PLUS.join([kind, *(role for role in roles if machine.speed and roles[role])])


def default_filter(machine: Machine) -> Estimator:
    """Return the default filter of a machine."""
    return make_filter(default_name(machine), machine)


def check_named(name: str) -> None:
    """Reject anything but a kind, ``"all"``, a filter file, or a user's class."""
    is_kind = name == "all" or split_name(name)[0] in KINDS
    if not (is_kind or name.endswith((FILTER_SUFFIX, ".json", ".csv", ".parquet")) or MARK in name):
        known = (
            f"known: {', '.join(KINDS)}, all, the file of a filter ({FILTER_SUFFIX}), of an expert "
            "(.json) or a force map (.csv), or a class of your own as file.py:Class"
        )
        raise AmbkitError(f'there is no filter "{name}"; {known}')


_OF_BINDING = {kind.core.binding: kind.core for kind in KINDS.values()}


def core_kernel(estimator: Estimator) -> CoreKernel | None:
    """Return the core interface of an estimator's kind; None if it has none."""
    return _OF_BINDING.get(type(estimator.core).__name__)


def kind_of(estimator: Estimator) -> str:
    """Return the name of an estimator's kind."""
    # Kinds with a common class are distinguished by the magnet model.

    inner = getattr(estimator, "inner", estimator)
    of = f"{type(inner).__module__.rpartition('.')[2]}.{type(inner).__name__}"
    around = inner is not estimator
    results = [
        k.name for k in KINDS.values() if k.of == of and (k.adaptive_noise is not None) == around
    ]
    magnet: Any = estimator.magnet
    if isinstance(magnet, ForceLaws):  # equal for all axes of a machine
        magnet = magnet.models[0]
    if not results:
        raise AmbkitError(f"the {estimator.name} is of no kind that a file can name")
    return next((k for k in results if KINDS[k].magnet_class == type(magnet).__name__), results[-1])


def learned_magnet(name: str, machine: Machine) -> MagnetModel | None:
    """Return the default magnet model of a kind that needs one."""
    if get_kind(name).magnet is not None:
        return None
    from ambkit.machine.stiffness import stiffness_map

    learn: Callable[[Machine], MagnetModel] = (
        stiffness_map if get_kind(name).name == "table" else _trained
    )
    learned: dict[str, MagnetModel] = {}
    for axis in machine.axes:
        if axis.bearing.name not in learned:  # both axes of a bearing have equal magnets
            learned[axis.bearing.name] = learn(machine.isolated_axis(axis.name))
    return force_laws([learned[axis.bearing.name] for axis in machine.axes], machine)


@lru_cache(maxsize=64)
def _trained(axis: Machine) -> MagnetModel:
    """Return the default expert of an axis."""
    from ambkit.fuzzy.training import train

    return train(axis, weights=True)
