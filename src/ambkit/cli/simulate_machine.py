"""``ambkit simulate`` of a whole machine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.cli.options import refuse_of_one_axis
from ambkit.data.signals import signal

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine
    from ambkit.simulation.machine import MachineRun
    from ambkit.workflow.waterfall import Waterfall


def simulate_machine(
    machine: Machine,
    *,
    scenario: Path | None,
    estimator: str,
    duration: float | None,
    load: float | None,
    seed: int | None,
    injection: Path | None,
    synchronous: Sequence[str],
    out: Path | None,
    plot: Path | None,
    waterfall: Path | None,
    json: bool,
    others: dict[str, Any],
) -> None:
    """Simulate a machine in closed loop, and print what the run came to."""
    from ambkit.cli import output
    from ambkit.judge.adequacy import judge_adequacy
    from ambkit.show import plots
    from ambkit.simulation.default_control import default_for, is_default
    from ambkit.simulation.flight import Flight
    from ambkit.simulation.holding import holding
    from ambkit.simulation.machine import simulate_machine as fly
    from ambkit.workflow.flying import FlightSummary, flight_for, plain_control
    from ambkit.workflow.given import of_machine
    from ambkit.workflow.harmonics import harmonics
    from ambkit.workflow.separation import sentence, separations

    refuse_of_one_axis(machine, others)
    flight = None if scenario is None else Flight.load(scenario)
    happening = flight_for(
        machine, flight, duration=duration, load=load, seed=seed, injection=injection
    )
    if estimator == "none" and happening.feedback == "estimate":
        raise AmbkitError(
            f'{scenario}: the controllers are fed by the estimate (feedback = "estimate"), so '
            "--estimator cannot be none"
        )
    named = estimator != "none"
    if not named and happening.feedback is None:
        happening = happening.replace(feedback="measurement")
    if is_default(happening.control):
        chosen = default_for(machine, happening)
        if chosen.fastest:
            output.note(chosen.summary)
    kalman = of_machine(estimator, machine, synchronous=synchronous) if named else None
    with output.progress("simulating"):
        run = fly(machine, happening, estimator=kalman)
    turning = () if kalman is None else harmonics(kalman, run.record)
    data = FlightSummary(run, turning).to_dict()
    speed = float(run.record["speed"][-1]) if "speed" in run.record else machine.speed
    apart = separations(machine, speed)
    data["critical_speeds"] = [each.to_dict() for each in apart]
    found = judge_adequacy(kalman, machine, happening, data.get("nis", math.nan))
    data["adequacy"] = output.say_adequacy(found)
    output.deliver(
        data,
        [_table(data, {} if run.estimate is None else run.estimate.units)],
        [
            (out, run.record.save),
            (plot, lambda path: plots.save_figure(plots.machine_figure(run), path)),
            (waterfall, lambda path: plots.save_figure(_waterfall(run).figure(), path)),
        ],
        as_json=json,
    )
    if apart:
        output.note(sentence(apart, speed))
    if any(each["mode"] == "tripped" for each in data.get("modes", ())):
        output.note("it tripped: see lost and overload in the flight's [sequence]")
    plain = plain_control(machine, happening, kalman)
    if plain is not None:
        output.note(plain)
    touched = run.samples_at_the_stop
    if touched and happening.start != "rest":
        output.note(f"the rotor touched a backup bearing in {touched} of {len(run.record)} samples")
        if not machine.speed and not holding(machine, happening.feedback or "measurement").held:
            output.note("no PID of each axis that was tried holds it; ambkit check says more")


def _waterfall(run: MachineRun) -> Waterfall:
    """Return the spectra of the first axis, in stretches of at most a tenth of a second."""
    from ambkit.workflow.waterfall import waterfall

    t = run.record.t
    window = min(0.1, float(t[-1] - t[0]) / 4)
    return waterfall(run.record, signal("s", run.machine.axes[0].name), window=window)


def _table(data: dict[str, Any], units: Mapping[str, str]) -> Any:
    from ambkit.cli import harmonics
    from ambkit.cli.output import table, value

    rows = [["duration", f"{value(data['duration'], 's')}, {data['samples']} samples"]]
    for what, unit in (("displacement", "m"), ("current", "A")):
        greatest = data[f"greatest_{what}"]
        shown = ", ".join(f"{name} {value(each, unit)}" for name, each in greatest.items())
        rows.append([f"greatest {what}", shown])
    rows.append(["  in a backup bearing", f"{data['samples_at_the_stop']} samples"])
    since = [f"{each['mode']} from {value(each['since'], 's')}" for each in data.get("modes", ())]
    rows += [["lift-off and landing", ", ".join(since)]] if since else []
    if "rmse" in data:
        rows.append([f"{data['estimator']}: RMSE", ""])
        rows += [[f"  {name}", value(each, units[name])] for name, each in data["rmse"].items()]
        rows.append(["  mean NIS (1: consistent)", f"{data['nis']:.3f}"])
    rows += [[f"  {what}", said] for what, said in harmonics.rows(data.get("synchronous", {}))]
    return table(f"{data['machine']}, seed {data['seed']}", ["", ""], rows)
