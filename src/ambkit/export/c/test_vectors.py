"""The self-test's samples, and what Python's filter says of them: all that an export puts out."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit._core import Magnet
from ambkit.base.arrays import Array, Bools
from ambkit.estimate.estimate import Status
from ambkit.estimate.estimator import Estimator
from ambkit.export.c import c_literals, filter_test_cases
from ambkit.export.c.c_literals import CPrecision

_UNUSED = int(Status.MISSING | Status.FROZEN | Status.OUTLIER)
_UNSURE = int(Status.HELD | Status.RESTARTED | Status.BAD_PARAMETER)


class Vectors(NamedTuple):
    """N samples of several runs, one after the other."""

    y: Array  # (N,) or (N, readings), as the rig has them
    u: Array  # (N,) or (N, axes)
    starts: NDArray[np.uint16]  # where runs begin
    expected: Array  # (N, columns): means, variances, k_i, k_s, innovations, their variances
    status: NDArray[np.uint16]  # (N,)
    health: NDArray[np.uint16]  # (N, readings)
    feed_back: NDArray[np.uint8]  # (N,): 1 where it may be fed back
    amplified: Bools  # (N,): where rounding is amplified
    runs: tuple[str, ...]  # names of the runs
    si: tuple[tuple[Array, Array], ...]  # y [m] and u [V] of each run as the filter takes them


def make(
    filter: Estimator, magnets: list[Magnet], *, settling: int, bound: float,
    more: Sequence[filter_test_cases.TestCase] = (),
) -> Vectors:  # fmt: skip
    """Let an estimator live through all scenes."""
    parts, amplified, as_taken = [], [], []
    for case in [*filter_test_cases.of(filter, magnets, settling), *more]:
        y, u, si = _as_read(filter, case)
        output = filter_test_cases.run(filter, *si)
        n = within(filter, output["mean"], bound)
        as_taken.append((si[0][:n], si[1][:n]))
        output = {name: values[:n].reshape(n, -1) for name, values in output.items()}
        parts.append((case.name, y[:n], u[:n], output))
        after = np.arange(n) >= (n if case.amplifies is None else case.amplifies)
        amplified.append(after | without_digits(filter, *si)[:n])
    columns = [_columns(filter, output) for *_, output in parts]
    health = [output.get("health", output["status"]) for *_, output in parts]
    status = [output["status"].ravel() for *_, output in parts]
    settled = [
        _feed_back(flags, item, settling) for flags, item in zip(status, health, strict=True)
    ]
    lengths = [len(item) for item in status]
    return Vectors(
        y=np.concatenate([y for _, y, _, _ in parts]),
        u=np.concatenate([u for _, _, u, _ in parts]),
        starts=np.cumsum([0, *lengths[:-1]]).astype(np.uint16),
        expected=np.concatenate(columns),
        status=np.concatenate(status),
        health=np.concatenate(health),
        feed_back=np.concatenate(settled).astype(np.uint8),
        amplified=np.concatenate(amplified),
        runs=tuple(name for name, *_ in parts),
        si=tuple(as_taken),
    )


def without_digits(filter: Estimator, y: Array, u: Array) -> Bools:
    """Return from where on (n,) float, in a machine's filter, is off by what double would say."""
    # A mean by more than a standard deviation, or a variance by more than ten of itself: then what
    # another rounding says is another number. AdaptiveNoise has no precision of its own.
    args, options = filter._made
    if filter.view.single or "precision" not in options or filter.precision == "float64":
        return np.zeros(len(y), bool)
    sharp = type(filter)(*args, **(options | {"precision": "float64"}))
    one, other = (filter_test_cases.run(item, y, u) for item in (filter, sharp))
    entries = diagonal(len(filter.states))
    variance, true = (item["covariance"][:, entries].astype(float) for item in (one, other))
    std = np.sqrt(np.maximum(true, np.finfo(np.float32).tiny))
    off = np.abs(one["mean"] - other["mean"]) > std
    off |= np.abs(variance - true) > 10 * np.abs(true)
    return np.asarray(np.maximum.accumulate(off.any(axis=1)))


def diagonal(n: int) -> list[int]:
    """Return where the variances stand in the upper triangle of n rows."""
    return [at * (2 * n + 1 - at) // 2 for at in range(n)]


def _as_read(
    filter: Estimator, case: filter_test_cases.TestCase
) -> tuple[Array, Array, tuple[Any, Any]]:
    """Return what the controller reads, in the rig's units, and what that is in SI."""
    of = filter.inputs
    y, u = of.y.numbers(case.y), of.u.numbers(case.u)
    return y, u, filter.in_si(y, u)


def within(filter: Estimator, mean: Array, bound: float) -> int:
    """Return how many samples there are before the output is no rotor."""
    # mean (N, n) [m, m/s, N ...]
    caps = filter.core.parameters["set"]["cap"]
    beyond = np.flatnonzero((np.abs(mean) > 0.99 * bound * caps).any(axis=1))
    return int(beyond[0]) if beyond.size else len(mean)


def _columns(filter: Estimator, output: dict[str, Any]) -> Array:
    """Return all numbers that an export puts out, sample by sample."""
    names = ("k_i", "k_s", "innovation", "variance")
    variances = output["covariance"][:, diagonal(len(filter.states))]
    return np.hstack([output["mean"], variances, *(output[name] for name in names)]).astype(float)


def _feed_back(status: NDArray[np.uint16], health: NDArray[np.uint16], settling: int) -> Bools:
    """Return what the supervisor says: settled, and not too long without a measurement."""
    doubted, missed, decisions = settling, 0, []
    for flags, item in zip(status, health, strict=True):
        used = bool(((item & _UNUSED) == 0).any())
        missed = 0 if used else min(missed + 1, settling)
        if flags & _UNSURE:
            doubted = settling
        elif used:
            doubted = max(doubted - 1, 0)
        decisions.append(doubted == 0 and missed < settling)
    return np.array(decisions)


def coverage(tested: Vectors, filter: Estimator) -> list[tuple[str, str]]:
    """Return what the samples visit, in words: what, and how much of it."""
    n = len(filter.states)
    rows = [("samples", f"{len(tested.y)}, in {len(tested.starts)} runs, each from a start")]
    for place, state in enumerate(filter.states):
        values = tested.expected[:, place]
        rows.append((f"`{state.name}`", f"{values.min():.4g} to {values.max():.4g} {state.unit}"))
    forces = (tested.expected.shape[1] - 2 * n - 2 * tested.health.shape[1]) // 2
    for k, (name, unit) in enumerate((("k_i", "N/A"), ("k_s", "N/m"))):
        of = tested.expected[:, 2 * n + k * forces : 2 * n + (k + 1) * forces]
        rows.append((f"`{name}`", f"{of.min():.4g} to {of.max():.4g} {unit}"))
    *flags, never = flag_rows(tested.status)
    rows += [*flags, ("to be fed back", f"{int(tested.feed_back.sum())} samples")]
    if tested.amplified.any():
        amplified = (
            f"{int(tested.amplified.sum())} samples, compared where each bit must be the same"
        )
        rows.append(("rounding is amplified", amplified))
    return [*rows, never]


def flag_rows(status: NDArray[np.uint16]) -> list[tuple[str, str]]:
    """Return in how many samples each flag is raised, and last those that never are."""
    counts = {f"`AMB_{flag.name}`": int(((status & flag) != 0).sum()) for flag in Status}
    rows = [(name, f"{count} samples") for name, count in counts.items() if count]
    never = ", ".join(name for name, count in counts.items() if not count)
    return [*rows, ("flags that are not raised", never or "none")]


def context(tested: Vectors, filter: Estimator, precision: CPrecision) -> dict[str, Any]:
    """Return what the self-test's files say."""
    starts = tested.starts.tolist()
    marks = tested.feed_back.copy()
    marks[starts] += 2
    marks[tested.amplified] += 4
    return {
        "steps": len(tested.y),
        "columns": tested.expected.shape[1],
        "y": c_literals.array(with_stand_ins(tested.y, precision), precision),
        "u": c_literals.array(with_stand_ins(tested.u, precision), precision),
        "expected": c_literals.array(tested.expected, precision),
        "status": c_literals.array(tested.status, precision),
        "health": c_literals.array(tested.health, precision),
        "marks": c_literals.array(marks, precision),
        "runs": list(zip(tested.runs, np.diff([*starts, len(tested.y)]).tolist(), strict=True)),
        "coverage": coverage(tested, filter),
    }


def with_stand_ins(values: Array, precision: CPrecision) -> Array:
    """Return numbers, and what the vectors have instead of what C has no literal for."""
    most = float(np.finfo(np.float32 if precision == "float" else np.float64).max)
    return np.nan_to_num(values, nan=most, posinf=most / 2, neginf=-most / 2)


def of_roles(filter: Estimator) -> dict[str, Any]:
    """Return which states the self-test of a machine asks for."""
    # `plain`: its state is the Kalman filter's own, whose covariance the self-test can spoil, and
    # the rotor is rigid: a mode may go beyond its bound, or back, within a sample.
    roles, view = [state.role for state in filter.states], filter.view
    linear = filter.name.startswith("linear") and not c_literals.called(filter).base
    return {
        "plain": linear and not view.single and view.H.shape[1] == view.rigid,
        "positions": [i for i, role in enumerate(roles) if role == "position"],
        "moving": [
            str(role in ("position", "velocity", "disturbance force")).lower() for role in roles
        ],
        "reads": [str(role == "sensor").lower() for role in roles],
        "loads": [str(role == "disturbance force").lower() for role in roles],
    }


def first(filter: Estimator, role: str) -> int:
    """Return the place of the first state of a role; -1 where there is none."""
    return next((i for i, state in enumerate(filter.states) if state.role == role), -1)


def stiff(filter: Estimator, magnet: Magnet) -> bool:
    """Whether a magnet without current pulls a rotor that is off the middle."""
    _, k_s = magnet.tangent(np.zeros(1), np.array([filter.machine.bearings[0].clearance]))
    return bool(k_s[0] != 0)


def stops(filter: Estimator) -> tuple[Array, Array]:
    """Return readings (2, m) that may be a rotor on its stops, and ones that may not."""
    known = filter.core.parameters
    gain, travel, var_y = (np.asarray(known["set"][k], float) for k in ("K_sen", "travel", "var_y"))
    stop, noise = np.abs(gain) * travel, np.sqrt(var_y + np.asarray(known["rounding"], float))
    between, beyond = (np.array([-at, at]) for at in (stop + 3.8 * noise, stop + 4.2 * noise))
    return filter.inputs.y.numbers(between), filter.inputs.y.numbers(beyond)


def stops_in_c(filter: Estimator, precision: CPrecision) -> dict[str, str]:
    """Return the same as C."""
    results = dict(zip(("between", "beyond"), stops(filter), strict=True))
    if filter.view.single:
        return {name: c_literals.array(at.ravel(), precision, "") for name, at in results.items()}
    return {name: c_literals.rows(at, precision) for name, at in results.items()}
