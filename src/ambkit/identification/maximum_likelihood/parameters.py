"""What can be identified: each parameter with its unit, its place in the model and its scale."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.identification.maximum_likelihood.loop_model import LoopModel


@dataclass(frozen=True)
class Parameter:
    """One figure of a :class:`LoopModel` that a record may tell."""

    name: str  #: As the user calls it.
    symbol: str  #: As papers call it, LaTeX.
    unit: str  #: SI.
    place: str  #: Where it stands in the model, as `LoopModel.replace` takes it.
    #: Searched by its logarithm, so that it stays positive; its error is then relative.
    positive: bool
    #: ``coarse(model)``: a standard error from which on nothing is known. Of the logarithm for a
    #: positive parameter, otherwise in `unit`; it scales the search, too.
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

    def text(self, model: LoopModel) -> str:
        """Return its value in a model in words."""
        return engineering(self.of(model), self.unit, 3)


def _path(place: str) -> list[str]:
    return ["isolated", *place.split("__")] if "__" in place else [place]


def _one(_: LoopModel) -> float:
    return 1.0


def _samples(model: LoopModel) -> float:
    return 10 * model.isolated.sampling_time


PARAMETERS: dict[str, Parameter] = {
    p.name: p
    for p in (
        Parameter("magnet_constant", "k", "N m^2/A^2", "magnet__magnet_constant", True, _one),
        Parameter("air_gap", "s_0", "m", "magnet__air_gap", True, _one),
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
        Parameter("disturbance_noise", "Q_d", "N^2/s", "disturbance_noise", True, _one),
    )
}  # fmt: skip
"""All that can be identified, by name; of two that cannot be told apart the later one is held."""

NOISES = ("measurement_noise", "control_noise", "disturbance_noise")
"""Those that say how much is left to chance."""

OFFSETS = ("position_offset", "current_offset")
"""Those that are of the log, and not of the bearing."""

USUAL = (
    "magnet_constant", "air_gap", "sensor_lag", "delay", "position_offset", "current_offset",
    "measurement_noise", "position_noise", "control_noise", "disturbance_noise",
)  # fmt: skip
"""Looked for where the user does not say what to look for, see `usual`."""


def usual(model: LoopModel) -> tuple[str, ...]:
    """Return what to look for in a model where the user does not say."""
    # A one-sided magnet knows no middle: where x = 0 is, is a choice, and an offset of the position
    # is nothing but another air gap. A lag of the current is looked for where the amplifier has
    # one, and the air gap not where a force map says what it does.
    magnet = model.isolated.magnet
    names = (*USUAL, "current_lag") if model.current_lag > 0 else USUAL
    idle = {"position_offset": magnet.type == "one-sided", "air_gap": magnet.force_map is not None}
    return tuple(name for name in names if not idle.get(name, False))


OFFSET_SHARE = 0.05
"""Of the bias current: how well the zero of a measured current is known where nobody says."""


def priors_of(model: LoopModel) -> dict[str, tuple[float, float]]:
    """Return what is known of parameters before any record: value and standard deviation [SI]."""
    # Of some, a record may tell nothing. A load that nobody knows takes the condition that the
    # magnet carries the weight away, and with it the offset of the current: two stiffnesses are
    # left for magnet constant, gap and offset, and the gap moves by metres per ampere. And at one
    # place the noise of a sensor does not show how it depends on the place. Taken for known, either
    # would make the errors of all others too small.
    b = model.isolated
    return {
        "current_offset": (model.current_offset, OFFSET_SHARE * b.magnet.bias_current),
        "position_noise": (b.sensor.position_noise, 1 / b.clearance),
    } | dict(model.known)


def log_prior(model: LoopModel) -> float:
    """How likely a model's parameters were before any record, up to a constant."""
    return sum(
        -0.5 * ((PARAMETERS[name].of(model) - value) / std) ** 2
        for name, (value, std) in model.known.items()
    )


def named(names: Sequence[str]) -> list[Parameter]:
    """Return parameters by their names, in the order of `PARAMETERS`."""
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
"""In the reason why a parameter is held: it looks like another that is looked for."""


def identifiable(
    parameters: Sequence[Parameter], model: LoopModel
) -> tuple[list[Parameter], dict[str, str]]:
    """Return what is left to be found, and why the others are not looked for."""
    # The mass is not where k is looked for, too. From one loop comes the ratio k/m. What seems to
    # part the two is how much load is expected, and that is a guess: a search would make a mass of
    # it, with an error that looks honest. Nor is the air gap of a force map, which was measured
    # with the gap that there is: only the law beneath it would move.
    held = {p.name: model.described[p.name] for p in parameters if p.name in model.described}
    if {"magnet_constant", "mass"} <= {p.name for p in parameters}:
        held["mass"] = f"magnet_constant and mass {ALIKE}, a loop tells their ratio"
    if model.isolated.magnet.force_map is not None and "air_gap" in {p.name for p in parameters}:
        held["air_gap"] = "the force map has it in it"
    return [p for p in parameters if p.name not in held], held


@dataclass(frozen=True)
class Coordinates:
    """The vector of the search: logarithms and scaled offsets, zero at the model it starts from."""

    model: LoopModel  #: Where it is zero.
    parameters: list[Parameter]  #: What its entries are.

    def model_at(self, z: Array, near: tuple[Array, LoopModel] | None = None) -> LoopModel:
        """Return the model at a vector (p,); it shares the bearing of one near it, if it may."""
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
        """Return where a model is (p,)."""
        return np.array([
            math.log(p.of(model) / p.of(self.model)) if p.positive
            else (p.of(model) - p.of(self.model)) / p.coarse(self.model)
            for p in self.parameters
        ])  # fmt: skip

    def unit_steps(self) -> Array:
        """What a step of one means (p,): of a logarithm 1, otherwise in SI."""
        return np.array([1.0 if p.positive else p.coarse(self.model) for p in self.parameters])
