"""Common parts of all estimators."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal, Self

from ambkit.base import late_binding
from ambkit.base.pickling import Copyable
from ambkit.base.quantity_arguments import of_type
from ambkit.data.input_scaling import Inputs, Scaling
from ambkit.estimate.along_records import AlongRecords
from ambkit.estimate.core_model import Engine
from ambkit.estimate.machine_model import View
from ambkit.estimate.noise_model import FilterNoise, LinearModel
from ambkit.machine.axes import constant_stiffness, force_laws
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, Precision
from ambkit.models.declaration import Part
from ambkit.models.linear import LinearSystem
from ambkit.models.machine_parts import machine_parts
from ambkit.result.card import Card
from ambkit.result.showing import Described

#: Arguments of a kind's class in the core, and those by name.
Arguments = tuple[Sequence[Any], dict[str, Any]]


class Estimator(AlongRecords, Described, Copyable):
    """An estimator of any kind: same inputs, same outputs, one interface in C.

    Each kind names its implementation in the core (``core/include/ambkit/estimator.h``).

    Parameters
    ----------
    machine : Machine
        Machine to estimate, with one axis or several.
    magnet : optional
        Magnet model; by default the constant stiffnesses at the origin. With several axes one for
        each.
    noise : FilterNoise, optional
        Variances; by default those of the machine.
    gravity : {"known", "disturbance"}
        ``"known"``: the weight is part of the model, and ``f_d`` is the disturbance alone.
        ``"disturbance"``: as eq. 15-16 of the paper, where weight is omitted and appears in F_St.
    precision : {"float64", "float32"}
        Precision of the C core; float32 is that of a Cortex-M4F.
    frozen_limit : int
        Minimum number of equal consecutive measurements of a frozen sensor; they must also be
        improbable for the prediction and the quantisation. 0: never.
    gate : float
        Innovations beyond this many standard deviations are outliers.
    outlier_limit : int
        Maximum number of consecutive outliers that are rejected; then the estimate must be wrong,
        and the filter restarts from the measurement. 0: none is rejected, no restarts.
    as_printed : bool
        Predict by eq. 19 as printed in the paper, with the position held over the sample in the
        sensor's lag. This puts every estimate ahead of the rotor by ``T/(1 - exp(-T/T_sen)) -
        T_sen``; for reproducing the paper only.
    synchronous : sequence of str
        Synchronous states to estimate: ``"unbalance"`` of a rotor, forces in two planes, and
        ``"runout"`` of each sensor. At a constant speed the two cannot be distinguished, and their
        stated errors are the initial ones; the disturbance force does not include them.

    Raises
    ------
    ValueError
        A variance is negative or not finite; the message states name, limit and value.
    """

    name = "estimator"
    binding = ""  # class of the core
    _default_magnet: Callable[[Machine], MagnetModel] = staticmethod(constant_stiffness)
    description = ""
    """Purpose, as in its file."""
    start_std: Mapping[str, float] = MappingProxyType({})
    """Initial standard deviations other than the default, by state."""
    origin: Mapping[str, str] = MappingProxyType({})
    """Where a number came from, by its key in a filter's file."""
    _parts: Callable[..., list[Part]] = staticmethod(machine_parts)  # in its model
    _of_core: tuple[str, ...] = ("core", "engine", "_core_step", "_live_mean")
    has_noise_estimate = True  # whether sensor noise with a memory is among its states
    side_by_side = True  # whether parallel runs can share it
    several_axes = True  # whether it supports several axes
    by_model = True  # whether it predicts by the machine's model
    estimates_force = True  # whether it can estimate the disturbance force
    predicts = "force held, all else exact"  # description of its prediction for the export's README
    scale_std = 0.0  # assumed standard deviation of the magnet constant [1]
    #: Axes of each ring whose forces its prediction of the covariance includes, if it does.
    rings: Sequence[tuple[int, ...]] | None = None
    can_smooth = False  # whether mean and covariance follow the smoother's model
    #: Basis of its steady-state gain: a Riccati equation with the stiffnesses through the origin,
    #: or with the tangents; or the gain is constant. None: there is no steady state.
    steady: Literal["through_origin", "tangent", "constant"] | None = None

    def __init__(
        self,
        machine: Machine,
        magnet: MagnetModel | Sequence[MagnetModel] | None = None,
        *,
        noise: FilterNoise | None = None,
        gravity: Literal["known", "disturbance"] = "known",
        precision: Precision = "float64",
        frozen_limit: int = 10,
        gate: float = 8.0,
        outlier_limit: int = 3,
        as_printed: bool = False,
        synchronous: Sequence[str] = (),
    ) -> None:
        of_type(Machine, machine=machine)
        if not self.takes(machine):
            names = ", ".join(machine.axis_names)
            raise ValueError(f"{self.name} takes one axis; {machine.name} has the axes {names}")
        if gravity not in ("known", "disturbance"):
            raise ValueError(f"gravity must be 'known' or 'disturbance', got {gravity!r}")
        for limit, value in (("frozen_limit", frozen_limit), ("outlier_limit", outlier_limit)):
            if value < 0:
                raise ValueError(f"{limit} must be 0 or more, got {value}")
        if not (math.isfinite(gate) and gate > 0):
            raise ValueError(f"gate must be greater than 0 standard deviations, got {gate!r}")
        noise = noise or FilterNoise()
        of_type(FilterNoise, noise=noise)
        self.machine: Any = machine
        self.view = View(machine)
        self.magnet = force_laws(
            self._default_magnet(machine) if magnet is None else magnet, machine
        )
        self.precision = precision
        self.engine = Engine(
            machine, precision, as_printed=as_printed, noise=self.has_noise_estimate,
            synchronous=synchronous, parts=self._parts,
        )  # fmt: skip
        self.variances: Any = self.view.variances(noise)
        forces = self.view.known_forces(self.magnet, weight=gravity == "known")
        noise_settings = self.view.settings(self.variances, self.states, self.engine.noises)
        settings = noise_settings | {
            "f_0": forces,
            "gate": gate,
            "frozen_limit": frozen_limit,
            "outlier_limit": outlier_limit,
        }
        self._settings = settings
        engine, core_class = self.engine, getattr(self.engine.core, self.binding)
        args, own = self._arguments(engine, settings)
        held = self.magnet.in_core(engine.core)
        self.core: Any = core_class(held, engine.model_of_core, *args, **settings, **own)
        self.reset()

    @classmethod
    def takes(cls, machine: Machine) -> bool:
        """Return whether it supports a machine: any, or one with a single axis.

        Parameters
        ----------
        machine : Machine
            The machine.
        """
        return cls.several_axes or machine.single

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.machine.name}>"

    def _card(self) -> Card:
        rows = [(state.name, state.role, state.unit) for state in self.states]
        title = f"{type(self).__name__} of {self.machine.name}"
        return Card(title, rows, None, ["state", "role", "unit"])

    @property
    def nominal(self) -> Estimator:
        """The filter with its initial noise; with online noise estimation the inner one."""
        return self

    @cached_property
    def inputs(self) -> Inputs:
        """Scaling of the controller's inputs, also in the exported C. It may be set."""
        return Inputs(u=Scaling(unit=self.machine.control_unit))

    @property
    def options(self) -> Mapping[str, Any]:
        """Options besides machine, magnet, noise and precision."""
        apart = ("machine", "magnet", "noise", "precision")
        return {name: value for name, value in self._made[1].items() if name not in apart}

    def for_machine(self, machine: Machine) -> Self:
        """Return the same filter for a machine with the same axes, such as at another speed.

        Parameters
        ----------
        machine : Machine
            The other machine.
        """
        args, options = self._made
        if args:
            return type(self)(machine, *args[1:], **options)
        return type(self)(**options | {"machine": machine})

    @staticmethod
    def load(path: str | os.PathLike[str], *, precision: Precision = "float64") -> Estimator:
        """Return the estimator in a file, of any kind.

        Parameters
        ----------
        path : path
            Written by `save`, ``ambkit tune`` and others; see `ambkit.FilterFile`.
        precision : {"float64", "float32"}
            Precision of the core.

        Raises
        ------
        ConfigError
            All errors; also if a referenced file has changed.
        AmbkitError
            The file cannot be read, or its content is inconsistent.
        """
        made: Estimator = late_binding.call("load_filter", path, precision)
        return made

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        machine: str | os.PathLike[str] | None = None,
        magnet: str | os.PathLike[str] | None = None,
    ) -> None:
        """Save its complete definition as TOML, through a temporary file.

        Parameters
        ----------
        path : path
            The file.
        machine, magnet : path, optional
            Files of its machine (or a preset's name), and of the expert or force map, the same for
            all bearings. If needed and not given, they are written beside `path` as
            ``NAME.machine.toml`` and ``NAME.expert.json``.

        Raises
        ------
        AmbkitError
            A file cannot be written, or the magnet model has no file format.
        """
        late_binding.call("save_filter", self, path, machine, magnet)

    def linear_system(self) -> LinearSystem | None:
        """Return the system from y and u to position and velocity, for one without model."""
        return None

    def linear_model(self, k_i: Any, k_s: Any) -> LinearModel:
        """Return the model of its prediction as matrices.

        Parameters
        ----------
        k_i, k_s : float or array_like (p,)
            Stiffnesses at the operating point [N/A], [N/m].
        """
        return LinearModel.of(self.model, k_i, k_s, self._settings)

    def _arguments(self, engine: Engine, settings: dict[str, Any]) -> Arguments:
        """Return the arguments that only this kind has."""
        return (), {}
