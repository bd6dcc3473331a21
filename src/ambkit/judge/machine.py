"""Estimators of a whole machine, judged by simulated truth beside the bound and the raw sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.asked import names_in
from ambkit.base.errors import AmbkitError
from ambkit.data.signals import signal
from ambkit.estimate.noise import FilterNoise
from ambkit.estimate.registry import kind_called, learned_magnet
from ambkit.judge import machine_reference
from ambkit.machine.bank import alone_of, weights_of
from ambkit.machine.magnets import magnet_of
from ambkit.machine.parts import Runout
from ambkit.models.parts.rotor import velocity_of
from ambkit.models.parts.synchronous import unbalance_planes
from ambkit.simulation.flight import Flight
from ambkit.simulation.machine import simulate_machine
from ambkit.simulation.run import Run

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.estimate.estimate import Estimate
    from ambkit.machine.machine import Machine
    from ambkit.simulation.waveforms import Signal

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
        and ``i_A1`` current where the amplifier lags [A]; of unbalance and runout the states.
    errors : mapping
        Of each contender, root mean square errors (seeds, quantities), each in its unit; those of
        the raw sensor are NaN where it says nothing.
    bound : ndarray (quantities,)
        Least standard deviation that any estimator can have, each in its unit [m, m/s, N, A].
    nees : mapping
        Of each filter, error squared over what it believes, of s, v and f_d together, over the
        number of these: 1 where it is honest (seeds,).
    finer : ndarray (seeds, quantities) or None
        Root mean square errors of a filter with ten steps in a sample, on the same noise, each in
        its unit [m, m/s, N, A, kg m].
    """

    quantities: tuple[str, ...]
    errors: Mapping[str, Array]
    bound: Array
    nees: Mapping[str, Array]
    finer: Array | None = None

    def efficiency(self, contender: str) -> Array:
        """Return the bound's variance over the mean square error, (quantities,) [1].

        Parameters
        ----------
        contender : str
            Name of a filter.
        """
        return np.asarray(self.bound**2 / np.mean(self.errors[contender] ** 2, axis=0))

    def paired(self, contender: str) -> Array:
        """Return the finer filter's mean square error over a filter's, (quantities,) [1].

        On the same noise both err alike, so that few seeds tell what the bound would need many for.

        Parameters
        ----------
        contender : str
            Name of a filter.

        Raises
        ------
        ValueError
            No finer filter was asked for.
        """
        if self.finer is None:
            raise ValueError("no finer filter was run: judge_machine(..., finer=True)")
        own = np.mean(self.errors[contender] ** 2, axis=0)
        return np.asarray(np.mean(self.finer**2, axis=0) / own)

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
        } | (
            {}
            if self.finer is None
            else {"paired": {name: self.paired(name).tolist() for name in self.nees}}
        )


def judge_machine(
    machine: Machine,
    kinds: Sequence[str] = ("linear", "extended"),
    *,
    seeds: int = 20,
    duration: float = 0.2,
    settled: float = 0.1,
    first_seed: int = 0,
    load: float = 0.1,
    speed: Signal | None = None,
    synchronous: Sequence[str] = (),
    balance: float = 1.0,
    finer: bool = False,
) -> MachineJudgement:
    """Judge estimators of a machine whose truth follows their model.

    The loads are random walks that come to a share of what the magnets have to spare, with the
    growth that the filters assume, the noise is that of the machine. Unbalance and runout are left
    out where the filters do not know them; where they do, they are drawn anew for each run, as
    large as the filters expect. The filters start from their first readings, with their usual
    doubt.

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
    speed : Signal, optional
        Of rotation, such as a run-up [rad/s]; by default the machine's own.
    synchronous : sequence of str
        What the filters estimate besides: ``"unbalance"``, ``"runout"``.
    balance : float
        How large these are and are expected to be, in typical sizes [1].
    finer : bool
        Whether a filter with ten steps in a sample is run beside them.

    Raises
    ------
    AmbkitError
        A run comes into a backup bearing, of which the model knows nothing.
    """
    plain = _known(machine, synchronous)
    noise = FilterNoise(disturbance=_growth(plain, duration, load))
    filters = {
        kind: kind_called(kind).make(
            plain, learned_magnet(kind, plain), noise=noise, synchronous=synchronous
        )
        for kind in names_in(kinds=kinds)
    }
    first = next(iter(filters.values()))
    drawn = {s.name: balance * s.size for s in first.states if s.role in ("unbalance", "runout")}
    other = machine_reference.finer(first) if finer else None
    for each in [*filters.values(), *([other] if other else [])]:
        each.start_std = dict(drawn)
    W, quantities = _quantities(first)
    judged = np.array([k for k, q in enumerate(quantities) if q.startswith(("s_", "v_", "f_d_"))])
    T = plain.sampling_time
    start = round(settled / T)
    errors: dict[str, list[Array]] = {name: [] for name in (*filters, RAW)}
    nees: dict[str, list[float]] = {name: [] for name in filters}
    bounds: list[Array] = []
    finest: list[Array] = []
    for seed in range(first_seed, first_seed + seeds):
        turned, rotor = _drawn(plain, drawn, seed)
        run, walks = _flown(turned, first, seed, Flight(duration=duration, seed=seed, speed=speed))
        if run.samples_at_the_stop:
            raise AmbkitError(
                f"{plain.name}: with loads of {load:g} of what the magnets have to spare the rotor "
                f"comes into a backup bearing (seed {seed}); judge with less load"
            )
        angle = _angle(run.record["speed"], T)
        truth = np.column_stack([
            _state_of(rotor, name, angle) if name in drawn else _truth(run, walks, name)
            for name in quantities
        ])[start:]  # fmt: skip
        for name, estimator in filters.items():
            estimate = estimator.run(run.record, covariance=True)
            assert estimate.covariance is not None
            wrong = (estimate.mean @ W.T)[start:] - truth
            errors[name].append(np.sqrt(np.mean(wrong**2, axis=0)))
            nees[name].append(_nees(wrong, estimate, W, start, judged))
        errors[RAW].append(_raw(plain, first, run, quantities, truth, start))
        if not bounds or synchronous:
            bounds.append(machine_reference.bound(first, run.record, W, start))
        if other:
            delay = plain.delay or 0.0
            fine = machine_reference.run_finer(other, run.record, delay)
            finest.append(_finer_errors(other, fine, quantities, truth, start))
    return MachineJudgement(
        quantities,
        {name: np.array(each) for name, each in errors.items()},
        np.sqrt(np.mean(np.square(bounds), axis=0)),
        {name: np.array(each) for name, each in nees.items()},
        np.array(finest) if other else None,
    )


def _known(machine: Machine, synchronous: Sequence[str]) -> Machine:
    """Return the machine without unbalance and runout, but for those that filters estimate."""
    sensors = [each.model_copy(update={"runout": ()}) for each in machine.sensor]
    without: dict[str, Any] = {"unbalance": [], "sensor": sensors}
    left = {"unbalance": "unbalance", "runout": "sensor"}
    for name in synchronous:
        without.pop(left[name], None)
    return machine.replace(**without)


def _drawn(
    machine: Machine, sizes: Mapping[str, float], seed: int
) -> tuple[Machine, dict[str, complex]]:
    """Return the machine with unbalance and runout of its own, and these by states, at angle 0."""
    rng = np.random.default_rng([seed, 41])
    rotor: dict[str, complex] = {}
    for name, size in sizes.items():
        if name.endswith(("_x", "_c")):
            rotor[name[:-2]] = complex(*(size * rng.normal(size=2)))
    planes = [
        {"place": z, "amount": abs(rotor[f"U{k}"]), "angle": float(np.angle(rotor[f"U{k}"]))}
        for k, z in enumerate(unbalance_planes(machine), 1) if f"U{k}" in rotor
    ]  # fmt: skip
    sensors = []
    for each in machine.sensor:
        lines = [
            Runout(order=int(name[1:].split("_")[0]), amplitude=abs(r), phase=float(np.angle(r)))
            for name, r in rotor.items() if name[0] == "r" and name.split("_", 1)[1] == each.name
        ]  # fmt: skip
        sensors.append(each.model_copy(update={"runout": tuple(lines) or each.runout}))
    return machine.replace(unbalance=planes, sensor=sensors), rotor


def _angle(speed: Array, T: float) -> Array:
    return np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2) * T])


def _state_of(rotor: Mapping[str, complex], name: str, angle: Array) -> Array:
    """Return an unbalance's or runout's state (n,) while the rotor turns."""
    order = int(name[1:].split("_")[0]) if name[0] == "r" else 1
    turned = rotor[name[:-2]] * np.exp(1j * order * angle)
    return np.asarray(turned.real if name.endswith(("_x", "_c")) else turned.imag)


def _finer_errors(
    other: Estimator, estimate: Estimate, quantities: tuple[str, ...], truth: Array, start: int
) -> Array:
    W, names = _quantities(other)
    rows = [W[names.index(name)] if name in names else np.full(W.shape[1], np.nan)
            for name in quantities]  # fmt: skip
    said = estimate.mean[:: machine_reference.FINER] @ np.array(rows).T
    return np.asarray(np.sqrt(np.mean((said[start:] - truth) ** 2, axis=0)))


def _growth(machine: Machine, duration: float, load: float) -> float:
    """Return how fast the variance of a load grows [N^2/s]."""
    spare = []
    for alone, carried in zip(alone_of(machine), weights_of(machine), strict=True):
        law = magnet_of(alone)
        most = float(law.force(alone.current_max, 0.0)) - law.bias_force
        spare.append(most - abs(carried))
    return float((load * min(spare)) ** 2 / duration)


def _flown(machine: Machine, filters: Estimator, seed: int, flight: Flight) -> tuple[Run, Array]:
    """Return a run, and the loads at its samples: what acts is their mean until the next one."""
    T, n = machine.sampling_time, round(flight.duration / machine.sampling_time) + 1
    rng = np.random.default_rng([seed, 14])
    growth = np.sqrt(T / WITHIN * np.array(filters.variances.disturbance))
    walks = np.cumsum(rng.normal(0.0, growth, (n * WITHIN, len(growth))), axis=0)
    parts = walks.reshape(n, WITHIN, -1)
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
    for roles in (("disturbance force",), ("current",), ("unbalance", "runout")):
        for k, state in enumerate(states):
            if state.role in roles:
                rows.append(np.eye(len(states))[k : k + 1])
                quantities.append(state.name)
    return np.concatenate(rows), tuple(quantities)


def _truth(run: Run, walks: Array, quantity: str) -> Array:
    record, (label, _, axis) = run.record, quantity.rpartition("_")
    if label == "f_d":
        return walks[:, [each.name for each in run.machine.axes].index(axis)]
    if label == "v":
        at = next(each for each in run.machine.axes if each.name == axis)
        forms = at.line.form.items()
        return np.asarray(sum(value * record[f"q_{velocity_of(q)}"] for q, value in forms))
    return np.asarray(record[{"i": signal("iu", axis)}.get(label, quantity)])


def _nees(wrong: Array, estimate: Estimate, W: Array, start: int, judged: Array) -> float:
    """Return the mean normalised error squared of s, v and f_d, over their number."""
    assert estimate.covariance is not None
    n = W.shape[1]
    rows, columns = np.triu_indices(n)
    found = []
    for k in range(0, len(wrong), 20):  # neighbours say the same
        P = np.zeros((n, n))
        P[rows, columns] = estimate.covariance[start + k]
        P = P + np.triu(P, 1).T
        part = W[judged] @ P @ W[judged].T
        size = np.sqrt(np.diag(part))
        e = wrong[k, judged] / size
        found.append(e @ np.linalg.solve(part / np.outer(size, size), e) / len(judged))
    return float(np.mean(found))


def _raw(
    machine: Machine, estimator: Estimator, run: Run, quantities: tuple[str, ...],
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
