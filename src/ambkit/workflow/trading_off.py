"""What a smaller peak of the sensitivity costs: filters tuned under one ceiling after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ambkit.base.asked import of_type
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.showing import Shown
from ambkit.data.record import Record
from ambkit.judge.loop.loop_of import OutOfReachError, zone_of
from ambkit.machine.bearing import Bearing
from ambkit.machine.machine import Machine
from ambkit.simulation.controllers import Control
from ambkit.simulation.scenario import PID
from ambkit.workflow.tuned_filter import BUDGET, RUNS, Tuned, tune
from ambkit.workflow.tuning_tasks import ByTruth

if TYPE_CHECKING:
    from ambkit.machine.magnets import MagnetModel
    from ambkit.result.report.figure import Figure

SIGNALS = {"x": "m", "f_d": "N"}
"""Whose errors stand against the peak, and their units."""


@dataclass(frozen=True)
class Traded:
    """A filter that was tuned under a ceiling."""

    ceiling: float  #: What the peak of abs(S) had to stay below [1].
    tuned: Tuned | None  #: The filter; None where nothing that was tried stays below.
    peak: float  #: What the peak came to [1].
    #: Root mean square errors of ``x`` [m] and ``f_d`` [N] in simulated runs.
    errors: dict[str, float]

    @property
    def zone(self) -> str:
        """Zone of ISO 14839-3."""
        return "–" if self.tuned is None else zone_of(self.peak)


@dataclass(frozen=True, eq=False)
class TradeOff(Shown):
    """Filters of one kind, from much margin of the loop to little."""

    bearing: Bearing | Machine  #: What is filtered.
    kind: str  #: Of the filters.
    points: tuple[Traded, ...]  #: By their ceilings.

    def __repr__(self) -> str:
        said = ", ".join(
            f"below {each.ceiling:g}: {each.errors['f_d']:.3g} N"
            for each in self.points if each.tuned is not None
        )  # fmt: skip
        return f"<TradeOff of {self.kind} for {self.bearing.name}: {said}>"

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        return {
            "bearing": self.bearing.name,
            "kind": self.kind,
            "points": [
                {
                    "ceiling": each.ceiling,
                    "reached": each.tuned is not None,
                    "peak": each.peak,
                    "zone": each.zone,
                    "kept": each.tuned is not None and each.tuned.kept,
                    "values": {} if each.tuned is None else dict(each.tuned.values),
                    "errors": each.errors,
                }
                for each in self.points
            ],
        }

    def figure(self) -> Figure:
        """Return errors over the peak of abs(S) as a picture."""
        from ambkit.show.plots.tuning import trade_off_figure

        reached = [each for each in self.points if each.tuned is not None]
        return trade_off_figure(
            f"{markdown(self.bearing.name)}, {self.kind} filter: what margin costs",
            [each.peak for each in reached],
            {name: [each.errors[name] for each in reached] for name in SIGNALS},
        )


def trade_off(
    bearing: Bearing | Machine,
    ceilings: Sequence[float],
    records: Record | Sequence[Record] = (),
    kind: str = "extended",
    *,
    controller: PID | Control | None = None,
    magnet: MagnetModel | None = None,
    runs: int = RUNS,
    budget: int = BUDGET,
    seed: int = 0,
    done: Callable[[], None] = lambda: None,
) -> TradeOff:
    """Tune a filter under one ceiling on the peak of abs(S) after another.

    Where it is the likelihood of records that they are tuned by, they are still judged by their
    errors in simulated runs: a record does not tell the load.

    Parameters
    ----------
    bearing : Bearing or Machine
        What is filtered; a machine's errors are those along its axes.
    ceilings : sequence of float
        What the peak of abs(S) must stay below [1].
    records, kind, controller, magnet, runs, budget, seed, done : optional
        See `ambkit.tune`; `budget` is spent under each ceiling.

    Returns
    -------
    TradeOff
        With a table (`to_dict`) and a picture (`figure`), from which to pick.

    Raises
    ------
    AmbkitError
        There is no ceiling; or none of them can be kept.
    """
    of_type(Bearing, Machine, bearing=bearing)
    if not ceilings:
        raise AmbkitError("ceilings must be one value or more")
    judge = ByTruth(bearing, runs, seed)
    points, refused = list[Traded](), None
    for ceiling in sorted(ceilings):
        try:
            found = tune(
                bearing, records, kind, max_sensitivity=ceiling, controller=controller,
                magnet=magnet, runs=runs, budget=budget, seed=seed, done=done,
            )  # fmt: skip
        except OutOfReachError as error:
            refused = error
            points.append(Traded(ceiling, None, float("nan"), {}))
            continue
        figures = judge.figures(lambda of=found: of.estimator)  # type: ignore[misc]
        errors = {name: figures[f"error of {name}"] for name in SIGNALS}
        points.append(Traded(ceiling, found, found.peak, errors))
    if refused is not None and all(each.tuned is None for each in points):
        raise refused
    return TradeOff(bearing, kind, tuple(points))
