"""One of many runs, before it is simulated."""

from __future__ import annotations

import pickle
from dataclasses import dataclass

from ambkit.control.controllers import Controllers
from ambkit.estimate.estimator import Estimator
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import Run, simulate_run
from ambkit.simulation.scenario import Scenario


@dataclass(frozen=True, slots=True)
class Planned:
    """One run of many: machine, scenario and noise.

    Attributes
    ----------
    machine : Machine
        The plant.
    scenario : Scenario
        The scenario, with the controllers.
    estimator, magnet, external_inputs
        As for :func:`ambkit.simulation.run.simulate_run`. The estimator is not changed, and one can
        serve all runs.
    number : int, optional
        Number of the run; with the scenario's seed it determines the noise, in place of
        ``scenario.run``.
    controllers : Controllers, optional
        For several axes, if already constructed, as for another machine.
    """

    machine: Machine
    scenario: Scenario
    estimator: Estimator | None = None
    magnet: MagnetModel | None = None
    external_inputs: ExternalInputs | None = None
    number: int | None = None
    controllers: Controllers | None = None

    @property
    def key(self) -> tuple[int, int]:
        """Seed and number of the run."""
        return self.scenario.seed, self.scenario.run if self.number is None else self.number

    def simulated(self) -> Run:
        """Simulate it with all samples."""
        scenario = self.scenario.model_copy(update={"run": self.key[1]})
        estimator = None if self.estimator is None else copied(self.estimator)
        return simulate_run(
            self.machine, scenario, estimator=estimator, magnet=self.magnet,
            external_inputs=self.external_inputs, controllers=self.controllers,
        )  # fmt: skip


def copied(estimator: Estimator) -> Estimator:
    """Return an estimator with a state of its own."""
    result: Estimator = pickle.loads(pickle.dumps(estimator))
    return result
