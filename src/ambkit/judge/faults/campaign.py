"""The fault campaign: every estimator through every fault, in the loop and beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.asked import of_type
from ambkit.base.errors import AmbkitError
from ambkit.base.progress import reporting
from ambkit.estimate.named import factories
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison.contenders import suited
from ambkit.judge.faults.declared import CLEAN, FAULTS
from ambkit.judge.faults.flight import Flight, Outcome
from ambkit.machine.machine import Machine
from ambkit.simulation.scenario import PID

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.judge.faults.declared import Channel
    from ambkit.machine.magnets import Precision
    from ambkit.simulation.run import Run

BASELINE = "measurement"
"""Stands for the loop without an estimator: the controller is fed by the measurement."""

MIXTURE = "mixture"
"""Stands for the faults that are drawn at random."""

SETTINGS = ("beside the loop", "in the loop")


@dataclass(frozen=True, repr=False)
class Torture:
    """What became of a campaign."""

    bearing: Machine  #: Whose.
    outcomes: tuple[Outcome, ...]  #: One a flight.

    def __repr__(self) -> str:
        failed = sum(not each.recovered for each in self.outcomes)
        lost = sum(each.levitation == "lost" for each in self.outcomes)
        return (
            f"<Torture of {self.bearing.name}: {len(self.estimators)} estimators, "
            f"{len(self.faults)} faults, {len(self.outcomes)} flights; {failed} did not recover, "
            f"in {lost} the rotor was lost>"
        )

    @property
    def estimators(self) -> list[str]:
        """Names of the estimators, without the baseline."""
        names = dict.fromkeys(each.estimator for each in self.outcomes)
        return [name for name in names if name != BASELINE]

    @property
    def faults(self) -> list[str]:
        """Names of the faults."""
        return list(dict.fromkeys(each.fault for each in self.outcomes))

    def select(self, **wanted: str) -> list[Outcome]:
        """Return the outcomes of which each named attribute is as given."""
        return [
            each
            for each in self.outcomes
            if all(getattr(each, name) == value for name, value in wanted.items())
        ]

    @property
    def failures(self) -> list[Outcome]:
        """Flights in which an estimator was not finite, stood still for ever or did not recover."""
        # In the loop only what is not finite counts, unless the rotor stayed up: an estimator that
        # went down with its rotor has nothing to come back to.
        return [
            each
            for each in self.outcomes
            if each.estimator != BASELINE
            and not each.recovered
            and (not each.finite or each.setting == "beside the loop" or each.levitation == "kept")
        ]

    def slowest(self, estimator: str) -> float:
        """Most samples that it took to recover beside the loop; infinity: it did not once."""
        beside = self.select(estimator=estimator, setting="beside the loop")
        took = [each.recovery if each.recovered else math.inf for each in beside]
        return max((each for each in took if not math.isnan(each)), default=math.nan)

    def to_dict(self) -> dict[str, Any]:
        """Return all outcomes as plain data, in SI; what is not finite stays so."""
        return {
            "bearing": self.bearing.name,
            "estimators": {
                name: {
                    "recovered": all(each.recovered for each in self._beside(name)),
                    "slowest_recovery": self.slowest(name),
                    "lost_in_loop": sorted(
                        {each.fault for each in self.select(estimator=name, setting="in the loop",
                                                            levitation="lost")}
                    ),
                }
                for name in self.estimators
            },
            "flights": [
                asdict(each) | {"recovered": each.recovered, "never": each.recovery == math.inf}
                for each in self.outcomes
            ],
        }  # fmt: skip

    def _beside(self, name: str) -> list[Outcome]:
        return self.select(estimator=name, setting="beside the loop")


def chosen_faults(names: Iterable[str] | None) -> list[str]:
    """Check names of faults; all of them where none is named."""
    found = list(FAULTS) if names is None else list(dict.fromkeys(names))
    for name in found:
        if name not in FAULTS:
            raise AmbkitError(f'there is no fault "{name}"; known: {", ".join(FAULTS)}')
    return found


def flights_of(estimators: int, faults: Iterable[str], seeds: int, *, steps: int) -> int:
    """Return how often `torture` calls `done`, for one precision."""
    there = [FAULTS[name].in_loop for name in faults]
    settings = [True, True, *([True, True] if steps else [])]  # clean, mixed
    in_loop, beside = sum(there) + sum(settings) // 2, len(there) + sum(settings) // 2
    return seeds * (estimators * (in_loop + beside) + in_loop)


def torture(
    bearing: Machine,
    estimators: Sequence[str] | Mapping[str, Callable[..., Estimator]] | None = None,
    *,
    reading: str | None = None,
    faults: Iterable[str] | None = None,
    seeds: Sequence[int] = (0,),
    steps: int = 50_000,
    precisions: Sequence[Precision] = ("float64",),
    controller: PID | None = None,
    threads: int = 2,
    done: Callable[[str], None] | None = None,
) -> Torture:
    """Fly each estimator through faults of sensor, control signal, amplifier and load.

    The rotor follows a slow sine under a load that is another. Each fault is flown in the loop,
    where the controller is fed by the estimate and levitation may be lost, and beside the loop,
    where the controller is fed by the true measurement and every estimator must come back. What it
    comes back to is its own clean flight: an error is back when it is within five times the 99 %
    quantile of that flight's, for position, velocity and disturbance force, and stays so.

    Parameters
    ----------
    bearing : Bearing or Machine
        The plant, and what the estimators know.
    estimators : sequence of str, or mapping of name to factory, optional
        Kinds of :data:`ambkit.estimate.registry.KINDS`, all of them by default; or what makes
        fresh ones, called with ``precision=...``.
    reading : str, optional
        Of several readings the one that the faults are of, by its name, and with it the axis that
        it shows most of; by default the first.
    faults : iterable of str, optional
        Some of ``ambkit.judge.faults.FAULTS``; by default all.
    seeds : sequence of int
        One campaign each, of noise and of what is drawn.
    steps : int
        Samples of a flight through random mixtures of faults; 0: none.
    precisions : sequence of {"float64", "float32"}
        Of the estimators.
    controller : PID, optional
        Its gains; by default those of :meth:`PID.for_bearing`.
    threads : int
        Flights side by side; the result does not depend on it.
    done : callable, optional
        Called after each flight with the name of its fault; a notebook shows a bar without it.

    Returns
    -------
    Torture
        What became of each flight.

    Raises
    ------
    AmbkitError
        A fault or kind is unknown, or a flight through mixtures has no room for one.
    """
    of_type(Machine, bearing=bearing)
    bearing = bearing.short
    at, named = _reading(bearing.long, reading), chosen_faults(faults)
    if not bearing.single and "lift-off" in named:  # its own start has lift-off
        named.remove("lift-off")
    kinds = suited(list(KINDS), bearing)
    built: Mapping[str, Callable[..., Estimator]] = (
        estimators
        if isinstance(estimators, Mapping)
        else factories(kinds if estimators is None else estimators, bearing)
    )

    works = [
        _Work(Flight(bearing, controller, in_loop, seed, precision, at), name, build)
        for precision in precisions
        for seed in seeds
        for in_loop in (False, True)
        for name, build in [*built.items(), *([(BASELINE, None)] if in_loop else [])]
    ]
    flights = len(precisions) * flights_of(len(built), named, len(seeds), steps=steps)
    pool = ThreadPoolExecutor(threads)
    with reporting(done, "flying", flights) as tell:

        def fly(work: _Work) -> list[Outcome]:
            return list(_campaign(work, named, steps, tell))

        try:
            outcomes = [each for found in pool.map(fly, works) for each in found]
        finally:
            pool.shutdown(cancel_futures=True)  # after Ctrl-C, what still waits is not flown first
    return Torture(bearing, tuple(outcomes))


def _reading(machine: Machine, name: str | None) -> int:
    """Return which reading has a name, the first without one."""
    names = [each.name for each in machine.readings]
    if name is not None and name not in names:
        raise AmbkitError(f"{machine.name} has no reading {name}; there are {', '.join(names)}")
    return 0 if name is None else names.index(name)


@dataclass(frozen=True)
class _Work:
    """Who is flown how; without `build`, the controller alone."""

    flight: Flight
    name: str
    build: Callable[..., Estimator] | None

    def run(self, channel: Channel) -> Run:
        made = None if self.build is None else self.build(precision=self.flight.precision)
        return self.flight.fly(channel, made)


def _campaign(
    work: _Work, named: Sequence[str], steps: int, done: Callable[[str], None]
) -> Iterator[Outcome]:
    """Fly one estimator through all faults, the clean flight first."""
    flight = work.flight
    channel, windows = flight.through(CLEAN)
    clean = work.run(channel)
    band = flight.band(clean)
    done(CLEAN.name)
    yield flight.evaluate(clean, windows, band, fault=CLEAN.name, estimator=work.name)
    for name in named:
        if flight.in_loop and not FAULTS[name].in_loop:
            continue
        channel, windows = flight.through(FAULTS[name])
        yield flight.evaluate(work.run(channel), windows, band, fault=name, estimator=work.name)
        done(name)
    if steps:
        channel, windows = flight.mixed(steps)
        if not windows:
            raise AmbkitError(f"{steps} steps have no room for a fault and its aftermath")
        yield flight.evaluate(work.run(channel), windows, band, fault=MIXTURE, estimator=work.name)
        done(MIXTURE)


def recovery_text(outcomes: Sequence[Outcome]) -> str:
    """Say in a word or a number of samples what became of the same flight over the seeds."""
    if not outcomes:
        return ""
    if any(not each.finite for each in outcomes):
        return "not finite"
    if any(each.levitation == "lost" for each in outcomes):
        return "lost"
    if any(each.held for each in outcomes):
        return "held"
    worst = float(np.max([each.recovery for each in outcomes]))
    if math.isnan(worst):
        return "lost"
    return "never" if math.isinf(worst) else f"{worst:.0f}"
