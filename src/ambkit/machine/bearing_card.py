"""Figure and description of a machine with one axis: force over current and displacement."""

from typing import Any

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.machine.magnets import ConstantStiffness, magnet_of
from ambkit.result.card import Card, settings_card, value
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Points, Rule

SHARES = {"series 2": -0.5, "estimate": 0.0, "series 3": 0.5}
"""Lines of the figure, as signed shares of the range."""


def bearing_figure(machine: Any) -> Figure:
    """Plot the magnet force, and the levitation current."""
    magnet, travel = magnet_of(machine), machine.clearance
    iu = np.linspace(machine.current_min, machine.current_max, 121)
    x = np.linspace(-travel, travel, 121)
    weight, force = -machine.weight, Axis("force of the magnet", "N")
    carried = Rule(weight, signal="reference", label="weight")
    over_current: list[Item] = [carried]
    over_displacement: list[Item] = [carried]
    for signal, share in SHARES.items():
        at_x, at_iu = share * travel, share * machine.current_max
        label = f"$x$ = {engineering(at_x, 'm', 3, like=travel)}"
        over_current.append(Line(iu, magnet.force(iu, at_x), signal=signal, label=label))
        label = f"$i_u$ = {engineering(at_iu, 'A', 3)}"
        over_displacement.append(Line(x, magnet.force(at_iu, x), signal=signal, label=label))
    here = np.array([machine.levitation_current]), np.array([weight])
    over_current.append(Points(*here, signal="measurement", label="levitation"))
    return Figure(
        id="bearing",
        title=f"Force of {markdown(machine.name)}",
        caption="Over all currents, and over the rotor's travel.",
        panels=[
            Panel(Axis("control current $i_u$", "A"), force, over_current),
            Panel(Axis("displacement $x$", "mm", 1e3), force, over_displacement),
        ],
        panel_height=2.0,
    )


def bearing_card(of: Any) -> Card:
    """Describe a machine with one axis by its file and the resulting stiffnesses."""
    linear = ConstantStiffness.of(of)
    centre = (
        f"k_i {value(linear.k_i, 'N/A')}, k_s {value(linear.k_s, 'N/m')}, "
        f"levitates with {value(of.levitation_current, 'A')}"
    )
    return settings_card(
        of, [("clearance", value(of.clearance, "m")), ("at x = 0", centre)], bearing_figure(of)
    )
