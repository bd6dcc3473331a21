"""What a notebook shows of what the commands came to."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ambkit.base.units import engineering
from ambkit.judge.comparison.seeds import EVALUATED
from ambkit.result.card import Card, value
from ambkit.show.notebook.results import FOUND, K, loops, parameters, with_spread
from ambkit.show.plots.design import design_figure
from ambkit.show.plots.filters import filter_figure
from ambkit.show.plots.identification import lift_off_figure
from ambkit.show.plots.maximum_likelihood import identified_figure

if TYPE_CHECKING:
    from ambkit.workflow.comparing import LoopScores
    from ambkit.workflow.designing import Design
    from ambkit.workflow.designing_machine import MachineDesign
    from ambkit.workflow.filtering import Filtering
    from ambkit.workflow.identifying import Identified, LiftedOff
    from ambkit.workflow.injection import Injection
    from ambkit.workflow.sweeping import Sweep
    from ambkit.workflow.trading_off import TradeOff
    from ambkit.workflow.tuned_filter import Tuned


def identified(of: Identified) -> Card:
    """Describe a bearing from records by what was found, and how it did."""
    found = of.likelihood
    title = f"Identification of {of.given.name}, {found.samples} measurements"
    notes = [f"{name}: {why}" for name, why in found.held.items()]
    notes += [f"{check.name}: {check.verdict}" for check in of.validation]
    figure = identified_figure(found, of.validation)
    return Card(title, parameters(found), figure, FOUND, notes)


def lifted_off(of: LiftedOff) -> Card:
    """Describe a bearing from the points at which its rotor lifts off."""
    fit, errors = of.fit, of.fit.standard_errors
    rows = [
        ("magnet constant", with_spread(fit.magnet_constant, errors["magnet_constant"], K)),
        ("offset of the gap", with_spread(fit.gap_offset, errors["gap_offset"], "m")),
        ("residual, rms", value(fit.residual_rms, "A")),
        ("points", f"{len(fit.points)}, {len(fit.left_out)} left out"),
    ]
    if of.working_point is not None:
        magnet = of.bearing.magnet
        rows.append(("air gap", value(magnet.air_gap, "m")))
        rows.append(("bias current", value(magnet.bias_current, "A")))
    return Card(f"Lift-off of {of.bearing.name}", rows, lift_off_figure(fit))


def tuned(of: Tuned) -> Card:
    """Describe a tuning by what it found, and what that gained."""
    rows = [
        [each.name, value(each.default, each.unit), value(of.values[each.name], each.unit)]
        for each in of.free
        if each.name in of.values
    ]
    rows += [_figures(name, *pair) for name, pair in of.unseen.items()]
    title = f"Tuning of the {of.estimator.name} for {of.estimator.bearing.name}"
    notes = [of.outcome, *of.warnings]
    return Card(title, rows, of.figure(), ["", "untuned", "tuned"], notes)


def _figures(name: str, untuned: float, tuned: float) -> list[str]:
    """Print figures of a tuning, whose unit stands behind their name or belongs to the signal."""
    what, _, unit = name.removesuffix("]").partition(" [")
    unit = unit or EVALUATED.get(name.removeprefix("error of "), "1")
    return [what, value(untuned, unit), value(tuned, unit)]


def trade_off(of: TradeOff) -> Card:
    """Describe filters that were tuned below ceilings by their errors."""
    rows = [
        [f"{each.ceiling:g}", "–" if each.tuned is None else f"{each.peak:.3f}", each.zone,
         *(value(error, EVALUATED[name]) for name, error in each.errors.items())]
        for each in of.points
    ]  # fmt: skip
    rows = [[*row, *["–"] * (5 - len(row))] for row in rows]
    heads = ["ceiling", "peak of |S|", "zone", "error of x", "error of f_d"]
    title = f"{of.bearing.name}, {of.kind} filter: what margin costs"
    return Card(title, rows, of.figure(), heads)


def filtering(of: Filtering) -> Card:
    """Describe estimators along a record by their innovations, predictions and errors."""
    evaluated = of.evaluations.values()
    rows = [
        ["measurements used", *(f"{e.used} of {e.samples}" for e in evaluated)],
        ["innovation, std", *(value(e.innovation_std, "m") for e in evaluated)],
        ["mean NIS (1: consistent)", *("–" if math.isnan(e.nis) else f"{e.nis:.3f}"
                                       for e in evaluated)],
        ["load, mean", *(value(e.disturbance_mean, "N") for e in evaluated)],
    ]  # fmt: skip
    first = next(iter(evaluated))
    units = first.estimate.units
    rows += [
        [f"{ahead} step{'s' * (ahead > 1)} ahead, rms",
         *(value(e.prediction[ahead], "m") for e in evaluated)]
        for ahead in first.prediction
    ]  # fmt: skip
    rows += [
        [f"error of {name}, rms", *(value(e.rmse[name], units[name]) for e in evaluated)]
        for name in first.rmse
    ]
    title = f"{of.machine.name}: {len(of.record)} samples"
    figure = filter_figure(of.record, of.evaluations, of.smoothed)
    return Card(title, rows, figure, ["", *of.evaluations])


def loop_scores(of: LoopScores) -> Card:
    """Describe estimators, each in its own loop, for each thing that happens."""
    title = (
        f"{of.bearing.name}: errors in the loop, mean and standard deviation over "
        f"{len(of.seeds)} runs"
    )
    return loops(of.scores, title)


def swept(of: Sweep) -> Card:
    """Describe a sweep by its peaks, and how far it is from the linear model."""
    rows = [
        [value(each.amplitude, "m"), f"{each.peak:.3f}", f"{100 * each.deviation:.2g} %",
         "yes" if each.limited else "no"]
        for each in of.swept
    ]  # fmt: skip
    heads = ["amplitude", "peak of |S|", "from the model, at most", "at a limit"]
    title = f"{of.name}, fed by {of.loop.name}: {of.kind} of the simulated loop"
    return Card(title, rows, of.figure(), heads)


def injection(of: Injection) -> Card:
    """Describe an experiment for the sensitivity by its size, and what it would tell."""
    low, high = of.expected.peak_interval()
    rows = [
        ("added to the measurement, greatest", value(of.amplitude, "m")),
        ("frequencies", f"{len(of.excitation.frequencies)}"),
        ("period", f"{value(of.period, 's')}, {of.periods} times"),
        ("peak of |S|, expected", f"{low:.3f} to {high:.3f}"),
    ]
    return Card(f"Experiment for the sensitivity of {of.name}", rows, of.figure())


def machine_design(of: MachineDesign) -> Card:
    """Describe the design of a machine by the gains of its axes, and what their loop comes to."""
    rows = [
        [name, *(value(getattr(pid, key), unit, 3) for key, unit in _GAINS.items())]
        for name, pid in of.control.pid.items()
    ]
    notes = [of.why, *of.objections, f"All of it lies in {of.folder}."]
    figure = of.assessed.figure(of.chosen)
    return Card(f"Design of {of.machine.name}", rows, figure, ["", *_GAINS], notes)


_GAINS = {"kp": "A/m", "ki": "A/(m s)", "kd": "A s/m", "derivative_filter": "s"}


def design(of: Design) -> Card:
    """Describe a design by those that were tried, and why one is to fly."""
    rows = [
        [c.kind, *(value(c.errors[s], unit, 3) for s, unit in EVALUATED.items()),
         f"{100 * c.efficiency:.0f} %", "tuned" if c.kept else "untuned"]
        for c in of.candidates
    ]  # fmt: skip
    heads = ["", *(f"error of {s}" for s in EVALUATED), "of what is possible", ""]
    notes = [of.why, *of.objections, *of.notes, f"All of it lies in {of.folder}."]
    figure = design_figure(
        [c.kind for c in of.candidates],
        [c.errors for c in of.candidates],
        of.raw,
        f"The {of.chosen.kind} filter is chosen; the sensor alone errs by "
                 f"{engineering(of.raw, 'm', 3)}",
    )  # fmt: skip
    return Card(f"Design: the {of.chosen.kind} filter", rows, figure, heads, notes)
