"""Loops of a machine, assessed beside each other: figures and pictures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ambkit.base.showing import Shown
from ambkit.data.signals import by_name
from ambkit.judge.loop.loop_of import ZONES, LoopOf, ideal_pieces
from ambkit.machine.machine import Machine, short_form
from ambkit.simulation.linear.pieces import WorkPoint
from ambkit.simulation.scenario import PID
from ambkit.workflow.assessed_loop import AssessedLoop
from ambkit.workflow.balance import Grade, of_grades, unbalance_forces
from ambkit.workflow.separation import Separation, separations

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.result.report.figure import Figure

BASIS = (
    "Zones after ISO 14839-3, of a linear model: an aid, not a certificate, which asks for a "
    "measurement on the machine."
)


@dataclass(frozen=True, eq=False)
class Assessment(Shown):
    """Loops of a machine and its controllers, assessed."""

    of: LoopOf  #: Plant, controllers and work point.
    estimators: dict[str, Estimator]  #: Those in the loops.
    #: Peaks of S and T, by their largest singular values, that no controller can be below with this
    #: plant.
    least: tuple[float, float]
    loops: dict[str, AssessedLoop]  #: By what the controllers are fed, the measurement first.

    @property
    def bearing(self) -> Any:
        """The plant, of a single axis in its short form."""
        return short_form(self.of.machine)

    @property
    def machine(self) -> Machine:
        """The plant."""
        return self.of.machine

    @property
    def controllers(self) -> dict[str, PID]:
        """Gains, with settings that were omitted tuned: by axis, or coordinate of the rotor."""
        # As they are fed in the last of the loops.
        return self.of.pids(self.estimators.get(list(self.loops)[-1]))

    @property
    def controller(self) -> PID:
        """Those of the first axis or coordinate."""
        return next(iter(self.controllers.values()))

    @property
    def point(self) -> WorkPoint:
        """Control current [A] and displacement [m] where it is linearised; of several (p,)."""
        point = self.of.point
        if len(self.of.axes) > 1:
            return point
        return point._replace(iu=float(point.iu[0]), x=float(point.x[0]))

    @property
    def top(self) -> float:
        """End of the range that the zones are taken from [Hz]."""
        return self.of.top

    def __repr__(self) -> str:
        said = ", ".join(
            f"{name}: zone {each.verdict}, peak {each.peak:.3g} at {each.peak_frequency:.4g} Hz"
            if each.stable
            else f"{name}: unstable"
            for name, each in self.loops.items()
        )
        return f"<Assessment of {self.bearing.name}: {said}>"

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain data, in SI."""
        found: dict[str, Any] = {
            "basis": BASIS,
            "range": self.top,
            "half_the_sampling_rate": 0.5 / self.machine.sampling_time,
            "least_peak": self.least[0],
            "least_complementary_peak": self.least[1],
            "loops": {name: each.to_dict() for name, each in self.loops.items()},
            "plain_control": self.plain(),
        }
        names = [axis.name for axis in self.machine.axes]
        pids = {name: pid.model_dump(mode="json") for name, pid in self.controllers.items()}
        return found | {
            "machine": self.machine.name,
            "speed": self.machine.speed,
            "control": self.of.control_for(self.estimators.get(list(self.loops)[-1])).model_dump(
                mode="json"
            ),
            "controllers": pids,
            "controller": next(iter(pids.values()), None),
            "control_current": by_name(names, self.of.point.iu.tolist()),
            "displacement": by_name(names, self.of.point.x.tolist()),
            "balance_grades": [each._asdict() for each in self.grades()],
            "critical_speeds": [each.to_dict() for each in self.separations],
        }

    @cached_property
    def separations(self) -> list[Separation]:
        """How far the machine's speed is from each critical speed; none where it does not turn."""
        machine = self.machine
        if not machine.turns:
            return []
        own = [self.controllers.get(name) for name in self.of.axes]
        known = [each for each in own if each is not None]
        return separations(machine, pids=known if len(known) == len(own) else None)

    def plain(self) -> list[str]:
        """Return a sentence where unbalance control is plain control at the machine's speed."""
        each = {self.of.plain(estimator) for estimator in self.estimators.values()}
        return sorted(one for one in each if one is not None)

    def grades(self, filter: str | None = None) -> list[Grade]:
        """Return what unbalance of each balance quality grade would do at the machine's speed."""
        loop = list(self.loops.values())[-1] if filter is None else self.loops[filter]
        machine = self.machine
        if not machine.turns or not loop.stable:
            return []
        return of_grades(loop.loop, machine, loop.of.point)

    def shares(self, filter: str | None = None) -> dict[str, float]:
        """Return the peak of abs(S) as it is, and with each piece of the loop ideal in turn [1]."""
        # The worst axis within the standard's range; controllers, filter and work point stay as
        # they are, so that what is told is the piece's own. Infinite where the loop is unstable
        # then.
        name = list(self.loops)[-1] if filter is None else filter
        estimator = self.estimators.get(name)
        found = {"as it is": self.loops[name].peak if self.loops[name].stable else math.inf}
        there = self.loops[name].of
        for piece, plant in ideal_pieces(self.machine).items():
            found[piece] = there.with_plant(plant, estimator).peak(estimator)
        if estimator is not None and not there.needs_estimate:
            found["filter"] = there.peak()
        return found

    def figure(self, filter: str | None = None) -> Figure:
        """Return Bode of S with the zones, Nyquist, compliance and noise as a picture."""
        # Of one axis with all loops that are stable; of several with all axes of one loop,
        # singular values, and the determinant of the return difference. Of a loop that is unstable
        # Nyquist, loop gain and poles of just this loop.
        from ambkit.show.plots.assessment import Curves, assessment_figure, unstable_figure

        name = list(self.loops)[-1] if filter is None else filter
        if not self.loops[name].stable:
            return unstable_figure(
                f"{self.bearing.name}: unstable loop, controller fed by {name}",
                self.loops[name].loop, self.of.axes, self.loops[name].unstable_poles,
            )  # fmt: skip
        title = f"{self.bearing.name}: sensitivity with the filter in the loop"
        stable = {each: one.loop for each, one in self.loops.items() if one.stable}
        whole, feeding = None, None
        if len(self.of.axes) == 1:
            curves = [Curves(each, loop) for each, loop in stable.items()]
        else:
            whole, feeding = stable[name], self.estimators.get(name)
            curves = [
                Curves(" and ".join(same), whole, self.of.axes.index(same[0]))
                for same in self.alike(name)
            ]
            title = f"{self.bearing.name}: sensitivity of each axis, controllers fed by {name}"
        return assessment_figure(
            title, curves, zones=ZONES, top=self.top, static=self.of.static_compliance(feeding),
            gain=self.of.alone[0].amplifier.gain, whole=whole,
            left_out=[each for each, one in self.loops.items() if not one.stable],
        )  # fmt: skip

    def alike(self, filter: str) -> list[list[str]]:
        """Return the names of a loop's axes, those together whose curves are the same."""
        found: list[list[str]] = []
        axes = self.loops[filter].axes
        for name, each in axes.items():
            for same in found:
                other = axes[same[0]]
                if math.isclose(each.peak, other.peak, rel_tol=1e-6) and math.isclose(
                    each.margins.crossover, other.margins.crossover, rel_tol=1e-6
                ):
                    same.append(name)
                    break
            else:
                found.append([name])
        return found

    def capacity_figure(self, filter: str | None = None) -> Figure:
        """Return the load that each loop, or each of several axes, bears over the frequency."""
        from ambkit.show.plots.capacity import capacity_figure

        demands: dict[str, tuple[float, float]] = {}
        if len(self.of.axes) == 1:
            each = {name: loop.demands for name, loop in self.loops.items()}
        else:
            name = list(self.loops)[-1] if filter is None else filter
            axes = self.loops[name].axes
            each = {" and ".join(same): axes[same[0]].demands for same in self.alike(name)}
            forces = dict(zip(self.of.axes, unbalance_forces(self.machine), strict=True))
            f = abs(self.machine.speed) / (2 * math.pi)
            demands = {
                " and ".join(same): (f, float(forces[same[0]]))
                for same in self.alike(name) if forces[same[0]] > 0
            }  # fmt: skip
        return capacity_figure(
            f"{self.bearing.name}: the load that the loop bears",
            {name: asked.capacity for name, asked in each.items() if asked},
            demands,
        )
