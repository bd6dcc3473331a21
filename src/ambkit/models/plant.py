"""The plant of a machine, for ``sim/plant.h``."""

import math
from types import ModuleType
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.signals import signal
from ambkit.machine import geometry
from ambkit.machine.axes import weights_of
from ambkit.machine.force_law import IsolatedAxis
from ambkit.machine.forces.drawing import computed_force_of_both
from ambkit.machine.loading import levitation_current
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, magnet_of
from ambkit.machine.parts import GRAVITY
from ambkit.models import plant_parts
from ambkit.models.continuous import Continuous, behind_magnets, continuous
from ambkit.models.model import compressed_rows

SOFT = 0.05  #: Depth of contact in a touch-down bearing without data [clearances].
LOSS = 0.5  #: Its loss of velocity at an impact [1].


class Plant:
    """A machine in the form of the C of the simulation."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.model: Continuous = continuous(machine)
        self.behind = behind_magnets(self.model)
        self.isolated = [machine.isolated_axis(axis.name) for axis in machine.axes]
        self.laws = [magnet_of(item) for item in self.isolated]
        self.bias = np.array([law.bias_force for law in self.laws])
        self.H = geometry.matrix([axis.line for axis in machine.axes], machine.positions)

    @property
    def pairs(self) -> list[int]:
        """Axes with separate currents of the two coils, because the voltage is limited."""
        return [
            k
            for k, item in enumerate(self.isolated)
            if item.amplifier.voltage_limit is not None and item.magnet.type == "two-sided"
        ]

    def equilibrium(self, place: Array, load: Array) -> tuple[Array, Array]:
        """Return displacements (q,) and currents (p,) [A] of a levitated rotor in equilibrium."""
        # place (p,) [m]; load (p,) [N]
        machine = self.machine
        rigid = machine.rigid_coordinates
        H = self.H[:, : len(rigid)]
        generalised_load = geometry.weight_of(machine.rotor, rigid, GRAVITY) + H.T @ load
        forces = np.linalg.lstsq(H.T, -generalised_load, rcond=None)[0]
        bent = geometry.static_deflection(machine, forces + load + np.array(weights_of(machine)))
        q = np.linalg.lstsq(H, place - self.H[:, len(rigid) :] @ bent, rcond=None)[0]
        q = np.concatenate([q, bent])
        currents = [
            levitation_current(b, law, float(x), law.bias_force - float(f))
            for b, law, x, f in zip(self.isolated, self.laws, self.H @ q, forces, strict=True)
        ]
        return np.asarray(q), np.array(currents)

    def resting(self) -> Array:
        """Return displacements (q,) of a rotor in contact with its touch-down bearings."""
        least = min(bearing.clearance for bearing in self.machine.bearings)
        falls = geometry.weight_of(self.machine.rotor, self.machine.positions, 1.0)
        return np.asarray(np.sign(falls) * least)

    def arrays(self, core: ModuleType, substeps: int, max_speed: float) -> dict[str, Any]:
        """Return the fields of ``amb_plant``."""
        machine, model = self.machine, self.model
        n, readings = len(model.states), machine.readings
        index, more = model.place, len(self.pairs)
        place = {name: k for k, name in enumerate(machine.positions)}
        q = len(place)
        # From the model the motion of the rotor only; currents and readings follow from their
        # parts.
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
        else:  # static bending by its bearings is no displacement, see geometry.py
            g += B @ np.array(weights_of(machine))
        rotation = {"cosine": cosine.tolist(), "sine": sine.tolist()} if cosine.any() else {}
        second = {axis: n + k for k, axis in enumerate(self.pairs)}
        return {
            "states": n + more, "positions": q,
            "axes": len(machine.axes), "sensors": len(readings),
            "A": compressed_rows(A, pattern),
            "spin": spin[pattern].tolist(),
            **{name: compressed_rows(values, values != 0) for name, values in sparse.items()},
            "g": g.tolist(), **rotation,
            "second": [second.get(k, -1) for k in range(len(machine.axes))],
            "amplifiers": [
                plant_parts.amplifier_of(isolated) | plant_parts.behind_fields(behind, dtype)
                for isolated, behind in zip(self.isolated, self.behind, strict=True)
            ],
            "behind": [[index[name] for name in behind.states] for behind in self.behind],
            "coils": [
                None if fields is None else core.Law("closed", **fields)
                for fields in map(plant_parts.coil_fields, self.isolated)
            ],
            "base": [place.get(way, -1) for way in "xyz"],
            "current": [-1 if item is None else index[item] for item in model.current],
            "magnets": [law.in_core(core) for law in self.laws],
            "bias": self.bias.tolist(),
            "farthest": [
                plant_parts.max_displacement(axis.bearing.clearance, axis.bearing.magnet.air_gap)
                for axis in machine.axes
            ],
            "shows": [index[signal("x_m", r.name)] for r in readings],
            "gain": [r.sensor.gain for r in readings],
            "lag": [machine.lag_of(r.sensor) for r in readings],
            "sensor_parts": self._sensors(dtype),
            "rings": self._rings(),
            **({"delay": 0, "delay_rest": 0.0} | plant_parts.delay_of(machine)),
            "substeps": plant_parts.substeps(machine, self.behind, substeps, max_speed),
        }  # fmt: skip

    def unbalance(self) -> tuple[Array, Array]:
        """Return accelerations due to unbalance, in phase and across, at 1 rad/s (q,)."""
        machine = self.machine
        moved = machine.masses
        result = np.zeros((2, len(moved)))
        for place, amount, angle in machine.unbalances():
            along = [machine.line(place, turn) for turn in (angle, angle + math.pi / 2)]
            result += amount * geometry.matrix(along, machine.positions) / moved
        return result[0], result[1]

    def _sensors(self, precision: str) -> list[dict[str, Any]]:
        sensors = []
        for r in self.machine.readings:
            second = r.sensor.type == "radial" and r.name == f"{r.sensor.name}2"
            around = math.pi / 2 if second else 0.0
            sensors.append(plant_parts.of_sensor(r.sensor, r.sensor.runout, precision, around))
        return sensors

    def _rings(self) -> list[dict[str, Any]]:
        rings, at = [], 0
        for bearing in self.machine.bearings:
            two = bearing.type == "radial"
            isolated = self.isolated[at]
            if bearing.stop is None:
                mass, k_s = isolated.rotor.mass, ConstantStiffness.of(isolated).k_s
                speed = math.sqrt(k_s / mass) * bearing.clearance
                stiffness = 1.25 * mass * speed**2 / (SOFT * bearing.clearance) ** 2.5
                stop = {"stiffness": stiffness, "damping": LOSS / speed}
            else:
                stop = bearing.stop.core()
            rings.append(
                {"first": at, "second": at + 1 if two else -1, "travel": bearing.clearance,
                 "stop": stop, **(coupling_of(isolated) if bearing.magnet.both_axes else {})}
            )  # fmt: skip
            at += 2 if two else 1
        return rings


def coupling_of(machine: IsolatedAxis) -> dict[str, Any]:
    """Return the coenergy of two axes with common iron."""
    both = computed_force_of_both(machine)
    degrees, energy = both.energy_terms
    fields = {"degrees": degrees.ravel().tolist(), "energy": energy.tolist(),
              "current": both.ranges[0], "place": both.ranges[2]}  # fmt: skip
    return {"coupling": fields}
