"""What can be changed on the running rig: ``core/include/ambkit/calibration.h``."""

from __future__ import annotations

import json
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.export.c import c_literals
from ambkit.export.c.c_literals import CPrecision, Name
from ambkit.export.c.crc import Constants
from ambkit.export.c.limits import Limits, limits
from ambkit.machine.magnets import bias_force_of

if TYPE_CHECKING:
    from ambkit.control.controller_states import Controller

SOURCES = ("src/calibration.c",)
TEMPLATES = {"{}_calibration.h": "calibration.h", "{}_calibration.c": "calibration.c"}


class Parameter(NamedTuple):
    """One number of ``amb_parameter``."""

    name: str
    unit: str
    about: str


PARAMETERS = (
    Parameter("var_y", "m^2", "variance of the measurement"),
    Parameter("var_u", "V^2", "variance of the control signal"),
    Parameter("var_d", "N^2", "growth of the disturbance force's variance in a sample"),
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


def check(controller: Controller) -> None:
    """Refuse what cannot be calibrated."""
    filter = controller.estimator
    called = c_literals.called(filter)
    if not filter.engine.built_in or called.has_own or called.has_state:
        raise AmbkitError(
            f"{filter.machine.name}, {filter.name}: what it works by is made of more than "
            "noise, gate, mass and k; calibration is for linear, adaptive and extended filters of "
            "an axis without parts"
        )
    if controller.law.schedule is not None:
        raise AmbkitError("calibration has one set of gains; this controller has them by speed")
    if controller.pid.type == "lqg":
        raise AmbkitError("calibration has the gains of a PID; this controller has a regulator")


def exported(controller: Controller) -> dict[str, float]:
    """Return the values that are exported, by the names in `PARAMETERS`."""
    filter, bearing = controller.estimator, controller.bearing
    set_ = filter.core.parameters["set"]
    results = {name: float(set_[name][0]) for name in ("var_y", "var_u", "var_d")}
    results |= {"gate": float(set_["gate"]), "mass": bearing.rotor.mass, "strong": 1.0}
    gains = ("kp", "ki", "kd", "T_f", "T_t", "weight")
    return results | dict(zip(gains, controller.law.pids[0], strict=False))


@lru_cache(maxsize=4)
def limits_of(controller: Controller) -> Limits:
    """Return what is taken on the running rig, by the names in `PARAMETERS`."""
    return limits(controller, exported(controller))


def _fields(controller: Controller, name: str) -> dict[str, Any]:
    filter, bearing = controller.estimator, controller.bearing
    bias = bias_force_of(filter.magnet, bearing)
    within = limits_of(controller)
    known = float(filter.core.parameters["set"]["f_0"][0])
    return {
        "control": Name(f"&{name}_control"),
        "exported": np.array(list(exported(controller).values())),
        "low": np.array([within.low[item.name] for item in PARAMETERS]),
        "high": np.array([within.high[item.name] for item in PARAMETERS]),
        "carried": known - bias,
        "bias": bias,
        "as_printed": filter.engine.as_printed,
    }


def context(controller: Controller, name: str, precision: CPrecision) -> str:
    """Return the base as an initialiser."""
    return c_literals.struct_with_arrays(_fields(controller, name), precision)


def constants(controller: Controller, name: str, crc: Constants) -> None:
    """Take it into the CRC."""
    crc.fields(f"{name}_base", _fields(controller, name), arrays=True)


def described(controller: Controller, name: str, precision: CPrecision) -> str:
    """Return what the A2L file is made of, as JSON."""
    values, within = exported(controller), limits_of(controller)
    parameters = [
        item._asdict()
        | {"exported": values[item.name], "low": within.low[item.name],
           "high": within.high[item.name]}
        for item in PARAMETERS
    ]  # fmt: skip
    description = {
        "prefix": name, "precision": precision, "peak_of_sensitivity": within.peak,
        "parameters": parameters,
    }  # fmt: skip
    return json.dumps(description, indent=2) + "\n"
