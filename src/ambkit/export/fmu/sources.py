"""The C of an FMU: the core, the model around it, the FMI layer, and the data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.errors import AmbkitError
from ambkit.export import core
from ambkit.export.c import data
from ambkit.export.c.exporter import MAGNETS
from ambkit.export.fmu.variables import Kind
from ambkit.export.fmu.xml import Fmi, Model
from ambkit.magnets import core_module

if TYPE_CHECKING:
    from ambkit.estimators import KalmanFilter

_HERE = Path(__file__).parent
_MODELS: dict[Kind, str] = {
    "estimator": "estimator_model",
    "plant": "plant_model",
    "closed-loop": "loop_model",
}
_STANDARD: dict[Fmi, tuple[str, ...]] = {
    2: ("fmi2FunctionTypes.h", "fmi2Functions.h", "fmi2TypesPlatform.h"),
    3: ("fmi3FunctionTypes.h", "fmi3Functions.h", "fmi3PlatformTypes.h"),
}


def core_sources(*names: str) -> dict[str, str]:
    """Return files of the core and their headers, as they lie in ``sources/``.

    Headers keep the names by which they are included, so that ``sources/`` is the one folder that
    a compiler must know.
    """
    return {
        name.removeprefix("include/").replace("src/", "core/"): text
        for name, text in core.closure(names).items()
    }


def model_files(kind: Kind, fmi: Fmi) -> dict[str, str]:
    """Return the hand-written C around the core, and the standard's headers."""
    name = _MODELS[kind]
    own = ["model.h", f"{name}.h", f"{name}.c", "instance.h", "instance.c", f"fmi{fmi}.c"]
    if kind != "estimator":
        own += ["rig.h", "rig.c"]
    texts = {file: (_HERE / "c" / file).read_text(encoding="utf-8") for file in own}
    for file in _STANDARD[fmi]:
        texts[file] = (_HERE / "standard" / file).read_text(encoding="utf-8")
    texts["fmi-standard-licence.txt"] = (_HERE / "standard" / "LICENSE.txt").read_text("utf-8")
    return texts


def description_files(kind: Kind, model: Model) -> dict[str, str]:
    """Return the table of the variables, in C."""
    context = {
        "kind_header": f"{_MODELS[kind]}.h",
        "variables": model.variables,
        "version": model.version,
        "token": model.token,
        "sampling_time": data.number(model.sampling_time, "double"),
    }
    return {
        "description.h": rendered("description.h.j2", context),
        "description.c": rendered("description.c.j2", context),
    }


def filter_data(estimator: KalmanFilter) -> dict[str, Any]:
    """Return what the data file says of an estimator."""
    if estimator.precision != "float64":
        raise AmbkitError(f'an FMU computes in "float64", the estimator in {estimator.precision!r}')
    magnet = estimator.source.magnet(core_module())
    kind, fields = MAGNETS[type(magnet).__name__], magnet.parameters
    arrays = data.arrays_of(fields)
    names = {path: path.replace(".", "_") for path in arrays}
    return {
        "settings": data.struct(estimator.core.parameters["set"], "double", {}),
        "std": data.array(np.asarray(estimator._default_std()), "double"),
        "magnet": data.struct(fields, "double", names),
        "magnet_type": kind.type,
        "magnet_methods": kind.methods,
        "magnet_source": f"src/{kind.source}.c",
        "magnet_header": f"ambkit/{kind.source}.h",
        "arrays": [
            {
                "name": names[path],
                "type": "amb_stiffness" if values.ndim == 2 else "amb_real",
                "length": len(values),
                "text": data.array(values, "double"),
            }
            for path, values in arrays.items()
        ],
    }


def compiled_files(files: Sequence[str] | dict[str, str]) -> tuple[str, ...]:
    """Return those that are compiled."""
    return tuple(sorted(name for name in files if name.endswith(".c")))


def rendered(template: str, context: dict[str, Any]) -> str:
    """Fill in a template of this package."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(_HERE / "templates"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=template.endswith(".html.j2"),
    )
    environment.filters["number"] = lambda value: data.number(value, "double")
    return environment.get_template(template).render(context)
