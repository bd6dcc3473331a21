"""What the self-test lets a controller live through: readings, references, and when to fly.

The flights are simulated, with what the controller itself demanded; the rest is bent from them.
Lift-off and landing are quicker than what flies, or a firmware would have to hold seconds of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.simulation.sequence import LiftOff

if TYPE_CHECKING:
    from ambkit.simulation.control import Controller

Array = NDArray[np.float64]

QUICK: dict[str, Any] = {
    "waiting": 5, "lost": 30, "overloaded": 12, "rise": 0.012, "descent": 0.018, "settling": 17,
}  # fmt: skip
"""The sequence of the self-test: fields of ``amb_sequence``, and the settling at most."""


class Scene(NamedTuple):
    """One run, n samples."""

    name: str
    y: Array  # (n,), as the rig has it; NaN: lost
    r: Array  # (n,) [m]
    fly: Array  # (n,), 1 or 0
    taken_over: float | None = None  # with this current [A], and not from power-on


def scenes(controller: Controller) -> Iterator[Scene]:
    """Yield the runs for a controller."""
    up, down = _flown(controller, 1.0), _flown(controller, -1.0)
    yield _spoilt(controller, up)
    yield _refused(controller, down)
    yield _lost(controller, up)
    yield _overloaded(controller, down)
    n = 60
    hovering = _hovering(controller, n)
    yield Scene("taken over", hovering, np.full(n, 1e-5), np.ones(n), taken_over(controller))


def taken_over(controller: Controller) -> float:
    """Return the current that acts where a rotor is taken over [A]."""
    return controller.bearing.current_max / 8


def _flown(controller: Controller, sign: float) -> Scene:
    """Lift-off, a step of the reference and one of the load, a landing that is called off; off."""
    from ambkit.simulation.run import simulate
    from ambkit.simulation.scenario import Scenario
    from ambkit.simulation.waveforms import Sequence, Step

    bearing = controller.bearing
    T, travel = bearing.sampling_time, bearing.rotor.travel_limit
    n = 420
    times = LiftOff(
        start=8 * T, stop=330 * T, wait=QUICK["waiting"] * T, lift=T / QUICK["rise"],
        land=T / QUICK["descent"], lost=QUICK["lost"] * T, overload=1.0,
    )  # fmt: skip
    reference = Sequence(times=(0.0, 170 * T), values=(0.0, sign * travel / 5))
    load = Step(amplitude=0.2 * sign * abs(bearing.weight or 1.0), time=250 * T)
    scenario = Scenario(
        duration=(n - 1) * T, start="rest", sequence=times, reference=reference, disturbance=load,
        controller=controller.pid, seed=int(sign > 0),
    )  # fmt: skip
    record = simulate(bearing, scenario, estimator=controller.estimator)
    fly = times.fly(record.t)
    fly[130:136] = 0.0  # on the way up, or just after
    raw = controller.estimator.inputs.y.numbers(record["y"])
    name = "a flight, and a step up" if sign > 0 else "a flight, and a step down"
    return Scene(name, raw, record["r"].copy(), fly)


def _spoilt(controller: Controller, scene: Scene) -> Scene:
    """Readings far away, lost and frozen; references that are no numbers."""
    y, r = scene.y.copy(), scene.r.copy()
    numbers = controller.estimator.inputs.y.numbers
    travel = controller.bearing.sensor.gain * controller.bearing.rotor.travel_limit
    y[0], y[1] = np.nan, float(numbers(3 * travel))  # before the first that can be one
    y[190:193] = np.nan, np.inf, -np.inf
    y[196:199] = numbers(np.array([1e3, -1e3, 2.5]) * travel)
    y[210:224] = y[210]
    r[200:203] = np.nan, np.inf, -np.inf
    return scene._replace(name=f"{scene.name}, with losses and freezing", y=y, r=r)


def _refused(controller: Controller, scene: Scene) -> Scene:
    """Told to fly and not to, while it waits; then with a start off the stops' middle."""
    fly = scene.fly.copy()
    fly[14:17] = 0.0
    fly[60:64] = 0.0
    return scene._replace(name=f"{scene.name}, told to fly and not to", fly=fly)


def _lost(controller: Controller, scene: Scene) -> Scene:
    """In flight the sensor is lost until it trips; told to land, and to fly again."""
    y, fly = scene.y[:330].copy(), scene.fly[:330].copy()
    y[180:240] = np.nan
    y[250:270] = scene.y[0]
    fly[255:262] = 0.0
    y[262:] = y[20:88]
    return Scene(f"{scene.name}, the sensor lost until it trips", y, scene.r[:330].copy(), fly)


def _overloaded(controller: Controller, scene: Scene) -> Scene:
    """A reference so far away that a current stays at its limit until it trips."""
    n = 280
    r = scene.r[:n].copy()
    r[165:168] = 60 * controller.bearing.rotor.travel_limit
    r[171:] = -60 * controller.bearing.rotor.travel_limit
    fly = scene.fly[:n].copy()
    fly[240:245] = 0.0
    return Scene(f"{scene.name}, overloaded until it trips", scene.y[:n].copy(), r, fly)


def _hovering(controller: Controller, n: int) -> Array:
    """A rotor that stays near a place off the middle; the first reading is the start."""
    bearing = controller.bearing
    std = float(np.sqrt(controller.estimator.core.parameters["set"]["var_y"][0]))
    here = 0.1 * bearing.sensor.gain * bearing.rotor.travel_limit
    near = here + std * np.resize([0.5, -1.0, 0.25, 1.0, -0.75], n)
    return controller.estimator.inputs.y.numbers(near)
