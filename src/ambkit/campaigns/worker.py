"""Computation of a part of a study: machines sampled, simulated, evaluated, tabulated."""

from __future__ import annotations

import math
import pickle
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Complex
from ambkit.base.errors import AmbkitError
from ambkit.base.threads import one_thread, rare_collections
from ambkit.campaigns.distributions import ChoiceMarginal
from ambkit.campaigns.plan import Plan, SampledMachine
from ambkit.campaigns.study_tables import ZONES, limit_of
from ambkit.control.linear.linear_controller import compensator, controller
from ambkit.control.linear.linear_plant import OperatingPoint, alike, plants
from ambkit.control.linear.steady_state_filter import estimator_at, estimators_at, tells
from ambkit.estimate.batch import processors
from ambkit.estimate.estimator import Estimator
from ambkit.judge.loop.loop_builder import LoopBuilder, zone_of
from ambkit.judge.loop.margins import peaks_by_poles
from ambkit.machine.magnets import ConstantStiffness
from ambkit.machine.rotors.modes import max_frequency
from ambkit.models.linear import LinearSystem
from ambkit.simulation.many import Many, simulate_many
from ambkit.simulation.plans import Planned
from ambkit.simulation.run_figures import FIGURES, FLAGS

if TYPE_CHECKING:
    import pyarrow as pa

    from ambkit.simulation.run import Run


class Rows(NamedTuple):
    """Result of a part."""

    runs: pa.Table  #: A row for each run.
    traces: pa.Table | None  #: A row for each sample of the runs with stored traces.


def versions() -> dict[str, str]:
    """Return the versions of the numerical libraries, which determine the last digits."""
    own = {name: version(name) for name in ("ambkit", "numpy", "scipy")}
    return own | {"python": platform.python_version()}


def part_of(pickled: bytes, part: int, expected_versions: Mapping[str, str]) -> Rows:
    """Compute a part in a worker of a cluster, in one thread."""
    here = versions()
    if other := [name for name in expected_versions if here.get(name) != expected_versions[name]]:
        has, own = (
            ", ".join(f"{n} {of.get(n)}" for n in other) for of in (here, expected_versions)
        )
        raise AmbkitError(f"a worker of the cluster has {has}, and this is {own}: install the same")
    plan = _plan_in(pickled)
    return compute(plan, *plan.span(part), threads=1)


@lru_cache(maxsize=4)
def _plan_in(pickled: bytes) -> Plan:
    result: Plan = pickle.loads(pickled)
    return result


@rare_collections()
def compute(
    plan: Plan,
    first: int,
    stop: int,
    *,
    threads: int | None = None,
    done: Callable[[int], None] | None = None,
) -> Rows:
    """Compute runs of a study."""
    points, noise = plan.points(first, stop), plan.noise(first, stop)
    every = plan.study.record.every if plan.study.record.traces else 0
    traced_runs = [run for run in range(first, stop) if every and run % every == 0]
    results = fly(plan, points, noise, first, traced=traced_runs, threads=threads, done=done)
    columns: dict[str, Any] = {"run": np.arange(first, stop)}
    for name, of, column in zip(plan.names, plan.marginals, points.T, strict=True):
        columns[name] = (
            [of.values[int(at)] for at in column] if isinstance(of, ChoiceMarginal) else column
        )
    columns |= results.columns
    runs = table(plan, columns)
    return Rows(runs, traces_table(plan, results.traces) if every else None)


class SimulatedMachines(NamedTuple):
    """Results of some machines."""

    columns: dict[str, Any]  #: Figures, counts, margins and verdict, by name.
    traces: Mapping[int, Run]  #: By the numbers of the runs.
    wrong: list[str]  #: Reasons why machines are impossible; empty if they are not.


def fly(
    plan: Plan,
    points: Array,
    noise: NDArray[np.uint64],
    first: int = 0,
    *,
    traced: Sequence[int] = (),
    threads: int | None = None,
    done: Callable[[int], None] | None = None,
) -> SimulatedMachines:
    """Sample machines at points, simulate and evaluate them."""
    # points (n, k); noise (n,)
    samples: list[SampledMachine] = []
    record = plan.study.record

    def possible() -> Iterator[Any]:
        for machine in plan.machines(points, noise, first):
            samples.append(machine)
            if not machine.wrong:
                yield machine.planned

    many = simulate_many(
        possible(), settling=record.settling, band=record.band, threads=threads, done=done
    )
    can = [at for at, sample in enumerate(samples) if not sample.wrong]
    columns = _spread(many, can, len(samples))
    if record.margins:
        highest = np.full(len(samples), np.inf)
        with one_thread():
            highest[can] = peaks([samples[at].planned for at in can], threads)
        columns["peak_S"] = highest
        columns["zone"] = ["" if np.isnan(peak) else zone_of(float(peak)) for peak in highest]
    fails = _fails(plan, columns, samples)
    columns["passed"] = np.array([not fail for fail in fails])
    columns["fails"] = fails
    traces = {
        run: samples[run - first].planned.simulated()
        for run in traced if not samples[run - first].wrong
    }  # fmt: skip
    return SimulatedMachines(columns, traces, [sample.wrong for sample in samples])


def _spread(many: Many, can: Sequence[int], n: int) -> dict[str, Any]:
    """Return the columns of all machines, if some are impossible."""
    columns: dict[str, Any] = {}
    for name, values in many.columns().items():
        empty: Any = np.zeros(n, values.dtype)
        if values.dtype.kind == "f":
            empty[:] = np.nan
        empty[can] = values
        columns[name] = empty
    return columns


def _fails(plan: Plan, columns: Mapping[str, Any], samples: Sequence[SampledMachine]) -> list[str]:
    """Return the criteria that each machine fails, separated by commas; empty if none."""
    passes = plan.study.passes
    against: dict[str, NDArray[np.bool_]] = {
        "impossible": np.array([bool(sample.wrong) for sample in samples], bool)
    }
    if passes.zone is not None:
        allowed = ZONES[: ZONES.index(passes.zone) + 1]
        against["zone"] = ~np.isin(columns["zone"], allowed)
    if not passes.contact:
        against["contact"] = ~(np.asarray(columns["touched"]) == 0)
    for name, limit in passes.at_most.items():  # values that do not apply are not below the limit
        against[name] = ~(np.asarray(columns[name]) <= limit_of(name, limit))
    named = np.array(list(against))
    return [",".join(named[row]) for row in np.column_stack(list(against.values()))]


def schema(plan: Plan) -> pa.Schema:
    """Return the columns of the rows with their units."""
    import pyarrow as pa

    fields = [("run", pa.int64(), "")]
    for name, of, key in zip(plan.names, plan.marginals, plan.keys, strict=True):
        words = isinstance(of, ChoiceMarginal) and not key.unit
        fields.append((name, pa.string() if words else pa.float64(), key.unit))
    fields += [(name, pa.float64(), figure.unit) for name, figure in FIGURES.items()]
    fields += [(f"samples_{name}", pa.int64(), "1") for name in FLAGS]
    if plan.study.record.margins:
        fields += [("peak_S", pa.float64(), "1"), ("zone", pa.string(), "")]
    fields += [("passed", pa.bool_(), ""), ("fails", pa.string(), "")]
    return pa.schema([pa.field(name, of, metadata={"unit": unit}) for name, of, unit in fields])


def table(plan: Plan, columns: Mapping[str, Any]) -> pa.Table:
    """Return columns as a table."""
    import pyarrow as pa

    table_schema = schema(plan)
    arrays = [pa.array(columns[field.name], type=field.type) for field in table_schema]
    return pa.Table.from_arrays(arrays, schema=table_schema)


def traces_table(plan: Plan, runs: Mapping[int, Run]) -> pa.Table:
    """Return selected signals of runs as one table, a row for each sample."""
    import pyarrow as pa

    names = plan.study.record.traces
    parts: dict[str, list[Any]] = {name: [] for name in ("run", "t", *names)}
    for number, run in sorted(runs.items()):
        t = run.record.t
        parts["run"].append(np.full(len(t), number))
        parts["t"].append(t)
        for name in names:
            parts[name].append(signal(run, name))
    empty = {"run": np.zeros(0, np.int64)}
    columns = {
        name: np.concatenate(values) if values else empty.get(name, np.zeros(0))
        for name, values in parts.items()
    }
    return pa.table(columns)


def signal(run: Run, name: str) -> Array:
    """Return a signal of a run by its name in a study."""
    state = name.removesuffix("_estimate")
    if state == name:
        return np.asarray(run.record[name])
    if run.estimate is None:
        return np.full(len(run.record), np.nan)
    try:
        return np.asarray(run.estimate[state])
    except KeyError as error:
        raise AmbkitError(f"{name}: {error}") from None


AT_ONCE = 512  #: Loops evaluated together.


def peaks(runs: Sequence[Planned], threads: int | None = None) -> Array:
    """Return the peak of abs(S) of each run's loop within the standard's range (n,) [1]."""
    # Of the worst axis, at the machine's own speed. Infinite if the loop is unstable or there is no
    # stabilising controller; NaN if the estimator has no steady-state gain. Loops of one axis with
    # a PID are evaluated in batches.
    result = np.full(len(runs), np.nan)
    points: dict[int, OperatingPoint] = {}
    groups: dict[Any, list[int]] = {}
    single_axes: list[int] = []
    for at, run in enumerate(runs):
        law = run.scenario.controller
        # with equal numbers of states
        if not run.machine.single or law.needs_estimate or law.block:
            single_axes.append(at)
            continue
        try:
            points[at] = OperatingPoint.equilibrium(run.machine)
        except AmbkitError:  # no stabilising controller
            result[at] = math.inf
            continue
        fed = _fed(run)
        if fed is None or tells(fed):
            pid, machine = run.scenario.controller, run.machine
            key = (*alike(machine), machine.speed, pid.ki > 0, id(fed))
            groups.setdefault(key, []).append(at)
    for group in groups.values():
        for start in range(0, len(group), AT_ONCE):
            places = group[start : start + AT_ONCE]
            batch: list[Any] = [runs[at] for at in places]
            result[places] = _highest(batch, [points[at] for at in places])
    with ThreadPoolExecutor(threads or processors()) as pool:
        result[single_axes] = list(pool.map(peak_of, [runs[at] for at in single_axes]))
    return result


def peak_of(run: Planned) -> float:
    """Return the peak of one run, see `peaks`."""
    fed = _fed(run)
    if fed is not None and not tells(fed):
        return math.nan
    try:
        of = LoopBuilder(run.machine, run.scenario.controller, law=run.controllers)
    except AmbkitError:  # no stabilising controller
        return math.inf
    return of.peak(fed)


def _highest(runs: Sequence[Planned], points: Sequence[OperatingPoint]) -> Array:
    """Return the peaks of loops of equal structure (n,)."""
    try:
        opened, closed = _poles(runs, points)
    except AmbkitError:  # one of the estimators has no gain
        if len(runs) == 1:
            return np.array([math.inf])
        return np.concatenate([
            _highest([run], [at]) for run, at in zip(runs, points, strict=True)
        ])  # fmt: skip
    stable, result = (np.abs(closed) < 1).all(axis=1), np.full(len(runs), np.inf)
    if stable.any():
        machine = runs[0].machine
        T = machine.sampling_time
        top = max_frequency(T, machine.speed)
        result[stable] = peaks_by_poles(opened[stable], closed[stable], T, top)
    return result


def _fed(run: Planned) -> Estimator | None:
    """Return the estimator that feeds the controllers."""
    return run.estimator if run.scenario.feedback == "estimate" else None


def _poles(runs: Sequence[Planned], points: Sequence[OperatingPoint]) -> tuple[Complex, Complex]:
    """Return the poles of plant and compensator, and of the closed loop, each (n, ...)."""
    machines = [run.machine for run in runs]
    P, fed = plants(machines, points), _fed(runs[0])
    inner = None if fed is None else _estimators(fed, points)
    made: dict[tuple[int, float, float], LinearSystem] = {}
    parts = []
    for machine, pid in zip(machines, (run.scenario.controller for run in runs), strict=True):
        key = id(pid), machine.amplifier.gain, machine.sampling_time
        if key not in made:
            made[key] = controller(pid, machine, measured=fed is None)
        parts.append(made[key])
    A, B, C, D = (np.array([getattr(one, name) for one in parts]) for name in "ABCD")
    gains = np.array([1 / machine.sensor.gain for machine in machines])[:, None, None]
    K = compensator(replace(parts[0], A=A, B=B, C=C, D=D), inner, gains)
    B_u, C_y, B_y, D_y = P.B[..., :1], P.C[..., :1, :], K.B[..., :1], K.D[..., :1]
    closed = np.block([[P.A + B_u @ D_y @ C_y, B_u @ K.C], [B_y @ C_y, K.A]])
    opened = [np.linalg.eigvals(of).astype(complex) for of in (P.A, K.A)]
    return np.hstack(opened), np.linalg.eigvals(closed).astype(complex)


def _estimators(estimator: Estimator, points: Sequence[OperatingPoint]) -> LinearSystem:
    """Return an estimator with its gain at points; with constant stiffness one for all."""
    n = len(points)
    if isinstance(estimator.magnet, ConstantStiffness) or not estimator.by_model:
        one = estimator_at(estimator, points[0])
        A, B, C, D = (np.repeat(getattr(one, name)[None], n, axis=0) for name in "ABCD")
    else:
        one = estimators_at(estimator, points)
        A, B, C, D = (
            np.broadcast_to(of, (n, *of.shape[-2:])) for of in (one.A, one.B, one.C, one.D)
        )
    return replace(one, A=A, B=B, C=C, D=D)
