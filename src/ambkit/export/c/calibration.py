"""Calibration at run time: ``core/include/ambkit/calibration.h``."""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.control.controller_states import Controller
from ambkit.data.signals import signal
from ambkit.export.c import c_literals
from ambkit.export.c.c_literals import Constants, CPrecision, Name
from ambkit.export.c.controller_test_cases import speeds_of
from ambkit.export.c.limits import Limits, Number, limits
from ambkit.machine.axes import bias_forces
from ambkit.simulation.scenario import Scenario

SOURCES = ("src/calibration.c", "src/scaled.c")
TEMPLATES = {"{}_calibration.h": "calibration.h", "{}_calibration.c": "calibration.c"}


class Parameter(NamedTuple):
    """One kind of value, ``amb_parameter``."""

    name: str
    unit: str
    about: str


PARAMETERS = (
    Parameter("var_y", "m^2", "variance of the measurement"),
    Parameter("var_u", "V^2", "variance of the control signal"),
    Parameter("var_d", "N^2", "process noise variance of the disturbance force per sample"),
    Parameter("gate", "1", "innovations beyond so many standard deviations are outliers"),
    Parameter("mass", "kg", "mass of the rotor"),
    Parameter("strong", "1", "magnet constant k over the exported one"),
    Parameter("kp", "A/m", "proportional gain"),
    Parameter("ki", "A/(m s)", "integral gain"),
    Parameter("kd", "A s/m", "derivative gain"),
    Parameter("T_f", "s", "derivative filter"),
    Parameter("T_t", "s", "tracking time of the integral"),
    Parameter("weight", "1", "set-point weight"),
)  # fmt: skip
"""In the order of ``amb_parameter``."""


def check(controller: Controller, scenario: Scenario) -> None:
    """Reject what cannot be calibrated."""
    filter, machine = controller.estimator, controller.plant.machine
    called = c_literals.called(filter)
    roles = {state.role for state in filter.states}
    if called.has_own or called.has_state or "unbalance" in roles:
        raise AmbkitError(
            f"{machine.name}, {filter.name}: what it works by is made of more than "
            "noise, gate, mass and k; calibration is for linear, adaptive and extended filters"
        )
    if controller.law.schedule is not None:
        raise AmbkitError("calibration has one set of gains; this controller has them by speed")
    if scenario.controller.type == "lqg":
        raise AmbkitError("calibration has the gains of a PID; this controller has a regulator")
    if speeds_of(machine, scenario) is not None:
        raise AmbkitError("calibration is for one speed of rotation; this scenario has several")


def numbers(controller: Controller) -> list[Number]:
    """Return the values in the order of ``amb_parameter``, with the exported ones."""
    filter, machine, law = controller.estimator, controller.plant.machine, controller.law
    set_ = filter.core.parameters["set"]
    forces = [state.name for state in filter.states if state.role == "disturbance force"]
    noises = [noise.name for noise in filter.model.noises]
    axes = [axis.name for axis in machine.axes]
    gains = ("kp", "ki", "kd", "T_f", "T_t", "weight")
    values: dict[str, list[tuple[int, str, float]]] = {
        "var_y": [(k, at.name, set_["var_y"][k]) for k, at in enumerate(machine.readings)],
        "var_u": [(k, name, set_["var_u"][k]) for k, name in enumerate(axes)],
        "var_d": [
            (k, noise.removeprefix("f_d").removeprefix("_"), set_["var_d"][k])
            for k, noise in enumerate(noises)
            if noise in forces
        ],
        "gate": [(0, "", set_["gate"])],
        "mass": [(0, "", machine.rotor.mass)],
        "strong": [(k, name, 1.0) for k, name in enumerate(axes)],
    } | {
        gain: [(k, name, law.pids[k][at]) for k, name in enumerate(law.names)]
        for at, gain in enumerate(gains)
    }
    return [
        Number(kind.name, index, signal(kind.name, of), float(value))
        for kind in PARAMETERS for index, of, value in values[kind.name]
    ]  # fmt: skip


@lru_cache(maxsize=4)
def limits_of(controller: Controller) -> Limits:
    """Return the limits on the running rig, by name."""
    return limits(controller, numbers(controller))


def _fields(controller: Controller, name: str) -> dict[str, Any]:
    filter, machine = controller.estimator, controller.plant.machine
    bias = np.array(bias_forces(filter.magnet, machine))
    within, of = limits_of(controller), numbers(controller)
    kinds = [item.name for item in PARAMETERS]
    return {
        "control": Name(f"&{name}_control"),
        "parameters": len(of),
        "kind": np.array([kinds.index(item.kind) for item in of], np.uint8),
        "index": np.array([item.position for item in of], np.uint8),
        "exported": np.array([item.exported for item in of]),
        "low": np.array([within.low[item.name] for item in of]),
        "high": np.array([within.high[item.name] for item in of]),
        "mass": machine.rotor.mass,
        "carried": filter.core.parameters["set"]["f_0"] - bias,
        "bias": bias,
    }


def context(controller: Controller, name: str, precision: CPrecision) -> str:
    """Return the base as an initialiser."""
    return c_literals.struct_with_arrays(_fields(controller, name), precision)


def constants(controller: Controller, name: str, crc: Constants) -> None:
    """Add it to the CRC."""
    crc.fields(f"{name}_base", _fields(controller, name), arrays=True)


def described(controller: Controller, name: str, precision: CPrecision) -> str:
    """Return the input of the A2L file, as JSON."""
    within, by_kind = limits_of(controller), {item.name: item for item in PARAMETERS}
    parameters = [
        {"name": item.name, "unit": by_kind[item.kind].unit,
         "about": by_kind[item.kind].about + item.name.removeprefix(item.kind).replace("_", " of "),
         "exported": item.exported, "low": within.low[item.name], "high": within.high[item.name]}
        for item in numbers(controller)
    ]  # fmt: skip
    set_ = controller.estimator.core.parameters["set"]
    sizes = [len(set_[name]) for name in ("var_y", "var_d", "f_0")]
    description = {
        "prefix": name, "precision": precision, "peak_of_sensitivity": within.peak,
        "room": 2 + sum(sizes) + 7 * len(set_["var_u"]),
        "parameters": parameters,
    }  # fmt: skip
    return json.dumps(description, indent=2) + "\n"
