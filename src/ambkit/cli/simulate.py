"""``ambkit simulate``: a bearing and a scenario make a record."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.cli.kinds import NAMES, one_of
from ambkit.cli.options import (
    PICTURES,
    RECORDS,
    BearingName,
    ExpertFile,
    Json,
    Plot,
    Synchronous,
    file_option,
    find_bearing,
    find_machine,
    quantity,
)

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing
    from ambkit.workflow.simulating import RunSummary


def simulate(
    bearing: BearingName,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="What happens; 'ambkit check --schema scenario', of a machine 'flight'. What its "
            "[controller] does not say, all of it without one, is tuned for the bearing.",
        ),
    ] = None,
    estimator: Annotated[
        str,
        typer.Option(
            "--estimator",
            "--filter",
            callback=lambda name: name if name == "none" else one_of(name),
            metavar="NAME",
            help=f"none, {', '.join(NAMES)}; the controller is fed by it unless the scenario "
            "says otherwise, the controllers of a machine where its flight says so.",
        ),
    ] = "linear",
    expert: ExpertFile = None,
    magnet: Annotated[
        Path | None,
        typer.Option(
            "--force-map",
            metavar="FILE.csv",
            help="Force map of the true magnet, points of iu, x and f_mag, which the estimators do "
            "not know: they know the bearing's.",
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(parser=quantity("s"), metavar="TIME", help='Such as "0.5 s".')
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="LENGTH",
            help="Step of the reference, after a tenth of the run.",
        ),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Reference r of a record, such as 'ambkit excite' writes; for as long as it is.",
        ),
    ] = None,
    injection: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Signal 'injected' of a record, such as 'ambkit excite --for sensitivity' writes, "
            "added to the measurement; for as long as it is.",
        ),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(
            parser=quantity("N"), metavar="FORCE", help="Load on the rotor, after half of the run."
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, metavar="N", help="Seed of the noise.")] = None,
    synchronous: Synchronous = None,
    out: Annotated[
        Path | None, file_option("Write the record: .csv or .parquet.", RECORDS, "--out")
    ] = None,
    plot: Plot = None,
    waterfall: Annotated[
        Path | None,
        file_option(
            "Of a whole machine: the spectrum over the run, in its first axis.",
            PICTURES,
            "--waterfall",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Simulate a bearing or a whole machine in closed loop.

    With its nonlinear magnets, noise, sensor lag, current limit and stops; a machine with its
    gyroscopics, unbalance and runout, and its orbits in the picture.

    For example:
      ambkit simulate zittau_axial --step "0.5 mm" --load "3 N" --out run.csv --plot run.png
      ambkit simulate tum_mlps --plot orbits.png
    """
    from ambkit.base.errors import AmbkitError
    from ambkit.cli import output
    from ambkit.cli.kinds import factories, surface_in
    from ambkit.cli.simulate_machine import simulate_machine
    from ambkit.judge.adequacy import judge_adequacy
    from ambkit.show import plots
    from ambkit.workflow.simulating import RunSummary, scenario_for, simulate_run

    whole = find_machine(bearing)
    if whole is not None:
        simulate_machine(
            whole, scenario=scenario, estimator=estimator, duration=duration, load=load, seed=seed,
            injection=injection, synchronous=synchronous or (), out=out, plot=plot,
            waterfall=waterfall, json=json,
            others={"expert": expert, "force-map": magnet, "step": step, "reference": reference},
        )  # fmt: skip
        return
    if waterfall is not None:
        raise AmbkitError("--waterfall is of a whole machine, not of one axis")
    if synchronous:
        raise AmbkitError("--synchronous is of a whole machine, not of one axis")
    plant = find_bearing(bearing)
    if reference is not None and step is not None:
        raise AmbkitError("give either --step or --reference")
    built = factories([estimator] if estimator != "none" else [], plant, expert)
    kalman = built[estimator]() if built else "none"
    true = None if magnet is None else surface_in(magnet, plant)
    with output.progress("simulating"):
        run = simulate_run(
            plant, scenario, estimator=kalman, magnet=true, duration=duration, step=step, load=load,
            seed=seed, reference=reference, injection=injection,
        )  # fmt: skip
    summary = RunSummary(plant, run)
    data = summary.to_dict()
    happening = scenario_for(
        plant, scenario, duration=duration, step=step, load=load, seed=seed, reference=reference,
        injection=injection, from_estimate=estimator != "none",
    )  # fmt: skip
    found = judge_adequacy(kalman, plant, happening, data.get("nis", math.nan))
    data["adequacy"] = output.say_adequacy(found)
    output.deliver(
        data,
        [_table(data, plant)],
        [
            (out, run.record.save),
            (plot, lambda path: plots.save_figure(plots.simulation_figure(run, plant), path)),
        ],
        as_json=json,
    )
    if summary.samples_at_the_stop:
        output.note(_of_the_stop(summary))


def _of_the_stop(summary: RunSummary) -> str:
    """Say when the rotor touched a stop, and what may help."""
    from ambkit.cli.output import value

    at = summary.first_at_the_stop
    first = "" if at is None else f", first at {value(at, 's')}"
    return (
        f"the rotor touched the stop at {value(summary.bearing.rotor.travel_limit, 'm')} in "
        f"{summary.samples_at_the_stop} of {len(summary.run.record)} samples"
        f"{first}: does the controller suit the "
        "bearing ([controller] in the file of --scenario)? Or take a smaller step or load"
    )


def _table(data: dict[str, Any], bearing: Bearing) -> Any:
    from ambkit.cli.output import table, value

    rows = [
        ["duration", f"{value(data['duration'], 's')}, {data['samples']} samples"],
        ["greatest displacement", value(data["greatest_displacement"], "m")],
        ["  at the stop", f"{data['samples_at_the_stop']} samples"],
        ["greatest control current", value(data["greatest_current"], "A")],
        ["  at its limit", f"{data['samples_at_the_current_limit']} samples"],
    ]
    if "rmse" in data:
        errors = data["rmse"]
        rows += [
            [f"{data['estimator']}: RMSE of x", value(errors["x"], "m")],
            ["  RMSE of v", value(errors["v"], "m/s")],
            ["  RMSE of F_St", value(errors["f_d"], "N")],
            ["  mean NIS (1: consistent)", f"{data['nis']:.3f}"],
        ]
    return table(f"{bearing.name}, seed {data['seed']}", ["", ""], rows)
