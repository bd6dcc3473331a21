"""Preparation of runs for the core, which simulates and evaluates many at once."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.control.controllers import Controllers
from ambkit.estimate.estimator import Estimator
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel
from ambkit.models.model import compressed_rows
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import Loop, Run, Sampled, samples, simulate_run
from ambkit.simulation.run_figures import FIGURES, FLAGS, first_of
from ambkit.simulation.scenario import AXES, Scenario, along


@dataclass(frozen=True, slots=True)
class Planned:
    """One run of many: machine, scenario and noise.

    Attributes
    ----------
    machine : Machine
        The plant.
    scenario : Scenario
        The scenario, with the controllers.
    estimator, magnet, external_inputs
        As for :func:`ambkit.simulation.run.simulate_run`. The estimator is not changed, and one can
        serve all runs.
    number : int, optional
        Number of the run; with the scenario's seed it determines the noise, in place of
        ``scenario.run``.
    controllers : Controllers, optional
        For several axes, if already constructed, as for another machine.
    """

    machine: Machine
    scenario: Scenario
    estimator: Estimator | None = None
    magnet: MagnetModel | None = None
    external_inputs: ExternalInputs | None = None
    number: int | None = None
    controllers: Controllers | None = None

    @property
    def key(self) -> tuple[int, int]:
        """Seed and number of the run."""
        return self.scenario.seed, self.scenario.run if self.number is None else self.number

    def simulated(self) -> Run:
        """Simulate it with all samples."""
        scenario = self.scenario.model_copy(update={"run": self.key[1]})
        estimator = None if self.estimator is None else copied(self.estimator)
        return simulate_run(
            self.machine, scenario, estimator=estimator, magnet=self.magnet,
            external_inputs=self.external_inputs, controllers=self.controllers,
        )  # fmt: skip


def copied(estimator: Estimator) -> Estimator:
    """Return an estimator with a state of its own."""
    result: Estimator = pickle.loads(pickle.dumps(estimator))
    return result


Counts = NDArray[np.int64]

LEAST = 50  #: Minimum number of samples after a step or a disturbance for its evaluation.
MOST_PLANS = 4096  #: Maximum number of cached plans.


class Windows(NamedTuple):
    """Windows of the figures of an axis, as sample numbers of ``amb_windows``."""

    first: int  #: First evaluated sample.
    step_from: int  #: Last step of the reference ...
    step_to: int  #: ... and the next change; equal if there is none.
    height: float  #: Of that step [m].
    load_from: int  #: Last change of a disturbance; the number of samples if there is none.


def windows(r: Array, f_d: Array, first: int) -> list[Windows]:
    """Return the windows of step responses and recovery, axis by axis."""
    # r (n, p) [m]; f_d (n, p) [N]
    n = len(r)
    steps, loads = (np.flatnonzero((of[1:] != of[:-1]).any(axis=1)) + 1 for of in (r, f_d))
    load = n
    if loads.size and n - loads[-1] >= LEAST and not (steps.size and steps[-1] > loads[-1]):
        load = int(loads[-1])
    result = []
    for own in r.T:
        at = Windows(first, 0, 0, 1.0, load)
        changes = np.flatnonzero(own[1:] != own[:-1]) + 1
        if changes.size:
            start = int(changes[-1])
            later, others = loads[loads > start], steps[steps > start]
            stop = min(int(of[0]) if of.size else n for of in (later, others))
            # No step response can be evaluated with a disturbance that never settles.
            if later.size <= 1 and stop - start >= LEAST:
                at = Windows(first, start, stop, float(own[start] - own[start - 1]), load)
        result.append(at)
    return result


class PreparedRun(NamedTuple):
    """Prepared runs."""

    numbers: NDArray[np.uint64]  #: (runs,) Number of each run.
    by_core: dict[ModuleType, dict[Any, list[int]]]
    """Indices of the runs of each plan, by core."""
    own: list[Loop]  #: Loops with classes of the user, whose errors are reported on request.


class Plans:
    """Preparation and simulation of runs; see `simulate_many` for the arguments."""

    def __init__(
        self, settling: float, band: float, threads: int, instructions: str | None
    ) -> None:
        if threads < 1:
            raise ValueError(f"threads must be 1 or more, got {threads}")
        self.settling, self.band = settling, band
        self.threads, self.instructions = threads, instructions
        # By the identity of a run's objects, which are retained so that no other has the same.
        self._plans: dict[tuple[int, ...], tuple[Planned, ModuleType, Any]] = {}
        self._signals: dict[tuple[Any, ...], tuple[Any, Array]] = {}
        self._rows: dict[int, tuple[Estimator, Any]] = {}
        self._last: tuple[Any, tuple[Array, Array], list[Windows]] | None = None

    def ready(self, runs: Sequence[Planned]) -> PreparedRun:
        """Return runs in the form of the core."""
        for kept in (self._plans, self._signals, self._rows):
            if len(kept) > MOST_PLANS:
                kept.clear()
        result = PreparedRun(np.array([planned.key[1] for planned in runs], np.uint64), {}, [])
        for place, planned in enumerate(runs):
            core, plan = self._plan(planned, result.own)
            result.by_core.setdefault(core, {}).setdefault(plan, []).append(place)
        return result

    def simulate(self, ready: PreparedRun) -> tuple[Array, Counts]:
        """Return figures (runs, figures) and counts of flags (runs, flags)."""
        numbers = ready.numbers
        figures = np.empty((len(numbers), len(FIGURES)))
        counts = np.empty((len(numbers), len(FLAGS)), np.int64)
        for core, plans in ready.by_core.items():
            places = np.concatenate([np.array(plan) for plan in plans.values()])
            which = np.repeat(np.arange(len(plans)), [len(plan) for plan in plans.values()])
            order = np.argsort(places)
            places, which = places[order], np.ascontiguousarray(which[order], np.int64)
            figures[places], counts[places] = core.fly(
                list(plans), which, numbers[places], instructions=self.instructions,
                threads=self.threads,
            )  # fmt: skip
        for loop in ready.own:
            loop.check()
        return figures, counts

    def _plan(self, planned: Planned, own: list[Loop]) -> tuple[ModuleType, Any]:
        made_of = (
            planned.machine, planned.scenario, planned.estimator, planned.magnet,
            planned.external_inputs, planned.controllers,
        )  # fmt: skip
        known = tuple(map(id, made_of))
        result = self._plans.get(known)
        if result is None:
            loop = self._loop(planned)
            plan, general = self._made(loop, planned)
            if loop.calls_python:
                own.append(loop)
            result = planned, loop.core, plan
            if general:
                self._plans[known] = result
        return result[1:]

    def _loop(self, planned: Planned) -> Loop:
        """Return the loop of a run; an estimator with a changing state is copied."""
        estimator, speed = planned.estimator, planned.scenario.speed
        if estimator is not None:
            stands = speed is None and estimator.view.speed in (None, planned.machine.speed)
            stands = stands and estimator.machine.angle is None
            if not (stands and estimator.side_by_side):
                estimator = copied(estimator)
        return Loop(
            planned.machine, planned.scenario, estimator=estimator, magnet=planned.magnet,
            external_inputs=planned.external_inputs, sampled=self._sampled(planned),
            controllers=planned.controllers,
        )  # fmt: skip

    def _sampled(self, planned: Planned) -> Sampled:
        """Return the signals of a scenario, shared by many runs."""
        of, machine, T = planned.scenario, planned.machine, planned.machine.sampling_time
        names = tuple(machine.axis_names)

        def known(values: Any, make: Callable[[], Array]) -> Array:
            key = id(values), of.duration, T, names
            if key not in self._signals:
                self._signals[key] = values, make()
            return self._signals[key][1]

        t = known(None, lambda: T * np.arange(samples(machine, of), dtype=float))
        return Sampled(
            t, *(known(getattr(of, what), partial(along, of, what, names, t)) for what in AXES)
        )

    def _windows(self, loop: Loop) -> Array:
        """Return the windows of the figures, (p, 7) by the fields of ``amb_windows``."""
        machine, (r, f_d) = loop.machine, loop.series
        first = first_of(self.settling, machine.sampling_time, len(r))
        key = id(r), id(f_d), first  # shared while unmodified
        if self._last is None or self._last[0] != key:
            self._last = key, (r, f_d), windows(r, f_d, first)
        clearances = [axis.bearing.clearance for axis in machine.axes]
        pairs = zip(self._last[2], clearances, strict=True)
        return np.array([(*at, self.band * clearance, clearance) for at, clearance in pairs])

    def _along(self, estimator: Estimator) -> Any:
        """Return displacements, velocities and disturbances of the axes, by estimator states."""
        if id(estimator) not in self._rows:
            *motion, loads = estimator.view.rows_along(estimator.states)
            parts = [*motion, loads] if loads.any(axis=1).all() else motion
            rows = [compressed_rows(part, part != 0) for part in parts]
            of_core = estimator.engine.core.Along(rows, *loads.shape)
            self._rows[id(estimator)] = estimator, of_core
        return self._rows[id(estimator)][1]

    def _made(self, loop: Loop, planned: Planned) -> tuple[Any, bool]:
        """Return the plan of a run, and whether it serves all numbers."""
        estimator, machine, stds = loop.estimator, loop.machine, loop.white_noise
        if estimator is not None and loop.calls_python:
            estimator.reset(loop.start)
        series: Any = (None, None)
        own = stds is None or machine.angle is not None  # of each run: noise drawn in Python
        if own:
            loop.scenario = loop.scenario.model_copy(update={"run": planned.key[1]})
        if stds is None:
            series = loop.noise
        arguments = loop.arguments(slice(0, len(loop.series[0])))
        std_u, std_y = stds or ([0.0] * len(machine.axes), [0.0] * len(machine.readings))
        plan = loop.core.Plan(
            **arguments,
            mean=None if estimator is None else loop.start,
            std=None if estimator is None else estimator.default_std(),
            along=None if estimator is None else self._along(estimator),
            seed=planned.key[0], std_u=std_u, std_y=std_y, noise_u=series[0], noise_y=series[1],
            windows=self._windows(loop),
        )  # fmt: skip
        general = not own and arguments.get("model") is None and not loop.calls_python
        return plan, general
