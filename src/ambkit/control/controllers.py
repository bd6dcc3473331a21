"""The controllers of a machine, for ``core/include/ambkit/controllers.h``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import chain
from typing import Any, Literal

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.control.blocks import gain_at_rest, sections_of
from ambkit.control.control import Control
from ambkit.control.pid import GAINS, PID, GainSchedule, integral_lead, overlaid, schedule_fields
from ambkit.control.regulator import regulator, scheduled
from ambkit.control.stabilising_controller import holding
from ambkit.control.synchronous_compensation import (
    UnbalanceControl,
    check_unbalance,
    unbalance_control,
    unbalance_control_fields,
)
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.machine_model import View
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.plant import Plant

TYPES = ("decentralised", "translation and tilt", "lqg")  #: From simple to linear-quadratic.
OF_CURRENTS = "fed_back"  #: Prefix of feedback to currents, as opposed to positions.
FAR = 1e9  #: Maximum reference [m].


@dataclass(frozen=True)
class Controllers:
    """PIDs of combinations of the axes' displacements, and feedback of an estimator's states."""

    pids: list[list[float]]  #: Gains, limits and sections of each, see `gains_of`.
    names: tuple[str, ...]  #: Axis or rigid-body coordinate of each PID.
    of_axes: Array  #: (q, p) Input of each PID, by the axes' displacements.
    spread: Array  #: (p, q) Current of each axis [A] by those of the PIDs [A].
    lead: Array  #: (q,) Change of each integral per metre of reference [A/m].
    measured: Array  #: (q, m) Input of each PID by the readings, if these feed it.
    feedback: dict[str, Array] = field(default_factory=dict)  #: (q, n), (p, n) By name.
    unbalance_control: UnbalanceControl | None = None  #: Synchronous motion that is not controlled.
    schedule: GainSchedule | None = None  #: Of the PIDs' gains, over the speed of rotation.

    def pids_at(self, speed: float) -> list[list[float]]:
        """Return the PIDs with their gains at a speed [rad/s]."""
        if self.schedule is None:
            return self.pids
        rows = self.schedule.at(speed).tolist()
        return [row + pid[len(row) :] for row, pid in zip(rows, self.pids, strict=True)]

    def scaled(self, ratio: Array) -> Controllers:
        """Return controllers with the current of each axis multiplied by a factor (p,)."""
        if (ratio == 1).all():
            return self
        feedback = {
            name: ratio[:, None] * rows if name.startswith(OF_CURRENTS) else rows
            for name, rows in self.feedback.items()
        }
        turn = self.unbalance_control
        if turn is not None:
            current = ratio[:, None] * turn.current
            turn = replace(turn, current=current, ampere=turn.ampere / ratio)
        spread = ratio[:, None] * self.spread
        return replace(self, spread=spread, feedback=feedback, unbalance_control=turn)

    def integrals(self, currents: Array, place: Array, states: Array | None) -> Array:
        """Return the integrals (q,) in equilibrium."""
        # currents (p,) [A]; place (p,) [m]; states (n,)
        if states is not None and "fed_back" in self.feedback:
            currents = currents - self.feedback["fed_back"] @ states
        held = np.linalg.lstsq(self.spread, currents, rcond=None)[0]
        held = held / np.array([gain_at_rest(behind(gains)) for gains in self.pids])
        return np.asarray(held + self.lead * (self.of_axes @ place))


def relative_gains(machine: Machine, other: Machine) -> Array:
    """Return the gains of the amplifiers (p,), relative to those of a similar machine [1]."""
    return np.array([
        own.bearing.amplifier.gain / its.bearing.amplifier.gain
        for own, its in zip(machine.axes, other.axes, strict=True)
    ])  # fmt: skip


def controllers_of(
    plant: Plant,
    control: Control,
    estimator: Estimator | None,
    pids: Sequence[PID] | None = None,
    fastest: float | None = None,
) -> Controllers:
    """Return the controllers of a machine."""
    if estimator is None and control.of_estimate:
        text = 'is made of the estimate: feedback must be "estimate"'
        raise AmbkitError(f"{control.of_estimate} {text}")
    if control.type == "lqg":
        if estimator is None:
            raise AmbkitError('type = "lqg" regulates the estimate: feedback must be "estimate"')
        _check_states(estimator, "an lqg")
        result = _regulated(plant, estimator, control.gain_scheduling)
    elif control.type in (None, "decentralised"):
        fed: Literal["measurement", "estimate"] = "estimate" if estimator else "measurement"
        result = _decentralised(plant, pids or pids_of(plant.machine, control, fed), estimator)
    else:
        result = _of_translation_and_tilt(plant, control)
    if estimator is None:
        return result
    feedback = _rows(estimator, result.of_axes @ estimator.view.H) | result.feedback
    if control.cross_feedback:
        torques = _against_gyroscopics(plant, estimator)
        feedback["fed_back_by_speed"] = control.cross_feedback * torques
    result = replace(result, feedback=feedback)
    if control.unbalance == "off":
        return result
    check_unbalance(estimator)
    if not (plant.machine.speed or fastest):
        return result
    turn = unbalance_control(
        plant, estimator, result, control.unbalance, control.unbalance_from, fastest
    )
    return replace(result, unbalance_control=turn)


def pids_of(
    machine: Machine, control: Control, feedback: Literal["measurement", "estimate"]
) -> list[PID]:
    """Return the PID of each axis of decentralised control, with omitted settings tuned."""
    names = machine.axis_names
    if control.custom:  # a class has none
        return [PID()] * len(names)
    own = _stated(control, names)
    if all(pid.model_fields_set >= GAINS for pid in own):
        return own
    usual = [PID(**item._asdict()) for item in holding(machine, feedback).pids]
    return [
        overlaid(pid, overrides, machine.isolated_axis(name)) if overrides.model_fields_set else pid
        for name, pid, overrides in zip(names, usual, own, strict=True)
    ]


def _stated(control: Control, names: list[str]) -> list[PID]:
    """Return the stated settings of each axis or coordinate, its own or common ones."""
    if unknown := [name for name in control.pid if name not in names]:
        raise AmbkitError(
            f"controller.pid.{unknown[0]}: there is no {unknown[0]}; known: {', '.join(names)}"
        )
    own = [control.pid.get(name, PID.model_construct()) for name in names]
    return [
        control.gains.model_copy(update={key: getattr(pid, key) for key in pid.model_fields_set})
        for pid in own
    ]


def arrays(controllers: Controllers, plant: Plant, estimator: Estimator | None) -> dict[str, Any]:
    """Return the fields of ``amb_controllers``, for the core."""
    feedback_fields = dict.fromkeys(
        ("velocity", "fed_back", "fed_back_by_speed", "fed_back_by_square"), None
    ) | {name: values.ravel().tolist() for name, values in controllers.feedback.items()}
    is_single = np.array_equal(controllers.of_axes, np.eye(1))
    return (
        {"position": controllers.measured.ravel().tolist()}
        | feedback_fields
        | unbalance_control_fields(controllers.unbalance_control)
        | schedule_fields(controllers.schedule)
        | {
            "feedback_estimate": estimator is not None,
            "pid": controllers.pids,
            "reference": None if is_single else controllers.of_axes.ravel().tolist(),
            "spread": controllers.spread.ravel().tolist(),
            "iu_min": [item.current_min for item in plant.isolated],
            "iu_max": [item.current_max for item in plant.isolated],
        }
    )


def gains_of(pid: PID, T: float, low: float, high: float) -> list[float]:
    """Return a PID in the form of ``amb_pid`` after T, followed by its sections."""
    return [pid.kp, pid.ki, pid.kd, pid.derivative_filter, pid.anti_windup, pid.setpoint_weight,
            low, high, *chain.from_iterable(sections_of(pid.block, T))]  # fmt: skip


def behind(gains: Sequence[float]) -> list[Sequence[float]]:
    """Return the sections behind a PID, from the result of `gains_of`."""
    return [gains[k : k + 5] for k in range(8, len(gains), 5)]


def _decentralised(plant: Plant, pids: Sequence[PID], estimator: Estimator | None) -> Controllers:
    limits = [(isolated.current_min, isolated.current_max) for isolated in plant.isolated]
    names, one = tuple(plant.machine.axis_names), np.eye(len(pids))
    transform = View(plant.machine).measured
    feedback = _fed_forward(plant, pids, estimator)
    own = {k: _seen(plant, estimator, k, pid.sees) for k, pid in enumerate(pids) if pid.sees}
    for k, (by_reading, _) in own.items():
        transform[k] = by_reading
    if estimator is not None and own:
        sensor_rows = estimator.view.H.copy()
        for k, (_, by_state) in own.items():
            sensor_rows[k] = by_state
        feedback |= _rows(estimator, sensor_rows)
    T = plant.machine.sampling_time
    return Controllers(
        [gains_of(pid, T, *ends) for pid, ends in zip(pids, limits, strict=True)],
        names, one, one, np.array([integral_lead(pid, 1.0) for pid in pids]), transform, feedback,
        schedule=GainSchedule.of(pids),
    )  # fmt: skip


def _seen(plant: Plant, filter: Any, axis: int, sees: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the input of a PID, by the readings (m,) and by the estimated displacements (q,)."""
    readings, states, C = plant.machine.readings, [], np.zeros((len(plant.machine.readings), 0))
    if filter is not None:
        C = filter.view.C
        states = [s.name for s in filter.states if s.role in ("position", "bending")]
    known = [*(r.name for r in readings), *states]
    by_reading, by_state = np.zeros(len(readings)), np.zeros(len(states))
    for name, weight in sees.items():
        if name not in known:
            raise AmbkitError(
                f"controller.pid.{plant.machine.axes[axis].name}.sees: there is no {name}; known: "
                f"{', '.join(known)}"
            )
        at = known.index(name)
        if at < len(readings):
            by_reading[at] = weight / readings[at].sensor.gain
            by_state += weight * C[at]
        else:
            by_state[at - len(readings)] += weight
    return by_reading, by_state


def _fed_forward(
    plant: Plant, pids: Sequence[PID], estimator: Estimator | None
) -> dict[str, Array]:
    """Return the currents (p, n) that cancel shares of the estimated disturbances."""
    shares = np.array([pid.feed_forward for pid in pids])
    if not shares.any():
        return {}
    if estimator is None:
        raise AmbkitError('feed_forward is made of the estimate: feedback must be "estimate"')
    _check_states(estimator, "feed_forward")
    k_i = np.array([ConstantStiffness.of(isolated).k_i for isolated in plant.isolated])
    gain = np.zeros((len(pids), len(estimator.states)))
    gain[:, _places(estimator, "disturbance force")] = np.diag(-shares / k_i)
    return {"fed_back": gain}


def _check_states(estimator: Estimator, which: str) -> None:
    """Reject an estimator without the states that a controller needs."""
    for role in ("position", "velocity", "disturbance force"):
        if not _places(estimator, role):
            raise AmbkitError(
                f"{estimator.name}: it has no {role} among its states, which {which} controller "
                "needs"
            )


def _of_translation_and_tilt(plant: Plant, control: Control) -> Controllers:
    """One PID for each rigid-body coordinate, tuned to its mass or inertia and stiffness."""
    # Each is scaled to metres at the radius of the magnets, and to amperes of an axis that would
    # hold the coordinate alone.
    masses = dict(zip(plant.machine.rigid_coordinates, plant.machine.masses, strict=False))
    stated = _stated(control, list(masses))
    k = [ConstantStiffness.of(isolated) for isolated in plant.isolated]
    k_i, k_s = np.array([item.k_i for item in k]), np.array([item.k_s for item in k])
    H, first = plant.H[:, : len(masses)], plant.isolated[0]
    to_axes, explained = _currents(plant), np.linalg.pinv(H)
    pids: list[PID] = []
    gains, of_axes, spread = [], [], []
    for at, (name, mass) in enumerate(masses.items()):
        stiffness = float(H[:, at] ** 2 @ k_s)
        lever = 1.0
        if name.startswith("th"):
            across = float(explained[at] @ explained[at])
            lever = 1 / math.sqrt(across * len(k_s) / 2)
        pid = stated[at].completed(_weightless(first, float(mass * k_s[0] / stiffness)))
        amperes = to_axes[:, at] * k_i[0] * stiffness / (k_s[0] * lever)
        room = min(
            abs(end / share)
            for share, isolated in zip(amperes, plant.isolated, strict=True) if share
            for end in (isolated.current_min, isolated.current_max)
        )  # fmt: skip
        pids.append(pid)
        gains.append(gains_of(pid, plant.machine.sampling_time, -room, room))
        of_axes.append(lever * explained[at])
        spread.append(amperes)
    transform = np.array(of_axes) @ View(plant.machine).measured
    return Controllers(
        gains, tuple(masses), np.array(of_axes), np.array(spread).T,
        np.array([integral_lead(pid, 1.0) for pid in pids]), transform,
        schedule=GainSchedule.of(pids),
    )  # fmt: skip


@lru_cache(maxsize=64)
def _weightless(axis: Machine, mass: float) -> Machine:
    """Return an axis with another mass, without weight."""
    return axis.replace(rotor__mass=mass, rotor__gravity="none")


def _regulated(plant: Plant, estimator: Estimator, by_speed: bool) -> Controllers:
    """State feedback; the PIDs only pass the references on."""
    if by_speed and plant.machine.speed:
        feedback, ahead = scheduled(plant, estimator)
    else:
        K, ahead = regulator(plant, estimator)
        feedback = {"fed_back": -K}
    p = len(plant.isolated)
    passed = [[1.0, 0.0, 0.0, 0.0, 1.0, 1.0, -FAR, FAR]] * p
    nothing = np.zeros((p, len(estimator.states)))
    return Controllers(
        # The references act through the integrals only.
        passed, tuple(plant.machine.axis_names), np.eye(p), ahead, -np.ones(p),
        View(plant.machine).measured,
        feedback | {"position": nothing, "velocity": nothing},
    )  # fmt: skip


def _rows(estimator: Estimator, sensor_rows: Array) -> dict[str, Array]:
    """Return the inputs of PIDs by the estimator's states (q, n), from those by coordinates."""
    position, velocity = estimator.view.along(sensor_rows, estimator.states)
    return {"position": position, "velocity": velocity}


def _places(estimator: Estimator, role: str) -> list[int]:
    return [k for k, state in enumerate(estimator.states) if state.role == role]


def _currents(plant: Plant) -> Array:
    """Return the currents (p, q) per unit force and torque on the rigid rotor."""
    k_i = np.array([ConstantStiffness.of(isolated).k_i for isolated in plant.isolated])
    rigid = len(plant.machine.rigid_coordinates)
    return np.asarray(np.linalg.pinv(plant.H[:, :rigid].T) / k_i[:, None])


def _against_gyroscopics(plant: Plant, estimator: Estimator) -> Array:
    """Return the currents (p, n) that cancel the gyroscopic torques, per rad/s."""
    machine = plant.machine
    q, n = len(machine.rigid_coordinates), len(machine.positions)
    torques = -machine.masses[:q, None] * plant.model.spin[n : n + q, n : n + q]  # on the rotor
    gain = np.zeros((len(plant.isolated), len(estimator.states)))
    gain[:, _places(estimator, "velocity")] = _currents(plant) @ torques
    return gain
