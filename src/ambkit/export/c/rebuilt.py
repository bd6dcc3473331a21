"""Constants of a filter for other physical parameters: ``core/include/ambkit/rebuild.h``."""

from typing import Any

import numpy as np

from ambkit.estimate.core_model import NUMBERS, arrays
from ambkit.estimate.rebuild import Rebuild
from ambkit.export.c import c_literals
from ambkit.machine.axes import bias_forces
from ambkit.models.model import Model

SOURCES = ("src/rebuild.c", "src/sampling.c", "src/transition.c")
TEMPLATES = {"{}_rebuild.h": "rebuild.h", "{}_rebuild.c": "rebuild.c"}

_TYPES: dict[str, Any] = {
    "row": np.uint16, "column": np.uint16, "use": np.uint8, "value": np.uint16, "k_i": np.uint16,
    "intensity": np.uint16, "operation": np.uint8, "left": np.uint16, "right": np.uint16,
    "from": np.uint32, "low": float, "high": float, "constant": float,
}  # fmt: skip
_IN_C = {np.uint8: "unsigned char", np.uint16: "unsigned short", np.uint32: "unsigned int"}


def context(export: Any) -> dict[str, Any]:
    """Return the template variables of parameters and model."""
    engine = export.filter.engine
    of = Rebuild.of(
        engine.machine, parts=engine.parts, noise=engine.noise, synchronous=engine.synchronous
    )
    fields, places = of.fields, _places(engine.model)
    n, size = fields["states"], fields["states"] + 3 * fields["forces"] + fields["controls"]
    slots = len(of.names) + len(fields["constant"]) + len(fields["operation"])
    # As in amb_rebuild_room and AMB_SAMPLING_WORK.
    room = 8 * size**2 + 2 * size + fields["noises"] * n * (n + 1)
    return {
        "parameters": list(of.names),
        "exported": c_literals.array(of.values, "double"),
        "arrays": [_array(name, fields[name], kind) for name, kind in _TYPES.items()],
        "late": [
            (control, _array(f"past_{k}", past, np.uint16), f"{share:.17g}")
            for k, (control, past, share) in enumerate(fields["late"])
        ],
        "T": f"{fields['T']:.17g}",
        **{name: fields[name] for name in ("states", "forces", "controls", "noises")},
        "counts": {name: len(fields[name]) for name in ("constant", "operation", "value", "from")},
        "room": room + slots + len(fields["value"]) + len(fields["k_i"]),
        "places": {field: place for field, (place, _) in places.items()},
        "sizes": {field: count for field, (_, count) in places.items()},
        "settings": list(_settings(export, of.names)),
    }


def _array(name: str, values: Any, kind: Any) -> dict[str, Any]:
    text = c_literals.array(np.array(values or [0], kind), "double")
    return {
        "name": f"rebuild_{name}",
        "type": _IN_C.get(kind, "double"),
        "length": len(values),
        "text": text,
    }


def _places(model: Model) -> dict[str, tuple[int, int]]:
    """Return the start of each matrix's values, and their count, by field of the model."""
    at, parts = 0, arrays(model)
    places: dict[str, tuple[int, int]] = {}
    for name in NUMBERS:
        part = parts[name]
        plain = not isinstance(part, tuple)
        if count := len(part if plain else part[2]):
            places[name if plain else f"{name}.value"] = at, count
        at += count
    return places


def _settings(export: Any, names: tuple[str, ...]) -> Any:
    """Yield the settings that depend on a parameter, as statements."""
    filter, machine = export.filter, export.filter.machine
    for name in ("gain", "lag"):
        field = {"gain": "K_sen"}.get(name, name)
        for r, reading in enumerate(machine.readings):
            key = f"{name}_{reading.sensor.name}" if reading.sensor.name else name
            if key in names:
                yield f"set.{field}[{r}] = (amb_real)parameters[{names.index(key)}];"
    bias = np.array(bias_forces(filter.magnet, machine))
    carried = np.asarray(filter.core.parameters["set"]["f_0"], float) - bias
    for f, force in enumerate(carried if "mass" in names else ()):
        if force:
            mass = names.index("mass")
            heavier = f"parameters[{mass}] / exported[{mass}] - 1.0"
            yield f"set.f_0[{f}] += (amb_real)({force:.17g} * ({heavier}));"
