"""The build of the C core for a model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache, partial
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import Precision, core_module
from ambkit.machine.placement_checks import OF_A_ROTOR
from ambkit.models.declaration import Part, Plan
from ambkit.models.machine_parts import compose, machine_parts, paper_pattern, printed, sampled
from ambkit.models.model import ENUMERATORS, ROLES, Model, compressed_rows
from ambkit.models.parts import SYNCHRONOUS
from ambkit.models.parts.speed_error import NAME
from ambkit.models.parts.synchronous import VAGUE

NODE = 0.02  #: Radians per sample between the speeds at which a scheduled model is computed.
GROWTH = 1e3  #: Acceleration for the transverse part of the unbalance force [rad/s^2].


NUMBERS = ("L", "b", "B_u", "h", "e", "r", "d", "c", "N", "rest")
"""Matrices of a model, in the order of the core."""


MOST_NUMBERS = 65536  #: Maximum number of a scheduled model's values: their indices have 16 bits.


PAPER_ROLES = ("position", "velocity", "disturbance force", "sensor")
"""Names of the states that are built in, compared first to avoid sampling most models."""

BUILT_IN: dict[Any, bool] = {}
"""Cache: whether models of a structure are built in; avoids sampling all but the first."""


class Nodes(NamedTuple):
    """A machine's model at successive speeds, for ``core/include/ambkit/turning.h``."""

    lowest: int  #: First node, in steps.
    step: float  #: Step between nodes [rad/s].
    still: Array  #: All values of the model (N,) at the machine's own speed.
    which: NDArray[np.intp]  #: Indices of those that depend on the speed (c,).
    at: Array  #: Their values at the nodes (nodes, c).
    grown: NDArray[np.intp]  #: Indices of those that depend on the acceleration (g,).
    by_growth: Array  #: Their derivatives at the nodes per rad/s^2 (nodes, g).


class Engine:
    """A build of the core, with the model of a machine."""

    def __init__(
        self,
        machine: Machine,
        precision: Precision,
        *,
        as_printed: bool = False,
        noise: bool = True,
        synchronous: Sequence[str] = (),
        parts: Callable[..., list[Part]] = machine_parts,
    ) -> None:
        self.machine = machine
        self.precision = precision
        self._made_of = parts, noise, tuple(synchronous)
        self.parts = parts
        self.turned = False  # whether the core's model was at another speed
        self._nodes: dict[int, tuple[Array, Array]] = {}  # by number of steps
        self.as_printed, self.noise, self.synchronous = as_printed, noise, tuple(synchronous)
        unknown = [name for name in synchronous if name not in SYNCHRONOUS]
        if unknown:
            known = " and ".join(SYNCHRONOUS)
            raise ValueError(f"synchronous must be some of {known}, got {unknown[0]!r}")
        if "unbalance" in synchronous and machine.rotor.type == "mass":
            raise ValueError(f"unbalance {OF_A_ROTOR}")
        if as_printed and not machine.single:
            raise ValueError(f"eq. 19 as printed has one axis; {machine.name} has several")
        plan = _plan(machine, *self._made_of)
        self.states, self.noises = tuple(plan.states), tuple(plan.noises)
        self.built_in = self._built_in(plan)
        self.core: ModuleType = core_module(precision, any_model=not self.built_in)
        check_size(self.core, plan, machine.name)
        if self.built_in:
            sensor = machine.sensor
            self.model_of_core: Any = self.core.Model(
                machine.sampling_time, machine.rotor.mass, sensor.gain, machine.lag_of(sensor),
                as_printed,
            )  # fmt: skip
        else:
            self.model_of_core = self.core.Model(arrays(self.model))

    def _built_in(self, plan: Plan) -> bool:
        """Return whether the model's pattern is built into the core as straight-line C."""
        if tuple(state.role for state in plan.states) != PAPER_ROLES or len(plan.noises) != 1:
            return False
        structure = plan.structure
        if structure not in BUILT_IN:
            own = self.model.pattern.items()
            BUILT_IN[structure] = all(np.array_equal(paper_pattern()[n], item) for n, item in own)
        return BUILT_IN[structure]

    def schedule_speeds(self, min_speed: float, max_speed: float) -> None:
        """Let the core's model follow any speed of rotation in a range [rad/s]."""
        # Its values are computed at speeds `NODE` radians per sample apart, with cubic
        # interpolation: synchronous states keep their phase to some 1e-8 rad per sample. The
        # transverse unbalance force is linear in the acceleration.
        nodes = self.nodes(min_speed, max_speed)
        node_arrays = {
            name: np.ascontiguousarray(
                values, np.uint16 if values.dtype == np.intp else self.precision
            )
            for name, values in nodes._asdict().items() if isinstance(values, np.ndarray)
        }  # fmt: skip
        self.model_of_core.nodes(nodes.lowest, nodes.step, **node_arrays)
        self.turned = True

    def synchronous_states(self) -> dict[str, Any] | None:
        """Return the synchronous states (``amb_speed_error``), or None."""
        # The random walk of each pair per sample is its own noise.
        states, noises = ([at.name for at in of] for of in (self.states, self.noises))
        if NAME not in states:
            return None
        parts, noise, synchronous = self._made_of
        pairs = []
        for part in parts(self.machine, noise=noise, synchronous=synchronous):
            if hasattr(part, "rotating"):
                first, _, order = part.rotating
                at, walk = states.index(first), noises.index(first.rsplit("_", 1)[0])
                pairs.append({
                    "state": at, "noise": walk, "order": float(order),
                    "power": 2.0 if self.states[at].role == "unbalance" else 0.0,
                    "usual": self.noises[walk].size ** 2,
                    "vague": VAGUE * self.states[at].size,
                })  # fmt: skip
        angle = self.machine.angle
        return {
            "state": states.index(NAME), "noise": noises.index(NAME), "pair": pairs,
            "reverses": angle is not None and angle.direction_assumed,
        }  # fmt: skip

    def nodes(self, min_speed: float, max_speed: float) -> Nodes:
        """Return the model at its nodes; for `schedule_speeds`."""
        step = NODE / self.machine.sampling_time
        lowest, highest = math.floor(min_speed / step) - 1, math.floor(max_speed / step) + 2
        results = [self._node(number, step) for number in range(lowest, highest + 1)]
        at, by_growth = (np.stack(item) for item in zip(*results, strict=True))
        grown = np.flatnonzero(by_growth.any(axis=0))
        changing = (at != at[0]).any(axis=0)
        changing[grown] = True
        which = np.flatnonzero(changing)
        still = numbers(self.model)
        if len(still) > MOST_NUMBERS:
            raise ValueError(
                f"{self.machine.name}: a model that turns has {MOST_NUMBERS} numbers at most; has "
                f"{len(still)}"
            )
        return Nodes(lowest, step, still, which, at[:, which], grown, by_growth[:, grown])

    def _node(self, number: int, step: float) -> tuple[Array, Array]:
        """Return the model's values at a node, and their derivatives by the acceleration."""
        # Cached, because runs of a campaign use the same nodes.
        if number not in self._nodes:
            there = self.machine.model_copy(update={"speed": number * step})
            parts, noise, synchronous = self._made_of
            parts_of = partial(parts, there, noise=noise, synchronous=synchronous)
            still, faster = (
                compose(parts_of(speeding=speeding), there.sampling_time, name="machine")
                for speeding in (0.0, GROWTH)
            )
            own = numbers(still)
            by_growth = np.zeros_like(own)
            grown = (faster.L - still.L)[still.pattern["L"] > 0] / GROWTH
            by_growth[: len(grown)] = grown  # L is the first
            self._nodes[number] = own, by_growth
        return self._nodes[number]

    def stand(self, estimator: Any) -> None:
        """Return the core's model, and an estimator, to the machine's own speed."""
        if self.turned:
            still = numbers(self.model).astype(self.precision)
            self.core.stand(estimator, self.model_of_core, still)
            self.turned = False

    @cached_property
    def model(self) -> Model:
        """The model as data, sampled on first use."""
        model = sampled(_plan(self.machine, *self._made_of), "machine")
        return printed(model) if self.as_printed else model

    def model_over(self, time: float) -> Model:
        """Return the model over another time [s]."""
        machine = self.machine.model_copy(update={"sampling_time": time})
        return sampled(_plan(machine, *self._made_of), "machine")


@lru_cache(maxsize=8)
def _plan(
    machine: Machine, parts: Callable[..., list[Part]], noise: bool, synchronous: tuple[str, ...]
) -> Plan:
    """Return the declarations of a machine's parts, cached for filters with other noise."""
    plan = Plan(machine.sampling_time)
    for part in parts(machine, noise=noise, synchronous=synchronous):
        plan.add(part)
    return plan


def check_size(core: ModuleType, plan: Plan, name: str) -> None:
    """Raise ValueError if a model is too large for the core."""
    if not hasattr(core, "MOST_STATES"):
        return
    for what, most in (
        ("states", core.MOST_STATES), ("forces", core.MOST_FORCES),
        ("measurements", core.MOST_SENSORS),
    ):  # fmt: skip
        count = len(getattr(plan, what))
        if count > most:
            raise ValueError(f"{name} has {count} {what}; estimators take {most} at most")


def numbers(model: Model) -> Array:
    """Return all values of a model in sequence, as in the core."""
    result = arrays(model)
    parts = (result[name] for name in NUMBERS)
    return np.concatenate([part[2] if isinstance(part, tuple) else part for part in parts])


def arrays(model: Model) -> dict[str, Any]:
    """Return a model for the core's loops (``ambkit/loops.h``)."""
    if unknown := [f"{at.name} has {at.role!r}" for at in model.states if at.role not in ROLES]:
        known = ", ".join(ROLES)
        raise ValueError(f"a state's role must be one of {known}; {', '.join(unknown)}")
    on = (model.pattern["h"] | model.pattern["e"] | model.pattern["r"]) > 0
    sensor_mask = np.array([state.role == "sensor" for state in model.states])
    upper = np.triu_indices(len(model.states))
    return {
        "states": len(model.states),
        "forces": len(model.forces),
        "controls": len(model.controls),
        "sensors": len(model.measurements),
        "noises": len(model.noises),
        **{
            name: compressed_rows(getattr(model, name), model.pattern[name] > 0)
            for name in ("L", "b", "B_u", "d", "c")
        },
        "h": compressed_rows(model.h, on),
        "e": model.e[on].tolist(),
        "r": model.r[on].tolist(),
        "N": compressed_rows(model.N[:, *upper], (model.pattern["N"] > 0)[:, *upper]),
        "rest": compressed_rows(model.rest, (model.pattern["rest"] > 0) & sensor_mask[:, None]),
        "role": [float(ENUMERATORS.index(ROLES[state.role])) for state in model.states],
    }
