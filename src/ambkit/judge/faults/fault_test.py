"""Fault-injection test: every estimator with every fault, in the loop and beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.progress import progress
from ambkit.base.quantity_arguments import of_type
from ambkit.base.threads import pool_of
from ambkit.control.pid import PID
from ambkit.data.files.tables import Table
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.named import factories
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison.tuning import suited
from ambkit.judge.faults.fault_run import BASELINE, SETTINGS, Flight, Outcome, recovery_text
from ambkit.judge.faults.faults import CLEAN, FAULTS
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import Precision
from ambkit.result.report import Axis, Cells, Figure, Panel
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put

MIXTURE = "mixture"  #: Name of the random mixtures of faults.

TEXTS = ("fault", "estimator", "precision", "setting", "levitation")
"""Outcomes in words."""

FLIGHT_UNITS = {
    "at_stop": "s", "worst_x": "m", "worst_f_d": "N", "after_x": "m", "after_f_d": "N",
}  # fmt: skip


@dataclass(frozen=True, repr=False)
class FaultCampaign(Result):
    """Results of a fault-injection test."""

    machine: Machine  #: Machine.
    outcomes: tuple[Outcome, ...]  #: Outcome of each run.

    @property
    def estimators(self) -> list[str]:
        """Names of the estimators, without the baseline."""
        names = dict.fromkeys(outcome.estimator for outcome in self.outcomes)
        return [name for name in names if name != BASELINE]

    @property
    def faults(self) -> list[str]:
        """Names of the faults."""
        return list(dict.fromkeys(outcome.fault for outcome in self.outcomes))

    def select(self, **criteria: str) -> list[Outcome]:
        """Return the outcomes with given attributes."""
        return [
            outcome
            for outcome in self.outcomes
            if all(getattr(outcome, name) == value for name, value in criteria.items())
        ]

    @property
    def failures(self) -> list[Outcome]:
        """Runs in which an estimator was not finite, was held forever or did not recover."""
        # In the loop only non-finite values count, unless the rotor stayed levitated: an estimator
        # whose rotor landed has no error band to return to.
        return [
            outcome
            for outcome in self.outcomes
            if outcome.estimator != BASELINE
            and not outcome.recovered
            and (
                not outcome.finite or outcome.setting == "open loop" or outcome.levitation == "kept"
            )
        ]

    def slowest(self, estimator: str) -> float:
        """Maximum number of samples until recovery in open loop; infinity if it once did not."""
        beside = self.select(estimator=estimator, setting="open loop")
        took = [item.recovery if item.recovered else math.inf for item in beside]
        return max((item for item in took if not math.isnan(item)), default=math.nan)

    @property
    def title(self) -> str:
        faults = f"{len(self.faults)} fault{'s' * (len(self.faults) > 1)}"
        return f"{self.machine.name}: {len(self.outcomes)} runs with {faults}"

    @property
    def finding(self) -> str:
        outcomes = [outcome for outcome in self.outcomes if outcome.estimator != BASELINE]
        lost = sum(e.setting == "closed loop" and e.levitation == "lost" for e in outcomes)
        failed = len(self.failures)
        if not lost and not failed:
            return f"{self.title}: no levitation was lost, and all filters recovered."
        return f"{self.title}: levitation lost in {lost}, no recovery in {failed}."

    @property
    def notes(self) -> list[str]:
        sentences = []
        for name in self.estimators:
            failed = {failure.fault for failure in self.failures if failure.estimator == name}
            if lost := self._lost(name):
                sentences.append(f"{name}: levitation was lost in {', '.join(lost)}.")
            if failed:
                sentences.append(f"{name}: no recovery from {', '.join(sorted(failed))}.")
        return sentences

    def _lost(self, name: str) -> list[str]:
        outcomes = self.select(estimator=name, setting="closed loop", levitation="lost")
        return sorted({outcome.fault for outcome in outcomes})

    @cached_property
    def rows(self) -> list[Row]:
        result = put(self._of(BASELINE), section=("controller_alone",), of=BASELINE)
        for name in reversed(self.estimators):
            result = put(self._of(name), section=("estimators",), of=name) + result
        about = {CLEAN.name: CLEAN.about, MIXTURE: "up to three at a time, at random"}
        about |= {name: fault.about for name, fault in FAULTS.items()}
        for fault in self.faults:
            unfiltered = recovery_text(self.select(fault=fault, estimator=BASELINE))
            result += put([
                *(Row(s.replace(" ", "_"), s, self._slowest(fault, s)) for s in SETTINGS),
                Row("controller_alone", "without filter", unfiltered or None),
                Row("about", "fault", about[fault], detail=True),
            ], section=("faults",), of=fault)  # fmt: skip
        return result

    def _of(self, name: str) -> list[Row]:
        """Return the figures of one estimator, or of the controller without one."""
        beside = self.select(estimator=name, setting="open loop")
        trials = self.select(estimator=name, setting="closed loop")
        own: list[Row] = []
        if beside:
            worst = ([getattr(e, key) for e in beside] for key in ("after_x", "after_f_d"))
            x, f_d = (max((w for w in item if not math.isnan(w)), default=None) for item in worst)
            back = sum(item.recovered for item in beside)
            own = [
                Row("recovered", "all recovered", back == len(beside), detail=True),
                Row("back", "recovered", back),
                Row("beside", "of", len(beside)),
                Row("slowest_recovery", "recovery, samples", self.slowest(name), digits=1),
                Row("after_x", "error of x", x, "m", 3),
                Row("after_f_d", "error of f_d", f_d, "N", 3),
            ]
        ends = [trial.levitation for trial in trials]
        return [
            *own,
            Row("flown", "simulated", len(trials), detail=True),
            Row("kept", "no contact", ends.count("kept")),
            Row("touched", "contact", ends.count("touched")),
            Row("lost", "lost", ends.count("lost")),
            Row("at_stop", "longest contact", max((e.at_stop for e in trials), default=None), "s",
                detail=True),
        ]  # fmt: skip

    def _slowest(self, fault: str, setting: str) -> str | None:
        """Return which estimators diverged, or the slowest recovery in samples."""
        of = {
            name: recovery_text(self.select(fault=fault, estimator=name, setting=setting))
            for name in self.estimators
        }
        of = {name: text for name, text in of.items() if text}
        if bad := [name for name, text in of.items() if not text.isdigit()]:
            summary = ", ".join(f"{name} {of[name]}" for name in bad)
            return summary if len(bad) <= 2 else f"{of[bad[0]]}: {len(bad)} of {len(of)}"
        if not of:
            return None
        name = max(of, key=lambda item: int(of[item]))
        return of[name] if of[name] == "0" or len(of) == 1 else f"{of[name]} ({name})"

    SECTIONS = {
        ("estimators",): Section("Open loop and closed loop", across=True),
        ("controller_alone",): Section("The controller fed by the measurement", across=True),
        ("faults",): Section("Recovery time, worst seed [samples]", across=True),
    }

    @property
    def series(self) -> dict[str, Any]:
        seeds = [outcome.seed for outcome in self.outcomes]
        return {
            "machine": self.machine.name,
            "seeds": [min(seeds), max(seeds)],
            "estimators": {name: {"lost_in_loop": self._lost(name)} for name in self.estimators},
            "flights": [
                asdict(outcome)
                | {"recovered": outcome.recovered, "never": outcome.recovery == math.inf}
                for outcome in self.outcomes
            ],
        }

    def file(self) -> Table:
        columns, lists = {}, {}
        for name in [*vars(self.outcomes[0]), "recovered"]:
            values = [getattr(outcome, name) for outcome in self.outcomes]
            if name in TEXTS:
                lists[f"{name}s"] = list(dict.fromkeys(values))
                values = [lists[f"{name}s"].index(value) for value in values]
            columns[name] = np.array(values, dtype=float)
        units = {name: FLIGHT_UNITS.get(name, "1") for name in columns}
        return Table(columns, units, {"machine": self.machine.name} | lists)

    def figures(self) -> list[Figure]:
        return [faults_figure(self)]


SLOW = 1000.0
"""Samples until recovery that have the darkest colour of a recovered cell."""


FEW = 5  #: Number of columns up to which each is as wide as its head.
RAISED = "\n\n\n"
"""Lowered below the others, so that each head is above its neighbours: heads are the wider."""


def faults_figure(campaign: FaultCampaign) -> Figure:
    """Plot the outcome of each estimator with each fault, in open and in closed loop."""
    panels = [
        Panel(Axis(""), Axis(""), [_cells(campaign, setting)], title=setting)
        for setting in SETTINGS
    ]
    rows = max(len(cells.rows) for panel in panels if (cells := panel.item(Cells)))
    return Figure(
        id="faults",
        title=f"{campaign.machine.name}: recovery from faults",
        caption="Recovery time of the estimate, in closed loop also of the rotor [samples]; worst "
        "seed, darker is longer. Darkest: lost (the rotor stayed on a stop), never, held (the "
        "estimate stands still), or ∞ (not finite). Last column in closed loop: controller fed by "
        "the measurement.",
        panels=panels,
        panel_height=0.19 * rows,
    )


def _cells(campaign: FaultCampaign, setting: str) -> Cells:
    names = (*campaign.estimators, BASELINE)
    columns = [name for name in names if campaign.select(setting=setting, estimator=name)]
    rows = [name for name in campaign.faults if campaign.select(setting=setting, fault=name)]
    results = [
        [campaign.select(setting=setting, fault=fault, estimator=name) for name in columns]
        for fault in rows
    ]
    return Cells(
        [
            name.replace("-", "\n") + RAISED * (place % 2 if len(columns) > FEW else 0)
            for place, name in enumerate(columns)
        ],
        rows,
        np.array([[_shade(cell) for cell in row] for row in results]),
        [[recovery_text(cell).replace("not finite", "∞") for cell in row] for row in results],
    )


def _shade(outcomes: Sequence[Outcome]) -> float:
    text = recovery_text(outcomes)
    if not text:
        return math.nan
    return min(0.7, 0.7 * math.log1p(float(text)) / math.log1p(SLOW)) if text.isdigit() else 1.0


def chosen_faults(names: Iterable[str] | None) -> list[str]:
    """Check names of faults; none means all of them."""
    results = list(FAULTS) if names is None else list(dict.fromkeys(names))
    for name in results:
        if name not in FAULTS:
            raise AmbkitError(f'there is no fault "{name}"; known: {", ".join(FAULTS)}')
    return results


def _faults_of(flight: Flight, faults: Sequence[str], steps: int) -> list[str]:
    """Return the faults of a run, the fault-free one first."""
    names = (CLEAN.name, *faults, *([MIXTURE] if steps else ()))
    return [name for name in names if FAULTS.get(name, CLEAN).in_loop or not flight.in_loop]


def inject_faults(
    machine: Machine,
    estimators: Any = None,
    *,
    reading: str | None = None,
    faults: Iterable[str] | None = None,
    seeds: Sequence[int] = (0,),
    steps: int = 50_000,
    precisions: Sequence[Precision] = ("float64",),
    controller: PID | None = None,
    plant: Any = None,
    threads: int = 2,
) -> FaultCampaign:
    """Simulate each estimator with faults of sensor, control signal, amplifier and disturbance."""
    of_type(Machine, machine=machine)
    at, named = _reading(machine, reading), chosen_faults(faults)
    if not machine.single and "lift-off" in named:  # lift-off includes its own start
        named.remove("lift-off")
    kinds = suited(list(KINDS), machine)
    built = factories(kinds if estimators is None else estimators, machine)
    works = [
        (Flight(machine, controller, in_loop, seed, precision, at, plant), name, build)
        for precision in precisions
        for seed in seeds
        for in_loop in (False, True)
        for name, build in [*built.items(), *([(BASELINE, None)] if in_loop else [])]
    ]
    run_count = sum(len(_faults_of(flight, named, steps)) for flight, *_ in works)
    with progress("flying", run_count, unit="flights") as tell, pool_of(threads) as pool:
        results = pool.map(lambda work: list(_campaign(named, steps, tell, *work)), works)
        outcomes = [item for result in results for item in result]
    return FaultCampaign(machine, tuple(outcomes))


def _reading(machine: Machine, name: str | None) -> int:
    """Return the reading with a name; without a name the first."""
    names = [reading.name for reading in machine.readings]
    if name is not None and name not in names:
        raise AmbkitError(f"{machine.name} has no reading {name}; there are {', '.join(names)}")
    return 0 if name is None else names.index(name)


def _campaign(
    faults: Sequence[str], steps: int, done: Callable[[str], None],
    fault_test: Flight, estimator: str, build: Callable[..., Estimator] | None,
) -> Iterator[Outcome]:  # fmt: skip
    """Simulate an estimator, or the controller without one, with all faults."""
    band = None
    for name in _faults_of(fault_test, faults, steps):
        fault = FAULTS.get(name, CLEAN)
        channel, windows = fault_test.mixed(steps) if name == MIXTURE else fault_test.through(fault)
        if not windows:
            raise AmbkitError(f"samples = {steps} is too short for a fault and its recovery")
        run = fault_test.fly(channel, build and build(precision=fault_test.precision))
        band = band or fault_test.band(run)
        yield fault_test.evaluate(run, windows, band, fault=name, estimator=estimator)
        done(name)
