"""Studies of whole machines: from the number of a run to the machine that it is of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.machine.bearing import FILES
from ambkit.machine.loading import load_machine
from ambkit.machine.machine import Machine, as_machine
from ambkit.simulation.controllers import TYPES, Control, Controllers, controllers_of
from ambkit.simulation.default_control import is_default, settled_flight
from ambkit.simulation.flight import Flight
from ambkit.simulation.holding_margins import shown_along_axes
from ambkit.simulation.many_machines import PlannedMachine
from ambkit.simulation.plant import Plant
from ambkit.workflow.campaign.keys import OF_FLIGHT, changed, nested
from ambkit.workflow.campaign.plan import Drawn, Plan

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.workflow.campaign.study import Study

Array = NDArray[np.float64]

_IN_AMPERES = ("fed_back", "fed_back_by_speed", "fed_back_by_square")
"""Feedback that is of currents, as against positions."""


def plan_of(study: Study) -> Plan:
    """Return a study made ready: of bearings, or of whole machines."""
    return Plan(study) if study.machine is None else WholePlan(study)


@dataclass(frozen=True, eq=False)
class WholePlan(Plan):
    """A study of whole machines."""

    # Controllers and estimators are made for the nominal machine and know nothing of the one that
    # was drawn: not its masses, not where its sensors look, not the gains of its amplifiers.

    @cached_property
    def bearing(self) -> Any:
        """The nominal machine, which controllers and estimators know."""
        assert self.study.machine is not None
        return as_machine(load_machine(self.study.machine))

    @property
    def _told(self) -> Flight:
        """What the study says of a run."""
        return self.study.flight

    def _described_nominal(self) -> tuple[dict[str, Any], list[Any]]:
        """Return the nominal machine without the files that it names, and these."""
        machine: Machine = self.bearing
        without: Any = {"bearing": {"__all__": {"magnet": {*FILES}}}, "rotor": {"file"}}
        there = [getattr(each.magnet, name) for each in machine.bearing for name in FILES]
        return (
            machine.model_dump(mode="json", exclude=without),
            [*there, getattr(machine.rotor, "file", None)],
        )

    @cached_property
    def flight(self) -> Flight:
        """The run, with the study's seed."""
        found: Flight = self.study.flight.model_copy(update={"seed": self.study.seed})
        if "none" in self._estimator_names and found.feedback is None:
            found = found.model_copy(update={"feedback": "measurement"})
        if self._choices("controller") and is_default(found.control):
            found = found.model_copy(update={"control": Control(type="decentralised")})
        return settled_flight(self.bearing, found)

    @property
    def scenario(self) -> Any:
        """What happens in a run."""
        return self.flight

    def machines(self, points: Array, noise: NDArray[np.uint64], first: int) -> Iterator[Drawn]:
        """Yield the machines at points, see `Plan.machines`."""
        for at, row in enumerate(points):
            values = self.valued(row)
            flight = self._happening(values)
            estimator = self.estimators[str(values.get("estimator", self.study.estimator))]
            name = str(values.get("controller", flight.control.type))
            control = self.controls.get(name, flight.control)
            flight = flight.model_copy(update={"control": control, "run": int(noise[at])})
            own = {
                key: value for key, value in values.items()
                if key not in ("estimator", "controller") and not key.startswith(OF_FLIGHT)
            }  # fmt: skip
            wrong = "" if self.allowed(points[at : at + 1])[0] else self.beyond(values)
            plant: Machine = self.bearing
            controllers = None
            if not wrong:
                if own:
                    plant = changed(plant, nested(own))
                    wrong = next(iter(plant.contradictions(self.bearing)), "")
                controllers = self._for(plant, estimator, flight)
            planned: Any = PlannedMachine(plant, flight, estimator, controllers)
            yield Drawn(first + at, values, planned, wrong)

    def _happening(self, values: Mapping[str, Any]) -> Flight:
        told = {k.removeprefix(OF_FLIGHT): v for k, v in values.items() if k.startswith(OF_FLIGHT)}
        found: Flight = changed(self.flight, nested(told)) if told else self.flight
        return found

    @cached_property
    def controls(self) -> dict[str, Control]:
        """The ways to control that there are to choose from."""
        usual = [Control.model_validate({"type": name}) for name in TYPES]
        own = self.flight.control
        return {str(each.type): each for each in (*usual, own)} | self.study.controls

    def _for(self, plant: Machine, estimator: Estimator | None, flight: Flight) -> Controllers:
        """Return the nominal machine's controllers at amplifiers of other gains."""
        made = self._controllers(flight, estimator)
        ratio = np.array([
            own.bearing.amplifier.gain / nominal.bearing.amplifier.gain
            for own, nominal in zip(plant.axes, self.bearing.axes, strict=True)
        ])  # fmt: skip
        if (ratio == 1).all():
            return made
        fed = {
            name: ratio[:, None] * each if name in _IN_AMPERES else each
            for name, each in made.feedback.items()
        }
        return replace(made, spread=ratio[:, None] * made.spread, feedback=fed)

    @cached_property
    def _made(self) -> dict[Any, Controllers]:
        return {}

    def _controllers(self, flight: Flight, estimator: Estimator | None) -> Controllers:
        key = id(estimator), flight.feedback, flight.control.model_dump_json()
        if key not in self._made:
            fed = estimator if flight.feedback == "estimate" else None
            found = controllers_of(Plant(self.bearing), flight.control, fed)
            if fed is None:  # by the readings, as the nominal sensors show the axes
                shown = found.of_axes @ shown_along_axes(self.bearing)
                found = replace(found, feedback=found.feedback | {"position": shown})
            self._made[key] = found
        return self._made[key]

    @cached_property
    def estimators(self) -> dict[str, Estimator | None]:
        """The estimators by name, each knowing the nominal machine; None for ``"none"``."""
        from ambkit.workflow.given import of_machine

        options = {"synchronous": self.study.synchronous} if self.study.synchronous else {}
        return {
            name: None if name == "none" else of_machine(name, self.bearing, **options)
            for name in self._estimator_names
        }

    @property
    def _estimator_names(self) -> list[str]:
        return [str(n) for n in self._choices("estimator") or (self.study.estimator,)]

    def with_design(self, estimator: Any, controller: Any) -> Plan:
        """Return the plan with another filter for all machines; controllers are the flight's."""
        return self._remade(estimators={self.study.estimator: estimator})

    def check(self) -> None:
        """Make all that is made once, so that what cannot be is said before any run."""
        wrong = list(self.flight.unknown_axes(tuple(axis.name for axis in self.bearing.axes)))
        if wrong:
            raise AmbkitError(f"{self.study.name}: flight.{'; '.join(wrong)}")
        if "none" in self.estimators and self.flight.feedback == "estimate":
            raise AmbkitError(
                f"{self.study.name}: the controllers are fed by the estimate, so the estimator "
                'cannot be none; say flight.feedback = "measurement"'
            )
        names = [str(n) for n in self._choices("controller")]
        names = names or [str(self.flight.control.type)]
        for estimator in self.estimators.values():
            for name in names:
                flight = self.flight.model_copy(update={"control": self.controls[name]})
                self._for(self.bearing, estimator, flight)
        self.points(0, 1)
