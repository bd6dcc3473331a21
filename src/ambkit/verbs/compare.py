"""Filters compared: in a case, or each in its own loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ambkit.verbs.words import (
    Case,
    Filters,
    Force,
    Length,
    Machine,
    Scenario,
    Share,
    Time,
    TrueMagnet,
)

if TYPE_CHECKING:
    from ambkit.judge.comparison.score import Benches
    from ambkit.judge.comparison.study import Study
    from ambkit.workflow.compare_steps import LoopScores


def compare(
    machine: Machine,
    filter: Filters = "all",
    *,
    case: Case = "paper",
    plant: TrueMagnet | None = None,
    spread: Share | None = None,
    budget: int = 0,
    seeds: int = 20,
    first_seed: int = 0,
    whole: bool = False,
) -> Study | Benches:
    """Compare filters by error, consistency, delay and cost.

    In a case, all run along the same records from the same start, and each in the loop, beside the
    raw sensors. Of several axes a case happens to each, and errors are those of all axes together.

    Parameters
    ----------
    machine : Machine, str or path
        What the filters know: a preset's name, or a TOML file.
    filter : str, path or sequence of them, optional
        Kinds, KIND@FILE with an expert (.json) or force map (.csv), filters' files (.toml), or a
        class of your own with step(y, u) as my.py:MyFilter. May be repeated.
    case : str, optional
        What happens: paper, uncertain, wrong-k, saturating, coloured-noise, step, unbalance, model,
        or all.
    plant : MagnetModel, str or path, optional
        Force map of the true magnet, points of iu, x and f_mag: your own iron, which the filters do
        not know; table and adaptive learn it, or ask their own file. Of one axis.
    spread : float or str, optional
        How far the plant is off at most, such as "20 %": magnet constant, mass, air gap, sensor and
        disturbance force; by default what the case says.
    budget : int, optional
        Number of evaluations to tune each filter with; 0: defaults.
    seeds : int, optional
        Number of runs.
    first_seed : int, optional
        Seed of the first.
    whole : bool, optional
        Also errors by step and wrong magnet constant, and the limit of any filter, for the page.

    Returns
    -------
    Study or Benches
        Of one case, or of all cases by their names.

    Raises
    ------
    AmbkitError
        There is no such case or filter, a file cannot be read, or an argument is out of its range.

    Examples
    --------
    $ ambkit compare zittau_axial --case paper --whole --plot matrix.png --out comparison.html
    $ ambkit compare my.toml --filter linear --filter extended --budget 40 --out filters=filters
    $ ambkit compare tum_mlps --case model --filter linear --filter extended
    """
    from ambkit.assessment.arguments import machine_argument
    from ambkit.base.progress import progress
    from ambkit.workflow import comparison

    with progress("learning") as done:
        return comparison.in_case(
            machine_argument(machine), filter, case, plant=plant, spread=spread, budget=budget,
            seeds=seeds, first_seed=first_seed, whole=whole, source=machine, done=done,
        )  # fmt: skip


def compare_steps(
    machine: Machine,
    filter: Filters = ("linear", "adaptive", "closed-law"),
    *,
    steps: Sequence[Length] | None = None,
    disturbance: Force | None = None,
    duration: Time | None = None,
    scenario: Scenario | None = None,
    plant: TrueMagnet | None = None,
    seeds: int = 20,
    first_seed: int = 0,
) -> LoopScores:
    """Compare the errors of filters, each in its own loop.

    Against the same noise, with the same Q and R, over steps of the reference or in a scenario.

    Parameters
    ----------
    machine : Machine, str or path
        What the filters know: a preset's name, or a TOML file.
    filter : Estimator, class, str, path, sequence or mapping of them, optional
        Kinds, KIND@FILE with an expert (.json) or force map (.csv), or filters' files (.toml). May
        be repeated.
    steps : sequence of float or str, optional
        Step of the first axis's reference [m]. May be repeated. By default 0.1, 0.3 and 0.5 of the
        clearance; with a scenario none.
    disturbance : float or str, optional
        Disturbance force on the first axis after half of the run [N].
    duration : float or str, optional
        Length of the run [s].
    scenario : Scenario, str or path, optional
        What happens; `ambkit schema scenario`.
    plant, seeds, first_seed : optional
        As for `ambkit compare`.

    Returns
    -------
    LoopScores
        The errors of each filter in each case.

    Raises
    ------
    AmbkitError
        There is no such filter, a file cannot be read, or an argument is out of its range.

    Examples
    --------
    $ ambkit compare steps tum_mlps --filter linear --steps "20 um" --steps "40 um"
    $ ambkit compare steps zittau_axial --steps "0.3 mm" --disturbance "3 N" --plot bars.png
    """
    from ambkit.assessment.arguments import machine_argument
    from ambkit.base.progress import progress
    from ambkit.workflow import comparison

    with progress("comparing") as done:
        return comparison.in_loops(
            machine_argument(machine), filter, scenario, steps=steps, load=disturbance,
            duration=duration, plant=plant, seeds=seeds, first_seed=first_seed, done=done,
        )  # fmt: skip
