"""``ambkit excite --for sensitivity``: of machines, and what is printed of experiments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ambkit.machine.machine import Machine
    from ambkit.workflow.injection import Injection

DURATION = 5.0
"""Of an experiment for the sensitivity, where nobody says it [s]."""


def excite_machine(
    machine: Machine, for_sensitivity: bool, refused: Mapping[str, Any], scenario: Path | None,
    duration: float | None, estimator: str | None, seed: int | None, axes: list[str],
    most: tuple[float | None, float | None], ends: tuple[float, float] | None, out: Path | None,
    plot: Path | None, json: bool,
) -> None:  # fmt: skip
    """Design an experiment for each of the axes of a machine."""
    from ambkit.cli import output
    from ambkit.simulation.scenario import Scenario
    from ambkit.workflow.injecting import design_injection
    from ambkit.workflow.simulating import scenario_for

    if not for_sensitivity:
        raise AmbkitError(
            f"{machine.name} is a whole machine: its parameters are excited axis by axis; take "
            "--for sensitivity, or a bearing of one axis"
        )
    for option, given in refused.items():
        if given is not None:
            raise AmbkitError(f"{option} is not for --for sensitivity")
    known = None if scenario is None else Scenario.load(scenario)
    if duration is None and known is None:
        duration = DURATION
    happening = scenario_for(machine, known, duration=duration, seed=seed)
    if estimator is not None:
        fed = "measurement" if estimator == "none" else "estimate"
        happening = happening.replace(feedback=fed)
    every = [each.name for each in machine.axes]
    wanted: list[Any] = every if axes == ["all"] else [each or None for each in axes]
    found = []
    with output.progress("trying amplitudes"):
        for name in wanted:
            found.append(
                design_injection(
                    machine, happening, None if estimator == "none" else estimator, axis=name,
                    current=most[0], displacement=most[1], band=ends,
                )
            )  # fmt: skip
    deliver_injections(found, out, plot, json)


def deliver_injections(
    found: list[Injection], out: Path | None, plot: Path | None, json: bool
) -> None:
    """Print experiments, and write each; of several with the name of its axis in the file's."""
    from functools import partial

    from ambkit.cli import output
    from ambkit.show.plots import save_figure

    def named(path: Path | None, one: Injection) -> Path | None:
        if path is None or len(found) == 1:
            return path
        return path.with_name(f"{path.stem}_{one.axis}{path.suffix}")

    def drawn(one: Injection, path: Path) -> None:
        save_figure(one.figure(), path)

    files: list[Any] = [(named(out, one), one.file().save) for one in found]
    files += [(named(plot, one), partial(drawn, one)) for one in found]
    data = found[0].to_dict() if len(found) == 1 else {one.axis: one.to_dict() for one in found}
    output.deliver(data, (each for one in found for each in output.told(one)), files, as_json=json)
