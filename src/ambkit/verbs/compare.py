"""Comparison of filters: in benchmark cases, and in closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ambkit.base.progress import progress
from ambkit.base.quantity_arguments import seeds_in
from ambkit.verbs import words

if TYPE_CHECKING:
    from ambkit.judge.comparison.score import ComparisonSet
    from ambkit.judge.comparison.study import Study
    from ambkit.workflow.comparison import LoopScores


def compare(
    machine: words.Machine,
    filter: words.Filters = "all",
    *,
    case: words.Case = "paper",
    plant: words.TruePlant | None = None,
    spread: words.Share | None = None,
    budget: int = 0,
    seeds: words.Seeds = 20,
    robustness: bool = False,
) -> Study | ComparisonSet:
    """Compare filters by error, consistency, delay and cost.

    All filters run along the same records, and each in its own loop; the raw sensor is included.
    With several axes the case applies to each axis, and errors are totals over all of them.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file; the model of the filters.
    filter : str, path or sequence of them, optional
        Kind, KIND@FILE with an expert (.json) or force map (.csv), filter file (.toml), or a class
        with step(y, u) as my.py:MyFilter.
    case : str, optional
        paper, uncertain, wrong-k, saturating, coloured-noise, step, unbalance, model, or all.
    plant : MagnetModel, class, str or path, optional
        True plant, unknown to the filters: the force map of the magnet (iu, x, f_mag) of one axis,
        on which table and adaptive are trained unless they have a file, or a class as
        my.py:MyPlant.
    spread : float or str, optional
        Maximum deviation of the plant, such as "20 %": magnet constant, mass, air gap, sensor and
        disturbance force. By default that of the case.
    budget : int, optional
        Evaluations to tune each filter; 0 keeps the default settings.
    seeds : int, range or str, optional
        Number of runs, each with its own noise; FIRST is the first random seed, else 0.
    robustness : bool, optional
        Add errors over the step size and a wrong magnet constant, with the Cramer-Rao bound.

    Returns
    -------
    Study or Benches
        Results of one case, or of all cases by name.

    Raises
    ------
    AmbkitError
        A case or filter is unknown, a file cannot be read, or an argument is out of range.

    Examples
    --------
    $ ambkit compare zittau_axial --case paper --robustness --plot matrix.png --out comparison.html
    $ ambkit compare my.toml --filter linear --filter extended --budget 40 --out filters=filters
    $ ambkit compare tum_mlps --case model --filter linear --filter extended
    """
    from ambkit.arguments import machine_argument
    from ambkit.workflow import comparison

    with progress("learning") as done:
        return comparison.in_case(
            machine_argument(machine), filter, case, plant=plant, spread=spread, budget=budget,
            seeds=seeds_in(seeds), robustness=robustness, source=machine, done=done,
        )  # fmt: skip


def compare_steps(
    machine: words.Machine,
    filter: words.Filters | None = None,
    *,
    steps: Sequence[words.Length] | None = None,
    disturbance: words.Force | None = None,
    duration: words.Time | None = None,
    scenario: words.Scenario | None = None,
    plant: words.TruePlant | None = None,
    seeds: words.Seeds = 20,
) -> LoopScores:
    """Compare filters in closed loop, over reference steps or in a scenario.

    All have the same noise, Q and R.

    Parameters
    ----------
    machine, plant, seeds : optional
        As for `ambkit compare`.
    filter : Estimator, class, str, path, sequence or mapping of them, optional
        Kind, KIND@FILE with an expert (.json) or force map (.csv), or filter file (.toml). By
        default as for `ambkit filter`.
    steps : sequence of float or str, optional
        Reference step of the first axis [m]. By default 0.1, 0.3 and 0.5 of the clearance; none
        with a scenario.
    disturbance : float or str, optional
        Disturbance force step on the first axis at half of the duration [N].
    duration : float or str, optional
        Duration [s].
    scenario : Scenario, str or path, optional
        Scenario (`ambkit schema scenario`).

    Returns
    -------
    LoopScores
        Errors of each filter in each case.

    Raises
    ------
    AmbkitError
        A filter is unknown, a file cannot be read, or an argument is out of range.

    Examples
    --------
    $ ambkit compare steps tum_mlps --filter linear --steps "20 um" --steps "40 um"
    $ ambkit compare steps zittau_axial --steps "0.3 mm" --disturbance "3 N" --plot bars.png
    """
    from ambkit.arguments import machine_argument
    from ambkit.workflow import comparison

    with progress("comparing") as done:
        return comparison.in_loops(
            machine_argument(machine), filter, scenario, steps=steps, load=disturbance,
            duration=duration, plant=plant, seeds=seeds_in(seeds), done=done,
        )  # fmt: skip
