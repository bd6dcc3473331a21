"""Assessed loops of a machine: figures and plots."""

import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from ambkit.assessment import rows as rows
from ambkit.assessment.loop import AssessedLoop
from ambkit.base import units
from ambkit.base.arrays import grouped
from ambkit.base.units import engineering
from ambkit.control.linear.linear_plant import OperatingPoint
from ambkit.control.pid import PID
from ambkit.data.signals import by_name
from ambkit.estimate.estimator import Estimator
from ambkit.judge.loop.loop_builder import ZONES, LoopBuilder, ideal_pieces
from ambkit.judge.modal_reduction import reduction
from ambkit.machine.machine import Machine
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.rotordynamics.separation_margins import BASIS as BASIS_OF_MARGINS
from ambkit.rotordynamics.separation_margins import Separations, separations
from ambkit.rotordynamics.unbalance_response import Grade, grade_of, of_grades, unbalance_forces

BASIS = (
    "Zones after ISO 14839-3 are those of a linear model; certification requires a measurement on "
    "the machine."
)

LQG, HINF = "LQG", "H-infinity"  #: Names of the loops with optimal controllers.

CRITICAL, GRADES, PIECES = ("critical_speeds",), ("balance_grades",), ("pieces",)
"""Sections of an assessment, besides its loops."""


def _axes(loop: str) -> tuple[str, ...]:
    return ("loops", loop, "axes")


def _poles(loop: str) -> tuple[str, ...]:
    return ("loops", loop, "unstable_poles")


def _poles_and_orbit(loop: AssessedLoop) -> dict[str, Any]:
    orbit = loop.of.point.orbit
    poles = [[float(pole.real), float(pole.imag)] for pole in loop.loop.closed.poles()]
    return {"poles": poles} | ({} if orbit is None else {"orbit": np.abs(orbit.x).tolist()})


@dataclass(frozen=True, eq=False, repr=False)
class Assessment(Result):
    """Assessment of a machine's loops."""

    signed = True

    of: LoopBuilder  #: Plant, controllers and operating point.
    estimators: dict[str, Estimator]  #: Estimators in the loops.
    #: Least peaks of S and T, by largest singular values, of any controller with this plant.
    least: tuple[float, float]
    #: Loops by the feedback of the controllers, the measurement first.
    loops: dict[str, AssessedLoop]

    @property
    def machine(self) -> Machine:
        """The plant."""
        return self.of.machine

    @property
    def controllers(self) -> dict[str, PID]:
        """Gains, with omitted settings tuned: by axis, or coordinate of the rotor."""
        # As in the last of the loops.
        return self.of.pids(self.estimators.get(list(self.loops)[-1]))

    @property
    def controller(self) -> PID:
        """That of the first axis or coordinate."""
        return next(iter(self.controllers.values()))

    @property
    def point(self) -> OperatingPoint:
        """Control current [A] and displacement [m] of the linearisation; with several axes (p,)."""
        point = self.of.point
        if len(self.of.axes) > 1:
            return point
        return point._replace(iu=float(point.iu[0]), x=float(point.x[0]))

    @property
    def top(self) -> float:
        """Upper end of the zones' range [Hz]."""
        return self.of.top

    @property
    def last(self) -> str:
        """Feedback of the controllers in the last of the loops."""
        return list(self.loops)[-1]

    TITLE = "Verdict on the loop of {0.machine.name}"

    @property
    def finding(self) -> str:
        *others, judged = (
            f"fed by {name}: zone {one.verdict}{one.cause}, peak of |S| {one.peak:.3f} at "
            f"{engineering(one.peak_frequency, 'Hz', 4)}" if one.stable else
            f"fed by {name}: unstable"
            for name, one in self.loops.items()
        )  # fmt: skip
        missed = [
            row.name.strip() for row in self.rows
            if row.kept is False and (row.of == self.last or row.section == CRITICAL)
        ]  # fmt: skip
        limit_text = f"not kept: {', '.join(missed)}" if missed else "all limits kept"
        compared = f" For comparison, {'; '.join(others)}." if others else ""
        return f"{self.machine.name}, controller {judged}; {limit_text}.{compared}"

    @cached_property
    def rows(self) -> list[Row]:
        results = []
        for name, loop in self.loops.items():
            results += put(rows.of_loop(loop), section=("loops",), of=name)
        for name, loop in self.loops.items():
            axes = loop.axes if len(loop.axes) > 1 else {}
            for item, axis in axes.items():
                results += put(
                    rows.of_axis(axis, loop.of), section=_axes(name), of=item, detail=True
                )
            results += put(rows.of_unstable_poles(loop.unstable_poles), section=_poles(name))
        for apart in self.separations:
            results += apart.rows()
        for grade in self.grades():
            results += put(rows.of_grade(grade), section=GRADES)
        for name in self.loops:
            if name not in (LQG, HINF):
                shares, where = self.shares(name), {"section": PIECES, "of": name}
                results += put([
                    Row(piece, rows.PIECES[piece], peak, "|S|", detail=True)
                    for piece, peak in shares.items() if len(shares) > 1
                ], **where)  # fmt: skip
        return results

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        machine, speed_text = self.machine, units.rpm(self.machine.speed, 6)
        several = len(self.of.axes) > 1
        at = f"{speed_text}, worst axis" if several else rows.held_at(self.of)
        all_sections: dict[tuple[str, ...], Section] = {
            ("loops",): Section(f"{machine.name} at {at}, controllers fed by"),
            CRITICAL: Section(
                f"Separation of {speed_text} from critical speeds ({BASIS_OF_MARGINS})", across=True
            ),
            GRADES: Section(
                f"Unbalance of grades of ISO 21940-11 at {speed_text}, worst-case phase",
                across=True,
            ),
            PIECES: Section("Peak of |S| with one part ideal, controllers fed by"),
        }  # fmt: skip
        for name in self.loops:
            all_sections[_axes(name)] = Section(
                f"Each axis with all other loops closed, controllers fed by {name}"
            )
            all_sections[_poles(name)] = Section(
                f"Unstable poles of the closed loop, controllers fed by {name}", across=True
            )
        return all_sections

    @property
    def facts(self) -> dict[str, str]:
        return rows.facts_of(self.loops[self.last], self.of, self.estimators.get(self.last))

    @property
    def notes(self) -> list[str]:
        notes, several = [], len(self.of.axes) > 1
        S, T = ("the largest singular value of S", "that of T") if several else (
            "the peak of |S|", "that of |T|"
        )  # fmt: skip
        if self.least[0] > 1:
            notes.append(
                f"With the unstable pole{'s' if several else ''} and the dead time no linear "
                f"controller brings {S} below {self.least[0]:.3f} or {T} below {self.least[1]:.3f}."
            )
        if any(one.demands.heating is None for o in self.loops.values() for one in o.axes.values()):
            lacking = {
                "the amplifier's resistance": any(
                    b.amplifier.resistance is None for b in self.of.isolated
                ),
                "[coil] with thermal_resistance and temperature_limit": any(
                    b.coil is None for b in self.of.isolated
                ),
            }
            needed = ", and ".join(what for what, is_lacking in lacking.items() if is_lacking)
            notes.append(f"Coil temperatures are not known: they need {needed}.")
        wrong = [name for name, loop in self.loops.items() if not loop.integral.holds]
        if wrong:
            notes.append(
                f"Bode's integral does not hold, as if the loop were unstable: {', '.join(wrong)}."
            )
        fed: list[Any] = [None] * ("measurement" in self.loops) + list(self.estimators.values())[:1]
        notes += [fromkey for fromkey in dict.fromkeys(map(self.of.choice, fed)) if fromkey]
        compared = None if self.machine.bending is None else reduction(self.machine)
        if compared is not None and not compared.good:
            notes.append(f"{compared.text()}.")
        if self.machine.turns and not self.separations:
            notes.append(f"{self.separations.sentence().capitalize()}.")
        own = grade_of(self.machine)
        if own is not None:
            notes.append(f"The unbalance is of balance quality grade G {1e3 * own:.3g}.")
        return [*notes, *self.plain(), BASIS]

    @property
    def series(self) -> dict[str, Any]:
        estimator = self.estimators.get(self.last)
        pids = {name: pid.model_dump(mode="json") for name, pid in self.controllers.items()}
        names = self.machine.axis_names
        return {
            "basis": BASIS,
            "machine": self.machine.name,
            "speed": self.machine.speed,
            "range": self.top,
            "half_the_sampling_rate": 0.5 / self.machine.sampling_time,
            "least_peak": self.least[0],
            "least_complementary_peak": self.least[1],
            "plain_control": self.plain(),
            "control": self.of.control_for(estimator).model_dump(mode="json"),
            "controllers": pids,
            "controller": next(iter(pids.values()), None),
            "control_current": by_name(names, self.of.point.iu.tolist()),
            "displacement": by_name(names, self.of.point.x.tolist()),
            "loops": {name: _poles_and_orbit(one) for name, one in self.loops.items()},
        }

    def figures(self) -> list[Figure]:
        stable = self.loops[self.last].stable
        return [self.figure(), *([self.capacity_figure()] if stable else [])]

    @cached_property
    def separations(self) -> Separations:
        """Separation of the machine's speed from each critical speed; empty at standstill."""
        machine = self.machine
        if not machine.turns:
            return Separations(0.0)
        fed_by = next(reversed(self.estimators.values()), None)
        return separations(machine, loop=self.of, fed_by=fed_by)

    def plain(self) -> list[str]:
        """Return a sentence if unbalance control is off at the machine's speed."""
        parts = {self.of.plain(estimator) for estimator in self.estimators.values()}
        return sorted(one for one in parts if one is not None)

    def grades(self, filter: str | None = None) -> list[Grade]:
        """Return the response to the unbalance of each balance grade at the machine's speed."""
        loop = list(self.loops.values())[-1] if filter is None else self.loops[filter]
        machine = self.machine
        if not machine.turns or not loop.stable:
            return []
        return of_grades(loop.loop, machine, loop.of.point)

    def shares(self, filter: str | None = None) -> dict[str, float]:
        """Return the peak of abs(S), and with each element of the loop ideal in turn [1]."""
        # The worst axis within the standard's range; controllers, filter and operating point are
        # unchanged, so that the difference is due to the element. Infinite if the loop is unstable
        # then.
        name = list(self.loops)[-1] if filter is None else filter
        estimator = self.estimators.get(name)
        results = {"as it is": self.loops[name].peak if self.loops[name].stable else math.inf}
        there = self.loops[name].of
        for piece, plant in ideal_pieces(self.machine).items():
            results[piece] = there.with_plant(plant, estimator).peak(estimator)
        if estimator is not None and not there.control.needs_estimate:
            results["filter"] = there.peak()
        return results

    def figure(self, filter: str | None = None) -> Figure:
        """Return a figure with Bode plot of S and zones, Nyquist plot, compliance and noise."""
        # For one axis with all stable loops; for several with all axes of one loop, singular
        # values, and the determinant of the return difference. For an unstable loop Nyquist plot,
        # loop gain and poles of that loop.
        from ambkit.assessment.assessment_figure import Curves, assessment_figure, unstable_figure

        name = list(self.loops)[-1] if filter is None else filter
        if not self.loops[name].stable:
            return unstable_figure(
                f"{self.machine.name}: unstable loop, controller fed by {name}",
                self.loops[name].loop, self.of.axes, self.loops[name].unstable_poles,
            )  # fmt: skip
        title = f"{self.machine.name}: sensitivity with the filter in the loop"
        stable = {item: one.loop for item, one in self.loops.items() if one.stable}
        full_loop, feeding = None, None
        if len(self.of.axes) == 1:
            curves = [Curves(item, loop) for item, loop in stable.items()]
        else:
            full_loop, feeding = stable[name], self.estimators.get(name)
            curves = [
                Curves(" and ".join(same), full_loop, self.of.axes.index(same[0]))
                for same in self.alike(name)
            ]
            title = f"{self.machine.name}: sensitivity of each axis, controllers fed by {name}"
        return assessment_figure(
            title, curves, zones=ZONES, top=self.top, static=self.of.static_compliance(feeding),
            gain=self.of.isolated[0].amplifier.gain, full_loop=full_loop,
            left_out=[item for item, one in self.loops.items() if not one.stable],
        )  # fmt: skip

    def alike(self, filter: str) -> list[list[str]]:
        """Return the names of a loop's axes, grouped by equal curves."""
        axes = list(self.loops[filter].axes.values())

        def alike(k: int, other: int) -> bool:
            a, b = ((axes[at].peak, axes[at].margins.crossover) for at in (k, other))
            return all(map(partial(math.isclose, rel_tol=1e-6), a, b))

        return [[axes[k].name for k in same] for same in grouped(len(axes), alike)]

    def capacity_figure(self, filter: str | None = None) -> Figure:
        """Return the load capacity of each loop, or of each of several axes, over the frequency."""
        from ambkit.assessment.assessment_figure import capacity_figure

        demands: dict[str, tuple[float, float]] = {}
        if len(self.of.axes) == 1:
            parts = {name: loop.demands for name, loop in self.loops.items()}
        else:
            name = list(self.loops)[-1] if filter is None else filter
            axes = self.loops[name].axes
            parts = {" and ".join(same): axes[same[0]].demands for same in self.alike(name)}
            forces = dict(zip(self.of.axes, unbalance_forces(self.machine), strict=True))
            f = abs(self.machine.speed) / (2 * math.pi)
            demands = {
                " and ".join(same): (f, float(forces[same[0]]))
                for same in self.alike(name) if forces[same[0]] > 0
            }  # fmt: skip
        return capacity_figure(
            f"{self.machine.name}: load capacity",
            {name: demand.capacity for name, demand in parts.items() if demand},
            demands,
        )
