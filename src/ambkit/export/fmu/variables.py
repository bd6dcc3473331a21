"""The variables of each kind of model: one table for the XML, the C and the documentation."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ambkit.base.arrays import Array
from ambkit.control.control import Control
from ambkit.control.controller_states import Controller
from ambkit.control.pid import PID
from ambkit.data.signals import signal
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.machine_model import several
from ambkit.export.c.c_literals import called
from ambkit.export.c.model import states
from ambkit.export.fmu.controller import ControllerStart
from ambkit.export.fmu.xml import TIME, Limit, Variable, per_name
from ambkit.machine.loading import levitation_current_at
from ambkit.machine.machine import Machine
from ambkit.models.continuous import continuous
from ambkit.models.plant_parts import between_magnet_and_rotor

Kind = Literal["estimator", "plant", "closed-loop", "controller", "whole-controller"]


def of_estimator(filter: Estimator) -> tuple[Variable, ...]:
    """Return the variables of an estimator."""
    about = "control signal u[k] from sample k on (C step: u_previous = u[k-1]); NaN: not known"
    return (
        TIME,
        *_readings(filter.machine),
        *per_name("u", "input", "V", about, filter.machine.axis_names, limit="losable"),
        *((POWER_FAILURE,) if called(filter).deenergises else ()),
        *_estimates("", filter),
        *_variances(filter),
    )


def _reading_names(machine: Machine) -> list[str]:
    return [reading.name for reading in machine.readings]


def _readings(machine: Machine) -> list[Variable]:
    names, about = _reading_names(machine), "measured position; NaN: lost"
    return per_name("y", "input", "m", about, names, limit="losable")


def _references(machine: Machine, **more: Any) -> list[Variable]:
    return per_name("r", "input", "m", "position that is demanded", machine.axis_names, **more)


def _estimates(prefix: str, filter: Estimator) -> list[Variable]:
    known = {"x": "displacement", "x_m": "sensor output"}
    axes, readings = filter.machine.axis_names, _reading_names(filter.machine)
    results = []
    for block, before, about in (
        ("mean", "", "estimated {known}"), ("std", "std_", "standard deviation of {field}"),
    ):  # fmt: skip
        both = zip(states(filter.states), filter.states, strict=True)
        for k, (state, described) in enumerate(both):
            description = about.format(
                known=known.get(state.field, described.role), field=state.field
            )
            unit = described.unit.replace(" ", ".")
            name = f"{prefix}{before}{state.field}"
            first = "" if k else block
            results.append(Variable(name, "output", unit, description, held=True, first=first))
    for name, unit, about, of in (
        ("k_i", "N/A", "current stiffness used by the prediction", axes),
        ("k_s", "N/m", "position stiffness used by the prediction", axes),
        ("innovation", "m", "measurement minus prediction, 0 if not used", readings),
        ("variance", "m2", "expected variance of the innovation", readings),
        ("status", "", "sum of flags, 0 if none (sources/ambkit/status.h)", [""]),
    ):
        results += per_name(prefix + name, "output", unit, about, of, held=True)
    return results


def _variances(filter: Estimator) -> list[Variable]:
    assumed, axes = filter.variances, filter.machine.axis_names
    readings = _reading_names(filter.machine)
    rows: Any = (
        ("measurement_variance", "m2", "variance of the measurement", readings, assumed.measurement,
         "positive"),
        ("control_variance", "V2", "variance of the control signal", axes, assumed.control,
         "not negative"),
        ("disturbance_growth", "N2/s", "process noise intensity of the disturbance force", axes,
         assumed.disturbance, "not negative"),
    )  # fmt: skip
    return [
        variable
        for name, unit, about, of, starts, limit in rows
        for variable in per_name(
            name, "tunable", unit, f"{about} that the filter assumes", of, several(starts),
            limit=limit,
        )
    ]  # fmt: skip


def of_plant(machine: Machine, places: Sequence[float]) -> tuple[Variable, ...]:
    """Return the variables of a plant with these initial positions along the axes [m]."""
    axes, readings = machine.axis_names, _reading_names(machine)
    known = (
        TIME,
        *per_name("u", "input", "V", "control signal, acts from when it is set", axes),
        Variable("on", "input", "1", "currents with the bias: from 0.5 on", 1.0),
        *_outside(machine),
        *_noises(machine),
        *(
            variable
            for name, unit, about, start, limit in _FAULTS
            for variable in per_name(
                name, "input", unit, about, axes if name in _OF_CONTROL else readings,
                start, limit=limit,
            )
        ),
        *_truth(machine),
        *(
            replace(at, follows=tuple(signal(name, of) for name in _SENSOR_INPUTS))
            for of, at in zip(readings, per_name(
                "y", "output", "m", "measured position: x_m and noise_y, with sensor faults",
                readings,
            ), strict=True)
        ),
        *_forced(machine),
    )  # fmt: skip
    if not machine.single or machine.delay is not None:  # no importer can integrate it
        return (*known, *_rig(machine, places))
    more = tuple(_continuous(machine))
    flowing = (item.name for item in more if item.name.startswith("i_"))
    current = ("u", "on", "noise_u", "fault_u_gain", "fault_current", *flowing)
    states = {"x": ("x",), "v": ("v",), "x_m": ("x_m",), "y": ("x_m",), "iu": current,
              "f_mag": ("x", *current, *between_magnet_and_rotor(machine))}  # fmt: skip
    with_states = (replace(v, follows=(*v.follows, *states.get(v.name, ()))) for v in known)
    return (*with_states, *more, *_rig(machine, places))


def _continuous(machine: Machine) -> Iterator[Variable]:
    """Return currents that are states, the rates of all states, and event indicators."""
    amplifier = machine.amplifier
    states = {"x": "m/s", "v": "m/s2", "x_m": "m/s"}
    if amplifier.bandwidth is not None:
        pair = amplifier.voltage_limit is not None and machine.magnet.type == "two-sided"
        for k in range(1 + pair):
            states[f"i_{k}"] = "A/s"
            yield Variable(f"i_{k}", "local", "A", f"control current of coil {k}")
    for state in between_magnet_and_rotor(machine):
        states[state] = "N/s"
        yield Variable(state, "local", "N", "lagged force of the magnet")
    for name, unit in states.items():
        yield Variable(f"der({name})", "local", unit, f"rate of {name}", rate_of=name)
    for k, side in enumerate(("+x", "-x")):
        about = f"way to the stop at {side} [m]; on a stop, the acceleration against it"
        yield Variable(f"event_{k}", "local", "1", about, event=True)


def of_loop(
    filter: Estimator, controller: PID, loop_controller: ControllerStart | None = None
) -> tuple[Variable, ...]:
    """Return the variables of a closed loop; `loop_controller`: its complete controller, if any."""
    machine, start = filter.machine, loop_controller
    axes = machine.axis_names
    return (
        TIME,
        *_references(machine),
        *((FLY,) if _lifts(start) else ()),
        *_outside(machine),
        *_noises(machine),
        *_truth(machine),
        *per_name("y", "output", "m", "measured position", _reading_names(machine), held=True),
        *per_name("u", "output", "V", "control signal", axes, held=True),
        *_forced(machine),
        *_estimates("estimate.", filter),
        *((MODE,) if _lifts(start) else ()),
        *_rig(machine, [0.0] if start is None else start.place.tolist()),
        *_variances(filter),
        *(
            _gains(controller, filter.machine)
            if start is None
            else _currents(machine, start.current)
        ),
    )


def of_complete_controller(
    filter: Estimator, loop_controller: ControllerStart
) -> tuple[Variable, ...]:
    """Return the variables of a complete controller."""
    machine = filter.machine
    axes, demanded = machine.axis_names, "control current that is demanded"
    coils = [
        Variable(signal(f"coil_{k}", axis.name), "output", "A",
                 f"current of {'the coil' if many < 2 else AT[k]}"
                 + (f", {axis.name}" if axis.name else ""), held=True)
        for axis, many in zip(machine.axes, loop_controller.coils, strict=True) for k in range(many)
    ]  # fmt: skip
    return (
        TIME,
        *_readings(machine),
        *_references(machine, limit="losable"),
        *((FLY,) if _lifts(loop_controller) else ()),
        POWER_FAILURE,
        *_speed(machine),
        replace(coils[0], first="coil_0"), *coils[1:],
        *per_name("u", "output", "V", "control signal", axes, held=True),
        *per_name("iu", "output", "A", demanded, axes, held=True),
        Variable("on", "output", "1", "1 with currents, else 0", held=True),
        Variable("status", "output", "", "sum of flags, of estimator and controller", held=True),
        *((MODE,) if _lifts(loop_controller) else ()),
        *_estimates("estimate.", filter),
        *_variances(filter),
        *per_name("start_position", "fixed", "m", "displacement at the start", axes,
               loop_controller.place.tolist()),
        *_currents(machine, loop_controller.current),
    )  # fmt: skip


AT = ("the coil towards +x", "the other coil")  #: The two coils of a pair.


POWER_FAILURE = Variable(
    "power_failure", "input", "1", "magnets without current from this sample on: from 0.5 on", 0.0
)
FLY = Variable("fly", "input", "1", "command to levitate: from 0.5 on", 1.0)
MODES = "0 off, 1 waiting, 2 lifting, 3 levitated, 4 landing, 5 tripped"
MODE = Variable("mode", "output", "", MODES, held=True)


def _lifts(start: ControllerStart | None) -> bool:
    """Return whether a controller performs lift-off."""
    return start is not None and start.controller.sequence is not None


def of_regulator(controller: Controller, current: Array) -> tuple[Variable, ...]:
    """Return the variables of controllers with these initial currents (p,) [A]."""
    filter, machine = controller.estimator, controller.estimator.machine
    axes, nothing = machine.axis_names, np.zeros(len(current))
    integrals = controller.integrals(current, nothing)
    names = [""] if len(integrals) == 1 else [str(k + 1) for k in range(len(integrals))]
    if controller.fed:
        middle = np.zeros(filter.view.H.shape[1])
        start_states = np.ravel(filter.equilibrium_state(middle, current=current))
        described = zip(states(filter.states), filter.states, start_states, strict=True)
        seen = [
            Variable(state.field, "input", item.unit.replace(" ", "."), f"estimated {item.role}",
                     float(start), limit="losable")
            for state, item, start in described
        ]  # fmt: skip
    else:
        seen = _readings(machine)
    return (
        TIME,
        *_references(machine),
        *_speed(machine),
        replace(seen[0], first="fed"),
        *(replace(variable, first="") for variable in seen[1:]),
        *per_name("u", "output", "V", "control signal", axes, held=True),
        *_currents(machine, current),
        *per_name("start_integral", "fixed", "A", "of the controller, in flight", names,
                   integrals.tolist()),
    )  # fmt: skip


def of_controller(machine: Machine, controller: Control) -> tuple[Variable, ...]:
    """Return the variables of a PID."""
    fed = "estimated displacement" if controller.feedback == "estimate" else "measured position"
    return (
        TIME,
        Variable("r", "input", "m", "position that is demanded"),
        Variable("x", "input", "m", f"{fed}; NaN: lost", limit="losable"),
        Variable(
            "v", "input", "m/s", "estimated velocity, if an estimator feeds it", limit="losable"
        ),
        Variable("u", "output", "V", "control signal", held=True),
        *_gains(controller, machine),
    )


def _speed(machine: Machine) -> list[Variable]:
    if machine.rotor.type == "mass":
        return []
    return [Variable("speed", "input", "rad/s", "speed of rotation", machine.speed)]


def base_inputs(machine: Machine) -> list[str]:
    """Return the directions x, y, z of a machine's foundation, "" if it cannot move."""
    ways = () if machine.rotor.type == "mass" else machine.rigid_coordinates
    return [f"base_{way}" if way in ways else "" for way in "xyz"]


def _outside(machine: Machine) -> list[Variable]:
    """Return the external inputs of a plant."""
    return [
        *_speed(machine),
        *(
            Variable(name, "input", "m/s2", "acceleration of the foundation")
            for name in base_inputs(machine) if name
        ),
        *per_name("f_d", "input", "N", "disturbance force", machine.axis_names),
    ]  # fmt: skip


def _noises(machine: Machine) -> list[Variable]:
    variables = per_name("noise_u", "input", "V", "noise on the control signal", machine.axis_names)
    for k, reading in enumerate(machine.readings):
        parts = {"coloured noise": reading.sensor.coloured_noise, "hum": reading.sensor.hum}
        named = "".join(f", {name} too" for name, part in parts.items() if part)
        about = f"noise on the measurement{named}; NaN: the sensor is lost"
        (variable,) = per_name("noise_y", "input", "m", about, [reading.name], limit="losable")
        variables.append(replace(variable, first="" if k else "noise_y"))
    return variables


_SENSOR_INPUTS = ("noise_y", "fault_y_gain", "fault_y_offset", "fault_frozen")
_OF_CONTROL = ("fault_u_gain", "fault_current")
_FAULTS: tuple[tuple[str, str, str, float, Limit], ...] = (
    ("fault_y_gain", "1", "fault: the measurement times that", 1.0, "any"),
    ("fault_y_offset", "m", "fault: and so much more", 0.0, "any"),
    ("fault_frozen", "1", "fault: from 0.5 on the measurement is frozen", 0.0, "any"),
    ("fault_u_gain", "1", "fault: factor of the control signal", 1.0, "any"),
    ("fault_current", "1", "fault: remaining share of the amplifier's range", 1.0,
     "not negative"),
)  # fmt: skip


def _truth(machine: Machine) -> list[Variable]:
    """Return positions and velocities, and their values at sensors and axes."""
    displayed = per_name("x_m", "output", "m", "sensor output without noise",
                      _reading_names(machine))  # fmt: skip
    if machine.single:
        return [
            Variable("x", "output", "m", "displacement of the rotor", first="q"),
            Variable("v", "output", "m/s", "its velocity"),
            *displayed,
        ]
    moving = continuous(machine).states[: 2 * len(machine.positions)]
    return [
        *(
            Variable(f"q_{at.name}", "output", at.unit.replace(" ", "."), at.role,
                     first="" if k else "q")
            for k, at in enumerate(moving)
        ),
        *displayed,
        *per_name("s", "output", "m", "displacement of the rotor along the axis",
                  machine.axis_names),
    ]  # fmt: skip


def _forced(machine: Machine) -> list[Variable]:
    axes = machine.axis_names
    forces = per_name("f_mag", "output", "N", "force of the magnet now", axes)
    return [
        *per_name("iu", "output", "A", "control current until now", axes, held=True),
        *(
            replace(force, follows=(signal("magnet_constant", axis),))
            for force, axis in zip(forces, axes, strict=True)
        ),
    ]


def _currents(machine: Machine, currents: Array) -> list[Variable]:
    about = "demanded until the start"
    return per_name("start_current", "fixed", "A", about, machine.axis_names, currents.tolist())


def _rig(machine: Machine, places: Sequence[float]) -> list[Variable]:
    axes, constants = machine.axis_names, [a.bearing.magnet.magnet_constant for a in machine.axes]
    mass = [
        Variable("mass", "tunable", "kg", "mass of the rotor", machine.rotor.mass, "positive")
    ] if machine.single else []  # fmt: skip
    return [
        *per_name("start_position", "fixed", "m", "displacement at the start", axes, list(places)),
        *mass,
        *per_name("magnet_constant", "tunable", "N.m2/A2", "constant k of the magnet", axes,
                   constants, limit="positive"),
    ]  # fmt: skip


def _gains(controller: PID, machine: Machine) -> list[Variable]:
    current = levitation_current_at(machine)
    weight = "set-point weight: share of the reference for kp"
    return [
        *per_name("start_current", "fixed", "A", "of the controller's integral", [""], current),
        Variable("controller.kp", "tunable", "A/m", "proportional gain", controller.kp),
        Variable("controller.ki", "tunable", "A/(m.s)", "integral gain", controller.ki),
        Variable("controller.kd", "tunable", "A.s/m", "derivative gain", controller.kd),
        Variable("controller.setpoint_weight", "tunable", "1", weight, controller.setpoint_weight),
    ]
