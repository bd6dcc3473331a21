"""``ambkit assess`` of a whole machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.cli.assess_sweep import deliver_sweep
from ambkit.cli.assess_tables import (
    said,
    tables_of_machine,
    tables_of_shares,
    tables_of_unstable,
    tables_over_speed,
)
from ambkit.cli.kinds import names
from ambkit.cli.options import refuse_of_one_axis

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ambkit.machine.machine import Machine
    from ambkit.simulation.controllers import Control
    from ambkit.simulation.scenario import PID


def assess_machine(
    machine: Machine,
    estimator: str | None,
    scenario: str | None,
    synchronous: Sequence[str],
    beside: tuple[bool, bool],
    amplitudes: str | None,
    stepped: bool,
    axis: str | None,
    fastest: float | None,
    orbit: bool | float,
    report: Path | None,
    plot: Path | None,
    json: bool,
    others: Mapping[str, Any],
) -> None:
    """Say how far a machine's loop is from the limit of stability, and what it asks."""
    from ambkit.cli import output
    from ambkit.show import plots
    from ambkit.workflow.assessing import assess
    from ambkit.workflow.given import of_machine
    from ambkit.workflow.over_speed import assess_over_speed
    from ambkit.workflow.verdict import write_verdict

    refuse_of_one_axis(machine, others)
    if fastest is not None and amplitudes is not None:
        raise AmbkitError("--over-speed and --sweep are looked at one after the other")
    controller, load, measured = control_of(machine, scenario)
    estimator = "none" if measured and estimator is None else estimator
    kinds = [] if estimator == "none" else names(estimator or "linear")
    if len(kinds) > 1 and (fastest is not None or amplitudes is not None or report is not None):
        one = "--over-speed, --sweep and --report are of one loop"
        raise AmbkitError(f"{one}: give one --filter, not {len(kinds)}")
    if fastest is not None and not isinstance(orbit, bool):
        raise AmbkitError("--over-speed makes the orbit of each speed: give --orbit own")
    if axis is not None and amplitudes is None:
        raise AmbkitError("--axis says which axis to --sweep: give its amplitudes")
    filters = {kind: of_machine(kind, machine, synchronous=synchronous) for kind in kinds}
    if synchronous and not filters:
        raise AmbkitError("--synchronous is of a filter, and none is in the loop")
    if amplitudes is not None:
        if report is not None:
            raise AmbkitError("--report is of the linear loop, without --sweep")
        deliver_sweep(
            machine,
            filters,
            controller,
            amplitudes,
            stepped,
            plot,
            json,
            axis=axis,
            load=load,
            orbit=orbit,
        )
        return
    if stepped:
        raise AmbkitError("--stepped-sine says how to --sweep: give its amplitudes")
    over = None
    if fastest is not None or report is not None:
        with output.progress("looking at one speed after the other"):
            over = assess_over_speed(machine, filters, controller, fastest=fastest, load=load,
                                     orbit=orbit is True)  # fmt: skip
    if fastest is not None and over is not None and report is None:
        output.deliver(
            over.to_dict(),
            tables_over_speed(over),
            [(plot, lambda path: plots.save_figure(over.figure(), path))],
            as_json=json,
        )
        return
    found = assess(
        machine, filters, controller, load=load, orbit=orbit, lqg=beside[0], hinf=beside[1]
    )
    output.deliver(
        found.to_dict(),
        [
            *tables_of_machine(found),
            *tables_of_unstable(found),
            *tables_of_shares(found),
            *said(found),
        ],
        [
            (plot, lambda path: plots.save_figure(found.figure(), path)),
            (report, lambda path: write_verdict(found, path, over=over)),
        ],
        as_json=json,
    )


def control_of(
    machine: Machine, given: str | None
) -> tuple[PID | Control | None, dict[str, float], bool]:
    """Return the controllers, the loads, and whether it is said that a measurement feeds them."""
    from ambkit.simulation import default_control
    from ambkit.simulation.controllers import TYPES, Control
    from ambkit.simulation.flight import Flight
    from ambkit.simulation.scenario import Scenario
    from ambkit.simulation.waveforms import Constant
    from ambkit.workflow.inspection import kind_of_toml

    if given is None:
        return None, {}, False
    if given in TYPES:
        return Control.model_validate({"type": given}), {}, False
    if Path(given).suffix != ".toml":
        raise AmbkitError(
            f"--controller: {given!r} is none of {', '.join(TYPES)}, and no file that ends with "
            ".toml"
        )
    if kind_of_toml(given) == "scenario":
        return Scenario.load(given).controller, {}, False
    flight = Flight.load(given)
    wrong = list(flight.unknown_axes(tuple(axis.name for axis in machine.axes)))
    if wrong:
        raise AmbkitError(f"{given}: {'; '.join(wrong)}")
    loads = {
        each.axis: each.force.value
        for each in flight.disturbance if isinstance(each.force, Constant)
    }  # fmt: skip
    control = flight.control
    if default_control.fastest_of(machine, flight) > abs(machine.speed):
        control = default_control.control_of(machine, flight)
    return control, loads, default_control.feedback_of(machine, flight) == "measurement"
