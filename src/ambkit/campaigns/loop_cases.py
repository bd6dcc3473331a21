"""What happens in a run of a study and who controls it: of one axis or of several."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.campaigns.study_checks import completed
from ambkit.control.control import Control
from ambkit.control.controllers import TYPES, Controllers, controllers_of
from ambkit.control.default_control import is_default
from ambkit.machine.machine import Machine
from ambkit.models.plant import Plant
from ambkit.simulation.many import Planned
from ambkit.simulation.scenario import Scenario, settled_scenario

if TYPE_CHECKING:
    from ambkit.campaigns.study import Study
    from ambkit.estimate.estimator import Estimator
    from ambkit.machine.machine import Bearing

_GAINS = ("kp", "ki", "kd", "feed_forward")

_IN_AMPERES = ("fed_back", "fed_back_by_speed", "fed_back_by_square")
"""Feedback that is of currents, as against positions."""


class OfOne:
    """Scenarios of a machine with one axis, whose controller is a PID."""

    def __init__(self, nominal: Bearing, study: Study) -> None:
        self.nominal, self.study = nominal, study

    def settled(self, *, unfed: bool, chosen: bool) -> Scenario:
        """Return the run with controllers tuned to the nominal machine."""
        run: Scenario = completed(self.study.scenario, self.nominal)
        if unfed and self.study.scenario.feedback is None:
            run = run.fed("measurement")
        return run.model_copy(update={"seed": self.study.seed})

    def controllers(self, run: Scenario) -> dict[str, Control]:
        """Return the controllers to choose from."""
        fed_by = run.feedback or "estimate"
        usual = {
            "tuned": run.controller,
            "textbook": Control.textbook(self.nominal).fed_by(fed_by),
        }
        return usual | {
            name: controller.completed(self.nominal).fed_by(controller.feedback or fed_by)
            for name, controller in self.study.controllers.items()
        }

    def planned(
        self, plant: Bearing, run: Scenario, estimator: Estimator | None, noise: int
    ) -> Planned:
        """Return a run whose controller goes by the nominal gains of amplifier and sensor."""
        # The simulated one divides by the plant's. What it lacks is a factor on its gains.
        pid = run.controller
        ratio = plant.amplifier.gain / self.nominal.amplifier.gain
        if pid.feedback == "measurement":
            ratio *= plant.sensor.gain / self.nominal.sensor.gain
        if ratio != 1:
            changes = {name: ratio * getattr(pid, name) for name in _GAINS}
            run = run.model_copy(update={"controller": pid.model_copy(update=changes)})
        return Planned(plant, run, estimator, number=noise)


class OfSeveral:
    """Scenarios of a machine with several axes."""

    def __init__(self, nominal: Machine, study: Study) -> None:
        self.nominal, self.study = nominal, study

    def settled(self, *, unfed: bool, chosen: bool) -> Scenario:
        """Return the run with controllers made for the nominal machine."""
        run = self.study.scenario.model_copy(update={"seed": self.study.seed})
        if unfed and run.feedback is None:
            run = run.fed("measurement")
        if chosen and is_default(run.controller):
            plain = run.controller.model_copy(update={"type": "decentralised"})
            run = run.model_copy(update={"controller": plain})
        return settled_scenario(self.nominal, run)

    def controllers(self, run: Scenario) -> dict[str, Control]:
        """Return the ways to control that there are to choose from."""
        usual = (*(Control.model_validate({"type": name}) for name in TYPES), run.controller)
        return {str(item.type): item for item in usual} | self.study.controllers

    def planned(
        self, plant: Machine, run: Scenario, estimator: Estimator | None, noise: int
    ) -> Planned:
        """Return a run with the nominal machine's controllers at amplifiers of other gains."""
        made = self._made(run, estimator)
        ratio = np.array([
            own.bearing.amplifier.gain / nominal.bearing.amplifier.gain
            for own, nominal in zip(plant.axes, self.nominal.axes, strict=True)
        ])  # fmt: skip
        if (ratio != 1).any():
            fed = {
                name: ratio[:, None] * item if name in _IN_AMPERES else item
                for name, item in made.feedback.items()
            }
            made = replace(made, spread=ratio[:, None] * made.spread, feedback=fed)
        return Planned(plant, run, estimator, number=noise, controllers=made)

    @cached_property
    def _known(self) -> dict[Any, Controllers]:
        return {}

    def _made(self, run: Scenario, estimator: Estimator | None) -> Controllers:
        key = id(estimator), run.feedback, run.controller.model_dump_json()
        if key not in self._known:
            fed = estimator if run.feedback == "estimate" else None
            self._known[key] = controllers_of(Plant(self.nominal), run.controller, fed)
        return self._known[key]


def happening(nominal: Machine, study: Study) -> Any:
    """Return what happens in the runs of a study."""
    return (OfSeveral if not nominal.single else OfOne)(nominal, study)  # type: ignore[arg-type]
