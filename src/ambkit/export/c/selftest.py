"""What the self-test's files say: vectors, and what it asks of which states."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.export.c import c_literals, test_vectors
from ambkit.export.c.c_literals import CPrecision

if TYPE_CHECKING:
    from ambkit._core import Magnet
    from ambkit.estimate.estimator import Estimator


def context(
    tested: test_vectors.Vectors, filter: Estimator, precision: CPrecision
) -> dict[str, Any]:
    """Return what the self-test's files say."""
    starts = tested.starts.tolist()
    marks = tested.feed_back.copy()
    marks[starts] += 2
    marks[tested.amplified] += 4
    return {
        "steps": len(tested.y),
        "columns": tested.expected.shape[1],
        "y": c_literals.array(_with_stand_ins(tested.y, precision), precision),
        "u": c_literals.array(_with_stand_ins(tested.u, precision), precision),
        "told": c_literals.array(tested.expected, precision),
        "status": c_literals.array(tested.status, precision),
        "health": c_literals.array(tested.health, precision),
        "marks": c_literals.array(marks, precision),
        "runs": list(zip(tested.runs, np.diff([*starts, len(tested.y)]).tolist(), strict=True)),
        "coverage": test_vectors.coverage(tested, filter),
    }


def _with_stand_ins(values: Array, precision: CPrecision) -> Array:
    """Return numbers, and what the vectors have instead of what C has no literal for."""
    most = float(np.finfo(np.float32 if precision == "float" else np.float64).max)
    return np.nan_to_num(values, nan=most, posinf=most / 2, neginf=-most / 2)


def is_plain(filter: Estimator) -> bool:
    """Whether it is the linear filter, of one axis or of a rotor that does not bend."""
    machine_view = filter.whole
    bends = machine_view is not None and machine_view.H.shape[1] > machine_view.rigid
    return filter.name.startswith("linear") and not c_literals.called(filter).base and not bends


def of_roles(filter: Estimator) -> dict[str, Any]:
    """Return which states the self-test of a machine asks for."""
    # `plain`: its state is the Kalman filter's own, whose covariance the self-test can spoil, and
    # the rotor is rigid: a mode may go beyond its bound, or back, within a sample.
    roles, machine_view = [state.role for state in filter.states], filter.whole
    return {
        "plain": machine_view is not None and is_plain(filter),
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
    stop_reading, noise = (
        np.abs(gain) * travel,
        np.sqrt(var_y + np.asarray(known["rounding"], float)),
    )
    between, beyond = (
        np.array([-at, at]) for at in (stop_reading + 3.8 * noise, stop_reading + 4.2 * noise)
    )
    return filter.inputs.y.numbers(between), filter.inputs.y.numbers(beyond)


def stops_in_c(filter: Estimator, precision: CPrecision) -> dict[str, str]:
    """Return the same as C."""
    results = dict(zip(("between", "beyond"), stops(filter), strict=True))
    if filter.whole is None:
        return {name: c_literals.array(at.ravel(), precision, "") for name, at in results.items()}
    return {name: c_literals.rows(at, precision) for name, at in results.items()}
