"""Estimators compared as the command does: in a case, in all of them, or in loops of one's own."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, overload

from ambkit.base.errors import AmbkitError
from ambkit.base.progress import reporting
from ambkit.base.quantity_arguments import Given, of_type
from ambkit.estimate.named import USUAL, factories
from ambkit.judge.comparison.cases import Case
from ambkit.machine.forces.force_map import surface_in
from ambkit.machine.forces.force_surface import ForceSurface
from ambkit.machine.machine import Machine
from ambkit.simulation.scenario import Scenario
from ambkit.workflow.compare_steps import (
    RUNS,
    LoopScores,
    compare_in_all,
    compare_in_case,
    compare_in_loops,
    loop_cases,
)
from ambkit.workflow.saved_filters import save_filters as write_filters

if TYPE_CHECKING:
    from ambkit.estimate.estimator import Estimator
    from ambkit.judge.comparison.score import Benches
    from ambkit.judge.comparison.study import Study
    from ambkit.machine.magnets import MagnetModel

Map = ForceSurface | str | os.PathLike[str] | None
Done = Callable[[str], None] | None


@overload
def compare(  # type: ignore[overload-overlap]
    bearing: Machine, case: Literal["all"], estimators: Sequence[str] | None = ..., *,
    tune: int = ..., runs: int = ..., seed: int = ..., spread: Given | None = ...,
    magnets: Mapping[str, MagnetModel] | None = ..., force_map: Map = ..., done: Done = ...,
) -> Benches: ...  # fmt: skip
@overload
def compare(  # type: ignore[overload-overlap]
    bearing: Machine, case: str | Case | None = ...,
    estimators: Sequence[str] | None = ..., *, tune: int = ..., runs: int = ..., seed: int = ...,
    spread: Given | None = ...,
    magnets: Mapping[str, MagnetModel] | None = ..., force_map: Map = ..., whole: bool = ...,
    save_filters: str | os.PathLike[str] | None = ..., done: Done = ...,
) -> Study: ...  # fmt: skip
@overload
def compare(
    bearing: Machine, *,
    scenario: Scenario | str | os.PathLike[str] | None = ...,
    steps: Iterable[Given] | None = ..., load: Given | None = ..., duration: Given | None = ...,
    estimators: Iterable[str] | Mapping[str, Callable[[], Estimator]] | None = ..., runs: int = ...,
    seed: int = ..., magnets: Mapping[str, MagnetModel] | None = ..., force_map: Map = ...,
    done: Done = ...,
) -> LoopScores: ...  # fmt: skip
def compare(
    bearing: Machine,
    case: str | Case | None = None,
    estimators: Any = None,
    *,
    tune: int = 0,
    runs: int = RUNS,
    seed: int = 0,
    spread: Given | None = None,
    magnets: Mapping[str, MagnetModel] | None = None,
    force_map: Map = None,
    scenario: Scenario | str | os.PathLike[str] | None = None,
    steps: Iterable[Given] | None = None,
    load: Given | None = None,
    duration: Given | None = None,
    whole: bool = False,
    save_filters: str | os.PathLike[str] | None = None,
    done: Done = None,
) -> Study | Benches | LoopScores:
    """Compare estimators by all that counts, as ``ambkit compare`` does.

    In a case, all run along the same records from the same start, and each in the loop. With a
    scenario, steps, a load or a duration of one's own, each closes its own loop, against the same
    noise and with the same Q and R, and the errors are compared.

    Parameters
    ----------
    bearing : Bearing or Machine
        What the estimators know. Of several axes errors are those of all axes together, and a case
        happens to each axis.
    case : str or Case, optional
        One of :data:`ambkit.judge.comparison.cases.CASES`, by default ``"paper"``; or ``"all"``.
    estimators : sequence of str, optional
        Kinds, filters' files, or ``file.py:Class``; by default all kinds, in loops of one's own
        `ambkit.estimate.named.USUAL`. There also a mapping of names to what builds each.
    tune : int
        Evaluations to tune each with; 0: defaults.
    runs, seed : int
        How many runs, and the seed of the first.
    spread : float or str, optional
        How far the plant is off at most, such as ``"20 %"``; by default what the case says.
    magnets : mapping of str to MagnetModel, optional
        What kinds know of the magnet, in place of what would be learned, such as
        ``{"adaptive": Expert.load("expert.json")}``.
    force_map : path or ForceSurface, optional
        The plant's true magnet, such as points of iu, x and f_mag: one's own iron; of one axis.
    scenario : Scenario or path, optional
        One's own run in place of a case.
    steps : iterable of float or str, optional
        In place of a case: steps of the first axis's reference [m], such as ``"0.1 mm"``.
    load, duration : float or str, optional
        In place of a case: load on the first axis after half of the run [N], and its length [s].
    whole : bool
        Whether the errors by step, wrong k and the limit are wanted, for a report.
    save_filters : path, optional
        A folder for the filters that were tuned, see `ambkit.workflow.saved_filters.save_filters`.
    done : callable, optional
        Called after each piece of work with what is next; a notebook shows a bar without it.

    Returns
    -------
    Study, Benches or LoopScores
        Of one case, of all cases by their names, or of loops of one's own.

    Raises
    ------
    AmbkitError
        There is no such case or estimator, a file cannot be read, or nothing was tuned to be saved.
    ValueError
        What is for a case is given beside what is in place of one; or `spread` is out of its range.

    Examples
    --------
    >>> from ambkit import Bearing, compare
    >>> bearing = Bearing.preset("zittau_axial")
    >>> found = compare(bearing, estimators=["linear"], steps=["0.3 mm"], load="3 N", runs=1)
    >>> found.scores["0.3 mm"]["linear"].mean("x") < 10e-6
    True
    """
    of_type(Machine, bearing=bearing)
    if case is not None:
        of_type(str, Case, case=case)
    true = _surface(force_map, bearing)
    own = {"scenario": scenario, "steps": steps, "load": load, "duration": duration}
    loop_options = [name for name, value in own.items() if value is not None]
    if loop_options:
        of_cases = {"case": case, "tune": tune or None, "spread": spread, "whole": whole or None,
                    "save_filters": save_filters}  # fmt: skip
        clash = [name for name, value in of_cases.items() if value is not None]
        if clash:
            raise ValueError(
                f"{loop_options[0]} is in place of a case, and does not go with {clash[0]}"
            )
        what = loop_cases(bearing, scenario, steps=steps, load=load, duration=duration)
        built: Mapping[str, Callable[[], Estimator]] = (
            estimators
            if isinstance(estimators, Mapping)
            else factories(USUAL if estimators is None else estimators, bearing, magnets)
        )
        with reporting(done, "comparing", len(what) * len(built) * runs) as tell:
            return compare_in_loops(
                bearing, what, built, runs=runs, seed=seed, plant=true, done=lambda: tell("")
            )
    options: dict[str, Any] = {
        "runs": runs, "budget": tune, "seed": seed, "spread": spread, "magnets": magnets,
        "plant": true, "done": done,
    }  # fmt: skip
    if case == "all":
        if save_filters is not None or whole:
            raise ValueError("save_filters and whole are of one case, not of all")
        return compare_in_all(bearing, estimators, **options)
    result = compare_in_case(bearing, case or "paper", estimators, **options, whole=whole)
    if save_filters is not None:
        write_filters(result, save_filters)
    return result


def _surface(force_map: Map, bearing: Machine) -> ForceSurface | None:
    """Return the plant's true magnet."""
    if force_map is None:
        return None
    if not bearing.single:
        axes = len(bearing.axes)
        raise AmbkitError(f"force_map is the magnet of one axis, and {bearing.name} has {axes}")
    if isinstance(force_map, str | os.PathLike):
        return surface_in(force_map, bearing.isolated_axis(""))
    return force_map
