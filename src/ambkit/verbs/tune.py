"""Tuning of filters: on records, in simulation, over tolerances, and against the margin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ambkit.base.progress import progress
from ambkit.base.quantity_arguments import seeds_in
from ambkit.verbs import words

if TYPE_CHECKING:
    from ambkit.workflow.robust_tuning import Robust
    from ambkit.workflow.trade_off import TradeOff
    from ambkit.workflow.tune import Tuned


def tune(
    machine: words.Machine,
    records: words.Records = (),
    filter: words.Filter | None = None,
    *,
    controller: words.Controller | None = None,
    channels: words.Channels | None = None,
    free: Sequence[str] | None = None,
    validate: Sequence[words.Record] = (),
    max_sensitivity: float | None = None,
    budget: int = 60,
    seeds: words.Seeds = 8,
) -> Tuned:
    """Tune a filter and validate it.

    With records by maximum likelihood (Schweppe 1965): tuned on the first halves, validated on the
    second halves or the validation records, and used only if these are more likely with it.
    Without records by the errors in simulation, validated with other seeds. The filter file of
    --out is read by filter, simulate, compare, faults and export.

    Parameters
    ----------
    machine : Machine, str or path
        Preset name or TOML file. All axes are tuned jointly.
    records : Record, str, path or sequence of them, optional
        Closed-loop record with y [m] and u [V] of all sensors and axes.
    filter : str, optional
        Kind (linear+unbalance also estimates the unbalance), or KIND@FILE with an expert (.json) or
        force map (.csv). By default as for `ambkit simulate`.
    controller : PID, Control, str or path, optional
        As for `ambkit assess`.
    channels : ChannelMap, str or path, optional
        Channel map of the logs (`ambkit read guess` proposes one).
    free : sequence of str, optional
        Setting to tune: noise.measurement, noise.control, noise.disturbance, and those of the kind.
        By default those that the records determine, in simulation all.
    validate : sequence of Record, str or path, optional
        Validation record.
    max_sensitivity : float, optional
        Limit of the sensitivity peak of the loop with this filter; 3 is the end of zone A.
    budget : int, optional
        Number of evaluations.
    seeds : int, range or str, optional
        Number of simulated runs for tuning, and as many for validation; FIRST: first random seed.

    Returns
    -------
    Tuned
        The filter, rows, series and a figure.

    Raises
    ------
    AmbkitError
        The kind or a setting is unknown, the kind has no likelihood (low-pass), or no filter keeps
        the sensitivity peak below `max_sensitivity`.
    TypeError
        An argument has the wrong type.

    Examples
    --------
    $ ambkit tune zittau_axial --filter linear --out filter.toml
    $ ambkit tune my.toml run.csv --validate other.csv --out filter.toml --plot tune.png
    $ ambkit tune my.toml run.csv --max-sensitivity 2.5 --out filter.toml
    """
    from ambkit.arguments import tuning_arguments
    from ambkit.workflow import tune

    task = tuning_arguments(machine, records, filter, controller, channels)
    with progress("tuning", budget, unit="evaluations") as done:
        result = tune.tune(
            task.machine, task.records, task.kind, validate=task.others(validate),
            max_sensitivity=max_sensitivity, controller=task.controller, free=free,
            magnet=task.magnet, inputs=task.inputs, source=task.source, seeds=seeds_in(seeds),
            budget=budget, done=done,
        )  # fmt: skip
    return result.named(machine=task.machine_file, magnet=task.magnet_file)


def tune_trade_off(
    machine: words.Machine,
    records: words.Records = (),
    filter: words.Filter | None = None,
    *,
    peaks: Sequence[float] = (1.7, 2.0, 2.5),
    controller: words.Controller | None = None,
    channels: words.Channels | None = None,
    budget: int = 60,
    seeds: words.Seeds = 8,
) -> TradeOff:
    """Tune a filter for several sensitivity limits: error against margin.

    All filters are compared by their errors in simulation, also those tuned on records, because a
    record does not determine the disturbance force.

    Parameters
    ----------
    machine, records, filter, controller, channels, seeds : optional
        As for `ambkit tune`.
    peaks : sequence of float, optional
        Limit of the sensitivity peak.
    budget : int, optional
        Number of evaluations for each limit.

    Returns
    -------
    TradeOff
        Rows, series and a figure, to choose from.

    Raises
    ------
    AmbkitError
        There is no limit, or none can be kept.

    Examples
    --------
    $ ambkit tune trade-off tum_mlps --filter linear --peaks 1.7 --peaks 2.5 --plot trade.png
    """
    from ambkit.arguments import tuning_arguments
    from ambkit.workflow import trade_off

    task = tuning_arguments(machine, records, filter, controller, channels)
    with progress("tuning", budget * len(peaks), unit="evaluations") as done:
        return trade_off.trade_off(
            task.machine, peaks, task.records, task.kind, controller=task.controller,
            magnet=task.magnet, seeds=seeds_in(seeds), budget=budget, done=done,
        )  # fmt: skip


def tune_robust(
    study: words.Study,
    *,
    filter: Sequence[str] | None = None,
    quantile: float = 0.95,
    max_sensitivity: float = 3.0,
    free: Sequence[str] | None = None,
    storage: words.Storage | None = None,
    budget: int = 60,
    seed: int = 0,
) -> Robust:
    """Tune controller and filter over the machines of a study.

    Minimises a quantile, over the machines, of the disturbance force error, with a limit on the
    same quantile of the sensitivity peak. The search uses Optuna's tree-structured Parzen estimator
    (Bergstra et al. 2011); each evaluation simulates the same machines with the same noise.

    Parameters
    ----------
    study : Study, str or path
        TOML file of the study; all its runs are simulated in each evaluation, so a few hundred are
        enough.
    filter : sequence of str, optional
        Kind of filter to try beside the study's; the search chooses among them.
    quantile : float, optional
        Quantile over the machines.
    max_sensitivity : float, optional
        Limit of that quantile of the sensitivity peak.
    free : sequence of str, optional
        Setting to tune: controller gains, filter settings such as noise.disturbance, and
        expert.rules of the adaptive filter. By default all.
    storage : str or path, optional
        File that stores the evaluations, so that the same command resumes the search.
    budget : int, optional
        Number of evaluations.
    seed : int, optional
        Random seed of the search.

    Returns
    -------
    Robust
        Rows, series and a figure; its file is the filter, with the controller in a second one.

    Raises
    ------
    AmbkitError
        Optuna is not installed; the study is not valid, has no margins or no filter of one kind;
        the storage is of another search; no evaluation satisfies the limit.

    Examples
    --------
    $ ambkit tune robust tolerances.toml --storage search.log --out filter.toml
    """
    from ambkit.workflow import robust_tuning
    from ambkit.workflow.robust_task import Task

    task = Task(study, filter or (), quantile, max_sensitivity)
    with progress("tuning over the tolerances", budget, unit="evaluations") as done:
        return robust_tuning.tune_robust(
            task, free=free, budget=budget, storage=storage, seed=seed, done=done,
        )  # fmt: skip
