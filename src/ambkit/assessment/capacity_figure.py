"""Picture of the load that a loop bears over the frequency."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ambkit.assessment.assessment_figure import LOOKS
from ambkit.base.errors import AmbkitError
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Points

if TYPE_CHECKING:
    from ambkit.judge.loop.capacity import Capacity


def capacity_figure(
    title: str,
    loops: Mapping[str, Capacity],
    demands: Mapping[str, tuple[float, float]] | None = None,
) -> Figure:
    """Show at which harmonic load current, displacement and voltage come to their limits."""
    if not loops:
        raise AmbkitError("no loop is stable: there is nothing to draw")
    f = next(iter(loops.values())).frequency
    frequency = Axis("frequency", "Hz", scale="log", limits=(float(f[0]), float(f[-1])))
    load = Axis("amplitude of the disturbance force", "N", scale="log")
    kinds = {"current at its limit": "current", "out of zone A of ISO 14839-2": "displacement",
             "voltage at its limit": "voltage"}  # fmt: skip
    panels = []
    for heading, kind in kinds.items():
        items: list[Item] = [
            Line(f, getattr(item, kind), signal=LOOKS[k % len(LOOKS)], label=name)
            for k, (name, item) in enumerate(loops.items())
            if getattr(item, kind) is not None
        ]
        if items:
            items += [
                Points(np.array([at]), np.array([force]), signal="spike",
                       label="force of the unbalance" if k == 0 else "")
                for k, (at, force) in enumerate((demands or {}).values())
            ]  # fmt: skip
            panels.append(Panel(frequency, load, items, title=heading[0].upper() + heading[1:]))
    return Figure(
        "capacity",
        title,
        "Amplitude of a harmonic load beside the constant one at which a limit is reached; what "
        "noise, unbalance, runout and the constant load take is taken off, of the voltage the last "
        "alone. Linear, in closed loop. Marks: the own force of the unbalance, at the speed.",
        panels,
        columns=len(panels),
        panel_height=2.8,
    )
