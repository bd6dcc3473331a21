"""Plant in an FMU: data and start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.control.controller_states import lies_at
from ambkit.estimate.machine_model import View
from ambkit.export.c import c_literals
from ambkit.export.c.c_literals import Name
from ambkit.export.c.model import BUILT_IN, CModel, sparse
from ambkit.export.fmu import variables
from ambkit.export.fmu.sources import magnet_data
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module, magnet_of, own_time
from ambkit.models import plant_parts
from ambkit.models.continuous import continuous
from ambkit.models.parts.typical_sizes import Typical
from ambkit.models.plant import Plant
from ambkit.simulation.scenario import Scenario


def room_of(machine: Machine) -> CModel:
    """Return the memory of a plant with several axes, without a filter."""
    model, p = continuous(machine), len(machine.axes)
    room = {
        "STATES": len(model.states), "FORCES": p, "CONTROLS": p,
        "SENSORS": len(machine.readings), "NOISES": 1,
    }  # fmt: skip
    return CModel({BUILT_IN: None}, (), {}, {}, room)


def rig_data(machine: Machine, start: RigStart) -> dict[str, Any]:
    """Return the data file of a plant: that of :func:`ambkit.simulate`."""
    single, axes = machine.single, isolated_axes(machine)
    laws = [magnet_of(item) for item in axes]
    coils = [plant_parts.coil_fields(item) for item in axes]
    of_axes = {
        "bias": [law.bias_force for law in laws],
        "k": [item.magnet.magnet_constant for item in axes],
        "travel": [item.clearance for item in axes],
        "k_ui": [item.amplifier.gain for item in axes],
        "iu_min": [item.current_min for item in axes],
        "iu_max": [item.current_max for item in axes],
    }
    arrays = {f"rig_{name}": np.array(values, float) for name, values in of_axes.items()}
    fields: dict[str, Any] = {name: Name(f"rig_{name}") for name in of_axes}
    core = core_module("float64", any_model=not single)
    if single:
        bearing, least = axes[0], Scenario().substeps
        of_plant = plant_parts.axis_fields(bearing, None, None, laws[0].bias_force, least)
        parts = (of_plant["delay"], of_plant["delay_rest"], *of_plant["sensor_parts"][0])
        fields |= {"weight": bearing.weight, "with_parts": not of_plant["plain"] or any(parts)}
    else:
        of_plant = Plant(machine).arrays(core, start.substeps, start.max_speed)
        fields |= {"with_parts": True}
        of_start = {"q": start.q, "place": start.place, "q_by_place": start.q_by_place.ravel()}
        arrays |= {f"rig_{name}": values for name, values in of_start.items()}
        fields |= {name: Name(f"rig_{name}") for name in of_start}
    plant = _plant_fields(of_plant)
    arrays |= plant.arrays
    fields["plant"] = Name("&rig_plant")
    base = [f"VR_{name}" if name else "-1" for name in variables.base_inputs(machine)]
    fields |= {
        "axes": len(axes), "T": machine.sampling_time,
        "magnet": Name("rig_magnet"), "coil": Name("rig_coil"),
        "mass": Name("VR_mass" if single else "-1"),
        "speed": Name("-1" if single else "VR_speed"),
        "s": Name("-1" if single else "FIRST_s"), "base": Name(f"{{{', '.join(base)}}}"),
    }  # fmt: skip
    held = [law.in_core(core) for law in laws]
    closed = [None if of is None else core.Law("closed", **of) for of in coils]
    return {
        "magnets": [magnet_data(of, f"rig_magnet_{k}") for k, of in enumerate(held)],
        "coils": [
            None if of is None else magnet_data(of, f"rig_coil_{k}") for k, of in enumerate(closed)
        ],
        "arrays": c_literals.declared(arrays, "double"),
        "structs": plant.structs,
        "plant": c_literals.struct(plant.fields, "double"),
        "text": c_literals.struct(fields, "double"),
    }


class RigStart(NamedTuple):
    """Start and maximum speed of a plant with several axes."""

    place: Array  #: Along the axes (p,) [m].
    q: Array  #: Positions (q,) [m] or [rad].
    q_by_place: Array  #: What each metre more along an axis adds (q, p).
    substeps: int
    max_speed: float  #: [rad/s].

    @classmethod
    def of(cls, machine: Machine, scenario: Scenario) -> RigStart:
        """Return the start of a scenario in :func:`ambkit.simulate`."""
        if machine.single:
            lies = scenario.start == "landed"
            place = np.array([lies_at(machine) if lies else 0.0])
            return cls(place, place, np.eye(1), scenario.substeps, machine.speed)
        plant, speeds = Plant(machine), [machine.speed]
        nothing = np.zeros(len(machine.axes))
        if scenario.speed is not None:
            T, n = machine.sampling_time, round(scenario.duration / machine.sampling_time)
            speeds = scenario.speed.sample(T * np.arange(n + 2)).tolist()
        if scenario.start == "levitated":
            q, place = plant.equilibrium(nothing, nothing)[0], nothing
        else:
            q = plant.resting() * (scenario.start == "landed")
            place = plant.H @ q
        by_place = View(machine).placed
        return cls(place, q, by_place, scenario.substeps, max(map(abs, speeds)))


class _PlantFields(NamedTuple):
    fields: dict[str, Any]  # of ``amb_plant``
    arrays: dict[str, NDArray[Any]]  # that it points to
    structs: list[tuple[str, str, str]]  # type, name with its length, text of arrays of structs


_STRUCTS = {"amplifiers": "amplifier", "sensor_parts": "sensor"}


def _plant_fields(fields_of_plant: dict[str, Any]) -> _PlantFields:
    """Return the fields of ``amb_plant``, as C."""
    fields: dict[str, Any] = {"rings": len(fields_of_plant["rings"]), "ring": Name("rig_ring")}
    if "mass" in fields_of_plant:
        fields["own"] = True
    arrays: dict[str, NDArray[Any]] = {}
    structs = []
    for name, value in fields_of_plant.items():
        if name in ("magnets", "coils", "bias", "behind", "rings"):
            continue
        if name in _STRUCTS:
            behind = fields_of_plant["behind"] if name == "amplifiers" else [[]] * len(value)
            texts = [
                _parts(parts | ({"behind_at": np.array(at, np.int32)} if at else {}))
                for parts, at in zip(value, behind, strict=True)
            ]
            fields[_STRUCTS[name]] = Name(f"rig_{name}")
            structs.append(("amb_parts", f"rig_{name}[{len(texts)}]", _listed(texts)))
        elif isinstance(value, tuple):
            fields[name], parts = sparse(f"rig_{name}", value)
            arrays |= parts
        elif isinstance(value, list):
            integer = all(isinstance(item, int) for item in value)
            arrays[f"rig_{name}"] = np.array(value or [0], np.int32 if integer else float)
            fields[name] = Name(f"rig_{name}")
        else:
            fields[name] = value
    stops = [_parts(ring["stop"]) for ring in fields_of_plant["rings"]]
    structs.append(("amb_parts", f"rig_stop[{len(stops)}]", _listed(stops)))
    rings = [
        c_literals.struct(ring | {"stop": Name(f"&rig_stop[{k}]")}, "double")
        for k, ring in enumerate(fields_of_plant["rings"])
    ]
    structs.append(("amb_ring", f"rig_ring[{len(rings)}]", _listed(rings)))
    return _PlantFields(fields, arrays, structs)


def _parts(fields: dict[str, Any]) -> str:
    return c_literals.struct_with_arrays(fields or {"corner": 0.0}, "double")


def _listed(texts: Sequence[str]) -> str:
    return "{" + ", ".join(texts) + "}"


def nominals(machine: Machine, states: Sequence[str]) -> list[str]:
    """Return the typical size of each state of a plant in continuous time, in its unit."""
    if not states:
        return []
    travel = machine.clearance
    sizes = {"x": travel, "x_m": abs(machine.sensor.gain) * travel, "v": travel / own_time(machine)}
    sizes |= dict.fromkeys(plant_parts.between_magnet_and_rotor(machine), Typical.of(machine).force)
    values = (sizes.get(name, machine.amplifier.current_limit) for name in states)
    return [c_literals.number(value, "double") for value in values]
