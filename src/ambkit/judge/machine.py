"""Estimators of a whole machine, judged by simulated truth beside the bound and the raw sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.estimate.noise import FilterNoise
from ambkit.estimate.registry import KINDS, learned_magnet
from ambkit.machine.bank import alone_of, weights_of
from ambkit.machine.magnets import magnet_of
from ambkit.models.machine import velocity_of
from ambkit.simulation.flight import Flight
from ambkit.simulation.machine import MachineRun, simulate_machine

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.estimate.base import Estimator
    from ambkit.estimate.estimate import Estimate
    from ambkit.machine.machine import Machine

Array = NDArray[np.float64]

RAW = "raw sensor"

WITHIN = 8
"""Steps of a load's walk in a sample."""


@dataclass(frozen=True)
class MachineJudgement:
    """Errors of estimators of a whole machine, over seeds, after they have settled.

    Attributes
    ----------
    quantities : tuple of str
        ``s_A1`` displacement at an axis [m], ``v_A1`` its velocity [m/s], ``f_d_A1`` load [N],
        and ``i_A1`` current where the amplifier lags [A].
    errors : mapping
        Of each contender, root mean square errors (seeds, quantities), each in its unit; those of
        the raw sensor are NaN where it says nothing.
    bound : ndarray (quantities,)
        Least standard deviation that any estimator can have, each in its unit [m, m/s, N, A].
    nees : mapping
        Of each filter, error squared over what it believes, of s, v and f_d together, over the
        number of these: 1 where it is honest (seeds,).
    """

    quantities: tuple[str, ...]
    errors: Mapping[str, Array]
    bound: Array
    nees: Mapping[str, Array]

    def efficiency(self, contender: str) -> Array:
        """Return the bound's variance over the mean square error, (quantities,) [1].

        Parameters
        ----------
        contender : str
            Name of a filter.
        """
        return np.asarray(self.bound**2 / np.mean(self.errors[contender] ** 2, axis=0))

    def to_dict(self) -> dict[str, object]:
        """Return the figures as plain data, in SI."""
        return {
            "quantities": list(self.quantities),
            "bound": self.bound.tolist(),
            "rmse": {
                name: np.sqrt(np.mean(each**2, axis=0)).tolist()
                for name, each in self.errors.items()
            },
            "efficiency": {name: self.efficiency(name).tolist() for name in self.nees},
            "nees": {name: float(np.mean(each)) for name, each in self.nees.items()},
        }


def judge_machine(
    machine: Machine,
    kinds: Sequence[str] = ("linear", "extended"),
    *,
    seeds: int = 20,
    duration: float = 0.2,
    settled: float = 0.1,
    first_seed: int = 0,
    load: float = 0.1,
) -> MachineJudgement:
    """Judge estimators of a machine whose truth follows their model.

    The loads are random walks that come to a share of what the magnets have to spare, with the
    growth that the filters assume, the noise is that of the machine; unbalance and runout, which
    these filters do not know, are left out. The filters start from their first readings, with their
    usual doubt.

    Parameters
    ----------
    machine : Machine
        The whole machine.
    kinds : sequence of str
        Of ``ambkit.estimate.registry.KINDS``.
    seeds : int
        Runs.
    duration : float
        Of each [s].
    settled : float
        From when on errors count [s].
    first_seed : int
        Of the first run.
    load : float
        That share [1]; a rotor that bends easily bears less.

    Raises
    ------
    AmbkitError
        A run comes into a backup bearing, of which the model knows nothing.
    """
    plain = _known(machine)
    noise = FilterNoise(disturbance=_growth(plain, duration, load))
    filters = {
        kind: KINDS[kind].make(plain, learned_magnet(kind, plain), noise=noise) for kind in kinds
    }
    first = next(iter(filters.values()))
    W, quantities = _quantities(first)
    T = plain.sampling_time
    start = round(settled / T)
    errors: dict[str, list[Array]] = {name: [] for name in (*filters, RAW)}
    nees: dict[str, list[float]] = {name: [] for name in filters}
    bound: Array | None = None
    for seed in range(first_seed, first_seed + seeds):
        run, walks = _flown(plain, first, seed, duration)
        if run.samples_at_the_stop:
            raise AmbkitError(
                f"{plain.name}: with loads of {load:g} of what the magnets have to spare the rotor "
                f"comes into a backup bearing (seed {seed}); judge with less load"
            )
        truth = np.column_stack([_truth(run, walks, name) for name in quantities])[start:]
        for name, estimator in filters.items():
            estimate = estimator.run(run.record, covariance=True)
            assert estimate.covariance is not None
            wrong = (estimate.mean @ W.T)[start:] - truth
            errors[name].append(np.sqrt(np.mean(wrong**2, axis=0)))
            nees[name].append(_nees(wrong, estimate.covariance[start:], W, quantities))
        errors[RAW].append(_raw(plain, first, run, quantities, truth, start))
        if bound is None:
            bound = _bound(first, run, W, start)
    assert bound is not None
    return MachineJudgement(
        quantities,
        {name: np.array(each) for name, each in errors.items()},
        bound,
        {name: np.array(each) for name, each in nees.items()},
    )


def _known(machine: Machine) -> Machine:
    """Return the machine without unbalance and runout."""
    sensors = [each.model_copy(update={"runout": ()}) for each in machine.sensor]
    return machine.replace(unbalance=[], sensor=sensors)


def _growth(machine: Machine, duration: float, load: float) -> float:
    """Return how fast the variance of a load grows [N^2/s]."""
    spare = []
    for alone, carried in zip(alone_of(machine), weights_of(machine), strict=True):
        law = magnet_of(alone)
        most = float(law.force(alone.current_max, 0.0)) - law.bias_force
        spare.append(most - abs(carried))
    return float((load * min(spare)) ** 2 / duration)


def _flown(
    machine: Machine, filters: Estimator, seed: int, duration: float
) -> tuple[MachineRun, Array]:
    """Return a run, and the loads at its samples: what acts is their mean until the next one."""
    T, n = machine.sampling_time, round(duration / machine.sampling_time) + 1
    rng = np.random.default_rng([seed, 14])
    growth = np.sqrt(T / WITHIN * np.array(filters.variances.disturbance))
    walks = np.cumsum(rng.normal(0.0, growth, (n * WITHIN, len(growth))), axis=0)
    parts = walks.reshape(n, WITHIN, -1)
    flight = Flight(duration=duration, seed=seed)
    return simulate_machine(machine, flight, disturbance=parts.mean(axis=1)), parts[:, 0]


def _quantities(estimator: Estimator) -> tuple[Array, tuple[str, ...]]:
    """Return what is judged as rows (quantities, states), and names."""
    whole, states = estimator.whole, estimator.states
    assert whole is not None
    names = [axis.name for axis in whole.machine.axes]
    rows, quantities = [], []
    for label, block in zip("sv", whole.along_axes(states), strict=True):
        rows.append(block)
        quantities += [f"{label}_{name}" for name in names]
    for role in ("disturbance force", "current"):
        for k, state in enumerate(states):
            if state.role == role:
                rows.append(np.eye(len(states))[k : k + 1])
                quantities.append(state.name)
    return np.concatenate(rows), tuple(quantities)


def _truth(run: MachineRun, walks: Array, quantity: str) -> Array:
    record, (label, _, axis) = run.record, quantity.rpartition("_")
    if label == "f_d":
        return walks[:, [each.name for each in run.machine.axes].index(axis)]
    if label == "v":
        at = next(each for each in run.machine.axes if each.name == axis)
        forms = at.line.form.items()
        return np.asarray(sum(value * record[f"q_{velocity_of(q)}"] for q, value in forms))
    return np.asarray(record[{"i": f"iu_{axis}"}.get(label, quantity)])


def _nees(wrong: Array, covariance: Array, W: Array, quantities: tuple[str, ...]) -> float:
    """Return the mean normalised error squared of s, v and f_d, over their number."""
    judged = [k for k, name in enumerate(quantities) if not name.startswith("i_")]
    n = W.shape[1]
    rows, columns = np.triu_indices(n)
    found = []
    for k in range(0, len(wrong), 20):  # neighbours say the same
        P = np.zeros((n, n))
        P[rows, columns] = covariance[k]
        P = P + np.triu(P, 1).T
        part = W[judged] @ P @ W[judged].T
        size = np.sqrt(np.diag(part))
        e = wrong[k, judged] / size
        found.append(e @ np.linalg.solve(part / np.outer(size, size), e) / len(judged))
    return float(np.mean(found))


def _raw(
    machine: Machine, estimator: Estimator, run: MachineRun, quantities: tuple[str, ...],
    truth: Array, start: int,
) -> Array:  # fmt: skip
    """Return the errors of the displacements that explain the readings best."""
    whole = estimator.whole
    assert whole is not None
    y, _ = whole.signals(run.record)
    shown = (y @ (whole.H @ whole.shown).T)[start:]
    found = np.full(len(quantities), np.nan)
    p = len(machine.axes)
    found[:p] = np.sqrt(np.mean((shown - truth[:, :p]) ** 2, axis=0))
    return found


def _bound(estimator: Estimator, run: MachineRun, W: Array, start: int) -> Array:
    """Return the least standard deviations once settled.

    With the tangents of the magnets where the rotor hovers the machine is linear and its noise
    normal: the Cramer-Rao bound is then the Kalman filter's own covariance (Tichavsky 1998).
    """
    whole = estimator.whole
    assert whole is not None
    tangents = []
    for axis, alone in zip(whole.machine.axes, whole.alone, strict=True):
        iu, s = (float(np.mean(run.record[f"{of}_{axis.name}"])) for of in ("iu", "s"))
        tangents.append([float(each) for each in magnet_of(alone).tangent(iu, s)])
    k_i, k_s = np.array(tangents).T
    linear = estimator.linear_model(k_i, k_s)
    unit = np.array(estimator.default_std())
    scaled = linear.scaled(unit)
    R = np.diag(np.atleast_1d(linear.R))
    size = np.sqrt(np.diag(R))
    H = scaled.H / size[:, None]
    P = np.eye(len(unit))
    for _ in range(start):
        P = scaled.A @ P @ scaled.A.T + scaled.Q
        S = H @ P @ H.T + np.eye(len(size))
        K = np.linalg.solve(S, H @ P).T
        left = np.eye(len(unit)) - K @ H
        P = left @ P @ left.T + K @ K.T
        P = (P + P.T) / 2
    rows = W * unit
    return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", rows, P, rows)))


def errors_along(estimate: Estimate, record: Record, first: int = 0) -> dict[str, float]:
    """Return root mean square errors against the truth of a whole machine's record.

    Parameters
    ----------
    estimate : Estimate
        What an estimator says.
    record : Record
        With truth where simulated, see `ambkit.simulation.machine.MachineRun`.
    first : int
        Sample from which on it counts.

    Returns
    -------
    dict of str to float
        By the names of states, coordinates and loads, each in its unit, of which there is truth.
    """
    truth = {state.name: f"q_{state.name}" for state in estimate.states} | {
        f"f_d_{axis}": f"f_d_{axis}" for axis in estimate.axes
    }
    return {
        name: float(np.sqrt(np.mean((estimate[name] - record[of])[first:] ** 2)))
        for name, of in truth.items()
        if of in record
    }
