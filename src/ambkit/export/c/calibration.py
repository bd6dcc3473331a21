"""Calibration at run time: ``core/include/ambkit/calibration.h``."""

import itertools
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.threads import one_thread
from ambkit.control.control_candidates import highest_sensitivity
from ambkit.control.controller_states import Controller
from ambkit.control.linear.linear_controller import compensator, controllers, fed
from ambkit.control.linear.linear_plant import OperatingPoint
from ambkit.control.linear.steady_state_filter import estimator_at
from ambkit.data.signals import signal
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.noise_model import FilterNoise
from ambkit.export.c import c_literals
from ambkit.export.c.c_literals import Constants, CPrecision, Name
from ambkit.export.c.controller_test_cases import speeds_of
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.machine.axes import bias_forces
from ambkit.machine.magnets import ConstantStiffness
from ambkit.simulation.scenario import Scenario

PEAK = 4.0
"""Limit of abs(S): the end of zone B of ISO 14839-3, or 10 % above that of the exported values."""

WIDEST = {
    "var_y": (0.01, 100.0), "var_u": (0.01, 100.0), "var_d": (0.01, 100.0),
    "mass": (0.5, 2.0), "strong": (0.5, 2.0),
    "kp": (0.33, 3.0), "ki": (0.1, 10.0), "kd": (0.33, 3.0), "T_f": (0.2, 5.0),
}  # fmt: skip
"""Maximum range, over the exported values."""

SHARES = np.arange(0.05, 1.001, 0.05)  #: Candidate logarithms of the range, smallest first.

#: Minimum gate in standard deviations: a smaller one rejects healthy measurements.
GATE = (4.0, 100.0)
TRACKING = (0.2, 5.0)  #: Range of the tracking time, over the exported one; see `LEAST_TRACKING`.

LEAST_TRACKING = 10

SIGMAS = (6.0, 3.0)
"""Standard deviations of position and current due to the sensor's noise that must fit the
clearance, and the current range beside the levitation current. If the exported values exceed it,
5 % more than theirs.
"""

DIGITS = 3
RANDOM, SEED = (8, 8), 1  #: Filters at random corners, and gains for each, with several axes.


class Number(NamedTuple):
    """A value that can be calibrated."""

    kind: str  #: Name of its ``amb_parameter``.
    position: int  #: Index of its sensor, control, noise, magnet or PID.
    name: str  #: Name with its kind and object: ``kp_A1``.
    exported: float


class Limits(NamedTuple):
    """Limits of each value, in the order of ``amb_parameter``, and their peak of abs(S)."""

    low: dict[str, float]
    high: dict[str, float]
    peak: float


Parts = dict[str, float]  #: Factors on the exported values by name; others are 1.


@one_thread()
def _widest(controller: Controller, numbers: Sequence[Number]) -> tuple[Parts, Parts, float]:
    """Return the ends of all factors, and the highest peak of abs(S) within them."""
    loops = _Loops(controller, numbers)
    varied = [number for number in numbers if number.kind in WIDEST]
    low: Parts = {}
    high: Parts = {}
    peak = loops.peak(low, high)
    most = max(PEAK, 1.1 * peak)
    for share in SHARES:
        ends = [{at.name: WIDEST[at.kind][k] ** share for at in varied} for k in (0, 1)]
        wider = loops.peak(ends[0], ends[1], most)
        if not wider <= most:
            break
        low, high, peak = ends[0], ends[1], wider
    return low, high, peak


def _limit(number: Number, part: float, end: int, controller: Controller) -> float:
    """Return the lower or the upper limit of a value."""
    value = number.exported
    if number.kind in WIDEST:
        return value if part == 1.0 else _rounded(part * value, up=end == 0)
    sampled = LEAST_TRACKING * controller.plant.machine.sampling_time
    return {
        "gate": (min(GATE[0], value), max(GATE[1], value)),
        "T_t": (min(value, max(sampled, TRACKING[0] * value)), TRACKING[1] * value),
        "weight": (0.0, max(1.0, value)),
    }[number.kind][end]


def _rounded(value: float, up: bool) -> float:
    """Return a limit with few digits, rounded inwards."""
    if value == 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - DIGITS + 1)
    unit_count = math.ceil(value / unit) if up else math.floor(value / unit)
    return float(f"{unit_count * unit:.{DIGITS}g}")


class _Loops:
    """The loop of a controller with other values than the exported."""

    def __init__(self, controller: Controller, numbers: Sequence[Number]) -> None:
        self.controller, self.numbers = controller, numbers
        machine, isolated = controller.plant.machine, controller.plant.isolated
        point = OperatingPoint.nearest(isolated[0]) if machine.single else None
        self.of = LoopBuilder(machine, point=point, law=controller.law)
        self.gains = np.array([b.amplifier.gain for b in isolated])
        room = [
            min(b.current_max - iu, iu - b.current_min)
            for b, iu in zip(isolated, np.atleast_1d(self.of.point.iu), strict=True)
        ]
        travel = [b.clearance for b in isolated]
        self.room = np.concatenate([np.array(travel) / SIGMAS[0], np.array(room) / SIGMAS[1]])
        self.share = math.inf
        self.share = max(1.0, 1.05 * self._worst({}, {}, math.inf)[1])

    def peak(self, low: Parts, high: Parts, most: float = math.inf) -> float:
        """Return the highest peak of abs(S) over all corners; infinite beyond `most`."""
        # Infinite if one is unstable, or if noise exceeds its limits.
        return self._worst(low, high, most)[0]

    def _worst(self, low: Parts, high: Parts, most: float) -> tuple[float, float]:
        """Return the highest peak of abs(S), and the largest utilisation by noise [1]."""
        measured = not self.controller.fed
        noise, worst, share = self.of.noise()[0], 0.0, 0.0
        readings = self.of.plant.outputs[: len(noise)]
        for parts, gains in self._corners(low, high):
            E = None if measured else self._filter(parts)
            for by in gains:
                law = self._law(by)
                K = compensator(law, E, self.controller.law.measured, readings)
                loop = self.of.around(K)
                worst = max(worst, highest_sensitivity(loop, loop.nyquist))
                if not worst <= most:
                    return math.inf, math.inf
                moved = loop.noise_covariance(noise, np.zeros(len(self.gains)))
                size = np.sqrt(np.diag(moved))
                size[len(self.gains) :] *= self.gains
                share = max(share, float((size / self.room).max()))
                if not share <= self.share:
                    return math.inf, math.inf
        return worst, share

    def _corners(self, low: Parts, high: Parts) -> Iterator[tuple[Parts, list[Parts]]]:
        """Yield factors of a filter's values, with all factors of the gains for each."""
        measured, axes = not self.controller.fed, range(len(self.gains))
        gains = ("kp", "ki", "kd", *(("T_f",) if measured else ()))
        own = [at for at in self.numbers if at.kind in ("strong", *gains)]
        groups = [list(self.numbers)]
        if len(axes) > 1 and low:
            groups += [[at for at in own if at.position == k] for k in axes]
        for group in groups:
            noisy = any(at.kind == "var_y" for at in group)
            filters = [{}] if measured else [
                _parts(group, {"mass": m, "strong": s} | noise)
                for m, s in itertools.product((low, high), repeat=2)
                for noise in ({"var_y": low, "var_u": high, "var_d": high},
                              {"var_y": high, "var_u": low, "var_d": low})[: 1 + noisy]
            ]  # fmt: skip
            all_gains = [
                _parts(group, dict(zip(gains, ends, strict=True)))
                for ends in itertools.product((low, high), repeat=len(gains))
            ]
            for one in _different(filters):
                yield one, _different(all_gains)
        if len(axes) > 1 and low:
            yield from self._random(low, high)

    def _random(self, low: Parts, high: Parts) -> Iterator[tuple[Parts, list[Parts]]]:
        random = np.random.default_rng(SEED)

        def corner() -> Parts:
            return {name: (low, high)[random.integers(2)][name] for name in low}

        for _ in range(RANDOM[0]):
            yield corner(), [corner() for _ in range(RANDOM[1])]

    def _law(self, by: Parts) -> Any:
        """Return the controllers with these factors on the exported gains."""
        result, names = self.controller.law, ("kp", "ki", "kd", "T_f")
        of = {(at.kind, at.position): by.get(at.name, 1.0) for at in self.numbers}
        pids = [
            [gain * of[name, k] for name, gain in zip(names, pid, strict=False)] + pid[4:]
            for k, pid in enumerate(result.pids)
        ]
        return controllers(
            replace(result, pids=pids), self.of.machine, measured=not self.controller.fed
        )

    def _filter(self, by: Parts) -> Any:
        """Return the filter with these factors of rotor and magnets, and with such noise."""
        # As in the core: forces and disturbances are relative to the mass, and the model is
        # unchanged.
        of: dict[str, list[float]] = {}
        for at in self.numbers:
            of.setdefault(at.kind, []).append(by.get(at.name, 1.0) * at.exported)
        (mass,) = of["mass"]
        heavier = mass / self.of.machine.rotor.mass
        magnets = [
            ConstantStiffness(s / heavier * k.k_i, s / heavier * k.k_s)
            for s, b in zip(of["strong"], self.controller.plant.isolated, strict=True)
            for k in (ConstantStiffness.of(b),)
        ]
        intensity = [v / heavier**2 / self.of.machine.sampling_time for v in of["var_d"]]
        noise = FilterNoise(*(values if len(values) > 1 else values[0]
                              for values in (of["var_y"], of["var_u"], intensity)))  # fmt: skip
        filter = KalmanFilter(
            self.of.machine, magnets if len(magnets) > 1 else magnets[0], noise=noise,
            as_printed=self.controller.estimator.engine.as_printed,
        )  # fmt: skip
        rows = fed(self.controller.law, len(filter.states), self.of.machine.speed)
        rows[:, [at.role == "disturbance force" for at in filter.states]] *= heavier
        signals = self._law({}).inputs[: len(rows)]
        return estimator_at(filter, self.of.point, (rows, signals))


def _parts(group: Sequence[Number], of: dict[str, Parts]) -> Parts:
    """Return the factors of a group's values, each from the end of its kind."""
    return {at.name: of[at.kind].get(at.name, 1.0) for at in group if at.kind in of}


def _different(parts: list[Parts]) -> list[Parts]:
    """Return those that are not alike."""
    return [one for k, one in enumerate(parts) if one not in parts[:k]]


SOURCES = ("src/calibration.c", "src/scaled.c")
TEMPLATES = {"{}_calibration.h": "calibration.h", "{}_calibration.c": "calibration.c"}


class Parameter(NamedTuple):
    """One kind of value, ``amb_parameter``."""

    name: str
    unit: str
    about: str


PARAMETERS = (
    Parameter("var_y", "m^2", "variance of the measurement"),
    Parameter("var_u", "V^2", "variance of the control signal"),
    Parameter("var_d", "N^2", "process noise variance of the disturbance force per sample"),
    Parameter("gate", "1", "innovations beyond so many standard deviations are outliers"),
    Parameter("mass", "kg", "mass of the rotor"),
    Parameter("strong", "1", "magnet constant k over the exported one"),
    Parameter("kp", "A/m", "proportional gain"),
    Parameter("ki", "A/(m s)", "integral gain"),
    Parameter("kd", "A s/m", "derivative gain"),
    Parameter("T_f", "s", "derivative filter"),
    Parameter("T_t", "s", "tracking time of the integral"),
    Parameter("weight", "1", "set-point weight"),
)  # fmt: skip
"""In the order of ``amb_parameter``."""


def check(controller: Controller, scenario: Scenario) -> None:
    """Reject what cannot be calibrated."""
    filter, machine = controller.estimator, controller.plant.machine
    called = c_literals.called(filter)
    roles = {state.role for state in filter.states}
    if called.has_own or called.has_state or "unbalance" in roles:
        raise AmbkitError(
            f"{machine.name}, {filter.name}: what it works by is made of more than "
            "noise, gate, mass and k; calibration is for linear, adaptive and extended filters"
        )
    if controller.law.schedule is not None:
        raise AmbkitError("calibration has one set of gains; this controller has them by speed")
    if scenario.controller.type == "lqg":
        raise AmbkitError("calibration has the gains of a PID; this controller has a regulator")
    if speeds_of(machine, scenario) is not None:
        raise AmbkitError("calibration is for one speed of rotation; this scenario has several")


def numbers(controller: Controller) -> list[Number]:
    """Return the values in the order of ``amb_parameter``, with the exported ones."""
    filter, machine, law = controller.estimator, controller.plant.machine, controller.law
    set_ = filter.core.parameters["set"]
    forces = [state.name for state in filter.states if state.role == "disturbance force"]
    noises = [noise.name for noise in filter.model.noises]
    axes = machine.axis_names
    gains = ("kp", "ki", "kd", "T_f", "T_t", "weight")
    values: dict[str, list[tuple[int, str, float]]] = {
        "var_y": [(k, at.name, set_["var_y"][k]) for k, at in enumerate(machine.readings)],
        "var_u": [(k, name, set_["var_u"][k]) for k, name in enumerate(axes)],
        "var_d": [
            (k, noise.removeprefix("f_d").removeprefix("_"), set_["var_d"][k])
            for k, noise in enumerate(noises)
            if noise in forces
        ],
        "gate": [(0, "", set_["gate"])],
        "mass": [(0, "", machine.rotor.mass)],
        "strong": [(k, name, 1.0) for k, name in enumerate(axes)],
    } | {
        gain: [(k, name, law.pids[k][at]) for k, name in enumerate(law.names)]
        for at, gain in enumerate(gains)
    }
    return [
        Number(kind.name, index, signal(kind.name, of), float(value))
        for kind in PARAMETERS for index, of, value in values[kind.name]
    ]  # fmt: skip


@lru_cache(maxsize=4)
def limits_of(controller: Controller) -> Limits:
    """Return the widest limits within which every set of values keeps the margins."""
    of = numbers(controller)
    low, high, peak = _widest(controller, of)
    lowest, highest = (
        {at.name: _limit(at, by.get(at.name, 1.0), k, controller) for at in of}
        for k, by in enumerate((low, high))
    )
    return Limits(lowest, highest, peak)


def _fields(controller: Controller, name: str) -> dict[str, Any]:
    filter, machine = controller.estimator, controller.plant.machine
    bias = np.array(bias_forces(filter.magnet, machine))
    within, of = limits_of(controller), numbers(controller)
    kinds = [item.name for item in PARAMETERS]
    return {
        "control": Name(f"&{name}_control"),
        "parameters": len(of),
        "kind": np.array([kinds.index(item.kind) for item in of], np.uint8),
        "index": np.array([item.position for item in of], np.uint8),
        "exported": np.array([item.exported for item in of]),
        "low": np.array([within.low[item.name] for item in of]),
        "high": np.array([within.high[item.name] for item in of]),
        "mass": machine.rotor.mass,
        "carried": filter.core.parameters["set"]["f_0"] - bias,
        "bias": bias,
    }


def context(controller: Controller, name: str, precision: CPrecision) -> str:
    """Return the base as an initialiser."""
    return c_literals.struct_with_arrays(_fields(controller, name), precision)


def constants(controller: Controller, name: str, crc: Constants) -> None:
    """Add it to the CRC."""
    crc.fields(f"{name}_base", _fields(controller, name), arrays=True)


def described(controller: Controller, name: str, precision: CPrecision) -> str:
    """Return the input of the A2L file, as JSON."""
    within, by_kind = limits_of(controller), {item.name: item for item in PARAMETERS}
    parameters = [
        {"name": item.name, "unit": by_kind[item.kind].unit,
         "about": by_kind[item.kind].about + item.name.removeprefix(item.kind).replace("_", " of "),
         "exported": item.exported, "low": within.low[item.name], "high": within.high[item.name]}
        for item in numbers(controller)
    ]  # fmt: skip
    set_ = controller.estimator.core.parameters["set"]
    sizes = [len(set_[name]) for name in ("var_y", "var_d", "f_0")]
    description = {
        "prefix": name, "precision": precision, "peak_of_sensitivity": within.peak,
        "room": 2 + sum(sizes) + 7 * len(set_["var_u"]),
        "parameters": parameters,
    }  # fmt: skip
    return json.dumps(description, indent=2) + "\n"
