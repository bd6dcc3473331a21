"""Model of an estimator in C: built in, its own straight-line header, or loops over arrays."""

from collections.abc import Sequence
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.estimate.core_model import NUMBERS, Nodes, arrays
from ambkit.estimate.estimator import Estimator
from ambkit.export.c.c_literals import Name
from ambkit.models import emit
from ambkit.models.model import Descriptor, Model

#: Maximum number of states for which straight-line code is smaller and faster than loops.
MOST_UNROLLED = 12

BUILT_IN = "generated/model.h"
LOOPS = "include/ambkit/loops.h"


class CModel(NamedTuple):
    """A model in an export."""

    instead: dict[str, str | None]  # files of the core with another text, or omitted
    sources: tuple[str, ...]  # further files of the core
    numbers: dict[str, Any]  # fields of the struct amb_model
    arrays: dict[str, NDArray[Any]]  # that these point to, by their names
    room: dict[str, int]  # the counts that loops have room for
    turning: dict[str, Any] | None = None  # fields of the struct amb_turning, if there is one


def c_model(
    filter: Estimator, *, loops: bool | None = None, speeds: tuple[float, float] | None = None
) -> CModel:
    """Return an estimator's model in C."""
    engine = filter.engine
    if engine.built_in:
        if loops:
            raise AmbkitError("the paper's axis has straight-line code; loops are for other models")
        return CModel({LOOPS: None}, (), filter.core.parameters["model"], {}, {})
    model = engine.model
    if speeds is not None:
        if loops is False:
            raise AmbkitError("a model that follows the speed of rotation is computed by loops")
        return turning(loop_model(model), engine.nodes(*speeds))
    if loops if loops is not None else len(model.states) > MOST_UNROLLED:
        return loop_model(model)
    names = emit.Names(model)
    what = "One axis" if filter.view.single else "A machine"
    about = f"{what}: {', '.join(state.name for state in model.states)}"
    rings = filter.nominal.rings if names.p > 1 else None
    header = emit.header(names, about, by=f"ambkit {version('ambkit')}", rings=rings)
    return CModel({LOOPS: None, BUILT_IN: header}, (), emit.constants(names, model), {}, {})


def loop_model(model: Model) -> CModel:
    """Return a model of any size for ``ambkit/loops.h``."""
    fields: dict[str, Any] = {}
    held: dict[str, NDArray[Any]] = {}
    for name, value in arrays(model).items():
        if isinstance(value, int):
            fields[name] = value
        elif isinstance(value, tuple):
            fields[name], parts = sparse(f"model_{name}", value)
            held |= parts
        else:
            held[f"model_{name}"] = _array(value, name)
            fields[name] = Name(f"model_{name}")
    counts = ("states", "forces", "controls", "sensors", "noises")
    room = {name.upper(): fields[name] for name in counts}
    return CModel({BUILT_IN: None}, ("src/loops.c", "src/covariance_loops.c"), fields, held, room)


def turning(of: CModel, nodes: Nodes) -> CModel:
    """Return a model by loops with contiguous values, and their dependence on the speed."""
    numbers, arrays, at = dict(of.numbers), dict(of.arrays), 0
    for name in NUMBERS:
        plain = name in ("e", "r")
        array_name = f"model_{name}" if plain else f"model_{name}_value"
        there = f"&model_still[{at}]"
        if not plain:
            there = f"{{model_{name}_start, model_{name}_column, {there}}}"
        numbers[name] = Name(there)
        empty = not plain and not int(arrays[f"model_{name}_start"][-1])
        at += 0 if empty else len(arrays[array_name])
        del arrays[array_name]
    arrays |= {
        "model_still": nodes.still, "model_which": nodes.which.astype(np.uint16),
        "model_at": nodes.at.ravel(), "model_grown": _array(nodes.grown.tolist(), "grown"),
        "model_by_growth": _array(nodes.by_growth.ravel().tolist(), "by_growth"),
    }  # fmt: skip
    node_fields = {
        "nodes": len(nodes.at), "numbers": len(nodes.still), "changing": len(nodes.which),
        "growing": len(nodes.grown), "lowest": nodes.lowest, "step": nodes.step,
        "still": Name("model_still"), "which": Name("model_which"), "at": Name("model_at"),
        "grown": Name("model_grown"), "by_growth": Name("model_by_growth"),
    }  # fmt: skip
    return of._replace(
        sources=(*of.sources, "src/turning.c", "src/synchronous.c", "src/direction.c"),
        numbers=numbers,
        arrays=arrays,
        turning=node_fields,
    )


def sparse(name: str, rows: Sequence[Any]) -> tuple[Name, dict[str, NDArray[Any]]]:
    """Return a matrix by its rows as a struct, and its arrays."""
    parts = dict(zip(("start", "column", "value"), rows, strict=True))
    arrays = {f"{name}_{part}": _array(at, part) for part, at in parts.items()}
    return Name("{" + ", ".join(arrays) + "}"), arrays


def _array(values: Sequence[float], what: str) -> NDArray[Any]:
    """Return an array with its C type, with one zero if it is empty."""
    places = dict.fromkeys(("start", "column", "grown"), np.uint16)
    return np.array(values or [0], dtype=(places | {"role": np.uint8}).get(what, np.float64))


class State(NamedTuple):
    """A state in the estimates."""

    field: str
    about: str
    equilibrium: str
    load: bool


OF_PAPER = {
    "x": "displacement of the rotor [m]",
    "v": "its velocity [m/s]",
    "f_d": "disturbance force [N]",
    "x_m": "sensor output without noise [m]",
}
OTHERS = ("k_i", "k_s", "innovation", "variance", "feed_back")  #: Further fields of the estimates.


def states(described: Sequence[Descriptor], current: str = "AMB_C(0.0)") -> list[State]:
    """Return the states in the struct of the estimates."""
    equilibrium = {"position": "x", "sensor": "x_m", "current": current, "past control": current}
    return [
        State(
            state.name + "_" * (state.name in emit.KEYWORDS or state.name in OTHERS),
            OF_PAPER.get(state.name, f"{state.role} [{state.unit}]"),
            equilibrium.get(state.role, "AMB_C(0.0)"),
            state.role == "disturbance force",
        )
        for state in described
    ]
