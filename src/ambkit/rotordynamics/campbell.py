"""Campbell diagram of a machine: its poles over the speed of rotation."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ambkit.base import units
from ambkit.base.escaping import markdown
from ambkit.base.quantity_arguments import QuantityLike
from ambkit.judge.modal_reduction import Reduction, reduction
from ambkit.judge.whirl_modes import WhirlModes, whirl_modes
from ambkit.machine.machine import Machine
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Rule
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.rotordynamics.separation_margins import Separations, separations


@dataclass(frozen=True, eq=False, repr=False)
class Campbell(WhirlModes, Result):
    """Poles of a levitated rotor over the speed of rotation."""

    TITLE = "Campbell diagram of {0.machine.name}"

    @property
    def finding(self) -> str:
        if self.machine.speed:  # the separation of the closed loop counts then
            return f"{self.machine.name}: {self._separations.sentence()}."
        damped, sharp = (
            ", ".join(units.rpm(one.speed) for one in self.criticals if one.damped is is_damped)
            for is_damped in (True, False)
        )
        beside = f" Critically damped: {damped} (amplification factor below 2.5)." if damped else ""
        speeds = f"{self.machine.name} up to {self._end}: {sharp or 'none'}"
        return f"Critical speeds of {speeds} (API 617).{beside}"

    @property
    def _end(self) -> str:
        return units.rpm(self.speed[-1])

    @property
    def rows(self) -> list[Row]:
        modes = zip(self.whirl, self.forwards, self.poles[0].imag, self.poles[-1].imag, strict=True)
        results = [Row("fastest", "highest speed", float(self.speed[-1]), "rpm", detail=True)]
        for k, (whirl, forwards, first, last) in enumerate(modes, 1):
            results += put([
                Row("whirl", "whirl", whirl),
                Row("forwards", "forward", bool(forwards), detail=True),
                Row("standstill", "at standstill", float(first), "turns"),
                Row("at_maximum_speed", f"at {self._end}", float(last), "turns"),
            ], section=("modes",), of=str(k))  # fmt: skip
        return results + [row for separation in self._separations for row in separation.rows()]

    SECTIONS = {
        ("modes",): Section("Modes", across=True),
        ("critical_speeds",): Section("Separation from critical speeds", across=True),
    }

    @property
    def notes(self) -> list[str]:
        compared = self._modes_left_out
        notes = [IDEAL] if self.machine.speed else []
        return notes + ([] if compared is None else [compared.text()])

    @property
    def series(self) -> dict[str, Any]:
        compared = self._modes_left_out
        left_out = {} if compared is None else {"modes_left_out": compared.to_dict()}
        return {"machine": self.machine.name, "critical": self.critical} | left_out

    @cached_property
    def _separations(self) -> Separations:
        return separations(self.machine, max_speed=float(self.speed[-1]))

    @property
    def _modes_left_out(self) -> Reduction | None:
        return reduction(self.machine)

    def figures(self) -> list[Figure]:
        return [campbell_figure(self)]


def campbell(
    machine: Machine, fastest: QuantityLike | None = None, *, count: int = 121
) -> Campbell:
    """Return the poles of a rotor over its speed, with the gains of a simulation."""
    return Campbell(**vars(whirl_modes(machine, fastest, count=count)))


IDEAL = (
    "Modes are those with ideal sensors and amplifiers; the separation is that of the closed loop, "
    "with all of its lags."
)
"""Difference between the critical speeds of the diagram and those of the separation margins."""

SPEED = Axis("speed of rotation", "rpm", 30 / math.pi)
FREQUENCY = Axis("frequency", "Hz", 1 / (2 * math.pi))
DAMPING = Axis("damping ratio")


def operating_speed(machine: Machine) -> list[Item]:
    """Return a vertical line at a machine's speed, none at standstill."""
    speed, text = abs(machine.speed), "operating speed"
    return [Rule(speed, axis="x", signal="reference", text=text, label="")] if speed else []


def campbell_figure(result: Campbell) -> Figure:
    """Plot frequencies and damping of a rotor's modes over its speed."""
    speed, poles, whirl = result.speed, result.poles, result.whirl
    line_styles = {"forward": "series 1", "backward": "series 2", "axial": "series 3"}
    frequencies: list[Item] = [
        Line(speed, poles[:, k].imag, signal=line_styles[way], label=way)
        for k, way in enumerate(whirl)
    ]
    # All modes of the rigid body and the first of bending, and what the speed can come near to.
    highest = np.sort(poles.imag.max(axis=0))
    lower = highest[: len(result.machine.axes) + 2]
    top = 1.05 * min(highest[-1], max(lower[-1], 2 * speed[-1]))
    near = speed <= 1.2 * highest[-1]
    frequencies.append(Line(speed[near], speed[near], signal="constant", label="speed of rotation"))
    frequencies += operating_speed(result.machine)
    damping: list[Item] = [
        Line(speed, -poles[:, k].real / np.abs(poles[:, k]), signal=line_styles[way], label=way)
        for k, way in enumerate(whirl)
    ]
    return Figure(
        id="campbell",
        title=f"Campbell diagram of {markdown(result.machine.name)}",
        caption="Modes of the rotor on its controllers; where a forward whirl meets the speed of "
        "rotation, unbalance excites it.",
        panels=[
            Panel(SPEED, replace(FREQUENCY, limits=(0.0, float(top))), frequencies),
            Panel(SPEED, DAMPING, damping),
        ],
        panel_height=2.4,
    )
