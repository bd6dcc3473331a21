"""Cases of the comparison, and their records.

Times are in time constants of the plant, ``sqrt(m/k_s)`` (8.3 ms on the paper's rig), lengths in
clearances and forces in weights, so that each case is equivalent on any machine. On the paper's rig
a step of half of the clearance is 0.5 mm, and 0.6 of the weight is 3 N.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.control.pid import PID
from ambkit.control.stabilising_controller import holding
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.registry import split_name
from ambkit.judge.comparison.conditions import (
    CERTAIN,
    Load,
    Spread,
    coloured_noise,
    random_walk,
    rotating,
    streams,
    turned,
)
from ambkit.machine.axes import isolated_axes, slowest_time, weights_of
from ambkit.machine.forces.force_surface import ForceSurface
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, magnet_of, own_time
from ambkit.machine.parts import GRAVITY
from ambkit.machine.stiffness import stiffness_map
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.many import Many, simulate_many
from ambkit.simulation.plans import Planned
from ambkit.simulation.run import samples, simulate
from ambkit.simulation.scenario import Disturbance, Reference, Scenario
from ambkit.simulation.waveforms import Constant, Sequence, Signal, Sine, Step

Force = Callable[[Array, Array], Array]

STEPS = (0.1, 0.3, 0.5)  #: Position steps as in the paper, over the clearance.
LOAD = 0.6  #: Disturbance force, over the weight.
#: Duration of a run with disturbance steps along all axes, in time constants of the plant.
LENGTH = 40.0

LOADED = 0.2
"""Standard deviation of these steps, over the load of an axis if all carry the same."""

REACH = 0.8
"""Overshoot of a step to half of the clearance, over the clearance; the range of the maps."""


@dataclass(frozen=True)
class Case:
    """A scenario in which estimators are compared."""

    name: str  #: Name.
    title: str  #: Short description.
    about: str  #: Purpose, in a sentence.
    scenario: Callable[[Machine, float], Scenario]  #: By machine and load over its weight.
    spread: Spread = CERTAIN  #: Tolerances of the plant.
    magnet_constant: float = 1.0  #: Factor on the plant's, unknown to the estimators.
    drift: float = 0.0  #: Relative drift of that constant until the end of the run.
    #: Whether the plant's iron saturates more than described; only learned maps include it.
    saturates: bool = False
    correlation: float = 0.0  #: Correlation time of the sensor noise in samples; 0: white.
    walks: float = 0.0  #: Intensity of the random walk, over the filters' assumption; 0: none.
    #: Which of unbalance and runout the filters estimate; a random walk goes without the others.
    synchronous: tuple[str, ...] = ()
    #: Measured or computed force map of the plant, which only learned maps include. Without it, the
    #: described magnet.
    magnet: ForceSurface | None = None
    plant: Any = None  #: The user's plant, a class or ``file.py:Class``.

    def with_states_of(self, filters: Iterable[str]) -> Case:
        """Return the case for filters with synchronous states, by name."""
        roles = {role for name in filters for role in split_name(name)[1]}
        return replace(self, synchronous=tuple(sorted(roles)))

    @property
    def certain(self) -> bool:
        """Whether the plant is the described machine."""
        return self.spread == CERTAIN and self.magnet_constant == 1.0

    def factors(self, runs: int, seed: int) -> Iterator[Spread]:
        """Yield the factors on the values of the plant."""
        for one in self.spread.factors(runs, seed):
            yield replace(one, magnet_constant=one.magnet_constant * self.magnet_constant)

    def process_noise(self, machine: Machine) -> Any:
        """Return the intensity of the disturbance's random walk, of each axis [N^2/s]."""
        own = KalmanFilter(machine).variances.disturbance
        if isinstance(own, tuple):
            return tuple(self.walks * item for item in own)
        return self.walks * float(own)


@dataclass(frozen=True, eq=False)
class Trial:
    """One run of a case: its plant and its record."""

    plant: Machine  #: True machine.
    scenario: Scenario  #: Scenario with its seed.
    external_inputs: ExternalInputs | None  #: Series of noise and disturbance.
    magnet: MagnetModel | None  #: Force map of the plant, if it has one.
    record: Record  #: Record of the loop closed by the nominal linear filter.
    _loads: dict[tuple[int, str], Load] = field(default_factory=dict, repr=False)

    def load(self, first: int, axis: str = "") -> Load:
        """Return the disturbance of an axis from a sample on."""
        if (first, axis) not in self._loads:
            self._loads[first, axis] = Load(self.record[signal("f_d", axis)][first:])
        return self._loads[first, axis]

    @property
    def lost(self) -> bool:
        """Whether the rotor touched a stop, which invalidates the run."""
        return bool(self.record.meta["stop_touched"])


def in_the_loop(made: Iterable[Trial], estimator: Estimator, settling: float) -> Many:
    """Simulate the same runs with another estimator in the loop."""
    runs = (Planned(at.plant, at.scenario, estimator, at.magnet, at.external_inputs) for at in made)
    return simulate_many(runs, settling=settling, threads=1)


def trials(case: Case, machine: Machine, runs: int, seed: int) -> list[Trial]:
    """Return the records of a case, see `iterate_trials`."""
    return list(iterate_trials(case, machine, runs, seed))


def iterate_trials(case: Case, machine: Machine, runs: int, seed: int) -> Iterator[Trial]:
    """Yield the records of a case, with independent disturbances of each axis."""
    if case.walks:  # the filters' model is exact
        machine = rotating(machine, case.synchronous)
    if not machine.single and (case.saturates or case.magnet is not None):
        raise AmbkitError(
            f"case {case.name}: its plant has another magnet than the described one, which can be "
            f"simulated for a machine with one axis only; {machine.name} has {len(machine.axes)}"
        )
    fixed = _magnet(case, machine, machine) if case.certain else None
    known, control = KalmanFilter(machine), _control(case, machine)
    for run, factors in enumerate(case.factors(runs, seed)):
        plant = machine if case.certain else factors.plant(machine)
        scenario = _flight(case, machine, LOAD * factors.load, 1000 * seed + run, control)
        external_inputs, truth = _beside(case, plant, scenario), {}
        if case.walks:  # acts as its mean over the sample; the truth is the value at the samples
            plant, rng = turned(plant, scenario.seed), streams(scenario)[0]
            variances = machine.sampling_time * np.atleast_1d(case.process_noise(machine))
            n = samples(plant, scenario)
            means, walks = zip(*(random_walk(rng, float(of), n) for of in variances), strict=True)
            external_inputs = replace(external_inputs, disturbance=np.column_stack(means))
            names = (signal("f_d", axis.name) for axis in machine.axes)
            truth = dict(zip(names, walks, strict=True))
        magnet = fixed if case.certain else _magnet(case, plant, machine)
        record = simulate(
            plant, scenario, estimator=known, magnet=magnet, external_inputs=external_inputs
        )
        record = replace(record, signals={**record.signals, **truth})
        yield Trial(plant, scenario, external_inputs, magnet, record)


def _control(case: Case, machine: Machine) -> Control | None:
    """Return the controllers of several axes, those of the described machine."""
    if machine.single:
        return None
    if case.certain:
        return Control().fed_by("estimate")
    pids = zip(machine.axes, holding(machine, "estimate").pids, strict=True)
    control = Control(pid={axis.name: PID(**gains._asdict()) for axis, gains in pids})
    return control.fed_by("estimate")


def _flight(
    case: Case, machine: Machine, load: float, seed: int, control: Control | None
) -> Scenario:
    """Return the scenario of all axes; without `control` that of the case controls the axis."""
    parts = [case.scenario(axis, load) for axis in isolated_axes(machine)]
    along = [(axis.name, of) for axis, of in zip(machine.axes, parts, strict=True)]
    return Scenario.model_construct(
        duration=max(of.duration for of in parts), seed=seed, plant=case.plant,
        controller=control or parts[0].controller,
        reference=tuple(Reference.model_construct(axis=name, position=of.reference)
                        for name, of in along),
        disturbance=tuple(Disturbance.model_construct(axis=name, force=of.disturbance)
                          for name, of in along),
    )  # fmt: skip


@lru_cache(maxsize=4)
def loaded(machine: Machine, runs: int, seed: int) -> list[Trial]:
    """Yield records with a disturbance step along each axis, of random size at a random time."""
    rng, made = np.random.default_rng(seed), []
    duration = LENGTH * slowest_time(machine)
    weight = machine.rotor.mass * GRAVITY / max(1, len(weights_of(machine)))
    for _ in range(runs):
        loads = tuple(
            Disturbance(
                axis=axis.name,
                force=Step(amplitude=LOADED * weight * float(rng.standard_normal()),
                           time=float(rng.uniform(0.3, 0.7)) * duration),
            )
            for axis in machine.axes
        )  # fmt: skip
        scenario = Scenario(duration=duration, seed=int(rng.integers(2**31)), disturbance=loads)
        made.append(Trial(machine, scenario, None, None, simulate(machine, scenario)))
    return made


def _beside(case: Case, plant: Machine, scenario: Scenario) -> ExternalInputs:
    """Return the drift of a plant's magnets and the coloured noise of its sensors."""
    n, noise, scale = samples(plant, scenario), None, None
    if case.drift:
        scale = np.linspace(1.0, 1.0 + case.drift, n)
    if case.correlation:
        std = [math.sqrt(reading.sensor.noise_variance) for reading in plant.readings]
        noise = coloured_noise(streams(scenario)[1], case.correlation, std, n)
    return ExternalInputs(sensor_noise=noise, magnet_scale=scale)


def saturating(machine: Machine) -> Force:
    """Return the force of magnets whose iron saturates at twice the flux of the bias current."""
    # The flux, proportional to i/s, saturates as ``phi/(1 + (phi/phi_s)^4)^(1/4)``. The machine's
    # own force, by law or force map, is reduced by the same factor as an ideal magnet's.
    m, own = machine.magnet, magnet_of(machine)
    limit = 2 * m.bias_current / m.air_gap

    def force(iu: Array, x: Array) -> Array:
        # Factor on the square of a flux, which is 1 at saturation.
        a = (m.bias_current + iu) / (m.air_gap - x) / limit
        p = np.sqrt(1 + a**4)
        if m.type == "one-sided":
            return np.asarray(1 / p * own.force(iu, x))
        # (h(a) - h(b)) / (a^2 - b^2) with h = a^2 / p, without cancellation.
        b = (m.bias_current - iu) / (m.air_gap + x) / limit
        q = np.sqrt(1 + b**4)
        share = (a**2 + b**2) / (p * q * (a**2 * q + b**2 * p))
        return np.asarray(share * own.force(iu, x))

    return force


def _magnet(case: Case, plant: Machine, nominal: Machine) -> MagnetModel | None:
    """Return the plant's magnet: the given one, or a map finer than the learned ones."""
    if case.magnet is not None:
        ratio = plant.magnet.magnet_constant / nominal.magnet.magnet_constant
        return case.magnet if ratio == 1 else case.magnet.scaled(ratio)
    if not case.saturates:
        return None

    max_displacement = min(plant.clearance, 0.95 * plant.magnet.air_gap)
    return stiffness_map(
        plant,
        currents=np.linspace(plant.current_min, plant.current_max, 31),
        displacements=np.linspace(-max_displacement, max_displacement, 41),
        force=saturating(plant),
    )


# ---- the cases ----


def _scenario(
    machine: Machine, duration: float, reference: Signal, disturbance: Signal | None = None
) -> Scenario:
    return Scenario(
        duration=duration * own_time(machine),
        reference=reference,
        disturbance=disturbance or Constant(value=0.0),
        controller=Control.textbook(machine),  # fast, so that the rotor moves far
    )


def against_gravity(machine: Machine) -> float:
    """Disturbances act against gravity, as in the paper: the safe direction for any magnet."""
    return -1.0 if machine.weight > 0 else 1.0


def _load(machine: Machine, load: float, at: float) -> Step:
    weight = machine.rotor.mass * GRAVITY
    return Step(amplitude=against_gravity(machine) * load * weight, time=at * own_time(machine))


def _positions(machine: Machine, plan: dict[float, float]) -> Sequence:
    """Steps of the position, over the clearance, at times in time constants of the plant."""
    return Sequence(
        times=tuple(at * own_time(machine) for at in plan),
        values=tuple(height * machine.clearance for height in plan.values()),
    )


def step_case(share: float) -> Case:
    """Return the case of one step and a disturbance, as in `ambkit reproduce`."""

    def scenario(machine: Machine, load: float) -> Scenario:
        return _scenario(machine, 60, _positions(machine, {6: share}), _load(machine, load, 30))

    return Case(
        "step",
        f"a step to {share:g} of the travel, then a load",
        "Far from the centre the force law is nonlinear: a linear filter takes its stiffness "
        "error for a disturbance force.",
        scenario,
    )


def walk_case(share: float) -> Case:
    """Return the case in which the filters' model is exact, with one step."""

    def scenario(machine: Machine, _load: float) -> Scenario:
        return _scenario(machine, 24, _positions(machine, {2: share}))

    return Case(
        "model",
        f"a step to {share:g} of the travel, all noise as the filters assume",
        "The disturbance force is a random walk, as in the filters' model: the bound is exact.",
        scenario,
        walks=1.0,
    )


def _paper(machine: Machine, load: float) -> Scenario:
    plan = dict(zip((6.0, 18.0, 30.0), STEPS, strict=True))
    return _scenario(machine, 60, _positions(machine, plan), _load(machine, load, 45))


def _wrong_k(machine: Machine, load: float) -> Scenario:
    plan = {6.0: 0.2, 14.0: -0.2, 22.0: 0.3, 30.0: 0.1}
    return _scenario(machine, 60, _positions(machine, plan), _load(machine, load, 42))


def _unbalance(machine: Machine, load: float) -> Scenario:
    weight, rate = machine.rotor.mass * GRAVITY, 1 / (6 * own_time(machine))
    force = Sine(amplitude=load * weight, frequency=rate)
    return _scenario(machine, 60, _positions(machine, {6: 0.3}), force)


def load_case(force: float) -> Case:
    """Return the case of a position step and back, then a step of the disturbance force."""

    def scenario(machine: Machine, _load: float) -> Scenario:
        step = Step(amplitude=against_gravity(machine) * force, time=20 * own_time(machine))
        return _scenario(machine, 32, _positions(machine, {2: STEPS[-1], 10: 0.0}), step)

    return Case(
        "load",
        f"a step to {STEPS[-1]:g} of the travel and back, then a force of {force:.3g} N",
        "A filter that assumes too slow a disturbance force lags it.",
        scenario,
    )


_DEFAULT = (
    Case("paper", "steps as the paper's, then a load",
         "Near the centre all are similar; the force law matters at larger displacements.", _paper),
    Case("uncertain", "the paper's steps, and a plant that is not the nominal one",
         "Remaining differences with an uncertain plant.", _paper,
         spread=Spread.all(0.2)),
    Case("wrong-k", "a magnet constant 30 % too small that drifts, position steps, a load",
         "The steps determine the constant; a filter that estimates it knows it before the load.",
         _wrong_k,
         magnet_constant=0.7, drift=0.1),
    Case("saturating", "iron that saturates, with maps learned from the measured force",
         "The closed law is wrong here; only trained models fit.", _paper, saturates=True),
    Case("coloured-noise", "sensor noise correlated over ten samples",
         "All filters assume white noise.", _paper, correlation=10.0),
    step_case(STEPS[-1]),
    Case("unbalance", "a load that is a sine",
         "No filter models it: the disturbance force varies all the time, so delay matters most.",
         _unbalance),
    walk_case(STEPS[-1]),
)  # fmt: skip

CASES = {case.name: case for case in _DEFAULT}  #: The cases by name.
