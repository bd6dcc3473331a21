"""The candidate filters of a design: evaluation, selection, objections."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base import escaping, files
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.estimate.filter_file import FilterFile
from ambkit.estimate.machine_model import several
from ambkit.estimate.noise_model import Variances
from ambkit.estimate.registry import KINDS
from ambkit.export.c import CExport, export_c
from ambkit.judge.adequacy import judge_adequacy
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.comparison.cases import CASES, load_case, trials
from ambkit.judge.comparison.comparison import bench
from ambkit.judge.comparison.criteria import SETTLING
from ambkit.judge.comparison.tuning import SIGNALS, Candidate, errors
from ambkit.judge.load_following import STEP
from ambkit.judge.loop.loop_builder import InfeasibleError
from ambkit.machine.axes import load_capacity, slowest_time
from ambkit.machine.machine import Machine
from ambkit.simulation.scenario import Scenario
from ambkit.workflow.tune import Tuned, tune
from ambkit.workflow.tuning import default_disturbance
from ambkit.workflow.tuning_tasks import JUDGED, RAW, By

STATE = "design.json"  #: File with the inputs and outputs of all stages, in the folder of a design.


class Stages:
    """Inputs and outputs of the stages in a folder, so that no stage runs twice."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        path = folder / STATE
        self.known: dict[str, Any] = read_json(path) if path.exists() else {}

    def make(
        self, name: str, made_from: Sequence[Any], written: Sequence[str], make: Callable[[], None]
    ) -> None:
        """Run a stage unless its outputs exist and its inputs are unchanged."""
        text = escaping.json_text([version("ambkit"), *made_from])
        key = hashlib.sha256(text.encode()).hexdigest()
        before = self.known.get(name, {})
        if before.get("from") == key and all(
            (self.folder / file).exists() and files.sha256(self.folder / file) == hashed
            for file, hashed in before.get("files", {}).items()
        ):
            return
        make()
        made = {file: files.sha256(self.folder / file) for file in written}
        self.known[name] = {"from": key, "files": made}
        write_json(self.folder / STATE, self.known)


def write_json(path: Path, data: Any) -> None:
    """Write plain data as JSON, through a temporary file."""
    files.write_text(path, escaping.json_text(data, indent=1) + "\n")


def read_json(path: Path) -> Any:
    """Read a file written by `write_json`."""
    try:
        return json.loads(files.read_text(path))
    except json.JSONDecodeError as error:
        raise AmbkitError(f"{path}:{error.lineno}: is not what ambkit wrote; remove it") from None


RUNS = 20  #: Simulated runs for the evaluation of a filter.
#: Excess of the position error over its bound that prevents an export without ``force``.
FAR_FROM_BOUND = 0.25

AS_LIKELY = 3e-3
"""Difference of log likelihood a sample within which the records do not tell two filters apart."""

AS_GOOD, AS_GOOD_BY_TRUTH = 0.02, 0.01
"""Relative difference of errors within which the simpler of two kinds is taken, of filters tuned on
records and of those tuned on simulated runs."""


@dataclass(frozen=True)
class TunedCandidate:
    """A tuned filter and its evaluation."""

    kind: str  #: Kind of filter.
    file: Path  #: Filter file.
    kept: bool  #: Whether the tuned filter was better than the untuned one.
    by: By  #: Criterion of the tuning.
    unseen: Mapping[str, float]  #: Figures on validation data, see `Tuned`.
    #: Root mean square errors of ``x`` [m], ``v`` [m/s], ``f_d`` [N] over all axes in simulated
    #: runs with a step of `load`, for a filter tuned on records with the noise it assumes.
    errors: Mapping[str, float]
    raw: float  #: Rms error of the sensors in these runs [m].
    #: Position error [m] by which filters are compared, under a random walk of the force with the
    #: assumed intensity.
    wandering: float
    #: Bound of the position error over that error, at most 1. NaN for a filter tuned in simulation,
    #: whose disturbance is no random walk.
    efficiency: float = math.nan
    #: Peak of abs(S) in the loop with the design's controllers [1]; NaN if undetermined.
    peak: float = math.nan
    #: Step of the disturbance force in these runs [N]: half of the load capacity, or less if the
    #: rotor touched a stop.
    load: float = math.nan

    @property
    def excess(self) -> float:
        """Relative excess of the position error over its bound; 0 if chance takes it below."""
        return max(1 / self.efficiency - 1, 0.0)


def tuned_within(peak_limit: float | None, *arguments: Any, **options: Any) -> Tuned:
    """Tune a filter with a limit on the peak of abs(S), or as close to it as possible."""
    try:
        return tune(*arguments, max_sensitivity=peak_limit, **options)
    except InfeasibleError as error:
        nearest: Tuned | None = error.nearest
        return nearest or tune(*arguments, **options)


def exported_filter(
    plant: Machine, place: Path, folder: str, precision: str, prefix: str | None,
    run: Scenario | None = None,
) -> CExport:  # fmt: skip
    """Return the design's filter as C, with its controllers if there is a scenario."""
    file = FilterFile.load(place / "filter.toml")
    filter = file.make(precision="float64" if precision == "double" else "float32")
    return export_c(plant, filter, place / folder, prefix=prefix, force=True, scenario=run)


def of_tuning(tuned: Tuned) -> dict[str, Any]:
    """Return the results of a tuning that a design keeps, as plain data."""
    pair_index = 1 if tuned.kept else 0
    validation = {name: pair[pair_index] for name, pair in tuned.unseen.items()}
    return {
        "kept": tuned.kept,
        "by": tuned.by,
        "unseen": validation,
        "warnings": list(tuned.warnings),
        "peak": None if math.isnan(tuned.peak) else tuned.peak,
    }


def judged(path: Path, seed: int) -> dict[str, Any]:
    """Evaluate a filter in simulated runs of its own machine, with the noise it assumes."""
    # The errors are those under a step of the disturbance force; the efficiency, for which there is
    # a bound, that under a random walk with the assumed intensity.
    file = FilterFile.load(path)
    made = file.make()
    usual, view = made.variances, made.view
    plant = _with_noise(made.machine, usual)
    own = several(default_disturbance(plant))
    walks = float(np.mean(np.divide(several(usual.disturbance), own)))
    field = {file.kind: Candidate(file.kind, file.kind, file.make)}
    result = bench(plant, replace(CASES["model"], walks=walks), field, runs=RUNS, seed=seed)
    load, errors = _under_a_load(plant, file, seed)
    raw_variance = view.measured**2 @ several(usual.measurement)
    return {
        "errors": errors,
        "wandering": result.default[file.kind].mean("x"),
        "load": load,
        "efficiency": result.efficiency(file.kind, "x"),
        "raw": math.sqrt(float(np.mean(raw_variance))),
    }


def _with_noise(machine: Machine, variances: Variances) -> Machine:
    """Return a machine with the noise of each sensor and amplifier that a filter assumes."""
    R = {r.sensor.name: v for r, v in _reversed(machine.readings, variances.measurement)}
    Q = {axis.bearing.name: v for axis, v in _reversed(machine.axes, variances.control)}
    sensors = [s.model_copy(update={"noise_variance": R[s.name]}) for s in machine.sensors]
    bearings = [
        b.model_copy(update={
            "amplifier": b.amplifier.model_copy(update={"noise_variance": Q[b.name]})
        })
        for b in machine.bearings
    ]  # fmt: skip
    return machine.replace(sensor=sensors, bearing=bearings)


def _reversed(of: Sequence[Any], values: Any) -> list[tuple[Any, float]]:
    """Return readings or axes with their values, in reverse order."""
    return list(zip(of, several(values), strict=True))[::-1]


def _under_a_load(plant: Machine, file: FilterFile, seed: int) -> tuple[float, dict[str, float]]:
    """Return the step of the disturbance force [N], and a filter's errors under it."""
    # The step is halved up to three times if the rotor touches a stop in every run.
    load = STEP * min(load_capacity(plant))
    first = round(SETTLING * slowest_time(plant) / plant.sampling_time)
    for share in (1.0, 0.5, 0.25, 0.125):
        made = trials(load_case(share * load), plant, RUNS, seed)
        valid_trials = [item for item in made if not item.lost]
        if valid_trials:
            means = errors(file.make, valid_trials, first).mean(axis=0).tolist()
            return share * load, dict(zip(SIGNALS, means, strict=True))
    raise AmbkitError(f"{plant.name}: the rotor met a stop in all simulated runs")


def candidate_in(place: Path, kind: str) -> TunedCandidate:
    """Return the candidate that the files in a folder describe."""
    tuning = read_json(place / f"candidates/{kind}.json")
    validation = tuning["unseen"]
    if tuning["by"] == "likelihood":
        result = read_json(place / f"candidates/{kind}.judged.json")
    else:  # evaluated in simulation when it was tuned
        errors = {signal: validation[f"error of {signal}"] for signal in SIGNALS}
        result = {"errors": errors, "raw": validation[RAW], "wandering": errors["x"]}
    peak = math.nan if tuning["peak"] is None else tuning["peak"]
    return TunedCandidate(
        kind, place / f"candidates/{kind}.toml", tuning["kept"], tuning["by"], validation,
        peak=peak, **result,
    )  # fmt: skip


def best_of(candidates: Sequence[TunedCandidate]) -> TunedCandidate:
    """Return the best among the likeliest on validation records; among equals the simplest."""
    # Records of a rotor that hardly moves do not distinguish the kinds; simulation does.
    order = list(KINDS)
    if candidates[0].by == "truth":
        least = min(c.unseen[JUDGED["truth"]] for c in candidates)
        limit = least + AS_GOOD_BY_TRUTH * abs(least)
        return next(c for c in candidates if c.unseen[JUDGED["truth"]] <= limit)
    unlikely = {c.kind: c.unseen[JUDGED["likelihood"]] for c in candidates}
    least = min(unlikely.values())
    likely = [c for c in candidates if unlikely[c.kind] <= least + AS_LIKELY]
    smallest = min(c.wandering for c in likely)
    equal = [c for c in likely if c.wandering <= (1 + AS_GOOD) * smallest]
    return min(equal, key=lambda c: order.index(c.kind))


def failed_criteria(chosen: TunedCandidate) -> list[str]:
    """Return the reasons against using a candidate."""
    objections = []
    if not chosen.wandering < chosen.raw:
        error, sensor = (engineering(v, "m", digits=3) for v in (chosen.wandering, chosen.raw))
        objections.append(
            f"its position error of {error} exceeds that of the raw sensors, {sensor}"
        )
    if chosen.excess > FAR_FROM_BOUND:
        objections.append(
            f"its position error is {100 * chosen.excess:.0f} % above the Cramér-Rao bound, more "
            f"than {100 * FAR_FROM_BOUND:.0f} %"
        )
    return objections


def adequacy_of(chosen: TunedCandidate, run: Scenario) -> list[Finding]:
    """Return whether a candidate is adequate, with NIS on validation records."""
    made = FilterFile.load(chosen.file).make()
    return judge_adequacy(made, None, run, chosen.unseen.get("nis", math.nan))
