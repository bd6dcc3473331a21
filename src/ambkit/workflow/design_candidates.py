"""The filters that a design tries: how each is judged, who flies, and what speaks against it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.estimate.filter_file import FilterFile
from ambkit.estimate.registry import KINDS
from ambkit.judge.adequacy import judge_adequacy
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.comparison.bench import bench
from ambkit.judge.comparison.cases import CASES, load_case, trials
from ambkit.judge.comparison.contenders import Contender
from ambkit.judge.comparison.criteria import SETTLING
from ambkit.judge.comparison.tuning import SIGNALS, errors
from ambkit.judge.load_following import STEP, load_capacity
from ambkit.judge.loop.loop_of import OutOfReachError, zone_of
from ambkit.machine.magnets import own_time
from ambkit.workflow.stages import read_json
from ambkit.workflow.tuned_filter import Tuned, tune
from ambkit.workflow.tuning import default_disturbance
from ambkit.workflow.tuning_tasks import AHEAD, JUDGED

if TYPE_CHECKING:
    from ambkit.export.c import CExport
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.machine import Machine
    from ambkit.simulation.flight import Flight

RUNS = 20
"""Simulated runs that a filter is judged in."""

FAR_FROM_BOUND = 0.8
"""A filter whose position is this far from the bound is not exported unasked."""

AS_LIKELY = 3e-3
"""Difference of log likelihood a sample within which the records do not tell two filters apart."""

AS_GOOD = 0.02
"""Relative difference of errors within which the simpler of two kinds is taken."""


@dataclass(frozen=True)
class Candidate:
    """A tuned filter, and how it did."""

    kind: str  #: Of the filter.
    file: Path  #: The filter.
    kept: bool  #: Whether tuning was of use.
    unseen: Mapping[str, float]  #: Figures on records that it was not tuned on, see `Tuned`.
    #: Root mean square errors of ``x`` [m], ``v`` [m/s], ``f_d`` [N] in simulated runs of the
    #: bearing that was found, with the noise that this filter assumes, under a step of `load`.
    errors: Mapping[str, float]
    efficiency: float  #: Bound of the position's error over that error; 1 is what nobody exceeds.
    #: Peak of abs(S) in the loop with the default controller [1]; NaN where it cannot be told.
    peak: float = math.nan
    #: Step of the disturbance force in these runs [N]: half the load capacity, or less where the
    #: rotor met a stop.
    load: float = math.nan
    #: Error of the position [m] where the force wanders as the filter assumes: kinds are told apart
    #: by it, whatever process noise each was tuned to.
    wandering: float = math.nan


def tuned_within(ceiling: float | None, *arguments: Any, **options: Any) -> Tuned:
    """Tune a filter below a ceiling on the peak of abs(S), or without where none can be."""
    try:
        return tune(*arguments, max_sensitivity=ceiling, **options)
    except OutOfReachError:
        return tune(*arguments, **options)


def exported_filter(
    plant: Bearing | Machine, place: Path, precision: str, prefix: str | None,
    flight: Flight | None = None,
) -> CExport:  # fmt: skip
    """Return the design's filter as C, with a flight the whole controller; it is judged before."""
    from ambkit.export.c import export_c

    file = FilterFile.load(place / "filter.toml")
    return export_c(
        plant, file.asked(), place / "c", filter_file=file, flight=flight, prefix=prefix,
        precision="double" if precision == "double" else "float", force=True,
    )  # fmt: skip


def of_tuning(tuned: Tuned) -> dict[str, Any]:
    """Return what is kept of a filter's tuning, as plain data."""
    taken = 1 if tuned.kept else 0
    unseen = {name: pair[taken] for name, pair in tuned.unseen.items()}
    return {
        "kept": tuned.kept,
        "unseen": unseen,
        "warnings": list(tuned.warnings),
        "peak": None if math.isnan(tuned.peak) else tuned.peak,
    }


def judged(path: Path, seed: int) -> dict[str, Any]:
    """Judge a filter in runs of its own bearing, with noise as it assumes it."""
    # Its errors are those under a step of the stated disturbance force; its efficiency, for which
    # there is a bound, is that with a load that wanders as it assumes.
    file = FilterFile.load(path)
    made = file.make()
    usual = made.variances
    plant = made.bearing.replace(
        sensor__noise_variance=usual.measurement, amplifier__noise_variance=usual.control
    )
    walks = usual.disturbance / default_disturbance(plant)
    case = replace(CASES["model"], walks=walks)
    field = {file.kind: Contender(file.kind, file.kind, file.make)}
    found = bench(plant, case, field, runs=RUNS, seed=seed)
    load, errors = _under_a_load(plant, file, seed)
    gain = plant.sensor.gain
    return {
        "errors": errors,
        "wandering": found.default[file.kind].mean("x"),
        "load": load,
        "efficiency": found.efficiency(file.kind, "x"),
        "raw": math.sqrt(usual.measurement) / abs(gain),
    }


def _under_a_load(plant: Bearing, file: FilterFile, seed: int) -> tuple[float, dict[str, float]]:
    """Return the stated load [N], and a filter's errors under a step of it."""
    # Where the rotor meets a stop in each run it is a half, a quarter, an eighth of that.
    load = STEP * load_capacity(plant)[0]
    first = round(SETTLING * own_time(plant) / plant.sampling_time)
    for share in (1.0, 0.5, 0.25, 0.125):
        made = trials(load_case(share * load), plant, RUNS, seed)
        flown = [each for each in made if not each.lost]
        if flown:
            means = errors(file.make, flown, first).mean(axis=0).tolist()
            return share * load, dict(zip(SIGNALS, means, strict=True))
    raise AmbkitError(f"{plant.name}: the rotor met a stop in all simulated runs")


def candidate_in(place: Path, kind: str) -> Candidate:
    """Return a candidate as its files in a folder have it."""
    tuning = read_json(place / f"candidates/{kind}.json")
    judged = read_json(place / f"candidates/{kind}.judged.json")
    peak = math.nan if tuning["peak"] is None else tuning["peak"]
    return Candidate(
        kind, place / f"candidates/{kind}.toml", tuning["kept"], tuning["unseen"],
        judged["errors"], judged["efficiency"], peak, judged["load"],
        judged["wandering"],
    )  # fmt: skip


def best_of(candidates: Sequence[Candidate]) -> Candidate:
    """Return who errs least among those that unseen records like best; of equals the simplest."""
    # Where a rotor hardly moves, its records do not tell the kinds apart; simulated truth does.
    order = list(KINDS)
    unlikely = {c.kind: c.unseen[JUDGED["likelihood"]] for c in candidates}
    least = min(unlikely.values())
    likely = [c for c in candidates if unlikely[c.kind] <= least + AS_LIKELY]
    smallest = min(c.wandering for c in likely)
    equal = [c for c in likely if c.wandering <= (1 + AS_GOOD) * smallest]
    return min(equal, key=lambda c: order.index(c.kind))


def objections_to(chosen: Candidate, raw: float) -> list[str]:
    """Return what speaks against flying a candidate."""
    said = []
    if not chosen.wandering < raw:
        error, sensor = (engineering(v, "m", digits=3) for v in (chosen.wandering, raw))
        said.append(f"its position errs by {error}, and that of the raw sensor by {sensor}")
    if chosen.efficiency < FAR_FROM_BOUND:
        said.append(
            f"its position reaches {100 * chosen.efficiency:.0f} % of the bound, less than "
            f"{100 * FAR_FROM_BOUND:.0f} %"
        )
    if zone_of(chosen.peak) != "A" and not math.isnan(chosen.peak):
        said.append(
            f"in the loop with the default controller the peak of |S| is {chosen.peak:.3g}, zone "
            f"{zone_of(chosen.peak)} of ISO 14839-3: another controller may leave more margin"
        )
    return said


def adequacy_of(chosen: Candidate) -> list[Finding]:
    """Return whether a candidate may fly, with NIS on records that it was not tuned on."""
    made = FilterFile.load(chosen.file).make()
    return judge_adequacy(made, nis=chosen.unseen.get("nis", math.nan))


def why_fly(chosen: Candidate, candidates: Sequence[Candidate], raw: float) -> str:
    """Return which filter to fly and why, in a sentence."""
    x, f_d = chosen.errors["x"], chosen.errors["f_d"]
    others = [c for c in candidates if c is not chosen]

    def ahead(candidate: Candidate) -> str:
        return engineering(candidate.unseen[AHEAD[10]], "m", digits=3)

    beside = "".join(f", the {KINDS[c.kind].label} {ahead(c)}" for c in others)
    return (
        f"Fly the {KINDS[chosen.kind].label}: on records that it was not tuned on it foretells "
        f"the position 10 samples ahead to {ahead(chosen)} rms"
        f"{beside}; in simulated runs of this bearing, under a step of the disturbance force of "
        f"{engineering(chosen.load, 'N', digits=3)}, it errs by {engineering(x, 'm', digits=3)} "
        f"in position, {100 * chosen.efficiency:.0f} % of what is possible, and "
        f"{engineering(f_d, 'N', digits=3)} in the disturbance force, where the raw sensor errs by "
        f"{engineering(raw, 'm', digits=3)}."
    )
