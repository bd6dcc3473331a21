"""Compute the figures that README.md and docs/explanation/comparison.md state in their text.

``python docs/make_numbers.py`` prints all, in some minutes; with names, such as ``reproduction
experiments``, these sections alone. What the pages show in tables, figures and output is computed
when they are built. Pictures and tables of docs/explanation/comparison.md come from
docs/make_comparison.py, those of docs/explanation/rig.md from examples/rig.py and
``python -m benchmarks.identification``.
"""

import os
import re
import runpy
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from paper import adaline, chain, expert, gain, recording
from paper.study import Study
from paper.verdicts import ours, runs
from scipy.stats import chi2, ttest_rel

import ambkit
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import ExtendedKalmanFilter
from ambkit.estimate.registry import KINDS
from ambkit.identification.excitation import design
from ambkit.identification.maximum_likelihood import maximum_likelihood
from ambkit.judge.comparison import criteria
from ambkit.judge.comparison.cases import CASES, Trial, trials, walk_case
from ambkit.judge.comparison.comparison import bench
from ambkit.judge.comparison.tuning import candidates
from ambkit.machine.magnets import own_time

DOCS = Path(__file__).parent
BEARING = ambkit.preset("zittau_axial")

Array = NDArray[np.float64]


def said(values: Array, digits: int = 2) -> str:
    """Mean and standard deviation of several runs."""
    return f"{values.mean():.{digits}f} ± {values.std(ddof=1):.{digits}f} ({values.size} runs)"


def reproduction() -> None:
    """Print what `ambkit reproduce` finds, by the ids of its summary.json."""
    study = Study()
    for chapter in (adaline.adaline, expert.expert, gain.gain, chain.chain, recording.recording):
        for row in chapter(study).rows:
            print(f"{row['id']:>22}: {ours(row)} {row['unit']}, runs {runs(row)}: {row['what']}")


def force_table() -> None:
    """Iron that saturates: examples/force_table.py."""
    runpy.run_path(str(DOCS.parent / "examples" / "force_table.py"))


def excite() -> None:
    """Print what docs/how-to/excite.md does: a load that nobody knows, coloured noise."""
    page = (DOCS / "how-to" / "excite.md").read_text(encoding="utf-8")
    names: dict[str, object] = {}
    for cell in re.findall(r"^```{code-cell}\n(.*?)^```", page, re.MULTILINE | re.DOTALL):
        if not cell.startswith(":tags:"):  # a picture
            exec(compile(cell, "docs/how-to/excite.md", "exec"), names)


def experiments(count: int = 100) -> None:
    """Print the scatter of what experiments of a second tell, over what was expected."""
    loop = ambkit.Scenario(duration=1.0, controller=ambkit.PID.for_bearing(BEARING))
    asked = ("magnet_constant", "air_gap")
    load = 1e-3  # N, in a second
    match = design(BEARING, loop, free=asked, load=load)
    t, T = match.record.t, BEARING.sampling_time

    def one(seed: int) -> list[float]:
        walk = load * np.sqrt(T) * np.cumsum(np.random.default_rng(seed).normal(size=t.size))
        record = ambkit.simulate(BEARING, loop.model_copy(update={
            "seed": seed,
            "reference": ambkit.Recorded.model_construct(times=tuple(t),
                                                         values=tuple(match.reference)),
            "disturbance": ambkit.Recorded.model_construct(times=tuple(t), values=tuple(walk)),
        })).record  # fmt: skip
        result = maximum_likelihood(record, match.expectation.model, asked)
        return [result[name] for name in asked]

    with ThreadPoolExecutor(2) as pool:
        values = np.array(list(pool.map(one, range(count))))
    for name, scatter in zip(asked, values.std(axis=0, ddof=1), strict=True):
        print(f"{name}: scatter over expectation {scatter / match.expectation[name]:.2f}")


def uncertain(count: int = 64) -> None:
    """Print whether the closed law helps where the plant is not the nominal one, untuned."""
    field = candidates(["linear", "closed-law", "augmented"], BEARING)
    standing = bench(BEARING, CASES["uncertain"], field, runs=count).default
    force = {name: item.figures["f_d"] for name, item in standing.items()}
    for name, errors in force.items():
        print(f"{name:>11}: f_d {said(errors[np.isfinite(errors)])}")
    better = 100 * np.mean(force["closed-law"] < force["linear"])
    p = ttest_rel(force["linear"], force["closed-law"], nan_policy="omit").pvalue
    print(f"the law is better in {better:.0f} % of the runs; t test of pairs: p = {p:.3f}")


def wrong_k(count: int = 32) -> None:
    """Print errors of the force from the load on, where the constant is wrong, untuned."""
    wrong = CASES["wrong-k"]
    cases = {
        "constant 30 % too small": replace(wrong, drift=0.0),
        "the same, drifting by 10 %": wrong,
        "constant right": replace(wrong, magnet_constant=1.0, drift=0.0),
    }
    at = 42 * own_time(BEARING)

    def error(make: Callable[[Trial], Estimator], trial: Trial) -> float:
        late = trial.record.t >= at
        off = make(trial).run(trial.record).f_d - trial.record["f_d"]
        return float(np.sqrt(np.mean(off[late] ** 2)))

    ways: dict[str, Callable[[Trial], Estimator]] = {
        "given, wrong": lambda _: ExtendedKalmanFilter(BEARING),
        "given, right": lambda trial: ExtendedKalmanFilter(trial.plant),
        "fifth state": lambda _: KINDS["augmented"].make(BEARING, None),
        "interacting models": lambda _: KINDS["multiple-model"].make(BEARING, None),
    }
    for title, case in cases.items():
        made = [trial for trial in trials(case, BEARING, count, 0) if not trial.lost]
        for name, make in ways.items():
            print(f"{title:>26}, {name:>18}: f_d "
                  f"{said(np.array([error(make, trial) for trial in made]))}")  # fmt: skip


def consistency(count: int = 200) -> None:
    """Print how sure filters are at three tenths of the travel, where all is as they assume."""
    made = [trial for trial in trials(walk_case(0.3), BEARING, count, 0) if not trial.lost]
    for name in ("linear", "closed-law"):
        shares = []
        for trial in made:
            estimate = KINDS[name].make(BEARING, None).run(trial.record, covariance=True)
            nees = criteria.normalised_errors(estimate, trial.record)[500:]
            shares.append(100 * np.mean(nees <= chi2.ppf(0.95, 3)))
        print(f"{name:>11}: NEES within its 95 % bound in {said(np.array(shares), 1)} %")


SECTIONS = {
    item.__name__: item
    for item in (reproduction, force_table, excite, experiments, uncertain, wrong_k, consistency)
}

if __name__ == "__main__":
    wanted = sys.argv[1:] or list(SECTIONS)
    unknown = sorted(set(wanted) - set(SECTIONS))
    if unknown:
        raise SystemExit(f"there is no section {unknown[0]}; known: {', '.join(SECTIONS)}")
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # some write files
        for name in wanted:
            print(f"\n{name}: {SECTIONS[name].__doc__}")
            SECTIONS[name]()
