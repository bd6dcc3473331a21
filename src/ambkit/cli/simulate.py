"""``ambkit simulate``: a bearing and a scenario make a record."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.cli.kinds import NAMES, one_of
from ambkit.cli.parameters import (
    PICTURES,
    RECORDS,
    BearingName,
    ExpertFile,
    Json,
    Plot,
    Synchronous,
    Verbose,
    file_option,
    find_machine,
    quantity,
    refuse_of_one_axis,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ambkit.estimate.estimator import Estimator
    from ambkit.machine.machine import Machine
    from ambkit.rotordynamics.spectrogram import Waterfall
    from ambkit.simulation.run import Run
    from ambkit.simulation.scenario import Scenario


def simulate(
    bearing: BearingName,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="What happens; 'ambkit check --schema scenario'. What its [controller] does "
            "not say, all of it without one, is tuned for the bearing.",
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
            "says otherwise, the controllers of several axes where the scenario says so.",
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
            help="Step of the reference, of the first axis, after a tenth of the run.",
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
            help="Signal 'injected' of a record, such as 'ambkit excite sensitivity' writes, "
            "added to the measurement; for as long as it is.",
        ),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(
            parser=quantity("N"),
            metavar="FORCE",
            help="Load on the rotor, in the first axis, after half of the run.",
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
            "The spectrum over the run, of the displacement in the first axis.",
            PICTURES,
            "--waterfall",
        ),
    ] = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Simulate a machine in closed loop.

    With its nonlinear magnets, noise, sensor lag, current limit and stops, gyroscopics, unbalance
    and runout; of several axes with orbits in the picture.

    For example:
      ambkit simulate zittau_axial --step "0.5 mm" --load "3 N" --out run.csv --plot run.png
      ambkit simulate tum_mlps --plot orbits.png
    """
    from ambkit.base.errors import AmbkitError
    from ambkit.cli import printing
    from ambkit.cli.kinds import factories
    from ambkit.judge.adequacy import judge_adequacy
    from ambkit.machine.forces.force_map import surface_in
    from ambkit.result.saving import save_figure
    from ambkit.workflow.simulate import scenario_for, simulate_run

    plant = find_machine(bearing)
    if not plant.single:
        refuse_of_one_axis(plant, {"force-map": magnet})
    elif synchronous or waterfall is not None:
        option = "synchronous" if synchronous else "waterfall"
        raise AmbkitError(f"--{option} is of a rotor that turns; {plant.name} is a mass")
    if reference is not None and step is not None:
        raise AmbkitError("give either --step or --reference")
    named = estimator != "none"
    settings: dict[str, Any] = {
        "duration": duration, "step": step, "load": load, "seed": seed, "reference": reference,
        "injection": injection,
    }  # fmt: skip
    full_scenario = scenario_for(plant, scenario, from_estimate=named, **settings)
    if not plant.single:
        _note_default(plant, full_scenario)
    built = factories([estimator] if named else [], plant, expert, synchronous or ())
    kalman = built[estimator]() if built else "none"
    true = surface_in(magnet, plant.isolated_axis("")) if magnet and plant.single else None
    with printing.progress("simulating"):
        run = simulate_run(plant, scenario, estimator=kalman, magnet=true, **settings)
    adequacy = printing.say_adequacy(judge_adequacy(kalman, plant, full_scenario, run.nis))
    of = None if isinstance(kalman, str) else kalman
    spectra = (waterfall, lambda path: save_figure(_waterfall(run).figure(), path))
    printing.deliver_result(
        run, [(out, run.record.save), spectra], as_json=json, verbose=verbose, plot=plot,
        more={"adequacy": adequacy},
    )  # fmt: skip
    for text in _notes(run, full_scenario, of):
        printing.note(text)


def _note_default(machine: Machine, scenario: Any) -> None:
    """Say which controllers were chosen, where nobody says them."""
    from ambkit.cli import printing
    from ambkit.control.default_control import is_default
    from ambkit.simulation.scenario_control import default_for

    if is_default(scenario.controller):
        chosen = default_for(machine, scenario)
        if chosen.fastest:
            printing.note(chosen.summary)


def _notes(run: Run, scenario: Scenario, estimator: Estimator | None) -> Iterator[str]:
    """Yield what may help, where the rotor does not fly as it is to."""
    from ambkit.control.stabilising_controller import holding
    from ambkit.workflow.simulate import plain_control

    machine, touched = run.plant, run.samples_at_the_stop
    if not machine.single:
        plain = plain_control(machine, scenario, estimator)
        if plain is not None:
            yield plain
    if touched and scenario.start == "levitated":
        yield _of_the_stop(run)
        if machine.single or machine.speed:
            return
        if not holding(machine, scenario.feedback or "estimate").held:
            yield "no PID of each axis that was tried holds it; ambkit check says more"


def _of_the_stop(run: Run) -> str:
    """Say when the rotor touched a stop, and what may help."""
    from ambkit.cli.printing import value
    from ambkit.machine.force_laws import isolated_axes

    travel = min(isolated_axis.rotor.clearance for isolated_axis in isolated_axes(run.plant))
    at = run.first_touch
    t = run.record.t  # it is there by the end of the sample
    first = "" if at is None else f", first at {value(t[min(at + 1, len(t) - 1)], 's')}"
    return (
        f"the rotor touched the stop at {value(travel, 'm')} in {run.samples_at_the_stop} of "
        f"{len(run.record)} samples{first}: do the controllers suit it ([controller] or [control] "
        "in the file of --scenario)? Or take a smaller step or load"
    )


def _waterfall(run: Run) -> Waterfall:
    """Return the spectra of the first axis, in stretches of at most a tenth of a second."""
    from ambkit.rotordynamics.spectrogram import waterfall

    t = run.record.t
    window = min(0.1, float(t[-1] - t[0]) / 4)
    return waterfall(run.record, run.displacement(run.axes[0]), window=window)
