"""Comparison in one case, with sweeps of step and magnet constant, and the bound."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as with_default
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.data.files.tables import Table
from ambkit.estimate.registry import KINDS, learned_magnet, split_name
from ambkit.fuzzy.training import train
from ambkit.judge.comparison import cases as benchmark
from ambkit.judge.comparison.cases import CASES, Case, Trial
from ambkit.judge.comparison.comparison import TRAINING, Sweep, bench, sweep
from ambkit.judge.comparison.conditions import CERTAIN
from ambkit.judge.comparison.criteria import CRITERIA, EVALUATED, per_run
from ambkit.judge.comparison.figures import efficiency_figure, run_figure, sweep_figure
from ambkit.judge.comparison.score import Comparison, ComparisonSet
from ambkit.judge.comparison.tuning import Candidate, candidates, suited
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel
from ambkit.machine.stiffness import StiffnessMap, stiffness_map
from ambkit.result.row import Part, Row, Section

HEIGHTS = (0.02, 0.1, 0.2, 0.3, 0.4, 0.5)  #: Heights of the steps, over the clearance.

WRONG = (0.7, 0.85, 1.0, 1.15, 1.3)
"""Magnet constants of the plant, over the assumed one."""

RULES, NODES = 5, 17
"""Rules of the expert and nodes of the table, along current and displacement."""

AROUND = (
    "How the errors grow with the distance from the centre, and with a magnet constant that is not "
    "the one that the estimators know."
)
LIMIT = (
    "If the filters' model is true, no estimator can have a smaller error than the "
    "posterior Cramér-Rao bound of Tichavský, Muravchik and Nehorai (1998). Their recursion needs "
    "the inverse of the process noise, which does not exist here; the bound is therefore taken in "
    "the state at the start and the noises, with the inequality of van Trees (1968), the Jacobians "
    "along true runs, and expectations over several of them."
)
HOW = (
    "{runs} records are made in closed loop, with the untuned linear filter in it, and each "
    "estimator runs along the same ones, from the same first measurement. Criteria of the loop "
    "come from the same runs with each estimator in the loop. The first two time constants of "
    "the plant are excluded."
)
TUNED = (
    f"Each estimator had {{budget}} evaluations on {TRAINING} runs of other seeds: its defaults, "
    "scrambled Sobol points for up to half of them, then a simplex from the best (Nelder and Mead "
    "1965). The objective is the mean RMSE of x, v and f_d, each over that of the untuned linear "
    "filter."
)

SWEEP_RUNS = 4  #: Runs per point of a sweep.


@dataclass(frozen=True, repr=False, kw_only=True)
class Study(Comparison):
    """A comparison in one case, with sweeps around it."""

    field: Mapping[str, Candidate]  #: The estimators.
    first: Trial  #: First run.
    #: Errors over the height of the step, over the plant's magnet constant, and over the height of
    #: the step with an exact model; None without report.
    steps: Sweep | None = None
    wrong_k: Sweep | None = None
    limit_steps: Sweep | None = None
    #: The case with a known bound, with the defaults, which are optimal there.
    model: Comparison | None = None
    #: Writes the tuned filters into a folder.
    save_filters: Callable[[Any, Path], object] | None = None
    #: Returns the objections to each kind.
    judge: Callable[[Any], Mapping[str, Sequence[Any]]] | None = None
    machine_file: str | os.PathLike[str] | None = None  #: Origin of the machine.
    #: Files with the magnet models of kinds.
    magnet_files: Mapping[str, str] = with_default(default_factory=dict)

    def file(self) -> Table:
        return per_run({self.case.name: self})

    def save_product(self, what: str, path: Path, beside: Mapping[str, Path]) -> None:
        """Write the tuned filters into a folder, one file per kind."""
        assert self.save_filters is not None  # set wherever products are named
        self.save_filters(self, path)

    @property
    def rows(self) -> list[Row]:
        model, result = self.model, super().rows
        if model is not None:
            result += [
                Row(s, CRITERIA[s].label, model.efficiency(name, s), section=("efficiency",),
                    of=name)
                for name in model.best for s in EVALUATED
            ]  # fmt: skip
        return result

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        title = "Efficiency where the filters' model is true"
        return {**super().sections, ("efficiency",): Section(title, across=True)}

    @property
    def chapters(self) -> list[Part]:
        best = [*self.figures(), run_figure(self)]
        around = {"steps": self.steps, "wrong_k": self.wrong_k}
        results = [Part("Comparison", self.case.about, None, best)]
        if self.steps is not None:
            swept = [sweep_figure(*item) for item in around.items()]
            results.append(Part("Dependence on conditions", AROUND, None, swept))
        if self.model is not None:
            limit = [sweep_figure("limit_steps", self.limit_steps),
                     efficiency_figure(self.model)]  # fmt: skip
            results.append(Part("Cramér-Rao bound", LIMIT, ("efficiency",), limit))
        return [*results, Part("Method", self._how(), ("tuning",))]

    def _how(self) -> str:
        spread = self.case.spread
        shares = (f"{n.replace('_', ' ')} ±{100 * by:.0f} %" for n, by in vars(spread).items())
        plant = (
            "The plant is the nominal one."
            if spread == CERTAIN
            else f"Scrambled Sobol points spread the plant around the nominal one: "
            f"{', '.join(shares)}."
        )
        tuned = TUNED.format(budget=self.budget) if self.tuned else ""
        criteria = "\n".join(f"- {of.label}: {of.about}" for of in CRITERIA.values())
        return f"{HOW.format(runs=self.runs)} {plant} {tuned}\n\n{criteria}"

    @property
    def series(self) -> dict[str, Any]:
        around = {"steps": self.steps, "wrong_k": self.wrong_k, "limit_steps": self.limit_steps}
        judged = {} if self.judge is None else self.judge(self)
        adequacy = {kind: [item._asdict() for item in of] for kind, of in judged.items()}
        return (
            super().series
            | {n: vars(item) for n, item in around.items() if item}
            | ({"adequacy": adequacy} if adequacy else {})
        )


def learned(
    case: Case, machine: Any, names: Sequence[str], own: Mapping[str, MagnetModel] | None = None
) -> dict[str, MagnetModel]:
    """Return the user's maps, or maps learned over the range of the steps."""
    # The expert has the paper's 25 rules. A table with more nodes costs no more, so it has more.
    results = dict(own or {})
    kinds = dict.fromkeys(split_name(name)[0] for name in names if name not in results)
    asking = [kind for kind in KINDS if kind in kinds and KINDS[kind].magnet is None]
    asking = [kind for kind in asking if kind not in results]
    if not asking:
        return results
    if not machine.single:
        known = {name: learned_magnet(name, machine) for name in asking}
        return results | {name: magnet for name, magnet in known.items() if magnet is not None}

    max_displacement = benchmark.REACH * machine.clearance
    force = benchmark.saturating(machine) if case.saturates else None
    if case.magnet is not None:
        force = case.magnet.force

    def work(nodes: int) -> StiffnessMap:
        currents = np.linspace(machine.current_min, machine.current_max, nodes)
        displacements = np.linspace(-max_displacement, max_displacement, nodes)
        return stiffness_map(machine, currents=currents, displacements=displacements, force=force)

    if set(asking) - {"table"}:
        results |= dict.fromkeys(asking, train(work(RULES), weights=True))
    return results | ({"table": work(NODES)} if "table" in asking else {})


def study(
    machine: Machine,
    case: Case | str,
    names: Sequence[str],
    *,
    custom: Mapping[str, Any] | None = None,
    runs: int = 16,
    budget: int = 0,
    seed: int = 0,
    threads: int | None = None,
    magnets: Mapping[str, MagnetModel] | None = None,
    robustness: bool = True,
    done: Callable[[str], None] = lambda _text: None,
) -> Study:
    """Compare estimators in one case, with sweeps around it."""
    case = CASES[case] if isinstance(case, str) else case
    names = suited(names, machine)
    case = case.with_states_of(names)
    threads = threads or os.cpu_count() or 1
    field = candidates(names, machine, learned(case, machine, names, magnets), custom)
    done("judging")
    main = bench(
        machine, case, field, runs=runs, budget=budget, seed=seed, threads=threads,
        done=lambda: done(f"case {case.name}"),
    )  # fmt: skip
    first = next(t for t in benchmark.iterate_trials(case, machine, runs, seed) if not t.lost)
    known: dict[str, Any] = vars(main) | {"field": field, "first": first}
    if not robustness:
        return Study(**known)
    tuned = {name: s.tuning for name, s in main.tuned.items() if s.tuning is not None}

    def row(what: str, cases: dict[float, Case], runs: int, tuned: Any) -> Sweep:
        return sweep(
            machine, cases, field, tuned=tuned, runs=runs, seed=seed, threads=threads,
            done=lambda: done(what),
        )  # fmt: skip

    def alike(other: Case, magnet_constant: float = 1.0) -> Case:
        return replace(
            other, saturates=case.saturates, magnet=case.magnet, magnet_constant=magnet_constant
        )

    travel = isolated_axes(machine)[0].clearance
    steps = {share * travel: alike(benchmark.step_case(share)) for share in HEIGHTS}
    wrong = {k: alike(benchmark.step_case(benchmark.STEPS[1]), k) for k in WRONG}
    walks = {share * travel: benchmark.walk_case(share) for share in HEIGHTS}
    return Study(
        **known,
        steps=row("errors by step", steps, SWEEP_RUNS, tuned),
        wrong_k=row("errors by k", wrong, SWEEP_RUNS, tuned),
        # The defaults are exact there.
        limit_steps=row("the limit", walks, 2 * SWEEP_RUNS, None),
        model=bench(
            machine, CASES["model"], field, runs=max(runs, 32), seed=seed, threads=threads,
            done=lambda: done("the limit"),
        ),
    )  # fmt: skip


def across(
    machine: Machine,
    cases: Mapping[str, Case],
    names: Sequence[str],
    *,
    custom: Mapping[str, Any] | None = None,
    runs: int = 16,
    budget: int = 0,
    seed: int = 0,
    magnets: Mapping[str, MagnetModel] | None = None,
    done: Callable[[str], None] = lambda _text: None,
) -> ComparisonSet:
    """Compare estimators in several cases, tuned in each."""
    known: dict[tuple[bool, int], dict[str, MagnetModel]] = {}

    def compared(case: Case) -> Comparison:
        learns_from = case.saturates, id(case.magnet)
        if learns_from not in known:
            known[learns_from] = learned(case, machine, names, magnets)
        return study(
            machine, case, names, custom=custom, runs=runs, budget=budget, seed=seed,
            magnets=known[learns_from], robustness=False, done=done,
        )  # fmt: skip

    return ComparisonSet({name: compared(case) for name, case in cases.items()})
