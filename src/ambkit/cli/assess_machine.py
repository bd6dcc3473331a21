"""``ambkit assess`` of a whole machine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.cli.assess_sweep import deliver_sweep
from ambkit.cli.assess_tables import said, tables_of_machine, tables_of_shares, tables_over_speed
from ambkit.cli.kinds import names
from ambkit.cli.options import refuse_of_one_axis

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ambkit.machine.machine import Machine
    from ambkit.simulation.scenario import PID


def assess_machine(
    machine: Machine,
    estimator: str | None,
    controller: PID | None,
    lqg: bool,
    amplitudes: str | None,
    stepped: bool,
    axis: str | None,
    fastest: float | None,
    report: Path | None,
    plot: Path | None,
    json: bool,
    others: Mapping[str, Any],
) -> None:
    """Say how far a machine's loop is from the limit of stability, and what it asks.

    Parameters
    ----------
    machine : Machine
        The machine.
    estimator : str, optional
        Whose estimate feeds the controllers: kinds, or none; the linear filter by default.
    controller : PID, optional
        What is not said of it is tuned to each axis alone.
    lqg : bool
        Beside them, the linear-quadratic-Gaussian controller.
    amplitudes : str, optional
        Sweep with these [m].
    stepped : bool
        By one sine after the other.
    axis : str, optional
        Which is swept.
    fastest : float, optional
        Look over speed up to there [rad/s].
    report, plot : Path, optional
        Files for the verdict and for the picture.
    json : bool
        Whether machines are to read it.
    others : mapping
        Options of one axis, by their names, which must not be given.
    """
    from ambkit.cli import output
    from ambkit.show import plots
    from ambkit.workflow.assessing import assess
    from ambkit.workflow.over_speed import assess_over_speed
    from ambkit.workflow.verdict import write_verdict

    refuse_of_one_axis(machine, others)
    if fastest is not None and amplitudes is not None:
        raise AmbkitError("--over-speed and --sweep are looked at one after the other")
    kinds = [] if estimator == "none" else names(estimator or "linear")
    if len(kinds) > 1 and (fastest is not None or amplitudes is not None or report is not None):
        one = "--over-speed, --sweep and --report are of one loop"
        raise AmbkitError(f"{one}: give one --filter, not {len(kinds)}")
    if axis is not None and amplitudes is None:
        raise AmbkitError("--axis says which axis to --sweep: give its amplitudes")
    if amplitudes is not None:
        if report is not None:
            raise AmbkitError("--report is of the linear loop, without --sweep")
        deliver_sweep(machine, kinds, controller, amplitudes, stepped, plot, json, axis=axis)
        return
    if stepped:
        raise AmbkitError("--stepped-sine says how to --sweep: give its amplitudes")
    over = None
    if fastest is not None or report is not None:
        with output.progress("looking at one speed after the other"):
            over = assess_over_speed(machine, kinds, controller, fastest=fastest)
    if fastest is not None and over is not None and report is None:
        output.deliver(
            over.to_dict(),
            tables_over_speed(over),
            [(plot, lambda path: plots.save_figure(over.figure(), path))],
            as_json=json,
        )
        return
    found = assess(machine, kinds, controller, lqg=lqg)
    output.deliver(
        found.to_dict(),
        [*tables_of_machine(found), *tables_of_shares(found), *said(found)],
        [
            (plot, lambda path: plots.save_figure(found.figure(), path)),
            (report, lambda path: write_verdict(found, path, over=over)),
        ],
        as_json=json,
    )
