"""Identifiable parameters: unit, place in the model, and scale."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.identification.maximum_likelihood.loop_model import LoopModel


@dataclass(frozen=True)
class Parameter:
    """One parameter of a :class:`LoopModel`."""

    name: str  #: Name.
    symbol: str  #: Usual symbol, LaTeX.
    unit: str  #: SI.
    place: str  #: Key of `LoopModel.replace`.
    #: Whether it is searched by its logarithm, which makes its error relative.
    positive: bool
    #: ``coarse(model)``: standard error above which it counts as unknown. Of the logarithm for a
    #: positive parameter, otherwise in `unit`; also the scale of the search.
    coarse: Callable[[LoopModel], float]

    def of(self, model: LoopModel) -> float:
        """Return its value in a model, SI."""
        thing: Any = model
        for part in _path(self.place):
            thing = getattr(thing, part)
        if thing is None:
            key = self.place.replace("__", ".")
            raise AmbkitError(f"{self.name}: {model.isolated.name} has no {key} to start from")
        return float(thing)

    def range(self, model: LoopModel) -> float:
        """Return its plausible standard deviation, in the coordinate of the search."""
        return self.coarse(model) if self.positive else 1.0

    def from_prior(self, model: LoopModel) -> float:
        """Return its distance from its prior's value, in standard deviations."""
        value, std = model.known[self.name]
        if self.positive:
            return math.log(self.of(model) / value) * value / std
        return (self.of(model) - value) / std

    def text(self, model: LoopModel) -> str:
        """Return its value in a model in words."""
        return engineering(self.of(model), self.unit, 3)


def _path(place: str) -> list[str]:
    return ["isolated", *place.split("__")] if "__" in place else [place]


def _one(_: LoopModel) -> float:
    return 1.0


def _guessed(_: LoopModel) -> float:
    return 3.0  # no description states it: the default is a guess


def _samples(model: LoopModel) -> float:
    return 10 * model.isolated.sampling_time


PARAMETERS: dict[str, Parameter] = {
    p.name: p
    for p in (
        Parameter("magnet_constant", "k", "N m^2/A^2", "magnet__magnet_constant", True, _one),
        Parameter("air_gap", "s_0", "m", "magnet__air_gap", True, _one),
        Parameter("saturation", "B_s", "T", "magnet__saturation", True, _one),
        Parameter("eddy_current_lag", r"T_\mathrm{e}", "s", "magnet__eddy_current_lag", True, _one),
        Parameter("eddy_current_corner", r"f_\mathrm{e}", "Hz", "magnet__eddy_current_corner", True,
                  _one),
        Parameter("mass", "m", "kg", "rotor__mass", True, _one),
        Parameter("sensor_lag", r"T_\mathrm{Sen}", "s", "sensor__lag", True, _one),
        Parameter("delay", "T_d", "s", "delay", False, _samples),
        Parameter("current_lag", "T_i", "s", "current_lag", True, _one),
        Parameter("position_offset", "y_0", "m", "position_offset", False,
                  lambda m: m.isolated.clearance),
        Parameter("current_offset", r"i_\mathrm{off}", "A", "current_offset", False,
                  lambda m: m.isolated.magnet.bias_current),
        Parameter("sensor_gain", r"K_\mathrm{Sen}", "1", "sensor__gain", True, _one),
        Parameter("amplifier_gain", r"k_\mathrm{ui}", "A/V", "amplifier__gain", True, _one),
        Parameter("measurement_noise", "R", "m^2", "sensor__noise_variance", True, _one),
        Parameter("position_noise", r"\kappa", "1/m", "sensor__position_noise", False,
                  lambda m: 1 / m.isolated.clearance),
        Parameter("control_noise", "Q_u", "V^2", "amplifier__noise_variance", True, _one),
        Parameter("disturbance_noise", "Q_d", "N^2/s", "disturbance_noise", True, _guessed),
    )
}  # fmt: skip
"""All parameters by name; of two indistinguishable ones the later is held."""

NOISES = ("measurement_noise", "control_noise", "disturbance_noise")
"""The noise parameters."""

OFFSETS = ("position_offset", "current_offset")
"""Parameters of the log, not of the machine."""

USUAL = (
    "magnet_constant", "air_gap", "sensor_lag", "delay", "position_offset", "current_offset",
    "measurement_noise", "position_noise", "control_noise", "disturbance_noise",
)  # fmt: skip
"""Default parameters, see `usual`."""


def usual(model: LoopModel) -> tuple[str, ...]:
    """Return the default parameters of a model."""
    # For a one-sided magnet the origin of x is arbitrary, and an offset of the position is
    # equivalent to another air gap. A current lag is included if the amplifier has one, and the air
    # gap is not if there is a force map.
    magnet = model.isolated.magnet
    names = (*USUAL, "current_lag") if model.current_lag > 0 else USUAL
    idle = {"position_offset": magnet.type == "one-sided", "air_gap": magnet.force_map is not None}
    return tuple(name for name in names if not idle.get(name, False))


OFFSET_SHARE = 0.05
"""Default uncertainty of the zero of a measured current, over the bias current."""

ZERO_SHARE = 0.1
"""Default uncertainty of a position sensor's zero, set between the stops, over the clearance."""

DESCRIBED = ("magnet_constant", "air_gap", "mass", "sensor_gain", "amplifier_gain")
"""Parameters that a description states to about an e-fold."""

LATE = ("delay", "sensor_lag", "current_lag")
"""What makes the loop late. Records determine the sum; one that is held counts as known."""


def priors_of(model: LoopModel, free: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return priors: value and standard deviation [SI], log-normal for a positive parameter."""
    # Some may not be determined by a record. An unknown disturbance replaces the balance of magnet
    # force and weight, and with it the current's offset: two stiffnesses remain for magnet
    # constant, gap and offset, and the gap changes by metres per ampere. The zero of the position
    # enters only by the curvature of the law, on a ridge with gap and constant that leads beyond
    # the stops. Without excitation gap and constant themselves have a ridge, along which a search
    # ended at gaps of metres. And at one position the dependence of the noise on the position is
    # invisible. If one of them were taken as known, the errors of all others would be too small.
    b = model.isolated
    priors = {p.name: (p.of(model),) * 2 for p in named(free) if p.name in DESCRIBED} | {
        "position_offset": (model.position_offset, ZERO_SHARE * b.clearance),
        "current_offset": (model.current_offset, OFFSET_SHARE * b.magnet.bias_current),
        "position_noise": (b.sensor.position_noise, 1 / b.clearance),
    }
    return {name: prior for name, prior in (priors | dict(model.known)).items() if name in free}


def log_prior(model: LoopModel) -> float:
    """Return the log prior density of a model's parameters, up to a constant."""
    return sum(-0.5 * PARAMETERS[name].from_prior(model) ** 2 for name in model.known)


def uncertain(held: Iterable[Parameter]) -> list[Parameter]:
    """Return the held parameters whose coarse range enters the errors of the others."""
    return [parameter for parameter in held if parameter.name not in LATE]


def named(names: Sequence[str]) -> list[Parameter]:
    """Return parameters by name, in the order of `PARAMETERS`."""
    import difflib

    for name in names:
        if name not in PARAMETERS:
            near = difflib.get_close_matches(name, PARAMETERS, 1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise AmbkitError(
                f"there is no parameter {name}; {hint}there are {', '.join(PARAMETERS)}"
            )
    return [parameter for name, parameter in PARAMETERS.items() if name in names]


ALIKE = "cannot be told apart"
"""Reason why a parameter is held: it is indistinguishable from another free one."""


def identifiable(
    parameters: Sequence[Parameter], model: LoopModel
) -> tuple[list[Parameter], dict[str, str]]:
    """Return the parameters to search, and reasons for excluding the others."""
    # The mass is excluded if k is free: one loop determines the ratio k/m. Only the assumed
    # intensity of the disturbance separates the two, and that is a guess: the search would return a
    # mass with a misleading error. The air gap of a force map is excluded too, because the map was
    # measured with the present gap: only the law beneath it would change.
    held = {p.name: model.described[p.name] for p in parameters if p.name in model.described}
    if {"magnet_constant", "mass"} <= {p.name for p in parameters}:
        held["mass"] = f"magnet_constant and mass {ALIKE}, a loop tells their ratio"
    if model.isolated.magnet.force_map is not None and "air_gap" in {p.name for p in parameters}:
        held["air_gap"] = "the force map has it in it"
    return [p for p in parameters if p.name not in held], held


@dataclass(frozen=True)
class Coordinates:
    """Search vector: logarithms and scaled offsets, zero at the initial model."""

    model: LoopModel  #: Model at zero.
    parameters: list[Parameter]  #: Its entries.

    def model_at(self, z: Array, near: tuple[Array, LoopModel] | None = None) -> LoopModel:
        """Return the model at a vector (p,); it shares the machine of a nearby one if possible."""
        model, changes = self.model, {}
        for parameter, step in zip(self.parameters, z.tolist(), strict=True):
            start = parameter.of(self.model)
            changes[parameter.place] = (
                start * math.exp(min(step, 50.0))
                if parameter.positive
                else start + step * parameter.coarse(self.model)
            )
        if near is not None:
            moved = [p.place for p, step in zip(self.parameters, z - near[0], strict=True) if step]
            if not any("__" in place for place in moved):
                model, changes = near[1], {place: changes[place] for place in moved}
        return model.replace(**changes)

    def of(self, model: LoopModel) -> Array:
        """Return the vector of a model (p,)."""
        return np.array([
            math.log(p.of(model) / p.of(self.model)) if p.positive
            else (p.of(model) - p.of(self.model)) / p.coarse(self.model)
            for p in self.parameters
        ])  # fmt: skip

    def unit_steps(self) -> Array:
        """Return the size of a unit step (p,): 1 for a logarithm, otherwise in SI."""
        return np.array([1.0 if p.positive else p.coarse(self.model) for p in self.parameters])
