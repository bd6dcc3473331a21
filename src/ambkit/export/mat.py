"""``ambkit export mat``: model, noise, stiffness tables and expert for MATLAB."""

import math
import os
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base import files
from ambkit.base.arrays import Array
from ambkit.base.config import Part
from ambkit.base.errors import AmbkitError
from ambkit.estimate.estimator import Estimator
from ambkit.export.stiffness_table import tabulate
from ambkit.fuzzy.expert import Expert
from ambkit.judge.adequacy import require_adequate
from ambkit.machine.axes import constant_stiffness, models_of
from ambkit.machine.forces.patches import PatchedForce
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module
from ambkit.machine.parts import FILES
from ambkit.machine.stiffness import stiffness_map

_HEADER = 116  # bytes of text at the start of a MAT-file, with SciPy's date


def export_mat(
    machine: Machine, filter: Estimator, out: str | os.PathLike[str], *, force: bool = False
) -> dict[str, Any]:
    """Write a reproducible MAT-file (version 5)."""
    from scipy.io import savemat

    if any(isinstance(magnet, PatchedForce) for magnet in models_of(filter.magnet)):
        raise AmbkitError(
            "filter: a MAT-file holds an expert; a force map goes into the machine, as its "
            "force_map, and its tables along"
        )
    require_adequate(filter, machine, force=force)
    content = variables(filter)
    text = f"MATLAB 5.0 MAT-file, written by ambkit {version('ambkit')}"
    with files.replacing(out) as temporary:
        savemat(temporary, content, appendmat=False, oned_as="row")
        with temporary.open("r+b") as file:
            file.write(text.encode().ljust(_HEADER))
    return content


def variables(filter: Estimator) -> dict[str, Any]:
    """Return the content of the file by names in MATLAB; all in SI."""
    machine = filter.machine
    single, inputs = machine.single, {"y": filter.inputs.y, "u": filter.inputs.u}
    axes = dict(zip(machine.axis_names, filter.view.isolated, strict=True))
    experts = {
        name: magnet if isinstance(magnet, Expert) else None
        for name, magnet in zip(axes, models_of(filter.magnet), strict=True)
    }
    described = machine.tables() | ({"sensor": machine.sensor.tables()} if single else {})
    tables = {name: _tables(axis, experts[name]) for name, axis in axes.items()}
    rules = {name: _expert(expert) for name, expert in experts.items() if expert is not None}
    content: dict[str, Any] = _model(filter) | {
        "states": np.array([state.name for state in filter.states], dtype=object),
        "tables": tables[""] if single else tables,
        "bearing" if single else "machine": _fields(described),
        "inputs": {
            name: {"gain": item.gain, "zero": item.zero, "unit": item.unit}
            for name, item in inputs.items()
        },
        "about": f"{machine.name}, written by ambkit {version('ambkit')}; SI units",
    }
    return content | ({"expert": rules[""] if single else rules} if rules else {})


def _model(filter: Estimator) -> dict[str, Any]:
    """Return the matrices of the filter's model."""
    k: Any = models_of(constant_stiffness(filter.machine))
    parameters = filter.core.parameters
    held = parameters["set"]
    model = filter.linear_model(np.array([one.k_i for one in k]), np.array([one.k_s for one in k]))
    return {
        "A": model.A,
        "B": model.B,
        "C": model.H,
        "D": 0.0,
        "E": model.E,
        "Q": model.B * np.array(held["var_u"]) @ model.B.T + _symmetric(parameters["growth"]),
        "R": model.R,
        "P0": np.diag(np.square(filter.default_std())),
        "T": held["T"],
        "f_0": held["f_0"][0] if len(held["f_0"]) == 1 else np.array(held["f_0"]),
    }


def _symmetric(triangle: Array) -> Array:
    """Return the matrix of an upper triangle, row by row."""
    n = math.isqrt(2 * len(triangle))
    matrix = np.zeros((n, n))
    matrix[np.triu_indices(n)] = triangle
    return matrix + np.triu(matrix, 1).T


def _tables(machine: Machine, expert: Expert | None) -> dict[str, Any]:
    """Return stiffnesses like the paper's Tables 4 and 5, or those of an expert within a bound."""
    stiff: Any
    if expert is None:
        stiff, bound = stiffness_map(machine), {}
    else:
        stiff = tabulate(expert, machine, precision="float64")
        bound = {"force_bound": stiff.bound}
    iu, x = np.meshgrid(stiff.current, stiff.displacement)
    # Of the table itself, without the static force at the centre.
    return {
        "current": stiff.current,
        "displacement": stiff.displacement,
        "k_i": stiff.k_i,
        "k_s": stiff.k_s,
        "force": stiff.k_i * iu + stiff.k_s * x,
    } | bound


def _fields(described: Part | Mapping[str, Any]) -> dict[str, Any]:
    """Return all values of a description, recursively; files without their folders."""
    values = dict(described)
    entries = {name: value for name, value in values.items() if value not in (None, ())}
    return {
        name: Path(value).name if name in FILES else _in_matlab(value)
        for name, value in entries.items()
    }


def _in_matlab(value: Any) -> Any:
    """Return a description as a struct, several as an array of structs, the rest unchanged."""
    if isinstance(value, Part | Mapping):
        return _fields(value)
    if not isinstance(value, tuple):
        return value
    rows = [_fields(item) for item in value]
    return np.array([tuple(row.values()) for row in rows], [(name, object) for name in rows[0]])


def _expert(expert: Expert) -> dict[str, Any]:
    """Return the rules of the network (paper, eq. 32, 33), in scaled units where named so."""
    held = expert.in_core(core_module()).parameters
    return {
        "centre_current": held["centre_iu"] / held["per_ampere"],
        "centre_displacement": held["centre_x"] / held["per_metre"],
        "per_ampere": held["per_ampere"],
        "per_metre": held["per_metre"],
        "width_k_i": np.sqrt(0.5 / held["k_i"]["sharpness"]),
        "width_k_s": np.sqrt(0.5 / held["k_s"]["sharpness"]),
        "weight_k_i": held["k_i"]["weight"],
        "weight_k_s": held["k_s"]["weight"],
        "normalised": held["normalised"],
        "current_range": np.array([held["iu_min"], held["iu_max"]]),
        "displacement_range": np.array([held["x_min"], held["x_max"]]),
        "source": expert.source,
    }
