"""The machine, filters and controllers that a user names for a loop."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ambkit.base.errors import AmbkitError
from ambkit.cli.kinds import is_filter, names
from ambkit.cli.options import find_machine

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ambkit.estimate.base import Estimator
    from ambkit.machine.machine import Machine
    from ambkit.simulation.scenario import PID, Control


@dataclass(frozen=True)
class LoopQuery:
    """Machine, filters, controllers and work point of the loops that a user named."""

    machine: Machine
    filters: dict[str, Estimator]
    controller: PID | Control | None
    x: float  #: Along the axes [m].
    load: Mapping[str, float]  #: By the names of the axes [N].

    def check_one(self, option: str) -> None:
        """Refuse several filters for what is of one loop."""
        if len(self.filters) > 1:
            raise AmbkitError(
                f"{option} is of one loop: give one --filter, not {len(self.filters)}"
            )


def read_query(
    target: str, estimator: str | None, expert: Path | None, scenario: str | None,
    synchronous: Sequence[str], x: float | None, load: float | None,
) -> LoopQuery:  # fmt: skip
    """Return the machine and what is in its loop: where a filter's file is the target, both."""
    from ambkit.cli import output
    from ambkit.cli.kinds import factories
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.simulation.linear.settled import tells
    from ambkit.workflow.given import given_load

    if is_filter(target):
        if estimator is not None:
            raise AmbkitError(f"{target} is a filter already: leave out --estimator")
        machine, estimator = FilterFile.load(target).plant, target
    else:
        machine = find_machine(target)
    controller, loads, measured = control_of(machine, scenario)
    estimator = estimator or ("none" if measured else "linear")
    if synchronous and estimator == "none":
        raise AmbkitError("--synchronous is of a filter, and none is in the loop")
    chosen = [] if estimator == "none" else names(estimator)
    built = factories(chosen, machine, expert, synchronous)
    filters = {name: make() for name, make in built.items()}
    if "all" in chosen:
        for name in [name for name, each in filters.items() if not tells(each)]:
            output.note(f"{name} is left out: it does not settle to a gain")
            del filters[name]
    return LoopQuery(
        machine, filters, controller, x or 0.0,
        loads if load is None else loads | given_load(machine, load),
    )  # fmt: skip


def control_of(
    machine: Machine, given: str | None
) -> tuple[PID | Control | None, dict[str, float], bool]:
    """Return the controllers, the loads, and whether it is said that a measurement feeds them."""
    from ambkit.simulation import default_control
    from ambkit.simulation.controllers import TYPES
    from ambkit.simulation.scenario import Control, Scenario
    from ambkit.simulation.waveforms import Constant

    if given is None:
        return None, {}, False
    if given in TYPES:
        return Control.model_validate({"type": given}), {}, False
    if Path(given).suffix != ".toml":
        raise AmbkitError(
            f"--controller: {given!r} is none of {', '.join(TYPES)}, and no file that ends with "
            ".toml"
        )
    scenario, axes = Scenario.load(given), tuple(axis.name for axis in machine.axes)
    wrong = list(scenario.wrong_for(axes, body=not machine.single))
    if wrong:
        raise AmbkitError(f"{given}: {'; '.join(wrong)}")
    if machine.single:
        return scenario.controller, {}, False
    loads = {
        axis: signal.value
        for axis, signal in scenario.by_axis("disturbance", axes[0]) if isinstance(signal, Constant)
    }  # fmt: skip
    control = scenario.control
    if default_control.fastest_of(machine, scenario) > abs(machine.speed):
        control = default_control.control_of(machine, scenario)
    return control, loads, default_control.feedback_of(machine, scenario) == "measurement"
