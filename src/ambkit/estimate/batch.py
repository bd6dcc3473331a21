"""Many estimators along many records at once, with SIMD lanes and threads, for Monte Carlo."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import real
from ambkit.base.quantity_arguments import of_type
from ambkit.estimate.estimator import Estimator
from ambkit.machine.magnets import Precision, core_module

Array = NDArray[Any]

TRUTH = ("x", "v", "f_d")  #: Signals with errors, in this order.


@dataclass(frozen=True)
class Batch:
    """Results of many runs; None if not requested."""

    #: (runs, n, states) State estimates: x [m], v [m/s], f_d [N], x_m [m], and further states of
    #: the model.
    mean: Array | None
    innovation: Array | None  #: (runs, n) As of :class:`ambkit.Estimate` [m], [m^2].
    innovation_variance: Array | None
    status: Array | None  #: (runs, n) Status of each step, :class:`ambkit.Status`.
    #: (runs, 3) Root mean square errors of x [m], v [m/s], f_d [N], if the truth was given.
    rmse: Array | None
    flags: Array  #: (runs,) Combined status of a run.


def instruction_sets() -> list[str]:
    """Return the instruction sets for lanes on this processor, the fastest last."""
    # ``"scalar"`` computes one run after another; ``"baseline"`` has 2 lanes in double precision,
    # ``"avx2"`` 4, ``"avx512"`` 8; twice as many in single. Compilers without GCC's vectors build
    # ``"scalar"`` only.
    return list(core_module().instruction_sets())


def run_many(
    estimators: Estimator | Sequence[Estimator],
    y: ArrayLike,
    u: ArrayLike,
    *,
    truth: ArrayLike | None = None,
    skip: int = 0,
    history: Sequence[str] = ("mean",),
    out: Batch | None = None,
    start: tuple[ArrayLike, ArrayLike] | None = None,
    threads: int | None = None,
    instructions: str | None = None,
) -> Batch:
    """Run many estimators, each along its own record with its own start.

    The results have the bits of `Estimator.run`, for all lanes and threads. The estimators are not
    changed. Those of one kind run side by side, and may differ in everything else: noise, machine,
    gains. Kinds from low-pass to extended have lanes; the others run one by one.

    Parameters
    ----------
    estimators : Estimator or sequence of Estimator
        One for all runs, or one for each; all of the same precision.
    y, u : array_like (runs, n) or (n,)
        Measured position [m] and control signal [V]; one record for all runs, or one for each.
        u[k] acts from sample k to k + 1.
    truth : array_like (runs, n, 3) or (n, 3), optional
        x [m], v [m/s], f_d [N]; gives ``rmse`` without a history.
    skip : int
        Number of samples at the start that are excluded from the errors.
    history : sequence of {"mean", "innovation", "innovation_variance", "status"}
        Outputs stored for every sample. Storing takes about as long as the filter: if only errors
        are needed, pass the truth and store nothing.
    out : Batch, optional
        Of an earlier call with the same shapes and `history`: its arrays are reused.
    start : (mean, std), optional
        State estimates and standard deviations at the start, (runs, states) or (states,) each
        [unit of each state].
        Default: as `Estimator.run`, in equilibrium at the record's first measurement within the
        clearance.
    threads : int, optional
        Default: all that are available to the process.
    instructions : str, optional
        One of `instruction_sets`; default: the fastest.

    Returns
    -------
    Batch

    Raises
    ------
    ValueError
        Shapes or precisions do not match, or the processor lacks the instructions.

    Examples
    --------
    >>> machine = ambkit.preset("zittau_axial")
    >>> noises = [ambkit.FilterNoise(disturbance=d) for d in (1.0, 10.0, 100.0)]
    >>> filters = [ambkit.KalmanFilter(machine, noise=noise) for noise in noises]
    >>> record = ambkit.simulate(machine, ambkit.Scenario(duration=0.1))
    >>> ambkit.run_many(filters, record["y"], record["u"]).mean.shape
    (3, 1001, 4)
    """
    parts = list(estimators) if isinstance(estimators, Iterable) else [estimators]
    for one in parts:
        of_type(Estimator, estimators=one)
    if not parts:
        raise ValueError("estimators must hold one or more, got none")
    if len({e.precision for e in parts}) > 1:
        raise ValueError("estimators must have one precision, got float32 and float64")
    if len({tuple(state.name for state in e.states) for e in parts}) > 1:
        raise ValueError("estimators must have the same states, and got different ones")
    precision = parts[0].precision
    Y, U = _rows("y", y, 2, precision), _rows("u", u, 2, precision)
    T = None if truth is None else _rows("truth", truth, 3, precision)
    runs = max(len(parts), len(Y), len(U), 1 if T is None else len(T))
    if len(parts) not in (1, runs):
        raise ValueError(f"estimators must be 1 or {runs}, as many as records, got {len(parts)}")
    n = Y.shape[1]
    if not 0 <= skip < max(n, 1):
        raise ValueError(f"skip must be within the {n} samples, got {skip}")
    mean, std = _starts(parts, _rows("y", y, 2, "float64")) if start is None else start
    history_arrays = _kept(out, history, (runs, n, len(parts[0].states)), precision)
    count = threads if threads is not None else processors()
    if count < 1:
        raise ValueError(f"threads must be 1 or more, got {count}")
    states = len(parts[0].states)
    squares, flags = parts[0].engine.core.run_batch(
        [e.core for e in parts],
        Y,
        U,
        _of_runs("start mean", mean, runs, states, precision),
        _of_runs("start std", std, runs, states, precision),
        truth=T,
        skip=skip,
        means=history_arrays["mean"],
        innovation=history_arrays["innovation"],
        variance=history_arrays["innovation_variance"],
        status=history_arrays["status"],
        instructions=instructions,
        threads=count,
    )
    rmse = None if T is None else np.sqrt(squares / max(n - skip, 1))
    return Batch(**history_arrays, rmse=rmse, flags=flags)


def processors() -> int:
    """Return the number of processors available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _rows(name: str, a: ArrayLike, dimensions: int, precision: Precision) -> Array:
    """Return a contiguous array with the runs first."""
    rows = np.ascontiguousarray(real(name, a, precision))
    if rows.ndim == dimensions - 1:
        rows = rows[np.newaxis]
    if rows.ndim != dimensions:
        raise ValueError(f"{name} must have {dimensions} dimensions or one less, got {rows.ndim}")
    return rows


def _of_runs(name: str, a: ArrayLike, runs: int, states: int, precision: Precision) -> Array:
    return np.ascontiguousarray(np.broadcast_to(real(name, a, precision), (runs, states)))


def _starts(item: list[Estimator], Y: Array) -> tuple[ArrayLike, ArrayLike]:
    """Return the starts of `Estimator.run`, twice broadcast to (runs, states)."""
    if len(item) == 1:
        return item[0].initial_state(Y), item[0].default_std()
    known = {e: e.default_std() for e in set(item)}
    records = Y if len(Y) > 1 else [Y[0]] * len(item)
    mean = np.array([e.initial_state(y) for e, y in zip(item, records, strict=True)])
    return mean, np.array([known[e] for e in item])


def _kept(
    out: Batch | None, history: Sequence[str], shape: tuple[int, int, int], precision: Precision
) -> dict[str, Array | None]:
    """Return the arrays to fill, those of `out` if they fit."""
    shapes: dict[str, tuple[tuple[int, ...], Any]] = {
        "mean": (shape, precision),
        "innovation": (shape[:2], precision),
        "innovation_variance": (shape[:2], precision),
        "status": (shape[:2], np.uint16),
    }
    if unknown := set(history) - set(shapes):
        raise ValueError(f"history knows {', '.join(shapes)}; got {', '.join(sorted(unknown))}")
    history_arrays: dict[str, Array | None] = {}
    for name, (array_shape, kind) in shapes.items():
        old = getattr(out, name, None)
        if name not in history:
            history_arrays[name] = None
        elif old is not None and old.shape == array_shape and old.dtype == kind:
            history_arrays[name] = old
        else:
            history_arrays[name] = np.empty(array_shape, dtype=kind)
    return history_arrays
