"""Complete controller in an FMU: data and start."""

from typing import Any, NamedTuple

import numpy as np

from ambkit.base.arrays import Array
from ambkit.control.controller_states import Controller
from ambkit.estimate.estimator import Estimator
from ambkit.export.c import c_literals, control
from ambkit.export.c.c_literals import CPrecision, Name
from ambkit.simulation.scenario import Scenario


class ControllerStart(NamedTuple):
    """A controller and its start."""

    controller: Controller
    levitated: bool  # levitated, else at power-on
    place: Array  # initial position of the rotor along the axes (p,) [m]
    current: Array  # initial commanded currents (p,) [A]

    @property
    def coils(self) -> list[int]:
        """Number of coils of each axis's magnet."""
        return [1 + (item.magnet.type == "two-sided") for item in self.controller.plant.isolated]


def controller_start(filter: Estimator, scenario: Scenario) -> ControllerStart:
    """Return the controller of :func:`ambkit.simulate`, with its start."""
    controller = control.controller_of(filter, scenario)
    isolated, nothing = controller.plant.isolated, np.zeros(len(controller.plant.isolated))
    levitated = scenario.start == "levitated" or scenario.sequence is None
    current = nothing
    if scenario.start == "levitated":
        current = controller.plant.equilibrium(nothing, nothing)[1]
    low, high = (
        np.array([getattr(item, f"current_{end}") for item in isolated]) for end in ("min", "max")
    )
    place = controller.down if scenario.start == "landed" else nothing
    return ControllerStart(controller, levitated, place, np.clip(current, low, high))


def controller_data(of: ControllerStart, precision: CPrecision) -> dict[str, Any]:
    """Return the data files of a complete controller."""
    controller, current = of.controller, of.current
    structs = control.structs(controller, "amb_data", of_filter=False)
    nothing, parts = np.zeros(len(current)), np.eye(len(current))
    integral = controller.integrals(current, nothing)
    by_current = [controller.integrals(current + at, nothing) - integral for at in parts]
    by_place = [controller.integrals(current, at) - integral for at in parts]
    structs = structs._replace(control=structs.control | {"estimator": Name("NULL")})
    law = control.in_c(structs, precision)
    arrays = {
        "integral": integral,
        "integral_by_current": np.column_stack(by_current).ravel(),
        "integral_by_place": np.column_stack(by_place).ravel(),
        "current": current,
        "bias": np.array([item.magnet.bias_current for item in controller.plant.isolated]),
    }
    return {
        "law": law,
        "controller": {
            **{key: law[key] for key in ("sequence", "control")},
            "levitated": of.levitated,
            "coils": of.coils,
            "turning": controller.plant.machine.rotor.type != "mass",
            **{name: c_literals.array(values, precision) for name, values in arrays.items()},
        },
    }


def law_data(controller: Controller) -> dict[str, Any]:
    """Return the data file of a controller only, fed by an estimator elsewhere."""
    structs, machine = control.structs(controller, "amb_data"), controller.plant.machine
    gains = [c_literals.number(b.amplifier.gain, "double") for b in controller.plant.isolated]
    law = control.in_c(structs, "double")
    named = "".join([law["law"], law["schedule"], *law["pids"]])
    arrays = {name: array for name, array in structs.arrays.items() if name in named}
    law |= {"arrays": c_literals.declared(arrays, "double")}
    law |= {"speed_input": machine.rotor.type != "mass"}
    return {"law": law, "k_ui": gains}
