"""Tuning: a filter on records or simulated runs, over tolerances, and against the margin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ambkit.verbs.words import (
    Channels,
    Controller,
    Filter,
    Machine,
    Record,
    Records,
    Storage,
    Study,
)

if TYPE_CHECKING:
    from ambkit.workflow.robust_tuning import Robust
    from ambkit.workflow.trade_off import TradeOff
    from ambkit.workflow.tune import Tuned


def tune(
    machine: Machine,
    records: Records = (),
    filter: Filter = "extended",
    *,
    controller: Controller | None = None,
    channels: Channels | None = None,
    free: Sequence[str] | None = None,
    validate: Sequence[Record] = (),
    max_sensitivity: float | None = None,
    budget: int = 60,
    runs: int = 8,
    seed: int = 0,
) -> Tuned:
    """Tune a filter, and judge it on data that it was not tuned on.

    By the likelihood of records (Schweppe 1965): their first halves tune, their second halves
    judge, or the records of validate; the tuned filter is taken only where these are more likely
    with it. Without records by the errors against simulated truth; other seeds judge. The filter's
    file goes into filter, simulate, compare, faults and export.

    Parameters
    ----------
    machine : Machine, str or path
        What is filtered: a preset's name, or a TOML file. All axes are tuned together.
    records : Record, str, path or sequence of them, optional
        Closed-loop runs with y [m] and u [V], of all readings and axes.
    filter : str, optional
        Kind of the filter; KIND@FILE with an expert (.json) or a force map (.csv) of its magnet.
    controller : PID, Control, str or path, optional
        Of the loop, as for `ambkit assess`.
    channels : ChannelMap, str or path, optional
        Channel map of the records; `ambkit read guess` proposes one.
    free : sequence of str, optional
        What may change: noise.measurement, noise.control, noise.disturbance, and what only this
        kind has. May be repeated. By default what the records determine, or with simulated runs
        all.
    validate : sequence of Record, str or path, optional
        Judge by this record. May be repeated.
    max_sensitivity : float, optional
        Limit of the peak of |S| in the loop with this filter; 3 is the end of zone A of ISO
        14839-3.
    budget : int, optional
        Number of evaluations.
    runs : int, optional
        Number of simulated runs to tune on, and of others to judge by.
    seed : int, optional
        Random seed.

    Returns
    -------
    Tuned
        The filter, rows, series and a picture.

    Raises
    ------
    AmbkitError
        There is no such kind or tunable; the kind has no likelihood, as a low-pass; or no filter
        that was tried keeps the peak of abs(S) below max_sensitivity.
    TypeError
        One of the arguments is of another type.

    Examples
    --------
    $ ambkit tune zittau_axial --filter linear --out filter.toml
    $ ambkit tune my.toml run.csv --validate other.csv --out filter.toml --plot tune.png
    $ ambkit tune my.toml run.csv --max-sensitivity 2.5 --out filter.toml
    """
    from ambkit.assessment.arguments import tuning_given
    from ambkit.base.progress import progress
    from ambkit.workflow import tune

    task = tuning_given(machine, records, filter, controller, channels)
    with progress("tuning", budget) as done:
        result = tune.tune(
            task.machine, task.records, task.kind, validate=task.others(validate),
            max_sensitivity=max_sensitivity, controller=task.controller, free=free,
            magnet=task.magnet, inputs=task.inputs, source=task.source, runs=runs,
            budget=budget, seed=seed, done=done,
        )  # fmt: skip
    return result.named(bearing=task.machine_file, magnet=task.magnet_file)


def tune_trade_off(
    machine: Machine,
    records: Records = (),
    filter: Filter = "extended",
    *,
    peaks: Sequence[float] = (1.7, 2.0, 2.5),
    controller: Controller | None = None,
    channels: Channels | None = None,
    budget: int = 60,
    runs: int = 8,
    seed: int = 0,
) -> TradeOff:
    """Tune a filter below one peak of the sensitivity after another, and show what margin costs.

    Filters that are tuned by the likelihood of records are still judged by their errors in
    simulated runs: a record does not determine the disturbance force.

    Parameters
    ----------
    machine, records, filter, controller, channels, runs, seed : optional
        As for `ambkit tune`.
    peaks : sequence of float, optional
        Limit of the peak of |S|. May be repeated.
    budget : int, optional
        Number of evaluations below each peak.

    Returns
    -------
    TradeOff
        Rows, series and a picture, from which to pick.

    Raises
    ------
    AmbkitError
        There is no limit, or none of them can be kept.

    Examples
    --------
    $ ambkit tune trade-off tum_mlps --filter linear --peaks 1.7 --peaks 2.5 --plot trade.png
    """
    from ambkit.assessment.arguments import tuning_given
    from ambkit.base.progress import progress
    from ambkit.workflow import trade_off

    task = tuning_given(machine, records, filter, controller, channels)
    with progress("tuning", budget * len(peaks)) as done:
        return trade_off.trade_off(
            task.machine, peaks, task.records, task.kind, controller=task.controller,
            magnet=task.magnet, runs=runs, budget=budget, seed=seed, done=done,
        )  # fmt: skip


def tune_robust(
    study: Study,
    *,
    quantile: float = 0.95,
    max_sensitivity: float = 3.0,
    free: Sequence[str] | None = None,
    storage: Storage | None = None,
    budget: int = 60,
    seed: int = 0,
) -> Robust:
    """Tune controller and filter over the machines of a study.

    A quantile over the machines of the disturbance force's error is made small, and that of the
    peak of |S| kept below a limit; by Optuna's tree-structured Parzen estimator (Bergstra et al.
    2011). All are simulated with the same machines and the same noise.

    Parameters
    ----------
    study : Study, str or path
        TOML file that says what varies; all its runs are made at each evaluation: some hundred are
        enough.
    quantile : float, optional
        Quantile over the machines.
    max_sensitivity : float, optional
        Limit of that quantile of the peak of |S|.
    free : sequence of str, optional
        What may change: gains of the controller, tunables such as noise.disturbance, and of the
        adaptive filter expert.rules. May be repeated. By default all.
    storage : str or path, optional
        File that keeps what was tried: the same command goes on with an interrupted search.
    budget : int, optional
        Number of evaluations.
    seed : int, optional
        Random seed of the search.

    Returns
    -------
    Robust
        Rows, series and a picture; its file is the filter, beside it the controller.

    Raises
    ------
    AmbkitError
        Optuna is not installed; the study is not valid, or has no margins or no filter of one kind;
        the storage is of another search; nothing that was tried is allowed.

    Examples
    --------
    $ ambkit tune robust tolerances.toml --storage search.log --out filter.toml
    """
    from ambkit.base.progress import progress
    from ambkit.workflow import robust_tuning

    with progress("tuning over the tolerances", budget, unit="evaluations") as done:
        return robust_tuning.tune_robust(
            study, quantile=quantile, max_sensitivity=max_sensitivity, free=free,
            budget=budget, storage=storage, seed=seed, done=done,
        )  # fmt: skip
