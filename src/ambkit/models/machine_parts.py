"""A machine's parts, composed into its sampled model."""

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any

import numpy as np

from ambkit.machine.machine import Machine
from ambkit.models.declaration import Part, Plan
from ambkit.models.model import ONE, Model
from ambkit.models.parts import PARTS, ROTATION, SENSOR_NOISE, SYNCHRONOUS
from ambkit.models.parts.delay import Delay
from ambkit.models.parts.typical_sizes import Typical
from ambkit.models.sampling import Sampling


def compose(parts: Sequence[Part], T: float, *, name: str = "model") -> Model:
    """Return the model of a machine, sampled."""
    if not (np.isfinite(T) and T > 0):
        raise ValueError(f"T must be positive, is {T!r}")
    plan = Plan(T)
    for part in parts:
        plan.add(part)
    return sampled(plan, name)


def sampled(plan: Plan, name: str) -> Model:
    """Return the model of a plan, sampled and cached."""
    plan.check()
    return _sampled(pickle.dumps(plan), name)


@lru_cache(maxsize=256)
def _sampled(plan: bytes, name: str) -> Model:
    return Sampling(pickle.loads(plan)).model(name)


def machine_parts(
    machine: Any,
    *,
    noise: bool = True,
    delay: bool = True,
    synchronous: Sequence[str] = (),
    speeding: float = 0.0,
) -> list[Part]:
    """Return the parts of a machine, by its keys."""
    sizes = [Typical.of(machine.isolated_axis(axis.name)) for axis in machine.axes]
    kinds: list[Any] = [item for item in PARTS if delay or item is not Delay]
    parts: list[Part] = [part for kind in kinds for part in kind.of(machine, sizes)]
    for name in (item for item in SYNCHRONOUS if item in synchronous):
        parts += SYNCHRONOUS[name].of(machine, speeding)
    for kind in ROTATION if synchronous else ():
        parts += kind.of(machine, [part for part in parts if hasattr(part, "rotating")])
    for kind in SENSOR_NOISE if noise else ():
        parts += kind.of(machine, sizes)
    return parts


def machine_model(
    machine: Any, *, T: float | None = None, synchronous: Sequence[str] = ()
) -> Model:
    """Return the sampled model of a machine."""
    parts = machine_parts(machine, synchronous=synchronous)
    return compose(parts, machine.sampling_time if T is None else T, name="machine")


PAPER_STATES = ("x", "v", "f_d", "x_m")  #: Its states.

PAPER_CONSTANTS: Mapping[tuple[str, int, int], str] = {
    ("L", 0, 1): "T",
    ("h", 0, 1): "T_2",
    ("b", 1, 0): "T_m",
    ("b", 0, 0): "T2_2m",
    ("L", 3, 3): "a_sen",
    ("L", 3, 0): "b_sen",
    ("L", 3, 1): "c_sen",
    ("b", 3, 0): "d_sen",
    ("rest", 3, 0): "K_sen",
} | {("N0", i, j): f"N{i}{j}" for i in range(4) for j in range(i, 4) if (i, j) != (2, 2)}
"""Names in C of the constants of the paper's axis (eq. 15-21), in their order there."""


def printed(model: Model) -> Model:
    """Return the paper's axis as printed in eq. 15-21: effects within the sample are zero."""
    names = tuple(state.name for state in model.states)
    if names != PAPER_STATES:
        raise ValueError(f"as printed there are the states x, v, f_d and x_m, not {list(names)}")
    h, L, b = model.h.copy(), model.L.copy(), model.b.copy()
    h[0, 1] = L[3, 1] = b[3, 0] = 0.0
    return replace(model, h=h, L=L, b=b, N=(model.pattern["N"] == ONE).astype(float))


@cache
def paper_pattern() -> dict[str, Any]:
    """Return the pattern of the paper's axis."""
    return dict(machine_model(Machine.preset("zittau_axial").replace(sensor__gain=1.1)).pattern)
