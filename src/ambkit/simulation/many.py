"""Many closed loops of the nonlinear plant in one call, for Monte Carlo and campaigns."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import name_of
from ambkit.control.controllers import Controllers
from ambkit.estimate.batch import processors
from ambkit.estimate.estimator import Estimator
from ambkit.machine.machine import Bearing, Machine
from ambkit.machine.magnets import MagnetModel, core_module
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import Loop, Run, Sampled, samples, simulate_run
from ambkit.simulation.run_figures import FIGURES, FLAGS, OF_SEVERAL, figures_of, first_of, flags_of
from ambkit.simulation.scenario import AXES, Scenario, along

Counts = NDArray[np.int64]

LEAST = 50
"""Samples that a step, or a load, must be followed by to be judged."""

CHUNK = 256
"""Runs that are planned and flown together: many times as many as there are lanes."""

MOST_PLANS = 4096
"""Of which so many are kept for runs that come later."""


@dataclass(frozen=True, slots=True)
class Planned:
    """One run of many: what is simulated, and with which noise.

    Attributes
    ----------
    bearing : Machine
        The plant.
    scenario : Scenario
        What happens to it, the controllers among it.
    estimator, magnet, external_inputs
        As for :func:`ambkit.simulation.run.simulate_run`. The estimator is not changed, and one may
        serve all runs: each begins afresh.
    number : int, optional
        Number of the run, which is with the scenario's seed the key of its noise, in place of
        ``scenario.run``.
    controllers : Controllers, optional
        Of several axes, where they are made already, as for another machine.
    """

    bearing: Machine
    scenario: Scenario
    estimator: Estimator | None = None
    magnet: MagnetModel | None = None
    external_inputs: ExternalInputs | None = None
    number: int | None = None
    controllers: Controllers | None = None

    @property
    def axis(self) -> Bearing:
        """The plant, which has one axis."""
        return self.bearing.isolated_axis("")

    @property
    def key(self) -> tuple[int, int]:
        """Seed and number of the run."""
        return self.scenario.seed, self.scenario.run if self.number is None else self.number

    @property
    def numbered(self) -> Scenario:
        """The scenario with the number of the run."""
        if self.number is None:
            return self.scenario
        return self.scenario.model_copy(update={"run": self.number})

    def simulated(self) -> Run:
        """Simulate it by itself, with every sample kept."""
        return self._flown(None if self.estimator is None else _copied(self.estimator))

    def _flown(self, estimator: Estimator | None) -> Run:
        """Simulate it with an estimator of the same kind."""
        return simulate_run(
            self.bearing, self.numbered, estimator=estimator, magnet=self.magnet,
            external_inputs=self.external_inputs, controllers=self.controllers,
        )  # fmt: skip


@dataclass(frozen=True)
class Many:
    """What many runs gave, in their order."""

    #: (runs,) By the names of :data:`FIGURES`, in SI; NaN where one does not apply.
    figures: Mapping[str, Array]
    #: (runs,) By the names of :class:`ambkit.Status` in lower case: samples at which it was said.
    status: Mapping[str, Counts]

    @classmethod
    def none(cls, figures: Iterable[str]) -> Many:
        """Return what no runs gave, by the names of their figures."""
        return cls(_columns(figures, (), float), _columns(FLAGS, (), np.int64))

    def __len__(self) -> int:
        return len(self.figures["touched"])

    def columns(self) -> dict[str, Array | Counts]:
        """Return all figures and, as ``samples_missing`` and so on, the counts of flags."""
        return {**self.figures, **{f"samples_{name}": n for name, n in self.status.items()}}


class Windows(NamedTuple):
    """Where the figures of a run are taken; sample numbers."""

    first: int
    """The first that errors count from."""
    step: tuple[int, int, float] | None
    """The last step of the reference: begin, end (the next change), height [m]."""
    load: int | None
    """The last change of the load."""


def windows(r: Array, f_d: Array, first: int) -> Windows:
    """Find where a step response and a recovery can be seen."""
    # r (n,) [m]; f_d (n,) [N]
    n = len(r)
    steps, loads = (np.flatnonzero(of[1:] != of[:-1]) + 1 for of in (r, f_d))
    step = load = None
    if steps.size:
        start = int(steps[-1])
        later = loads[loads > start]
        stop = int(later[0]) if later.size else n
        # A load that never rests leaves no step response to be seen.
        if later.size <= 1 and stop - start >= LEAST:
            step = start, stop, float(r[start] - r[start - 1])
    if loads.size and n - loads[-1] >= LEAST and not (steps.size and steps[-1] > loads[-1]):
        load = int(loads[-1])
    return Windows(first, step, load)


def simulate_many(
    runs: Iterable[Planned],
    *,
    settling: float = 0.0,
    band: float = 0.05,
    threads: int | None = None,
    instructions: str | None = None,
    done: Callable[[int], None] | None = None,
) -> Many:
    """Simulate many closed loops and judge each by the truth, without keeping its samples.

    The numbers are those of `simulate_run`, run by run and to the last bit, whatever the order, the
    threads, the lanes and what else is in the batch.

    Parameters
    ----------
    runs : iterable of Planned
        All of one axis, or all of several; else any mixture. Taken one after another, so that 10^6
        of them need not be there at once.
    settling : float
        Time at the start of each run that errors leave out [s]; the first sample always is.
    band : float
        Control error that a rotor has recovered within, as a share of its clearance.
    threads : int, optional
        Default: as many as the process may use.
    instructions : str, optional
        One of `ambkit.estimate.batch.instruction_sets`, of runs of one axis; default: the fastest.
    done : callable, optional
        Called now and then with the number of runs that were finished since the last call.

    Returns
    -------
    Many

    Raises
    ------
    ValueError
        A run has no sample after the settling, or some runs have one axis and others several.

    Examples
    --------
    >>> bearing = ambkit.Bearing.preset("zittau_axial")
    >>> scenario = ambkit.Scenario(duration=0.1, seed=1)
    >>> kalman = ambkit.KalmanFilter(bearing)
    >>> runs = [Planned(bearing, scenario, kalman, number=k) for k in range(20)]
    >>> simulate_many(runs).figures["f_d_rms"].shape
    (20,)
    """
    threads = processors() if threads is None else threads
    of_one, planned = _parted(runs)
    if of_one:
        figures, flags = _in_lanes(planned, _Engine(settling, band, threads, instructions), done)
    else:
        figures, flags = _in_threads(planned, settling, band, threads, done)
    known = FIGURES if of_one else OF_SEVERAL
    return Many(_columns(known, figures, float), _columns(FLAGS, flags, np.int64))


_Judged = tuple[Sequence[Array], Sequence[Counts]]
"""Tables of figures, and of counts of flags."""


def _parted(runs: Iterable[Planned]) -> tuple[bool, Iterator[Planned]]:
    """Return whether runs have one axis, and the runs; each is checked when it is taken."""
    parts = iter(runs)
    first = next(parts, None)
    if first is None:
        return True, parts
    of_one = first.bearing.single

    def alike() -> Iterator[Planned]:
        for run in chain([first], parts):
            if run.bearing.single != of_one:
                raise ValueError("runs must all have one axis, or all several")
            own = run.scenario.controller.custom or run.scenario.plant
            if of_one and own is not None:  # the lanes are C throughout
                raise AmbkitError(
                    f"{name_of(own)}: a class of yours runs one at a time: use simulate"
                )
            yield run

    return of_one, alike()


def _in_threads(
    runs: Iterator[Planned], settling: float, band: float, threads: int,
    done: Callable[[int], None] | None,
) -> _Judged:  # fmt: skip
    """Fly runs of several axes: while one is in C, another is got ready."""
    own = threading.local()  # an estimator has a state: each thread has its own

    def fly(planned: Planned) -> tuple[list[float], list[int]]:
        if not hasattr(own, "estimators"):
            own.estimators = {}
        estimator = planned.estimator
        if estimator is not None:
            known = own.estimators.get(id(estimator))
            estimator = known or own.estimators.setdefault(id(estimator), _copied(estimator))
        run = planned._flown(estimator)
        result = figures_of(run, planned.estimator, settling, band)
        return [result[name] for name in OF_SEVERAL], flags_of(run)

    rows, flags = list[Array](), list[Counts]()
    with ThreadPoolExecutor(threads) as pool:
        for row, flag_counts in pool.map(fly, runs):
            rows.append(np.array([row]))
            flags.append(np.array([flag_counts], np.int64))
            if done is not None:
                done(1)
    return rows, flags


def _copied(estimator: Estimator) -> Estimator:
    result: Estimator = pickle.loads(pickle.dumps(estimator))
    return result


def _in_lanes(
    runs: Iterator[Planned], engine: _Engine, done: Callable[[int], None] | None
) -> _Judged:
    """Fly runs of one axis, many at once in C."""
    parts: list[tuple[Array, Counts]] = []
    # While some are flown, the next ones are planned: C needs no interpreter.
    ahead: Future[tuple[Array, Counts]] | None = None
    last = 0
    with ThreadPoolExecutor(1) as pilot:

        def landed() -> None:
            if ahead is not None:
                parts.append(ahead.result())
                if done is not None:
                    done(last)

        while chunk := list(islice(runs, CHUNK)):
            ready = engine.ready(chunk)
            landed()
            ahead, last = pilot.submit(engine.flown, ready), len(chunk)
        landed()
    figures, flags = zip(*parts, strict=True) if parts else ((), ())
    return figures, flags


def _columns(names: Iterable[str], parts: Sequence[NDArray[Any]], kind: Any) -> dict[str, Any]:
    """Return each column of tables that stand one below the other."""
    return {
        name: np.concatenate([part[:, k] for part in parts]) if parts else np.empty(0, kind)
        for k, name in enumerate(names)
    }


class Ready(NamedTuple):
    """Runs that are planned."""

    numbers: NDArray[np.uint64]
    """Of each run (runs,)."""
    by_core: dict[ModuleType, dict[Any, list[int]]]
    """Places of the runs of each plan, by the core that flies it."""


class _Engine:
    """Plans what has not been planned yet, and flies it; see `simulate_many` for the arguments."""

    def __init__(
        self, settling: float, band: float, threads: int, instructions: str | None
    ) -> None:
        if threads < 1:
            raise ValueError(f"threads must be 1 or more, got {threads}")
        self.settling, self.band = settling, band
        self.threads, self.instructions = threads, instructions
        # By the identity of what a run is made of, which is kept, so that no other takes its place.
        self._plans: dict[tuple[int, ...], tuple[Planned, ModuleType, Any]] = {}
        self._signals: dict[tuple[Any, ...], tuple[Any, Array]] = {}
        self._last: tuple[Any, tuple[Array, Array], Windows] | None = None

    def ready(self, runs: Sequence[Planned]) -> Ready:
        """Return runs as cores want them."""
        if len(self._plans) > MOST_PLANS:
            self._plans.clear()
        by_core: dict[ModuleType, dict[Any, list[int]]] = {}
        for place, planned in enumerate(runs):
            core, plan = self._plan(planned)
            by_core.setdefault(core, {}).setdefault(plan, []).append(place)
        return Ready(np.array([planned.key[1] for planned in runs], np.uint64), by_core)

    def flown(self, ready: Ready) -> tuple[Array, Counts]:
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
        return figures, counts

    def _plan(self, planned: Planned) -> tuple[ModuleType, Any]:
        made_of = (
            planned.bearing, planned.scenario, planned.estimator, planned.magnet,
            planned.external_inputs,
        )  # fmt: skip
        known = tuple(map(id, made_of))
        result = self._plans.get(known)
        if result is None:
            core, plan, general = self._made(planned)
            if not general:
                return core, plan
            result = self._plans[known] = planned, core, plan
        return result[1:]

    def _sampled(self, planned: Planned) -> Sampled:
        """Return the signals of a scenario, each of which many runs share."""
        of, T = planned.scenario, planned.axis.sampling_time
        if len(self._signals) > MOST_PLANS:
            self._signals.clear()

        def known(signal: Any, make: Callable[[], Array]) -> Array:
            key = id(signal), of.duration, T
            if key not in self._signals:
                self._signals[key] = signal, make()
            return self._signals[key][1]

        t = known(None, lambda: T * np.arange(samples(planned.axis, of), dtype=float))
        return Sampled(
            t, *(known(getattr(of, what), partial(along, of, what, ("",), t)) for what in AXES)
        )

    def _windows(self, bearing: Bearing, r: Array, f_d: Array, sampled: Sampled) -> Windows:
        """Return where figures are taken; of signals that nothing was added to they are shared."""
        first = first_of(self.settling, bearing.sampling_time, len(r))
        if r is not sampled.reference or f_d is not sampled.disturbance:
            return windows(r.ravel(), f_d.ravel(), first)
        key = id(r), id(f_d), first
        if self._last is None or self._last[0] != key:
            self._last = key, (r, f_d), windows(r.ravel(), f_d.ravel(), first)
        return self._last[2]

    def _made(self, planned: Planned) -> tuple[ModuleType, Any, bool]:
        """Return a core, its plan of a run, and whether that serves all numbers."""
        sampled = self._sampled(planned)

        def of(scenario: Scenario) -> Loop:
            return Loop(
                planned.axis, scenario, estimator=planned.estimator, magnet=planned.magnet,
                external_inputs=planned.external_inputs, sampled=sampled,
            )  # fmt: skip

        loop = of(planned.scenario)
        estimator = loop.estimator
        if estimator is not None and not estimator.side_by_side:
            raise AmbkitError(
                f"{estimator.name}: it is in Python and has one state; runs side by side take kinds"
            )
        precision = "float64" if estimator is None else estimator.precision
        core = core_module(precision) if estimator is None else estimator.engine.core

        def given(values: ArrayLike) -> NDArray[Any]:
            return np.ascontiguousarray(np.ravel(values), dtype=precision)

        r, f_d = loop.series
        bearing = planned.axis
        at = self._windows(bearing, r, f_d, sampled)
        start, stop, height = at.step or (0, 0, 0.0)
        stds = loop.white_noise
        series: Any = (None, None) if stds is not None else of(planned.numbered).noise
        noise_u, noise_y = (None if item is None else item.ravel() for item in series)
        plan = core.Plan(
            **loop.arguments(core, given),
            mean=None if estimator is None else given(loop.start),
            std=None if estimator is None else given(estimator.default_std()),
            seed=planned.key[0], std_u=0.0 if stds is None else stds[0],
            std_y=0.0 if stds is None else stds[1], noise_u=noise_u, noise_y=noise_y,
            first=at.first, step_from=start, step_to=stop, height=height,
            load_from=len(r) if at.load is None else at.load,
            band=self.band * bearing.rotor.clearance,
        )  # fmt: skip
        return core, plan, stds is not None
