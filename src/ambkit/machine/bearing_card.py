"""A bearing: the force of its magnet, over current and displacement."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.machine.magnets import ConstantStiffness, magnet_of
from ambkit.result.card import Card, settings_card, value
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Points, Rule

STYLES = ("series 2", "estimate", "series 3")
SHARES = (-0.5, 0.0, 0.5)  #: Of the range of what the lines stand for.


def bearing_figure(machine: Any) -> Figure:
    """Show what its magnet pulls with, and the current that carries the rotor."""
    magnet, travel = magnet_of(machine), machine.clearance
    iu = np.linspace(machine.current_min, machine.current_max, 121)
    x = np.linspace(-travel, travel, 121)
    current, displacement = Axis("control current $i_u$", "A"), Axis("displacement $x$", "mm", 1e3)
    force = Axis("force of the magnet", "N")
    places = [share * travel for share in SHARES]
    currents = [share * machine.current_max for share in SHARES]
    carried: list[Item] = [Rule(-machine.weight, signal="reference", label="weight")]
    levitation_current = np.array([machine.levitation_current])
    here = Points(
        levitation_current, np.array([-machine.weight]), signal="measurement", label="levitation"
    )
    over_current: list[Item] = [
        Line(iu, magnet.force(iu, place), signal=style,
             label=f"$x$ = {engineering(place, 'm', 3, like=travel)}")
        for style, place in zip(STYLES, places, strict=True)
    ]  # fmt: skip
    over_displacement: list[Item] = [
        Line(x, magnet.force(control_current, x), signal=style,
             label=f"$i_u$ = {engineering(control_current, 'A', 3)}")
        for style, control_current in zip(STYLES, currents, strict=True)
    ]  # fmt: skip
    return Figure(
        id="bearing",
        title=f"Force of {markdown(machine.name)}",
        caption="Over all currents, and over the rotor's travel.",
        panels=[
            Panel(current, force, [*carried, *over_current, here]),
            Panel(displacement, force, [*carried, *over_displacement]),
        ],
        panel_height=2.0,
    )


def bearing_card(of: Any) -> Card:
    """Describe a bearing by what its file says, and by the stiffnesses that follow."""
    linear = ConstantStiffness.of(of)
    centre = (
        f"k_i {value(linear.k_i, 'N/A')}, k_s {value(linear.k_s, 'N/m')}, "
        f"hovers with {value(of.levitation_current, 'A')}"
    )
    return settings_card(
        of, [("clearance", value(of.clearance, "m")), ("at x = 0", centre)], bearing_figure(of)
    )
