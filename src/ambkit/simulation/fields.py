"""Plant and controllers as fields of ``amb_plant``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.control.blocks import gain_at_rest, sections_of
from ambkit.control.controller_states import Controller, lies_at
from ambkit.control.controllers import Controllers, arrays, controllers_of, gains_of, relative_gains
from ambkit.control.pid import PID, integral_lead
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.machine_model import View
from ambkit.machine.loading import levitation_current_at
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import Law, MagnetModel, magnet_of
from ambkit.models import plant_parts
from ambkit.models.plant import Plant
from ambkit.simulation.scenario import Scenario


class StraightLine:
    """A single axis and its PID, with an unrolled plant in C."""

    def __init__(
        self, machine: Machine, scenario: Scenario, magnet: MagnetModel | None, at: float,
        load: float,
    ) -> None:  # fmt: skip
        self.machine, self.scenario = machine, scenario
        self.law = magnet if isinstance(magnet, Law) else magnet_of(machine)
        self.magnet = self.law if magnet is None else magnet
        self.coil = plant_parts.coil_fields(machine) if magnet is None else None
        levitated = scenario.start == "levitated"
        self.held = levitation_current_at(machine, at, load, magnet) if levitated else 0.0
        self.held_at = at if levitated else 0.0
        self.place = lies_at(machine) if scenario.start == "landed" else self.held_at
        # The command before the start is the controller's own, and known.
        self.current = min(max(self.held, machine.current_min), machine.current_max)

    @property
    def states(self) -> dict[str, tuple[int, str]]:
        """Index and unit of the recorded states."""
        return {"x": (0, "m"), "v": (1, "m/s"), "x_m": (2, "m")}

    def moved(self, X: Array) -> Array | None:
        """Return None: the displacement is a state."""
        return None

    def force(self, result: Array) -> Array:
        """Return the force of the magnet (n, 1) [N]."""
        weight = self.machine.weight
        return np.asarray(result + (weight + self.law.bias_force) - weight, float)

    def arguments(
        self, core: ModuleType, estimator: Estimator | None, elsewhere: Any
    ) -> dict[str, Any]:
        """Return the arguments of a core for plant, controller and start."""
        machine, pid = self.machine, self.scenario.controller
        precision = "float64" if estimator is None else estimator.precision
        coil = None if self.coil is None else core.Law("closed", **self.coil)
        loop = plant_parts.axis_fields(
            machine, self.magnet.in_core(core), coil, self.law.bias_force, self.scenario.substeps,
            precision,
        ) | {
            "T": machine.sampling_time,
            "k_ui": [machine.amplifier.gain],
            "pid": gains_of(pid, machine.sampling_time, machine.current_min, machine.current_max),
            "feedback_estimate": pid.feedback == "estimate",
        }  # fmt: skip
        result: dict[str, Any] = {
            "loop": loop, "place": self.place if elsewhere is None else elsewhere,
            "current": self.current,
            "integral": self.held / gain_at_rest(sections_of(pid.block, machine.sampling_time))
            + integral_lead(pid, self.held_at),
        }  # fmt: skip
        sequence = self.scenario.sequence
        if estimator is not None and (sequence is not None or pid.needs_estimate):
            # It divides by the nominal amplifier gain rather than the plant's.
            known = relative_gains(estimator.view.machine, machine)
            controller = Controller.of_axis(machine, estimator, pid, sequence)
            controller = replace(controller, law=controller.law.scaled(known))
            integral = controller.integral(float(known[0]) * self.held, self.held_at)
            result |= {"control": controller.in_core(), "integral": integral}
            if sequence is not None and self.scenario.start != "levitated":
                result |= {"hovers": False, "current": 0.0}
        numbers = ("place", "current", "integral")
        return result | {name: np.array([result[name]], precision) for name in numbers}


class InLoops:
    """Any machine and its controllers; the plant is loops over the pattern of its model."""

    def __init__(
        self, machine: Machine, scenario: Scenario, estimator: Estimator | None,
        at: Array, load: Array, fastest: float, made: Controllers | Sequence[PID] | None,
    ) -> None:  # fmt: skip
        self.machine, self.scenario, self.fastest = machine, scenario, fastest
        self.plant = plant = Plant(machine)
        self.place, self.current = plant.equilibrium(at, load)
        known = None
        if estimator is not None:
            known = np.ravel(estimator.equilibrium_state(self.place, current=self.current))
        self.held = self.current, at, known
        if scenario.start != "levitated":
            lies = scenario.start == "landed"
            self.place = plant.resting() if lies else np.zeros_like(self.place)
            self.current = np.zeros(len(machine.axes))
            if scenario.controller.type != "lqg":  # only the PIDs' integrals balance the weight
                self.held = self.current, np.zeros_like(self.current), None
        self.fed = estimator if scenario.feedback == "estimate" else None
        if not isinstance(made, Controllers):
            made = controllers_of(plant, scenario.controller, self.fed, made, fastest)
        self.law = made

    @property
    def states(self) -> dict[str, tuple[int, str]]:
        """Index and unit of the recorded states."""
        values, moving = self.plant.model.states, 2 * len(self.machine.positions)
        results = {f"q_{values[k].name}": (k, values[k].unit) for k in range(moving)}
        shown = {at.name: (k, at.unit) for k, at in enumerate(values) if at.role == "sensor"}
        return results | shown

    def moved(self, X: Array) -> Array | None:
        """Return the displacements along the axes (n, p) [m]."""
        h = self.plant.model.h
        return np.asarray(X[: h.shape[1]].T @ h.T)

    def force(self, result: Array) -> Array:
        """Return the forces of the magnets (n, p) [N]."""
        return np.asarray(np.asarray(result, float) + self.plant.bias)

    def arguments(
        self, core: ModuleType, estimator: Estimator | None, elsewhere: Any, **other: Any
    ) -> dict[str, Any]:
        """Return the arguments of a core for plant, controllers and start."""
        machine, scenario = self.machine, self.scenario
        precision = "float64" if estimator is None else estimator.precision
        gains = [axis.bearing.amplifier.gain for axis in machine.axes]
        loop = (
            self.plant.arrays(core, scenario.substeps, self.fastest)
            | {"T": machine.sampling_time, "k_ui": gains}
            | arrays(self.law, self.plant, self.fed)
        )
        start = {"place": self.place, "current": self.current}
        start["integral"] = self.law.integrals(*self.held)
        if elsewhere is not None:
            start["place"] = View(machine).placed @ elsewhere
        result: dict[str, Any] = {k: np.ascontiguousarray(v, precision) for k, v in start.items()}
        if scenario.sequence is not None and estimator is not None:
            fed = self.fed is not None
            law = self.law.scaled(relative_gains(estimator.view.machine, machine))
            controller = Controller(self.plant, estimator, law, scenario.sequence, fed)
            levitated = scenario.start == "levitated"
            result |= {"control": controller.in_core(**other), "hovers": levitated}
        return result | {"loop": loop}
