"""The whole machine: the composition that a rotor, its bearings and its sensors give."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ambkit.data.signals import signal
from ambkit.machine.geometry import Line, deflections, modal_positions
from ambkit.machine.rotors.modes import Bending
from ambkit.models.compose import compose
from ambkit.models.model import Model
from ambkit.models.parts import (
    Amplifier,
    ColouredNoise,
    Delay,
    Disturbance,
    Hum,
    MagnetPlace,
    Rotor,
    Sensor,
    SynchronousForce,
    SynchronousRunout,
)
from ambkit.models.parts.typical import Typical
from ambkit.models.plan import UNIT, Part, Place


def velocity_of(position: str) -> str:
    """Return what the derivative of a coordinate is called: ``v_x``, ``w_x`` of ``th_x``."""
    return f"w_{position[3:]}" if position.startswith("th_") else f"v_{position}"


def velocities_of(positions: tuple[str, ...]) -> tuple[str, ...]:
    """Return what the derivatives of the coordinates are called; that of a mass is ``v``."""
    return ("v",) if positions == ("x",) else tuple(map(velocity_of, positions))


SYNCHRONOUS = ("unbalance", "runout")
"""What turns with the rotor and can be among the states, by name."""

GRADE = 6.3e-3
"""Balance quality grade that an unknown unbalance is expected to have [m/s] (ISO 21940-11)."""
RUNOUT = 3e-6
"""Runout that is expected where none is described [m]."""
SLOWEST = 100.0
"""Speed from which on that is expected [rad/s]."""
MEMORY = 1e5
"""Time in which both may change by as much as they are expected to be [s]."""


def machine_parts(
    machine: Any,
    *,
    noise: bool = True,
    delay: bool = True,
    synchronous: Sequence[str] = (),
    speeding: float = 0.0,
) -> list[Part]:
    """Return the parts of a machine, as its keys give them."""
    axes, sizes = machine.axes, [_typical(machine, axis.name) for axis in machine.axes]
    parts: list[Part] = [rotor_part(machine, sizes)]
    each = list(zip(axes, sizes, strict=True))
    parts += [MagnetPlace(s.force, signal("f", a.name), place(a.line.form)) for a, s in each]
    parts += [
        Disturbance(s.force, 1e-3 * s.force, signal("f_d", a.name), signal("f", a.name))
        for a, s in each
    ]
    for r in machine.readings:
        size = abs(r.sensor.gain) * max(s.displacement for s in sizes)
        lag, form = machine.lag_of(r.sensor), place(r.line.form)
        parts.append(
            Sensor(r.sensor.gain, lag, size, signal("y", r.name), signal("x_m", r.name), form)
        )
    parts += [
        Amplifier(s.current, a.bearing.amplifier.bandwidth,
                  *(signal(what, a.name) for what in "uif")) for a, s in each
    ]  # fmt: skip
    if machine.delay and delay:
        parts += [Delay(machine.delay, s.current, signal("u", a.name)) for a, s in each]
    if "unbalance" in synchronous:
        parts += _unbalance(machine, speeding)
    if "runout" in synchronous:
        parts += _runout(machine)
    return parts + (_noises(machine) if noise else [])


def unbalance_planes(machine: Any) -> list[float]:
    """Where unbalance is estimated: one or two described planes, or at the outer bearings."""
    # Two planes are all that a rigid rotor has, and one that bends has another for each mode.
    given = {each.place for each in machine.unbalance}
    most = 2 if machine.bending is None else 2 + len(machine.bending.frequency)
    if 0 < len(given) <= most:
        return sorted(given)
    places = sorted(each.place for each in machine.bearing if each.type == "radial")
    return [places[0], places[-1]]


def _unbalance(machine: Any, speeding: float) -> list[Part]:
    planes = unbalance_planes(machine)
    speed, usual = machine.speed, max(abs(machine.speed), SLOWEST)
    size = machine.rotor.mass * GRADE / usual / len(planes)
    return [
        SynchronousForce(
            size, size * math.sqrt(machine.sampling_time / MEMORY), speed, f"U{k}",
            place(machine.line(z, 0.0).form), place(machine.line(z, math.pi / 2).form), speeding,
        )
        for k, z in enumerate(planes, 1)
    ]  # fmt: skip


def _runout(machine: Any) -> list[Part]:
    parts: list[Part] = []
    for sensor in machine.sensor:
        told = {line.order: line.amplitude for line in sensor.runout} or {1: RUNOUT}
        looking = [r for r in machine.readings if r.sensor is sensor]
        for order, size in told.items():
            # A quarter farther round: exactly 0 and 1 where they are.
            around = [Line.across(0.0, order * k * math.pi / 2) for k in range(len(looking))]
            seen = tuple(
                (signal("x_m", r.name), sensor.gain, machine.lag_of(sensor), at.cosine, at.sine)
                for r, at in zip(looking, around, strict=True)
            )
            growth = size * math.sqrt(machine.sampling_time / MEMORY)
            name = f"r{order}_{sensor.name}"
            parts.append(SynchronousRunout(size, growth, machine.speed, order, name, seen))
    return parts


def rotor_part(machine: Any, sizes: list[Typical]) -> Rotor:
    """Return the rotor, with its gyroscopics at the machine's speed, and its bending modes."""
    positions = machine.positions
    reach = max(
        (abs(a.line.place) for a in machine.axes if not (a.line.axial or a.line.translation)),
        default=1.0,
    )
    way, fast = max(s.displacement for s in sizes), max(s.velocity for s in sizes)
    at = {q: k for k, q in enumerate(positions)}
    polar = {("th_x", "th_y"): machine.rotor.polar_inertia} if "th_x" in positions else {}
    stiffness: dict[str, float] = {}
    damping: dict[tuple[str, str], float] = {}
    circulatory: dict[tuple[str, str], float] = {}
    bends: dict[str, tuple[float, float]] = {}
    bending = machine.bending
    if bending is not None:
        stiffness = dict(zip(modal_positions(bending), bending.stiffness.repeat(2), strict=True))
        bends = _typical_bendings(machine, sizes)
        polar, damping = _coupled(bending)
        circulatory = _circulatory(bending)
    return Rotor(
        {(k, k): value for k, value in enumerate(machine.masses.tolist())}, way, fast, positions,
        velocities_of(positions), speed=machine.speed,
        gyroscopic={(at[i], at[j]): g for (i, j), g in polar.items()}
        | {(at[j], at[i]): -g for (i, j), g in polar.items()},
        stiffness={(at[q], at[q]): float(k) for q, k in stiffness.items()},
        damping={(at[i], at[j]): d for (i, j), d in damping.items()},
        circulatory={(at[i], at[j]): n for (i, j), n in circulatory.items()},
        turns=tuple(q.startswith("th") for q in positions), lever=reach, bends=bends,
    )  # fmt: skip


def _coupled(
    bending: Bending,
) -> tuple[dict[tuple[str, str], float], dict[tuple[str, str], float]]:
    """Return entries of G, of which those across the diagonal follow, and of D."""
    # In one plane the slopes are th_y and those of the modes, in the other -th_x and those.
    planes = [
        [("x", 1.0), ("th_y", 1.0), *((f"{name}_x", 1.0) for name in bending.names)],
        [("y", 1.0), ("th_x", -1.0), *((f"{name}_y", 1.0) for name in bending.names)],
    ]
    polar = {
        (i, j): float(bending.polar[k, m] * si * sj)
        for k, (i, si) in enumerate(planes[0][1:])
        for m, (j, sj) in enumerate(planes[1][1:])
        if bending.polar[k, m]
    }
    every = bending.damping.copy()
    every[2:, 2:] += bending.internal
    damping = {
        (i, j): float(every[k, m] * si * sj)
        for plane in planes
        for k, (i, si) in enumerate(plane)
        for m, (j, sj) in enumerate(plane)
        if every[k, m]
    }
    return polar, damping


def _circulatory(bending: Bending) -> dict[tuple[str, str], float]:
    """Return entries of N: of D_internal (q' - speed J q), what is not of q'."""
    # J turns from x towards y. What stands still for a rotor that turns moves for its material,
    # which so drives a whirl that is slower than the rotor.
    found: dict[tuple[str, str], float] = {}
    for k, m in np.argwhere(bending.internal):
        one, other, value = bending.names[k], bending.names[m], float(bending.internal[k, m])
        found |= {(f"{one}_x", f"{other}_y"): value, (f"{one}_y", f"{other}_x"): -value}
    return found


LEAST_BENT = 1 / 30
"""Of the travel, that a mode is expected to be out at least."""


def _typical_bendings(machine: Any, sizes: list[Typical]) -> dict[str, tuple[float, float]]:
    """Return how far and how fast modes are bent [m], [m/s]: by what the magnets pull at most."""
    bending, positions = machine.bending, modal_positions(machine.bending)
    lines = [axis.line for axis in machine.axes]
    least = LEAST_BENT * min(s.displacement for s in sizes)
    most = np.full(len(positions), least)
    for k, size in enumerate(sizes):
        pull = size.force * np.eye(len(lines))[k]
        most = np.maximum(most, np.abs(deflections(bending, lines, pull, positions)))
    rates = bending.frequency.repeat(2)
    return {
        q: (float(far), float(far * rate))
        for q, far, rate in zip(positions, most, rates, strict=True)
    }


def place(form: dict[str, float]) -> Place:
    """Return a linear form of the coordinates, with ones by structure where it is along one."""
    return {q: UNIT if q in "xyz" and value == 1 else value for q, value in form.items()}


def _typical(machine: Any, axis: str) -> Typical:
    return Typical.of(machine.alone(axis))


def _noises(machine: Any) -> list[Part]:
    parts: list[Part] = []
    for r in machine.readings:
        coloured = r.sensor.coloured_noise
        if coloured:
            parts.append(
                ColouredNoise(
                    coloured.variance,
                    coloured.bandwidth,
                    signal("n_y", r.name),
                    signal("y", r.name),
                )
            )
        for k, line in enumerate(r.sensor.hum, 1):
            name = signal(f"hum{k if k > 1 else ''}", r.name)
            parts.append(
                Hum(line.frequency, line.amplitude, line.bandwidth, name, signal("y", r.name))
            )
    return parts


def machine_model(
    machine: Any,
    *,
    T: float | None = None,
    noise: bool = True,
    synchronous: Sequence[str] = (),
    speeding: float = 0.0,
) -> Model:
    """Return the sampled model of a whole machine."""
    parts = machine_parts(machine, noise=noise, synchronous=synchronous, speeding=speeding)
    return compose(parts, machine.sampling_time if T is None else T, name="machine")
