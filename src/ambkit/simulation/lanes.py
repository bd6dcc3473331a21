"""Runs of one axis, many at once in C."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module
from ambkit.simulation.planned import Planned
from ambkit.simulation.run import Loop, Sampled, samples
from ambkit.simulation.run_figures import FLAGS, figures_for, first_of
from ambkit.simulation.scenario import AXES, Scenario, along

Counts = NDArray[np.int64]

LEAST = 50
"""Samples that a step, or a load, must be followed by to be judged."""

MOST_PLANS = 4096  #: That are kept for runs that come later.


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


class Ready(NamedTuple):
    """Runs that are planned."""

    numbers: NDArray[np.uint64]
    """Of each run (runs,)."""
    by_core: dict[ModuleType, dict[Any, list[int]]]
    """Places of the runs of each plan, by the core that flies it."""


class Lanes:
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
        figures = np.empty((len(numbers), len(figures_for(None))))
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

    def _windows(self, bearing: Machine, r: Array, f_d: Array, sampled: Sampled) -> Windows:
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
