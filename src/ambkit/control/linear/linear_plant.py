"""The plant of a loop as a linear system, at an operating point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.arrays import Complex
from ambkit.base.errors import AmbkitError
from ambkit.data.signals import displacement
from ambkit.data.signals import signal as named
from ambkit.estimate.machine_model import View
from ambkit.machine.axes import isolated_axes
from ambkit.machine.loading import levitation_current_at
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module, magnet_of
from ambkit.models.declaration import Part
from ambkit.models.linear import LinearSystem, Signal, linearised
from ambkit.models.machine_parts import machine_parts
from ambkit.models.parts.synchronous import SynchronousForce, across
from ambkit.models.plant import Plant
from ambkit.models.plant_parts import between_magnet_and_rotor

TURN = 64  #: Angles of the mean over an orbit.

POSITION, VELOCITY = Signal("position", "m"), Signal("velocity", "m/s")


class Orbit(NamedTuple):
    """Motion about an operating point: complex amplitudes, of ``Re(amplitude e^(j angle))``."""

    # Scalars for one axis; for several arrays (p,).

    iu: Any  #: Of the true current [A].
    x: Any  #: Of the displacement [m].
    demanded: Any  #: Of the commanded current [A].


class OperatingPoint(NamedTuple):
    """The operating point of a linearised loop: control current [A] and displacement [m]."""

    # Scalars for one axis; for several arrays (p,). With an orbit the tangents are averaged over a
    # turn: the first term of the harmonic series of a loop with periodic stiffness (Wereley 1991).

    iu: Any
    x: Any
    orbit: Orbit | None = None

    def along_orbit(self) -> list[tuple[Any, Any]]:
        """Return currents [A] and displacements [m] of each axis over a turn."""
        turn = np.exp(2j * np.pi * np.arange(TURN) / TURN)
        swing = self.orbit
        if swing is None:
            swing, turn = Orbit(0.0 * self.iu, 0.0 * self.x, None), np.ones(1, complex)
        parts = zip(*map(np.atleast_1d, (self.iu, self.x, swing.iu, swing.x)), strict=True)
        return [(iu + np.real(i * turn), x + np.real(far * turn)) for iu, x, i, far in parts]

    @classmethod
    def equilibrium(cls, machine: Machine, x: float = 0.0, load: float = 0.0) -> OperatingPoint:
        """Return the operating point in equilibrium with weight and disturbance."""
        travel = machine.clearance
        if not abs(x) <= travel:
            raise AmbkitError(
                f"the rotor can be held up to its stops at {travel:g} m, not at {x:g} m"
            )
        iu = levitation_current_at(machine, x, load)
        if not machine.current_min < iu < machine.current_max:
            raise AmbkitError(
                f"no control current from {machine.current_min:g} to {machine.current_max:g} A "
                f"holds the rotor at x = {x:g} m with a load of {load:g} N"
            )
        return cls(iu, x)

    @classmethod
    def nearest(cls, machine: Machine) -> OperatingPoint:
        """Return the equilibrium at the centre; zero current if there is none."""
        try:
            return cls.equilibrium(machine)
        except AmbkitError:  # there is none at the centre, but perhaps elsewhere
            return cls(0.0, 0.0)

    @classmethod
    def of_machine(
        cls, machine: Machine, load: Mapping[str, float] | None = None, x: float = 0.0
    ) -> OperatingPoint:
        """Return the equilibrium at x of the axes, with disturbances."""
        names, loads = machine.axis_names, dict(load or {})
        for name in loads:
            if name not in names:
                raise AmbkitError(f"load: there is no axis {name}; there are {', '.join(names)}")
        load_forces = np.array([loads.get(name, 0.0) for name in names])
        travel = min(placed.clearance for placed in machine.bearings)
        if not abs(x) <= travel:
            raise AmbkitError(
                f"the rotor can be held up to its stops at {travel:g} m, not at {x:g} m"
            )
        q, currents = Plant(machine).equilibrium(np.full(len(names), x), load_forces)
        for name, b, iu in zip(names, isolated_axes(machine), currents, strict=True):
            if not b.current_min < iu < b.current_max:
                of = f" of axis {name}" if name else ""
                raise AmbkitError(
                    f"no control current from {b.current_min:g} to {b.current_max:g} A{of} holds "
                    f"the rotor of {machine.name} at x = {x:g} m with a load of "
                    f"{loads.get(name, 0.0):g} N"
                )
        return cls(currents, View(machine).H @ q)


def of_axes(signal: Signal, axes: Sequence[str]) -> tuple[Signal, ...]:
    """Return a signal name for each axis, with the axis as suffix; unchanged without axes."""
    return tuple(Signal(named(signal.name, axis), signal.unit) for axis in axes) or (signal,)


def plant(of: Machine, point: OperatingPoint, *, continuous: bool = False) -> LinearSystem:
    """Return the plant from u and disturbance to y and x: amplifiers, magnets, rotor, sensors."""
    # Within the limits of current and voltage, without quantisation and noise; for a nonlinear
    # sensor the slope at the operating point.
    system = _linear(of, machine_parts(of, noise=False), point, continuous=continuous)
    B, C, isolated = system.B.copy(), system.C, isolated_axes(of)
    B[:, : len(isolated)] *= [b.amplifier.gain for b in isolated]
    view, m = View(of), len(of.readings)
    seen = np.linalg.pinv(view.measured) @ np.atleast_1d(point.x) / view.gains
    stands = {state.name: k for k, state in enumerate(system.states)}
    along = np.zeros((len(isolated), len(stands)))
    for k, axis in enumerate(of.axes):
        for q, value in axis.line.form.items():
            along[k, stands[q]] = value
    C = np.vstack([C[:m], along])
    names = of.axis_names
    inputs = (*of_axes(Signal("u", "V"), names), *system.inputs[len(names) :])
    positions = tuple(Signal(displacement(name), "m") for name in names)
    bent = [
        1 + (2 * r.sensor.quadratic + 3 * r.sensor.cubic * x) * x
        for r, x in zip(of.readings, seen, strict=True)
    ]
    C = np.vstack([np.array(bent)[:, None] * C[:m], C[m:]])
    return replace(
        system, B=B, C=C, D=np.zeros((len(C), B.shape[1])), inputs=inputs,
        outputs=(*system.outputs[:m], *positions),
    )  # fmt: skip


def plants(bearings: Sequence[Machine], points: Sequence[OperatingPoint]) -> LinearSystem:
    """Return `plant` of machines of equal structure, as matrices (machines, ...)."""
    values = [machine_parts(b, noise=False) for b in bearings]
    parts = [_stacked(of) for of in zip(*values, strict=True)]
    core = core_module()
    k = np.array([
        [k[0] for k in magnet_of(b).in_core(core).tangent(np.array([at.iu]), np.array([at.x]))]
        for b, at in zip(bearings, points, strict=True)
    ])  # fmt: skip
    system = linearised(parts, bearings[0].sampling_time, k[:, :1], k[:, 1:])
    gains = np.array([b.amplifier.gain for b in bearings])
    B = np.concatenate([system.B[..., :1] * gains[:, None, None], system.B[..., 1:]], axis=-1)
    return replace(system, B=B)


def alike(machine: Machine) -> tuple[Any, ...]:
    """Return the structure that machines must share for `plants`."""
    amplifier, sensor = machine.amplifier, machine.sensor
    return (
        machine.sampling_time, machine.delay, amplifier.bandwidth is None, bool(sensor.lag),
        between_magnet_and_rotor(machine),
    )  # fmt: skip


def _stacked(parts: Sequence[Any]) -> Any:
    """Return parts of equal structure as one, with arrays for the values that differ."""
    first = parts[0]
    changes: dict[str, Any] = {}
    for field in fields(first):
        values = [getattr(part, field.name) for part in parts]
        typical = "size" in field.name or field.name == "growth"  # no effect on the plant
        if typical or all(value == values[0] for value in values):
            continue
        if isinstance(values[0], Mapping):
            changes[field.name] = {key: np.array([v[key] for v in values]) for key in values[0]}
        else:
            changes[field.name] = np.array(values, float)
    return replace(first, **changes)


def unbalance_columns(machine: Machine, point: OperatingPoint, places: Sequence[float]) -> Complex:
    """Return the change of the plant's states within a sample per kg m of unbalance (n, planes)."""
    # Each rotates from x towards y, within the sample too.
    unbalance_parts: list[Part] = [
        SynchronousForce(1.0, 1.0, machine.speed, f"U{k}", *across(machine, z))
        for k, z in enumerate(places)
    ]
    A = _linear(machine, [*machine_parts(machine, noise=False), *unbalance_parts], point).A
    n = len(A) - 2 * len(places)
    return np.asarray(A[:n, n::2] - 1j * A[:n, n + 1 :: 2])


def _linear(
    of: Machine, parts: Sequence[Part], point: OperatingPoint, *, continuous: bool = False
) -> LinearSystem:
    """Return the linear parts of a plant at an operating point."""
    k_i, k_s = np.array([
        [float(np.mean(k)) for k in magnet_of(b).tangent(iu, x)]
        for b, (iu, x) in zip(isolated_axes(of), point.along_orbit(), strict=True)
    ]).T  # fmt: skip
    return linearised(parts, of.sampling_time, k_i, k_s, continuous=continuous)
