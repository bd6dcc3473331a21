"""A whole controller in an FMU: its data, and how it starts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.export.c import control, data
from ambkit.export.c.data import CPrecision, Name
from ambkit.machine.hovering import hover_current
from ambkit.machine.magnets import magnet_of
from ambkit.simulation.control import Controller, lies_at, needs_states

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.machine import Bearing
    from ambkit.simulation.scenario import Scenario


class Flown(NamedTuple):
    """A controller, and how it starts."""

    controller: Controller
    hovering: bool  # in flight, else at power-on
    place: float  # where the rotor is at the start [m]
    current: float  # that is demanded until then [A]


def is_whole(scenario: Scenario) -> bool:
    """Say whether a scenario is flown by more than a PID."""
    return scenario.sequence is not None or needs_states(scenario.controller)


def flown(estimator: Estimator, scenario: Scenario) -> Flown:
    """Return what :func:`ambkit.simulate` flies, started as there."""
    bearing = estimator.bearing
    pid = scenario.controller.completed(bearing)
    controller = Controller.of_axis(bearing, estimator, pid, scenario.sequence)
    hovering = scenario.start == "hover" or scenario.sequence is None
    current = hovers_at(bearing) if scenario.start == "hover" else 0.0
    held = min(max(current, bearing.current_min), bearing.current_max)
    return Flown(controller, hovering, starts_at(bearing, scenario), held)


def starts_at(bearing: Bearing, scenario: Scenario) -> float:
    """Return where the rotor is at the start [m]."""
    lies = scenario.start == "rest" and scenario.sequence is not None
    return lies_at(bearing) if lies else 0.0


def hovers_at(bearing: Bearing) -> float:
    """Return the current that holds the rotor in the middle [A]."""
    law = magnet_of(bearing)
    return hover_current(bearing, law, 0.0, bearing.weight + law.bias_force)


def flown_data(of: Flown, precision: CPrecision) -> dict[str, Any]:
    """Return what the data files say of a whole controller."""
    controller, current = of.controller, of.current
    told = control.structs(controller, "amb_data")
    integral = controller.integral(current, 0.0)
    by_current = controller.integral(current + 1.0, 0.0) - integral
    by_place = controller.integral(current, 1.0) - integral
    fields = told.control | {"estimator": Name("NULL")}
    return {
        "law": _law(told, precision),
        "flown": {
            "sequence": data.struct(told.sequence, precision, {}) if told.sequence else None,
            "control": data.struct(fields, precision, {}),
            "hovering": of.hovering,
            "integral": data.array(np.array([integral, by_current, by_place]), precision),
            "current": data.number(current, precision),
            "coils": controller.coils,
            "bias": data.number(controller.bearing.magnet.bias_current, precision),
        },
    }


def law_data(controller: Controller) -> dict[str, Any]:
    """Return what the data file says of a controller alone, that an estimator elsewhere feeds."""
    if controller.sequence is not None:
        raise AmbkitError(
            "a controller alone neither lifts off nor lands: take kind whole-controller, or leave "
            "[sequence] out of the scenario"
        )
    told = control.structs(controller, "amb_data")
    gain = data.number(controller.bearing.amplifier.gain, "double")
    return {"law": _law(told, "double", alone=True), "k_ui": gain}


def _law(told: control.Structs, precision: CPrecision, *, alone: bool = False) -> dict[str, Any]:
    text = data.struct(told.law, precision, {})
    arrays = {name: each for name, each in told.arrays.items() if not alone or name in text}
    return {
        "arrays": data.declared(arrays, precision),
        "pids": [data.struct(pid, precision, {}) for pid in told.pids],
        "text": text,
    }
