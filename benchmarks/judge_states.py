"""Estimators judged state by state where the truth follows their model, beside the bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import names_in, of_type
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.errors import true_signal
from ambkit.estimate.kalman import ExtendedKalmanFilter, KalmanFilter
from ambkit.estimate.machine_model import several
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import get_kind, learned_magnet
from ambkit.judge.comparison.criteria import normalised_errors
from ambkit.machine.accessories import Runout
from ambkit.machine.axes import force_laws, isolated_axes, weights_of
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, magnet_of
from ambkit.models.parts.synchronous import unbalance_planes
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import simulate
from ambkit.simulation.scenario import Scenario

if TYPE_CHECKING:
    from ambkit.estimate.estimate import Estimate
    from ambkit.estimate.estimator import Estimator
    from ambkit.simulation.waveforms import Signal


RAW = "raw sensor"

FINER = 10  #: Steps in a sample of the filter that is compared with.

WITHIN = 8  #: Steps of a load's walk in a sample.


@dataclass(frozen=True)
class Judgement:
    """Errors of estimators, over seeds, after they have settled.

    Attributes
    ----------
    quantities : tuple of str
        ``s_A1`` displacement at an axis [m], ``v_A1`` its velocity [m/s], ``f_d_A1`` disturbance
        force [N], and ``i_A1`` current where the amplifier lags [A], without the name of a single
        axis; of unbalance and runout the states.
    errors : mapping
        Of each candidate, root mean square errors (seeds, quantities), each in its unit; those of
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

    def efficiency(self, candidate: str) -> Array:
        """Return the bound's variance over the mean square error, (quantities,) [1].

        Parameters
        ----------
        candidate : str
            Name of a filter.
        """
        return np.asarray(self.bound**2 / np.mean(self.errors[candidate] ** 2, axis=0))

    def paired(self, candidate: str) -> Array:
        """Return the finer filter's mean square error over a filter's, (quantities,) [1].

        On the same noise both err alike, so that few seeds tell what the bound would need many for.

        Parameters
        ----------
        candidate : str
            Name of a filter.

        Raises
        ------
        ValueError
            No finer filter was asked for.
        """
        if self.finer is None:
            raise ValueError("no finer filter was run: judge_states(..., finer=True)")
        own = np.mean(self.errors[candidate] ** 2, axis=0)
        return np.asarray(np.mean(self.finer**2, axis=0) / own)

    def to_dict(self) -> dict[str, object]:
        """Return the figures as plain data, in SI."""
        return {
            "quantities": list(self.quantities),
            "bound": self.bound.tolist(),
            "rmse": {
                name: np.sqrt(np.mean(error**2, axis=0)).tolist()
                for name, error in self.errors.items()
            },
            "efficiency": {name: self.efficiency(name).tolist() for name in self.nees},
            "nees": {name: float(np.mean(nee)) for name, nee in self.nees.items()},
            **({} if self.finer is None
               else {"paired": {name: self.paired(name).tolist() for name in self.nees}}),
        }  # fmt: skip


def judge_states(
    bearing: Machine,
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
) -> Judgement:
    """Judge estimators of a machine whose truth follows their model, state by state.

    The disturbance forces are random walks that come to a share of what the magnets have to spare,
    with the growth that the filters assume, the noise is that of the machine. Unbalance and runout
    are left out where the filters do not know them; where they do, they are drawn anew for each
    run, as large as the filters expect. The filters start from their first readings, with their
    usual doubt.

    Parameters
    ----------
    bearing : Machine
        The machine.
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
        That share [1]; a flexible rotor easily bears less.
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
        A run comes into a touch-down bearing, of which the model knows nothing.
    TypeError
        `bearing` is no machine.
    """
    of_type(Machine, bearing=bearing)
    plain = _known(bearing, synchronous)
    noise = FilterNoise(disturbance=_growth(plain, duration, load))
    filters = {
        kind: get_kind(kind).make(
            plain, learned_magnet(kind, plain), noise=noise, synchronous=synchronous
        )
        for kind in names_in(kinds=kinds)
    }
    first = next(iter(filters.values()))
    initial_std = {
        s.name: balance * s.size for s in first.states if s.role in ("unbalance", "runout")
    }
    other = finer_filter(first) if finer else None
    for item in [*filters.values(), *([other] if other else [])]:
        item.start_std = dict(initial_std)
    W, quantities = _quantities(first)
    T = plain.sampling_time
    start = round(settled / T)
    errors: dict[str, list[Array]] = {name: [] for name in (*filters, RAW)}
    nees: dict[str, list[float]] = {name: [] for name in filters}
    bounds: list[Array] = []
    finest: list[Array] = []
    for seed in range(first_seed, first_seed + seeds):
        sampled_machine, rotor = _drawn(plain, initial_std, seed)
        scenario = Scenario(duration=duration, seed=seed, speed=speed)
        record = _flown(sampled_machine, first, seed, scenario)
        if record.meta["stop_touched"]:
            raise AmbkitError(
                f"{plain.name}: with loads of {load:g} of what the magnets have to spare the rotor "
                f"comes into a touch-down bearing (seed {seed}); judge with less load"
            )
        truth = (_true_states(first, record, rotor) @ W.T)[start:]
        for name, estimator in filters.items():
            estimate = estimator.run(record, covariance=True)
            wrong = (estimate.mean @ W.T)[start:] - truth
            errors[name].append(np.sqrt(np.mean(wrong**2, axis=0)))
            squares = normalised_errors(estimate, record, first.view)[start:]
            nees[name].append(float(np.mean(squares)) / (3 * len(first.view.isolated)))
        errors[RAW].append(_raw(first, record, truth, start))
        if not bounds or synchronous:
            bounds.append(settled_bound(first, record, W, start))
        if other:
            fine = run_finer(other, record, plain.delay or 0.0)
            rows, names = _quantities(other)
            rows = np.array([rows[names.index(name)] for name in quantities])
            fine_mean = (fine.mean[::FINER] @ rows.T)[start:]
            finest.append(np.sqrt(np.mean((fine_mean - truth) ** 2, axis=0)))
    return Judgement(
        quantities,
        {name: np.array(error) for name, error in errors.items()},
        np.sqrt(np.mean(np.square(bounds), axis=0)),
        {name: np.array(nee) for name, nee in nees.items()},
        np.array(finest) if other else None,
    )


def _known(machine: Machine, synchronous: Sequence[str]) -> Machine:
    """Return the machine without unbalance and runout, but for those that filters estimate."""
    sensors = [sensor.model_copy(update={"runout": ()}) for sensor in machine.sensors]
    without: dict[str, Any] = (
        {"unbalance": []} if machine.unbalance and "unbalance" not in synchronous else {}
    )
    return machine.replace(**without, **({} if "runout" in synchronous else {"sensor": sensors}))


def _drawn(
    machine: Machine, sizes: Mapping[str, float], seed: int
) -> tuple[Machine, dict[str, complex]]:
    """Return the machine with unbalance and runout of its own, and these by states, at angle 0."""
    if not sizes:
        return machine, {}
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
    for sensor in machine.sensors:
        lines = [
            Runout(order=int(name[1:].split("_")[0]), amplitude=abs(r), phase=float(np.angle(r)))
            for name, r in rotor.items() if name[0] == "r" and name.split("_", 1)[1] == sensor.name
        ]  # fmt: skip
        sensors.append(sensor.model_copy(update={"runout": tuple(lines) or sensor.runout}))
    return machine.replace(unbalance=planes, sensor=sensors), rotor


def _state_of(rotor: Mapping[str, complex], name: str, angle: Array) -> Array:
    """Return an unbalance's or runout's state (n,) while the rotor turns."""
    order = int(name[1:].split("_")[0]) if name[0] == "r" else 1
    phasor = rotor[name[:-2]] * np.exp(1j * order * angle)
    return np.asarray(phasor.real if name.endswith(("_x", "_c")) else phasor.imag)


def _growth(machine: Machine, duration: float, load: float) -> float:
    """Return how fast the variance of a load grows [N^2/s]."""
    spare = []
    for isolated, carried in zip(isolated_axes(machine), weights_of(machine), strict=True):
        law = magnet_of(isolated)
        most = float(law.force(isolated.current_max, 0.0)) - law.bias_force
        spare.append(most - abs(carried))
    return float((load * min(spare)) ** 2 / duration)


def _flown(machine: Machine, filters: Estimator, seed: int, scenario: Scenario) -> Record:
    """Return a run, with the loads at its samples: what acts is their mean until the next one."""
    T, n = machine.sampling_time, round(scenario.duration / machine.sampling_time) + 1
    rng = np.random.default_rng([seed, 14])
    step_std = np.sqrt(T / WITHIN * np.array(several(filters.variances.disturbance)))
    walks = np.cumsum(rng.normal(0.0, step_std, (n * WITHIN, len(step_std))), axis=0)
    parts = walks.reshape(n, WITHIN, -1)
    record = simulate(machine, scenario, external_inputs=ExternalInputs(parts.mean(axis=1)))
    names = [signal("f_d", axis.name) for axis in machine.axes]
    loads = dict(zip(names, parts[:, 0].T, strict=True))
    if not machine.single:
        return replace(record, signals={**record.signals, **loads})
    along = {"s": record["x"], "speed": np.full(len(record), machine.speed)}
    units = {**record.units, "s": "m", "speed": "rad/s"}
    return replace(record, signals={**record.signals, **along, **loads}, units=units)


def _quantities(estimator: Estimator) -> tuple[Array, tuple[str, ...]]:
    """Return what is judged as rows (quantities, states), and names."""
    view, states = estimator.view, estimator.states
    names = [signal(what, axis.name) for what in ("s", "v", "f_d") for axis in view.machine.axes]
    own = [
        k for roles in (("current",), ("unbalance", "runout"))
        for k, state in enumerate(states) if state.role in roles
    ]  # fmt: skip
    rows = np.concatenate([*view.rows_along(states), np.eye(len(states))[own]])
    return rows, (*names, *(states[k].name for k in own))


def _true_states(estimator: Estimator, record: Record, rotor: Mapping[str, complex]) -> Array:
    """Return the truth of an estimator's states (n, states); 0 where nobody judges it."""
    speed = record["speed"]
    steps = np.cumsum((speed[1:] + speed[:-1]) / 2) * estimator.machine.sampling_time
    angle = np.append(0.0, steps)
    result = np.zeros((len(record), len(estimator.states)))
    for k, state in enumerate(estimator.states):
        if state.role in ("unbalance", "runout"):
            result[:, k] = _state_of(rotor, state.name, angle)
        elif state.role == "current":
            result[:, k] = record["iu" + state.name[1:]]
        elif (truth := true_signal(record, state.name)) is not None:
            result[:, k] = truth
    return result


def _raw(estimator: Estimator, record: Record, truth: Array, start: int) -> Array:
    """Return the errors of the displacements that explain the readings best."""
    view = estimator.view
    y = np.column_stack([record[signal("y", r.name)] for r in view.machine.readings])
    raw_position = (y @ view.measured.T)[start:]
    result = np.full(truth.shape[1], np.nan)
    p = len(view.isolated)
    result[:p] = np.sqrt(np.mean((raw_position - truth[:, :p]) ** 2, axis=0))
    return result


def settled_bound(estimator: Estimator, record: Record, W: Array, start: int) -> Array:
    """Return the least standard deviations once settled (quantities,), root mean square."""
    # With the tangents of the magnets where the rotor hovers the machine is linear and its noise
    # normal: the Cramer-Rao bound is then the covariance of the linear filter that knows them,
    # which depends on no reading (Tichavsky 1998).
    # W (quantities, states)
    view, tangents = estimator.view, []
    for axis, isolated in zip(view.machine.axes, view.isolated, strict=True):
        iu, s = (float(np.mean(record[signal(of, axis.name)])) for of in ("iu", "s"))
        k_i, k_s = magnet_of(isolated).tangent(iu, s)
        tangents.append(ConstantStiffness(float(k_i), float(k_s)))
    linear = KalmanFilter(
        view.machine, force_laws(tangents, view.machine), noise=FilterNoise(*estimator.variances),
        synchronous=estimator.engine.synchronous, frozen_limit=0, outlier_limit=0,
    )  # fmt: skip
    linear.start_std = estimator.start_std
    believed = linear.run(record, covariance=True).covariance
    assert believed is not None
    rows, columns = np.triu_indices(W.shape[1])
    weights = np.where(rows == columns, 1.0, 2.0) * W[:, rows] * W[:, columns]
    return np.asarray(np.sqrt((believed[start:] @ weights.T).mean(axis=0)))


def finer_filter(estimator: Estimator) -> Estimator:
    """Return the extended filter of a machine's law with `FINER` steps in a sample."""
    # The noise of a control, held over a sample, is that of as many shorter ones together. Loads,
    # unbalance and runout grow as they do. A delay of the loop is taken out of its model and put
    # into the control signals, see `run_finer`.
    machine, variances = estimator.machine, estimator.variances
    control = estimator.view.plain([FINER * item for item in several(variances.control)])
    other = ExtendedKalmanFilter(
        machine.replace(sampling_time=machine.sampling_time / FINER, delay=None),
        noise=FilterNoise(variances.measurement, control, variances.disturbance),
        synchronous=estimator.engine.synchronous, frozen_limit=0, outlier_limit=0,
    )  # fmt: skip
    other.start_std = estimator.start_std
    return other


def run_finer(other: Estimator, record: Record, delay: float) -> Estimate:
    """Return what the finer filter says at all its steps along a record."""
    machine, n = other.machine, (len(record) - 1) * FINER + 1
    late = round(delay / machine.sampling_time)
    signals: dict[str, Array] = {}
    for reading in machine.readings:
        measurement = np.full(n, np.nan)
        measurement[::FINER] = record[signal("y", reading.name)]
        signals[signal("y", reading.name)] = measurement
    for axis in machine.axes:
        held = np.repeat(record[signal("u", axis.name)], FINER)
        signals[signal("u", axis.name)] = np.concatenate([np.full(late, held[0]), held])[:n]
    T = record.t[1] - record.t[0]
    speed = np.interp(np.arange(n) / FINER, np.arange(len(record)), record["speed"])
    units = {name: "m" if name[0] == "y" else "V" for name in signals}
    t = T / FINER * np.arange(n)
    return other.run(Record(t, signals | {"speed": speed}, units | {"speed": "rad/s"}))
