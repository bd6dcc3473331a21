"""Whole machines for several tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ambkit import Machine
from ambkit.machine import presets

Array = NDArray[np.float64]

PRESETS = presets.machine_names()

MAGNET = {
    "type": "two-sided", "magnet_constant": 3.6e-6, "air_gap": 0.7e-3, "bias_current": 2.0,
}  # fmt: skip


def bearing(name: str, place: float, **keys: Any) -> dict[str, Any]:
    amplifier = {"gain": 1.0, "current_limit": 2.0, "noise_variance": 1e-5}
    amplifier |= keys.pop("amplifier", {})
    given = {"name": name, "place": place, "travel_limit": 0.3e-3, "magnet": MAGNET}
    return given | {"amplifier": amplifier} | keys


def sensor(name: str, place: float, **keys: Any) -> dict[str, Any]:
    given = {"name": name, "place": place, "gain": 1.0, "lag": 5e-5, "noise_variance": 0.25e-12}
    return given | keys


def machine(**keys: Any) -> Machine:
    """A rotor of 4 kg on bearings at 0.2 and -0.3 m."""
    data: dict[str, Any] = {
        "name": "made", "sampling_time": 1e-4, "speed": 500.0,
        "rotor": {"mass": 4.0, "transverse_inertia": 0.16, "polar_inertia": 0.05},
        "bearing": [bearing("A", 0.2), bearing("B", -0.3)],
        "sensor": [sensor("A", 0.2), sensor("B", -0.3)],
    }  # fmt: skip
    return Machine(**data | keys)


def uncoupled() -> Machine:
    """Bearings in each other's centre of percussion: a push on one does not move the other."""
    m, I_t, z = 4.0, 0.16, 0.2
    other = -I_t / (m * z)
    rotor = {"mass": m, "transverse_inertia": I_t, "polar_inertia": 0.05, "gravity": "none"}
    return machine(
        speed=0.0, rotor=rotor, bearing=[bearing("A", z), bearing("B", other)],
        sensor=[sensor("A", z), sensor("B", other)],
    )  # fmt: skip


def directions(machine: Machine, lines: Any) -> Array:
    """Displacements along lines by (x, y, th_x, th_y), written anew."""
    rows = []
    for each in lines:
        z, c, s = each.line
        rows.append([c, s, -z * s, z * c])
    return np.array(rows)


def slopes(machine: Machine, q: Array, w: Array, F: Array) -> Array:
    """Second derivatives of q = (x, y, th_x, th_y), by the equations of the issue."""
    rotor, W = machine.rotor, machine.speed
    push = directions(machine, machine.axes).T @ F
    turned = [-rotor.polar_inertia * W * w[3], rotor.polar_inertia * W * w[2]]
    weight = [-rotor.mass * 9.81 if rotor.gravity == "-x" else 0.0, 0.0]
    return np.r_[(push[:2] + weight) / rotor.mass, (push[2:] + turned) / rotor.transverse_inertia]


def integrated(rhs: Any, state: Array, ends: tuple[float, float], scale: Array) -> Array:
    """Stiff integration to 1e-10."""
    found = solve_ivp(rhs, ends, state, "Radau", rtol=1e-10, atol=1e-12 * scale)
    return np.asarray(found.y[:, -1])
