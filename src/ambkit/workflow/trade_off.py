"""The error cost of a lower sensitivity peak: filters tuned with different limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.quantity_arguments import of_type
from ambkit.base.units import engineering
from ambkit.control.pid import PID
from ambkit.data.record import Record
from ambkit.estimate import DEFAULT
from ambkit.judge.loop.loop_builder import ZONE_A, InfeasibleError, zone_of
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Points, Rule
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.workflow.tune import BUDGET, RUNS, Tuned, tune
from ambkit.workflow.tuning_tasks import SimulationObjective

#: Signals whose errors are plotted over the peak, and their units.
SIGNALS = {"x": "m", "f_d": "N"}


@dataclass(frozen=True)
class TradeOffPoint:
    """A filter tuned with a limit on the sensitivity peak."""

    ceiling: float  #: Limit of the peak of abs(S) [1].
    tuned: Tuned | None  #: The filter; None if none kept the limit.
    peak: float  #: Its peak of abs(S) [1].
    #: Root mean square errors of ``x`` [m] and ``f_d`` [N] in simulated runs.
    errors: dict[str, float]

    @property
    def zone(self) -> str:
        """Zone of ISO 14839-3."""
        return "–" if self.tuned is None else zone_of(self.peak)


AXES = {
    "f_d": Axis("error of the disturbance force, rms", "N"),
    "x": Axis("error of the position, rms", "µm", 1e6),
}
"""Of the picture, by signal."""

POINTS = ("points",)  #: Section of a trade-off.


@dataclass(frozen=True, eq=False, repr=False)
class TradeOff(Result):
    """Filters of one kind, tuned with different limits of the peak."""

    machine: Machine  #: The machine.
    kind: str  #: Kind of filter.
    points: tuple[TradeOffPoint, ...]  #: Filters by their limits.

    TITLE = "{0.kind} for {0.machine.name}, tuned in simulated runs"

    @property
    def finding(self) -> str:
        parts = ", ".join(
            f"{engineering(one.errors['f_d'], 'N', 3)} below {one.ceiling:g}"
            if one.tuned is not None else f"none below {one.ceiling:g}"
            for one in self.points
        )  # fmt: skip
        return f"{self.kind} for {self.machine.name}, error of f_d by the peak of |S|: {parts}."

    @property
    def rows(self) -> list[Row]:
        results = []
        for one in self.points:
            reached = one.tuned is not None
            errors = [
                Row(f"error_{name}", f"error of {name}", one.errors.get(name), unit, 3)
                for name, unit in SIGNALS.items()
            ]
            results += put([
                Row("ceiling", "limit", one.ceiling, digits=3, detail=True),
                Row("reached", "reached", reached),
                Row("peak", "peak of |S|", one.peak if reached else None, "|S|"),
                Row("zone", "zone", one.zone),
                *errors,
                Row("tuned_kept", "tuned", one.tuned is not None and one.tuned.kept, detail=True),
            ], section=POINTS, of=f"below {one.ceiling:g}")  # fmt: skip
        return results

    SECTIONS = {POINTS: Section("{0.title}", across=True)}

    @property
    def series(self) -> dict[str, Any]:
        values = {
            f"below {one.ceiling:g}": {"values": dict(one.tuned.values)}
            for one in self.points if one.tuned is not None
        }  # fmt: skip
        return {"machine": self.machine.name, "kind": self.kind, "points": values}

    def figures(self) -> list[Figure]:
        reached = [point for point in self.points if point.tuned is not None]
        size, panels = np.array([item.peak for item in reached], float), []
        for name, axis in AXES.items():
            error = np.array([item.errors[name] for item in reached], float)
            items: list[Item] = [
                Line(size, error, signal="estimate", label=""),
                Points(size, error, signal="estimate", label="tuned, by limit"),
            ]
            if size.max(initial=0.0) > ZONE_A:
                items.append(Rule(ZONE_A, axis="x", signal="limit", label="end of zone A"))
            panels.append(Panel(Axis("peak of |S|"), axis, items))
        title = f"{markdown(self.machine.name)}, {self.kind} filter: error against margin"
        caption = (
            "Each point is a filter, tuned with the peak of abs(S) in the loop kept below "
            "a limit, in simulated validation runs."
        )
        return [Figure("trade-off", title, caption, panels, columns=2)]


def trade_off(
    machine: Machine,
    peak_limits: Sequence[float],
    records: Record | Sequence[Record] = (),
    kind: str = DEFAULT,
    *,
    controller: PID | None = None,
    magnet: MagnetModel | None = None,
    seeds: range = range(RUNS),
    budget: int = BUDGET,
    done: Callable[[], None] = lambda: None,
) -> TradeOff:
    """Tune a filter for each of several limits of the peak of abs(S)."""
    of_type(Machine, machine=machine)
    if not peak_limits:
        raise AmbkitError("peaks must be one value or more")
    judge = SimulationObjective(machine, seeds)
    points, refused = list[TradeOffPoint](), None
    for peak_limit in sorted(peak_limits):
        try:
            result = tune(
                machine, records, kind, max_sensitivity=peak_limit, controller=controller,
                magnet=magnet, seeds=seeds, budget=budget, done=done,
            )  # fmt: skip
        except InfeasibleError as error:
            refused = error
            points.append(TradeOffPoint(peak_limit, None, float("nan"), {}))
            continue
        figures = judge.figures(lambda of=result: of.estimator)  # type: ignore[misc]
        errors = {name: figures[f"error of {name}"] for name in SIGNALS}
        points.append(TradeOffPoint(peak_limit, result, result.peak, errors))
    if refused is not None and all(point.tuned is None for point in points):
        raise refused
    return TradeOff(machine, kind, tuple(points))
