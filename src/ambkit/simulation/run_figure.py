"""Figure of a simulated run: signals over time, and orbits in the bearings."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base import units
from ambkit.base.escaping import label, markdown
from ambkit.data.signals import signal
from ambkit.estimate.estimate_panels import contact_spans, true_noise
from ambkit.machine.components import BearingAt
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Rule
from ambkit.result.signal_styles import CURRENT, DISTURBANCE, NOISE, POSITION, TIME, VELOCITY

TURNS = 5  #: Revolutions of an orbit in a dark colour, at the end of the run.
AXES = ("first axis", "second axis")  #: Axes of a radial bearing.
DISPLACEMENT = Axis("displacement", "µm", 1e6)
SPEED = Axis("speed of rotation", "rpm", 30 / math.pi)


def simulation_figure(run: Any) -> Figure:
    """Plot the signals of a simulated run, with the estimates."""
    record, estimate = run.record, run.estimate
    if not run.machine.single:
        return _machine_figure(run)
    machine = run.machine
    t, name = record.t, "estimate"

    def lines(signal: str) -> list[Item]:
        return [] if estimate is None else [Line(t, estimate[signal], signal=name)]

    limits = [
        Rule(limit, signal="limit", label="limit")
        for limit in (machine.current_min, machine.current_max)
        if np.max(np.abs(record["iu"][run.energised])) > 0.5 * abs(limit)
    ]
    position: list[Item] = [
        Line(t, record["y"], signal="measured"),
        Line(t, record["r"], signal="reference"),
        Line(t, record["x"], signal="truth"),
        *lines("x"),
    ]
    supplied = np.where(run.energised, 1.0, np.nan)
    control = Line(t, supplied * record["iu"], signal="control", label="control current")
    currents = [] if estimate is None else estimate.states_with_role("current")
    follows = [Line(t, supplied * estimate[n], signal=name) for n in currents]
    coloured = None if estimate is None else estimate.sensor_noise
    noises = (
        [] if coloured is None
        else [Panel(TIME, NOISE, [*true_noise(record), Line(t, coloured, signal=name)])]
    )  # fmt: skip
    contact = contact_spans(t, [] if estimate is None else [estimate])
    return Figure(
        id="simulation",
        title=f"Simulated run of {markdown(machine.name)}",
        caption="" if estimate is None else f"In the loop or beside it: {estimate.estimator}.",
        panels=[
            Panel(TIME, POSITION, [*position, *contact]),
            Panel(TIME, VELOCITY, [Line(t, record["v"], signal="truth"), *lines("v"), *contact]),
            Panel(TIME, CURRENT, [control, *follows, *limits, *contact]),
            Panel(
                TIME, DISTURBANCE, [Line(t, record["f_d"], signal="truth"), *lines("f_d"), *contact]
            ),
            *noises,
        ],
    )


def _machine_figure(run: Any) -> Figure:
    """Plot the orbits of the rotor in its radial bearings, displacements and currents."""
    record, machine = run.record, run.machine
    t = record.t
    supplied = np.where(run.energised, 1.0, np.nan)
    full_time = replace(TIME, limits=(float(t[0]), float(t[-1])))
    contact = contact_spans(t, [] if run.estimate is None else [run.estimate])
    radial = [bearing for bearing in machine.bearings if bearing.type == "radial"]
    names = {
        bearing.name: [axis.name for axis in machine.axes if axis.bearing is bearing]
        for bearing in machine.bearings
    }

    def lines(quantity: str, bearing: str, factor: Any = 1.0) -> list[Item]:
        return [
            Line(t, factor * record[signal(quantity, name)], signal=f"series {k}", label=axis)
            for k, (name, axis) in enumerate(zip(names[bearing], AXES, strict=False), 1)
        ]

    def current(bearing: BearingAt) -> Panel:
        limit, fed = bearing.amplifier.current_limit, lines("iu", bearing.name, supplied)
        currents = [record[signal("iu", name)][run.energised] for name in names[bearing.name]]
        if np.abs(currents).max(initial=0.0) > 0.5 * limit:
            fed += [Rule(end, signal="limit", label="limit") for end in (-limit, limit)]
        title = f"Control currents of bearing {label(bearing.name)}"
        return Panel(full_time, CURRENT, fed, title=title)

    panels = [_orbit(run, bearing) for bearing in radial]
    panels += [
        Panel(TIME, DISPLACEMENT, [*lines("s", name), *contact],
              title=f"Displacement in bearing {label(name)}")
        for name in names
    ]  # fmt: skip
    panels += [current(bearing) for bearing in machine.bearings]
    speed = record["speed"]
    rpm = units.rpm(speed[-1], 6)
    if speed.max() != speed.min():
        rpm = f"{units.rpm(speed[0], 6).removesuffix(' rpm')} to {rpm}"
        panels.append(Panel(full_time, SPEED, [Line(t, speed, signal="truth", label="speed")]))
    caption = (
        f"The rotor at {rpm}; orbits over the whole run, and dark over its last {TURNS} "
        "revolutions; the circle is the touch-down bearing where it is near."
    )
    if "mode" in record:
        caption += " On the stops all currents are zero, the bias included."
    if not run.energised.all():
        caption += " All currents are zero while the power fails."
    return Figure(
        id="machine", title=f"Simulated run of {markdown(machine.name)}", caption=caption,
        panels=panels, columns=max(1, min(2, len(radial))), panel_height=2.1,
    )  # fmt: skip


def _orbit_of(run: Any, place: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the displacements x and y of the rotor at a place (n,) [m]."""
    record = run.record
    x, y = (
        sum(value * record[f"q_{q}"] for q, value in run.machine.line(place, turn).form.items())
        for turn in (0.0, math.pi / 2)
    )
    return np.asarray(x), np.asarray(y)


def _orbit(run: Any, bearing: BearingAt) -> Panel:
    x, y = _orbit_of(run, bearing.place)
    late = _last_turns(run)
    items: list[Item] = [
        Line(x, y, signal="measured", label="whole run"),
        Line(x[late], y[late], signal="estimate", label=f"last {TURNS} revolutions"),
    ]
    travel = bearing.clearance
    if max(np.abs(x).max(), np.abs(y).max()) > 0.5 * travel:
        turn = np.linspace(0, 2 * math.pi, 181)
        items.append(
            Line(travel * np.cos(turn), travel * np.sin(turn), signal="limit",
                 label="touch-down bearing")
        )  # fmt: skip
    along_x = "$x$, against gravity" if run.machine.weight < 0 else "$x$"  # a shaft may be vertical
    across = Axis(along_x, "µm", 1e6), Axis("$y$", "µm", 1e6)
    return Panel(*across, items, title=f"Orbit in bearing {label(bearing.name)}", equal=True)


def _last_turns(run: Any) -> slice:
    """Return the samples of the last revolutions; the last tenth at low speed."""
    speed, t = run.record["speed"], run.record.t
    angle = np.concatenate([[0.0], np.cumsum(np.abs(speed[:-1]) * np.diff(t))])
    first = int(np.searchsorted(angle, angle[-1] - TURNS * 2 * math.pi))
    return slice(min(first, int(0.9 * len(t))) if first == 0 else first, None)
