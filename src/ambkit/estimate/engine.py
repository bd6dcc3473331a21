"""From a model as data to the build of the C core that computes with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.machine.bearing import Bearing
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import Precision, core_module
from ambkit.models import axis_model, axis_parts
from ambkit.models.axis import PAPER_STATES
from ambkit.models.machine import SYNCHRONOUS, machine_model, machine_parts
from ambkit.models.model import Descriptor, Model, compressed_rows
from ambkit.models.plan import Part, Plan
from ambkit.models.roles import ENUMERATORS, ROLES

if TYPE_CHECKING:
    from ambkit.estimate.noise import Variances

Array = NDArray[np.float64]

NODE = 0.02
"""Radians a sample between the speeds at which a model that turns is computed."""
GROWTH = 1e3
"""Growth of the speed by which it is told what unbalance does across [rad/s^2]."""


class Engine:
    """A build of the core, and the model of a bearing or a machine in it.

    Parameters
    ----------
    bearing : Bearing or Machine
        Whose parts decide: the paper's axis is built in, all else runs by loops over its model.
    precision : {"float64", "float32"}
        What it computes in.
    as_printed : bool
        Eq. 19 as the paper prints it.
    noise : bool
        Whether sensor noise with a memory is among the states.
    synchronous : sequence of str
        What turns with a machine's rotor and is among the states: unbalance, runout.

    Raises
    ------
    ValueError
        As printed, with parts that the paper does not have; more states, axes or readings than
        the core has room for.
    """

    def __init__(
        self,
        bearing: Bearing | Machine,
        precision: Precision,
        *,
        as_printed: bool = False,
        noise: bool = True,
        synchronous: Sequence[str] = (),
    ) -> None:
        self.bearing: Any = bearing
        self.turned = False  # whether the core's model has been at another speed
        self._nodes: dict[int, tuple[dict[str, Any], list[float]]] = {}  # by number of steps
        self.as_printed, self.noise, self.synchronous = as_printed, noise, tuple(synchronous)
        unknown = [name for name in synchronous if name not in SYNCHRONOUS]
        if unknown:
            known = " and ".join(SYNCHRONOUS)
            raise ValueError(f"synchronous must be some of {known}, got {unknown[0]!r}")
        if synchronous and not isinstance(bearing, Machine):
            raise ValueError("synchronous states are of a whole machine, not of one axis")
        if isinstance(bearing, Machine) and as_printed:
            raise ValueError("as printed there is one axis, not a whole machine")
        plan = Plan(bearing.sampling_time)
        for part in parts_of(bearing, noise=noise, synchronous=synchronous):
            plan.add(part)
        self.states, self.noises = tuple(plan.states), tuple(plan.noises)
        self.built_in = tuple(state.name for state in plan.states) == PAPER_STATES
        self.core: ModuleType = core_module(precision, any_model=not self.built_in)
        check_room(self.core, plan, bearing.name)
        if self.built_in and isinstance(bearing, Bearing):
            self.model_of_core: Any = self.core.Model(
                bearing.sampling_time, bearing.rotor.mass, bearing.sensor.gain,
                bearing.sensor_lag, as_printed,
            )  # fmt: skip
        else:
            self.model_of_core = self.core.Model(arrays(self.model))

    def let_turn(self, slowest: float, fastest: float) -> None:
        """Let the core's model take any speed of rotation between two [rad/s].

        Its numbers are computed at speeds `NODE` of a radian a sample apart, and interpolated by
        cubics in between: what turns then keeps its phase to some 1e-8 rad a sample. What unbalance
        does across while the speed grows is linear in that growth.
        """
        step = NODE / self.bearing.sampling_time
        lowest = math.floor(slowest / step)
        count = max(4, math.ceil(fastest / step) - lowest + 1)
        at, growing = zip(
            *(self._node(number, step) for number in range(lowest, lowest + count)), strict=True
        )
        self.model_of_core.nodes(lowest * step, step, list(at), list(growing))
        self.turned = True

    def _node(self, number: int, step: float) -> tuple[dict[str, Any], list[float]]:
        """Return the model's arrays at a node, and what growth of the speed does there.

        They are kept, as one run of a campaign after the other asks for the same nodes.
        """
        if number not in self._nodes:
            there = self.bearing.model_copy(update={"speed": number * step})
            still, faster = (
                machine_model(
                    there, noise=self.noise, synchronous=self.synchronous, speeding=speeding
                )
                for speeding in (0.0, GROWTH)
            )
            grown = (faster.L - still.L)[still.pattern["L"] > 0] / GROWTH
            self._nodes[number] = arrays(still), grown.tolist()
        return self._nodes[number]

    def stand(self, estimator: Any) -> None:
        """Let the core's model be of the machine's own speed again, and an estimator of it."""
        if self.turned:
            self.core.stand(estimator, self.model_of_core, arrays(self.model))
            self.turned = False

    @cached_property
    def model(self) -> Model:
        """The model as data, sampled when it is first asked for."""
        if isinstance(self.bearing, Machine):
            return machine_model(self.bearing, noise=self.noise, synchronous=self.synchronous)
        return axis_model(self.bearing, as_printed=self.as_printed, noise=self.noise)


def parts_of(
    bearing: Bearing | Machine, *, noise: bool = True, synchronous: Sequence[str] = ()
) -> list[Part]:
    """Return the parts of a bearing or of a whole machine."""
    if isinstance(bearing, Machine):
        return machine_parts(bearing, noise=noise, synchronous=synchronous)
    return axis_parts(bearing, noise=noise)


def check_room(core: ModuleType, plan: Plan, name: str) -> None:
    """Raise ValueError where a model is larger than the core has room for."""
    if not hasattr(core, "MOST_STATES"):
        return
    for what, most in (
        ("states", core.MOST_STATES), ("forces", core.MOST_FORCES),
        ("measurements", core.MOST_SENSORS),
    ):  # fmt: skip
        count = len(getattr(plan, what))
        if count > most:
            raise ValueError(f"{name} has {count} {what}; estimators take {most} at most")


class Sizes(NamedTuple):
    """The most that a rotor between its stops can do, for the states' caps."""

    position: float
    velocity: float
    force: float

    @classmethod
    def of(cls, bearing: Bearing) -> Sizes:
        """A tenth of the travel in a sample, and the force that does that within one."""
        T, travel = bearing.sampling_time, bearing.rotor.travel_limit
        velocity = 0.1 * (travel / T)
        return cls(travel, velocity, bearing.rotor.mass * (velocity / T))


def caps(bearing: Bearing, states: Sequence[Descriptor]) -> list[float]:
    """Return the most that each state can be (``ambkit/envelope.h``)."""
    most, current = Sizes.of(bearing), 10 * bearing.amplifier.current_limit
    by_role = {
        "position": most.position,
        "velocity": most.velocity,
        "disturbance force": most.force,
        "sensor": 3 * abs(bearing.sensor.gain) * most.position,
        "current": current,
        "past control": current,
    }
    return [by_role.get(state.role, 30 * state.size) for state in states]


def core_settings(engine: Engine, variances: Variances) -> dict[str, Any]:
    """Return what the core is told of a bearing, but for known forces and limits of judgement."""
    bearing = engine.bearing
    T, travel = bearing.sampling_time, bearing.rotor.travel_limit
    return {
        "T": T,
        "K_sen": [bearing.sensor.gain],
        "lag": [bearing.sensor_lag],
        "travel": [travel],
        "k_ui": [bearing.amplifier.gain],
        "iu_min": [bearing.current_min],
        "iu_max": [bearing.current_max],
        "x_max": [travel],
        "cap": caps(bearing, engine.states),
        "var_u": [variances.control],
        "var_d": variances.growth(T, engine.noises),
        "var_y": [variances.measurement],
        "rise": [bearing.sensor.noise_rise],
    }


def arrays(model: Model) -> dict[str, Any]:
    """Return a model as the core's loops want it (``ambkit/loops.h``).

    Raises
    ------
    ValueError
        It has a state of a role that the core does not know.
    """
    unknown = [state.name for state in model.states if state.role not in ROLES]
    if unknown:
        raise ValueError(f"states of unknown roles: {', '.join(unknown)}")
    on = (model.pattern["h"] | model.pattern["e"] | model.pattern["r"]) > 0
    shown = np.array([state.role == "sensor" for state in model.states])
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
        "rest": compressed_rows(model.rest, (model.pattern["rest"] > 0) & shown[:, None]),
        "role": [float(ENUMERATORS.index(ROLES[state.role])) for state in model.states],
    }
