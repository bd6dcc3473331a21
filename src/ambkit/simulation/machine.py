"""A whole machine in closed loop, run in one call into C (``sim/loop.h``)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.asked import of_type
from ambkit.base.copying import own_version
from ambkit.base.errors import AmbkitError
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.base import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.machine.magnets import core_module
from ambkit.simulation import noise
from ambkit.simulation.control import Controller
from ambkit.simulation.controllers import Controllers, arrays, controllers_of
from ambkit.simulation.default_control import feedback_of, settled_scenario
from ambkit.simulation.holding_margins import shown_along_axes
from ambkit.simulation.plant import Plant
from ambkit.simulation.run import Run

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine
    from ambkit.simulation.imposed import Faults
    from ambkit.simulation.scenario import PID, Scenario

Array = NDArray[np.float64]

STREAMS = 64
"""Of random numbers for each axis and its reading: its control signal's, then its sensor's."""


def simulate_machine(
    machine: Machine,
    flight: Scenario,
    *,
    estimator: Estimator | None = None,
    disturbance: Array | None = None,
    readings: Array | None = None,
    references: Array | None = None,
    pids: Sequence[PID] | None = None,
    controllers: Controllers | None = None,
    from_readings: bool = False,
    fly: Array | None = None,
    other: dict[str, Any] | None = None,
    faults: Faults | None = None,
) -> Run:
    """Simulate a whole machine with its controllers.

    The plant is continuous (Runge-Kutta of order 4): the rotor with its gyroscopics, each magnet's
    force law, weight, unbalance, loads, amplifiers, sensors with their runout, backup bearings.

    Parameters
    ----------
    machine : Machine
        The plant.
    flight : Scenario
        What happens to it.
    estimator : Estimator, optional
        Of the whole machine; beside the loop, or in it with ``flight.feedback = "estimate"``, where
        it is the linear filter if none is given.
    disturbance : ndarray (n, p), optional
        Forces along the axes, sample by sample, added to the flight's [N].
    readings : ndarray (n, m), optional
        Added to the readings, sample by sample [m]; NaN: lost.
    references : ndarray (n, p), optional
        Added to the references of the axes, sample by sample [m]; NaN: none.
    pids : sequence of PID (p,), optional
        Of each axis, where each has its own; by default they are tuned to the axes alone.
    controllers : Controllers, optional
        All of them, where they are made already, as of another machine that was to be this one.
    from_readings : bool
        Whether the estimator starts where its first readings show the rotor, as an exported one
        does; by default it starts where the rotor is. With lift-off and landing it always does.
    fly : ndarray (n,), optional
        With a sequence, whether it is told to fly [1]; by default as the sequence says.
    other : dict, optional
        Fields of ``amb_control`` of another value than the flight's sequence has.
    faults : Faults, optional
        Of every reading (n, m) and of every control signal and amplifier (n, p). The record's
        readings and control signals are then those that the estimator gets, NaN for infinity.

    Raises
    ------
    ValueError
        `disturbance`, `readings` or `references` have not a row a sample.
    AmbkitError
        A load or a reference is of an axis that the machine has not; a run-up is too fast for the
        sampling time; no default controller holds the rotor.
    """
    if estimator is not None:
        of_type(Estimator, estimator=estimator)
    names = tuple(axis.name for axis in machine.axes)
    flight.check_for(names, body=True)
    if pids is not None or controllers is not None:
        flight = flight.fed(feedback_of(machine, flight))
    else:
        flight = settled_scenario(machine, flight)
    plant = Plant(machine)
    T = machine.sampling_time
    n = max(2, round(flight.duration / T) + 1)
    t: Array = T * np.arange(n + 1, dtype=float)
    speed = np.full(n + 1, machine.speed) if flight.speed is None else flight.speed.sample(t)
    fastest = float(np.abs(speed).max())
    if fastest * T >= math.pi:
        raise AmbkitError(
            f"speed: {fastest:.6g} rad/s turns half a revolution within a sample, or more; must be "
            f"less than {math.pi / T:.6g} rad/s"
        )
    loads, wanted, added = (
        flight.along(what, names, t[:-1]) for what in ("disturbance", "reference", "injection")
    )
    base = _of_base(machine, flight, t[:-1])
    if estimator is None and (flight.feedback == "estimate" or flight.sequence is not None):
        estimator = KalmanFilter(machine)
    precision = "float64" if estimator is None else estimator.precision
    core = core_module(precision, any_model=True) if estimator is None else estimator.engine.core
    loads = _added("disturbance", loads, disturbance)
    q, currents = plant.hovering(wanted[0], loads[0])
    known = None if estimator is None else np.ravel(estimator.at_rest(q, current=currents))
    held = currents, wanted[0], known
    wanted = _added("references", wanted, references)
    if flight.start == "rest":
        q, currents = plant.resting(), np.zeros(len(machine.axes))
        if flight.controller.type != "lqg":  # whose integrals are all that knows of the weight
            held = currents, np.zeros_like(currents), None
    noise_u, noise_y = _noise(machine, flight, n)
    noise_y = noise_y + added @ np.linalg.pinv(shown_along_axes(machine)).T
    noise_y = _added("readings", noise_y, readings)
    feeding = estimator if flight.feedback == "estimate" else None
    if controllers is None:
        controllers = controllers_of(plant, flight.controller, feeding, pids, fastest)
    given = (
        plant.arrays(core, flight.substeps, fastest)
        | {"T": T, "k_ui": [axis.bearing.amplifier.gain for axis in machine.axes]}
        | arrays(controllers, plant, feeding)
    )
    off = n if flight.off is None else round(flight.off / T)
    follows, of_flight = None, dict[str, Any]()

    def flown(samples: int, **of_estimator: Any) -> dict[str, Any]:
        series = {"r": wanted, "load": loads, "base": base, "noise_u": noise_u, "noise_y": noise_y}
        at_once = {"place": q, "current": currents, "integral": controllers.integrals(*held)}
        told = {name: values[:samples] for name, values in series.items()} | at_once
        told["speed"] = speed[: samples + 1]
        inputs = {name: np.ascontiguousarray(v, precision) for name, v in told.items()}
        found: dict[str, Any] = core.simulate(given, **inputs, off=off, **of_estimator)
        return found

    if estimator is not None:
        follows = estimator.turning(speed, n + 1)
        estimator.reset(np.ravel(estimator.at_rest(q, current=currents)))
        if flight.sequence is not None:
            whole = Controller(plant, estimator, controllers, flight.sequence, feeding is not None)
            told = flight.sequence.fly(t[:-1]) if fly is None else fly
            of_flight = {
                "control": whole.in_core(**(other or {})), "hovers": flight.start == "hover",
                "fly": np.ascontiguousarray(told, precision),
            }  # fmt: skip
        elif from_readings:
            first = flown(1, estimator=estimator.core)["y"]
            estimator.reset(estimator.at_first(np.asarray(first, float)))
    if faults is not None:
        of_flight |= {"beside": faults.beside, "faults": {
            name: np.ascontiguousarray(each, precision) for name, each in faults.series.items()
        }}  # fmt: skip
    turning = estimator.engine.model_of_core if estimator and follows is not None else None
    of_core = None if estimator is None else estimator.core
    out = flown(n, estimator=of_core, model=turning, **of_flight)
    if faults is not None:  # a record holds no infinities
        for name in ("y", "u"):
            out[name] = np.where(np.isfinite(out[name]), out[name], np.nan)
    series = {"r": wanted, "f_d": loads, "speed": speed[:-1], "injected": added, "base": base}
    record = _record(plant, flight, t[:-1], out, series)
    estimate = None if estimator is None else estimator.told(t[:-1], out["estimate"])
    usable = out["usable"].astype(bool) if "usable" in out else None
    return Run(machine, record, estimate, out["status"], usable)


def _of_base(machine: Machine, flight: Scenario, t: Array) -> Array:
    """Return the accelerations of the foundation (n, 3) [m/s^2]."""
    found = np.zeros((len(t), 3))
    for at, each in enumerate(flight.base):
        if each.direction not in machine.rigid_positions:
            raise AmbkitError(
                f"base[{at}].direction: {machine.name} has no thrust bearing, and does not move "
                f"along {each.direction}"
            )
        found[:, "xyz".index(each.direction)] += each.acceleration.sample(t)
    return found


def _added(what: str, values: Array, more: Array | None) -> Array:
    if more is None:
        return values
    if more.shape != values.shape:
        raise ValueError(f"{what} must be {values.shape}, is {more.shape}")
    return np.asarray(values + more)


def _noise(machine: Machine, flight: Scenario, n: int) -> tuple[Array, Array]:
    """Return noise on the control signals (n, p) [V] and on the readings (n, m) [m]."""
    p, readings = len(machine.axes), machine.readings
    noise_u, noise_y = np.zeros((n, p)), np.zeros((n, len(readings)))
    if not flight.noise:
        return noise_u, noise_y
    for k, axis in enumerate(machine.axes):
        std = math.sqrt(axis.bearing.amplifier.noise_variance)
        noise_u[:, k] = noise.Stream(flight.seed, flight.run, STREAMS * k).normal(std, n)
    for k, r in enumerate(readings):
        own = noise.Stream(flight.seed, flight.run, STREAMS * k + 1)
        noise_y[:, k] = noise.of_sensor(r.sensor, machine.sampling_time, n, own)
    return noise_u, noise_y


def _record(
    plant: Plant, flight: Scenario, t: Array, out: dict[str, Any], series: dict[str, Array]
) -> Record:
    machine, model = plant.machine, plant.model
    told = ("X", "iu", "force", "y", "u")
    out = out | {name: np.asarray(out[name], float) for name in told}
    out["X"] = out["X"].T  # n x states
    axes = [axis.name for axis in machine.axes]
    signals: dict[str, tuple[Array, str]] = {}
    for k, r in enumerate(machine.readings):
        signals[signal("y", r.name)] = out["y"][:, k], "m"
    if flight.off is not None:
        bias = [axis.bearing.magnet.bias_current for axis in machine.axes]
        out["iu"] = np.where((t < flight.off)[:, None], out["iu"], np.negative(bias))
    moved = out["X"][:, : len(model.states)] @ model.h.T
    of_axes = {
        "u": (out["u"], "V"), "r": (series["r"], "m"), "s": (moved, "m"),
        "iu": (out["iu"], "A"), "f_mag": (out["force"] + plant.bias, "N"),
        "f_d": (series["f_d"], "N"),
    }  # fmt: skip
    for name, (values, unit) in of_axes.items():
        signals |= {signal(name, axis): (values[:, k], unit) for k, axis in enumerate(axes)}
    for axis in machine.axes:
        name = signal("u", axis.name)
        signals[name] = signals[name][0], axis.bearing.amplifier.control_unit
    for k, state in enumerate(model.states[: 2 * len(machine.positions)]):
        signals[f"q_{state.name}"] = out["X"][:, k], state.unit
    signals |= {f"{at.name}": (out["X"][:, k], at.unit) for k, at in enumerate(model.states)
                if at.role == "sensor"}  # fmt: skip
    signals["speed"] = series["speed"], "rad/s"
    if flight.sequence is not None:
        signals["mode"] = out["mode"].astype(float), "1"
    for way in {each.direction for each in flight.base}:
        signals[f"base_{way}"] = series["base"][:, "xyz".index(way)], "m/s^2"
    for name, _ in flight.by_axis("injection", axes[0]):
        signals[signal("injected", name)] = series["injected"][:, axes.index(name)], "m"
    meta = {
        "machine": machine.to_toml(),
        "scenario": flight.model_dump(mode="json"),
        "seed": flight.seed,
        "version": own_version(),
        "stop_touched": int(out["touched"]),
        "first_touch": int(out["first"]) if out["touched"] else None,
    }
    return Record(
        t,
        {name: values for name, (values, _) in signals.items()},
        {name: unit for name, (_, unit) in signals.items()},
        meta=meta,
    )
