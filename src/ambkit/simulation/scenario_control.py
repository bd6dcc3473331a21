"""The controllers of a scenario, chosen where it does not state them."""

from __future__ import annotations

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.control.control_candidates import Feedback
from ambkit.control.default_control import DefaultControl, default_control, is_default, settled
from ambkit.machine.machine import Machine
from ambkit.simulation.scenario import Scenario

TIMES = 2001
"""Times in a run at which its speed is looked at."""


def fastest_of(machine: Machine, scenario: Scenario) -> float:
    """Return the highest speed of rotation of a run, or the machine's own if higher [rad/s]."""
    if scenario.speed is None:
        return abs(machine.speed)
    speed = scenario.speed.sample(np.linspace(0.0, scenario.duration, TIMES))
    return max(abs(machine.speed), float(np.abs(speed).max()))


def feedback_of(scenario: Scenario) -> Feedback:
    """Return what feeds the controllers of a scenario: the estimate where it is not stated."""
    return scenario.feedback or "estimate"


def default_for(machine: Machine, scenario: Scenario) -> DefaultControl:
    """Return the default controllers of a scenario, over its speed range and the machine's."""
    return default_control(machine, feedback_of(scenario), fastest_of(machine, scenario))


def control_of(machine: Machine, scenario: Scenario) -> Control:
    """Return the controllers of a scenario with their type; held or not."""
    feedback = feedback_of(scenario)
    control = settled(machine, scenario.controller, feedback, fastest_of(machine, scenario))
    return control.fed_by(feedback)


def settled_scenario(machine: Machine, scenario: Scenario) -> Scenario:
    """Return a scenario with controllers and feedback chosen where they are not stated."""
    if is_default(scenario.controller):
        result = default_for(machine, scenario)
        if not result.held:
            raise AmbkitError(result.summary)
    return scenario.model_copy(update={"controller": control_of(machine, scenario)})
