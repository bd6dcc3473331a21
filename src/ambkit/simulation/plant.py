"""The plant of a whole machine, for ``sim/plant.h``."""

from __future__ import annotations

import math
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.data.signals import signal
from ambkit.machine import geometry
from ambkit.machine.bank import weights_of
from ambkit.machine.bearing import GRAVITY
from ambkit.machine.geometry import Axis
from ambkit.machine.hovering import hover_current
from ambkit.machine.magnets import ConstantStiffness, magnet_of
from ambkit.models.continuous import Continuous, behind_magnets, continuous
from ambkit.models.model import compressed_rows
from ambkit.simulation import parts

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine

Array = NDArray[np.float64]

SOFT = 0.05
"""How deep the rotor comes into a backup bearing that nothing is said of [travel limits]."""
LOSS = 0.5
"""And what share of its speed it loses there."""


class Plant:
    """A machine as the C of the simulation wants it."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.model: Continuous = continuous(machine)
        self.behind = behind_magnets(self.model)
        self.alone = [machine.alone(axis.name) for axis in machine.axes]
        self.laws = [magnet_of(each) for each in self.alone]
        self.bias = np.array([law.bias_force for law in self.laws])
        self.H = geometry.matrix([axis.line for axis in machine.axes], machine.positions)

    @property
    def pairs(self) -> list[int]:
        """Axes whose two coils have currents of their own, as their voltage is limited."""
        return [
            k
            for k, each in enumerate(self.alone)
            if each.amplifier.voltage_limit is not None and each.magnet.type == "two-sided"
        ]

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of its bearings."""
        return self.machine.axes

    def hovering(self, place: Array, load: Array) -> tuple[Array, Array]:
        """Return displacements (q,) and currents (p,) [A] of a rotor that hovers."""
        # place (p,) [m]; load (p,) [N]
        machine = self.machine
        rigid = machine.rigid_positions
        H = self.H[:, : len(rigid)]
        push = geometry.weight_of(machine.rotor, rigid, GRAVITY) + H.T @ load
        forces = np.linalg.lstsq(H.T, -push, rcond=None)[0]
        bent = machine.bent_by(forces + load + np.array(weights_of(machine)))
        q = np.linalg.lstsq(H, place - self.H[:, len(rigid) :] @ bent, rcond=None)[0]
        q = np.concatenate([q, bent])
        currents = [
            hover_current(b, law, float(x), law.bias_force - float(f))
            for b, law, x, f in zip(self.alone, self.laws, self.H @ q, forces, strict=True)
        ]
        return np.asarray(q), np.array(currents)

    def resting(self) -> Array:
        """Return displacements (q,) of a rotor that lies in its backup bearings."""
        least = min(each.travel_limit for each in self.machine.bearings)
        falls = geometry.weight_of(self.machine.rotor, self.machine.positions, 1.0)
        return np.asarray(np.sign(falls) * least)

    def arrays(self, core: ModuleType, substeps: int, fastest: float) -> dict[str, Any]:
        """Return the fields of ``amb_plant``."""
        machine, model = self.machine, self.model
        n, readings = len(model.states), machine.readings
        index, more = model.place, len(self.pairs)
        place = {name: k for k, name in enumerate(machine.positions)}
        q = len(place)
        # Of the model, the motion of the rotor; currents and readings follow from their parts.
        A, spin = model.A[q : 2 * q, : 2 * q], model.spin[q : 2 * q, : 2 * q]
        pattern = (A != 0) | (spin != 0)
        B = model.push[q : 2 * q]
        seen = geometry.matrix([r.line for r in readings], machine.positions)
        sparse = {"H": model.h[:, :q], "B": B, "C": seen}
        cosine, sine = self.unbalance()
        dtype = "float32" if core.__name__.endswith("f32") else "float64"
        g = B @ self.bias
        if machine.bending is None:
            weight = geometry.weight_of(machine.rotor, machine.positions, GRAVITY)
            g += weight / machine.masses
        else:  # what its bearings bend it by at rest is no displacement, see geometry.py
            g += B @ np.array(weights_of(machine))
        turned = {"cosine": cosine.tolist(), "sine": sine.tolist()} if cosine.any() else {}
        second = {axis: n + k for k, axis in enumerate(self.pairs)}
        return {
            "states": n + more, "positions": q,
            "axes": len(self.axes), "sensors": len(readings),
            "A": compressed_rows(A, pattern),
            "spin": spin[pattern].tolist(),
            **{name: compressed_rows(values, values != 0) for name, values in sparse.items()},
            "g": g.tolist(), **turned,
            "second": [second.get(k, -1) for k in range(len(self.axes))],
            "amplifiers": [
                parts.amplifier_of(alone) | parts.behind_fields(behind, dtype)
                for alone, behind in zip(self.alone, self.behind, strict=True)
            ],
            "behind": [[index[name] for name in behind.states] for behind in self.behind],
            "coils": [
                None if fields is None else core.Law(**fields)
                for fields in map(parts.coil_fields, self.alone)
            ],
            "base": [place.get(way, -1) for way in "xyz"],
            "current": [-1 if each is None else index[each] for each in model.current],
            "magnets": [law.in_core(core) for law in self.laws],
            "bias": self.bias.tolist(),
            "farthest": [_farthest(axis) for axis in self.axes],
            "shows": [index[signal("x_m", r.name)] for r in readings],
            "gain": [r.sensor.gain for r in readings],
            "lag": [machine.lag_of(r.sensor) for r in readings],
            "sensor_parts": self._sensors(dtype),
            "rings": self._rings(),
            **({"delay": 0, "delay_rest": 0.0} | parts.delay_of(machine)),
            "substeps": self._substeps(substeps, fastest),
        }  # fmt: skip

    def unbalance(self) -> tuple[Array, Array]:
        """Return accelerations by unbalance ahead and across, for 1 rad/s (q,)."""
        machine = self.machine
        moved = machine.masses
        found = np.zeros((2, len(moved)))
        for place, amount, angle in machine.unbalances():
            along = [machine.line(place, turn) for turn in (angle, angle + math.pi / 2)]
            found += amount * geometry.matrix(along, machine.positions) / moved
        return found[0], found[1]

    def _sensors(self, precision: str) -> list[dict[str, Any]]:
        told = []
        for r in self.machine.readings:
            second = r.sensor.type == "radial" and r.name == f"{r.sensor.name}2"
            around = math.pi / 2 if second else 0.0
            told.append(parts.of_sensor(r.sensor, r.sensor.runout, precision, around))
        return told

    def _rings(self) -> list[dict[str, Any]]:
        rings, at = [], 0
        for each in self.machine.bearings:
            two = each.type == "radial"
            alone = self.alone[at]
            if each.stop is None:
                mass, k_s = alone.rotor.mass, ConstantStiffness.of(alone).k_s
                speed = math.sqrt(k_s / mass) * each.travel_limit
                stiffness = 1.25 * mass * speed**2 / (SOFT * each.travel_limit) ** 2.5
                stop = {"stiffness": stiffness, "damping": LOSS / speed}
            else:
                stop = each.stop.model_dump()
            rings.append(
                {"first": at, "second": at + 1 if two else -1, "travel": each.travel_limit,
                 "stop": stop}
            )  # fmt: skip
            at += 2 if two else 1
        return rings

    def _substeps(self, least: int, fastest: float) -> int:
        """Return steps in a sample: what is fast needs short ones."""
        # Two in a sensor's lag, four in an amplifier's, four in a radian of the fastest runout and
        # eight in one of the fastest bending, which they damp then by less than 1e-7 of its own.
        T, machine = self.machine.sampling_time, self.machine
        orders = [line.order for sensor in machine.sensors for line in sensor.runout]
        needed = [4 * T * fastest * max(orders, default=1)]
        needed += [2 * T / machine.lag_of(sensor) for sensor in machine.sensors]
        bandwidths = [each.amplifier.bandwidth for each in machine.bearings]
        needed += [4 * T * 2 * math.pi * each for each in bandwidths if each is not None]
        needed += [4 * T * parts.fastest(behind) for behind in self.behind]
        if machine.bending is not None:
            needed.append(8 * T * float(machine.bending.frequency.max()))
        return max(least, *(math.ceil(each) for each in needed))


def _farthest(axis: Axis) -> float:
    gap, travel = axis.bearing.magnet.air_gap, axis.bearing.travel_limit
    return travel + 0.9 * (gap - travel)
