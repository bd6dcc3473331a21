"""The variables of each kind of model: one table for the XML, the C and the documentation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from ambkit.data.signals import signal
from ambkit.estimate.machine_model import several
from ambkit.export.c.model import states
from ambkit.models.plant_parts import between_magnet_and_rotor

if TYPE_CHECKING:
    from ambkit.control.control import Control
    from ambkit.control.pid import PID
    from ambkit.estimate.estimator import Estimator
    from ambkit.export.fmu.controller import ControllerStart
    from ambkit.machine.machine import Bearing, Machine

Kind = Literal["estimator", "plant", "closed-loop", "controller", "whole-controller"]
Role = Literal["time", "fixed", "tunable", "input", "output", "local"]
Limit = Literal["any", "not negative", "positive", "losable"]


@dataclass(frozen=True)
class Variable:
    """A variable of a model; its value reference is its place in the table."""

    name: str  #: As the importer shows it.
    #: Fixed parameters hold from the start, tunable ones can be changed between steps; local is
    #: what only importers that integrate ask for.
    role: Role
    unit: str  #: As in `UNITS`; empty for integers.
    about: str  #: In a few words.
    start: float = 0.0  #: Start value; of an output, nothing.
    #: Of a value that is set; what is losable may be NaN, as of a lost sensor.
    limit: Limit = "any"
    #: Inputs and parameters that an output follows at once, not with the next step.
    follows: tuple[str, ...] = ()
    held: bool = False  #: Changes only with a sample.
    rate_of: str = ""  #: State whose derivative it is.
    event: bool = False  #: Whether an event begins where its sign changes.
    #: In C, of those that stand together and of which this is the first; empty for others.
    first: str = ""

    @property
    def integer(self) -> bool:
        """Whether it is a whole number: those have no unit."""
        return not self.unit

    @property
    def reference(self) -> str:
        """Name of its value reference in C."""
        return "VR_" + re.sub(r"\W", "_", self.name)


UNITS = (
    "1", "s", "m", "m2", "m/s", "m/s2", "rad", "rad/s", "kg.m", "N/s", "kg", "A", "A/s", "A/m",
    "A/(m.s)", "A.s/m", "V", "A2", "V2", "N", "N/A", "N/m", "N2/s", "N.m2/A2",
)  # fmt: skip
"""Units of variables, in the order of the file."""

_DERIVED = {"N": {"kg": 1, "m": 1, "s": -2}, "V": {"kg": 1, "m": 2, "s": -3, "A": -1}}


def exponents(unit: str) -> dict[str, int]:
    """Return the exponents of the SI base units in a unit."""
    total: dict[str, int] = {}
    for sign, product in zip((1, -1), unit.split("/"), strict=False):
        for name, power in re.findall(r"([A-Za-z]+)(\d?)", product):
            for base, exponent in _DERIVED.get(name, {name: 1}).items():
                total[base] = total.get(base, 0) + sign * exponent * int(power or 1)
    order = ("kg", "m", "s", "A") if total.get("kg") else ("rad", "A", "m", "s")
    return {base: total[base] for base in order if total.get(base)}


TIME = Variable("time", "time", "s", "time")


def in_unit(variables: Sequence[Variable], control: str) -> tuple[Variable, ...]:
    """Return variables with control signals in their unit."""
    units = {"V": control, "V2": f"{control}2"}
    return tuple(
        replace(variable, unit=units.get(variable.unit, variable.unit)) for variable in variables
    )


def of_estimator(filter: Estimator) -> tuple[Variable, ...]:
    """Return the variables of an estimator."""
    about = "control signal u[k] from sample k on (C step: u_previous = u[k-1]); NaN: not known"
    return (
        TIME,
        *_readings(filter.machine),
        *_per_name("u", "input", "V", about, _axes(filter.machine), limit="losable"),
        *_estimates("", filter),
        *_variances(filter),
    )


def _axes(machine: Machine) -> list[str]:
    return [axis.name for axis in machine.axes]


def _per_name(
    what: str, role: Role, unit: str, about: str, names: Sequence[str],
    starts: Iterable[float] | float = 0.0, **more: Any,
) -> list[Variable]:  # fmt: skip
    """Return a variable for each name of an axis or a reading."""
    start_values = several(starts) * (1 if isinstance(starts, tuple | list) else len(names))
    block = what.rsplit(".", 1)[-1]
    return [
        Variable(signal(what, name), role, unit, about + (f", {name}" if name else ""),
                 float(start), first="" if k else block, **more)
        for k, (name, start) in enumerate(zip(names, start_values, strict=True))
    ]  # fmt: skip


def _readings(machine: Machine) -> list[Variable]:
    names = [reading.name for reading in machine.readings]
    return _per_name("y", "input", "m", "measured position; NaN: lost", names, limit="losable")


def _references(machine: Machine, **more: Any) -> list[Variable]:
    return _per_name("r", "input", "m", "position that is demanded", _axes(machine), **more)


def _estimates(prefix: str, filter: Estimator) -> list[Variable]:
    known = {"x": "displacement", "x_m": "position as the sensor shows it"}
    axes, readings = _axes(filter.machine), [r.name for r in filter.machine.readings]
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
        ("k_i", "N/A", "current stiffness that the prediction used", axes),
        ("k_s", "N/m", "position stiffness that the prediction used", axes),
        ("innovation", "m", "measurement less its prediction, 0 where it was not used", readings),
        ("variance", "m2", "variance of the innovation, as the filter expects it", readings),
        ("status", "", "sum of flags, 0 where all is well (sources/ambkit/status.h)", [""]),
    ):
        results += _per_name(prefix + name, "output", unit, about, of, held=True)
    return results


def _variances(filter: Estimator) -> list[Variable]:
    assumed, axes = filter.variances, _axes(filter.machine)
    readings = [reading.name for reading in filter.machine.readings]
    rows: Any = (
        ("measurement_variance", "m2", "variance of the measurement", readings, assumed.measurement,
         "positive"),
        ("control_variance", "V2", "variance of the control signal", axes, assumed.control,
         "not negative"),
        ("disturbance_growth", "N2/s", "growth of the disturbance force's variance", axes,
         assumed.disturbance, "not negative"),
    )  # fmt: skip
    return [
        variable
        for name, unit, about, of, starts, limit in rows
        for variable in _per_name(
            name, "tunable", unit, f"{about} that the filter assumes", of, several(starts),
            limit=limit,
        )
    ]  # fmt: skip


def of_plant(bearing: Bearing, place: float = 0.0) -> tuple[Variable, ...]:
    """Return the variables of a plant that starts at this place [m]."""
    sensor_inputs = ("noise_y", "fault_y_gain", "fault_y_offset", "fault_frozen")
    known = (
        TIME,
        Variable("u", "input", "V", "control signal, acts from when it is set"),
        Variable("on", "input", "1", "currents, that of the bias too: from 0.5 on", 1.0),
        Variable("f_d", "input", "N", "disturbance force"),
        *_noises(bearing),
        *_FAULTS,
        *_TRUTH,
        Variable("y", "output", "m", "measured position: x_m and noise_y, with the sensor's faults",
                 follows=sensor_inputs),
        *_FORCED,
    )  # fmt: skip
    if not in_continuous_time(bearing):
        return (*known, *_rig(bearing, place))
    more = tuple(_continuous(bearing))
    flowing = (item.name for item in more if item.name.startswith("i_"))
    current = ("u", "on", "noise_u", "fault_u_gain", "fault_current", *flowing)
    states = {"x": ("x",), "v": ("v",), "x_m": ("x_m",), "y": ("x_m",), "iu": current,
              "f_mag": ("x", *current, *between_magnet_and_rotor(bearing))}  # fmt: skip
    with_states = (replace(v, follows=(*v.follows, *states.get(v.name, ()))) for v in known)
    return (*with_states, *more, *_rig(bearing, place))


def in_continuous_time(bearing: Bearing) -> bool:
    """Say whether a plant is one of differential equations: a dead time is not."""
    return bearing.delay is None


def _continuous(bearing: Bearing) -> Iterator[Variable]:
    """Currents that are states, the rates of all states, and what begins events."""
    amplifier = bearing.amplifier
    states = {"x": "m/s", "v": "m/s2", "x_m": "m/s"}
    if amplifier.bandwidth is not None:
        pair = amplifier.voltage_limit is not None and bearing.magnet.type == "two-sided"
        for k in range(1 + pair):
            states[f"i_{k}"] = "A/s"
            yield Variable(f"i_{k}", "local", "A", f"control current of coil {k}")
    for state in between_magnet_and_rotor(bearing):
        states[state] = "N/s"
        yield Variable(state, "local", "N", "lagged force of the magnet")
    for name, unit in states.items():
        yield Variable(f"der({name})", "local", unit, f"rate of {name}", rate_of=name)
    for k, side in enumerate(("+x", "-x")):
        about = f"way to the stop at {side} [m]; on a stop, what presses the rotor there"
        yield Variable(f"event_{k}", "local", "1", about, event=True)


def of_loop(
    filter: Estimator, controller: PID, loop_controller: ControllerStart | None = None
) -> tuple[Variable, ...]:
    """Return the variables of a closed loop; `flown`: the whole controller in it, if it has one."""
    bearing, start = filter.bearing, loop_controller
    return (
        TIME,
        Variable("r", "input", "m", "position that is demanded"),
        *_fly_input(start),
        Variable("f_d", "input", "N", "disturbance force"),
        *_noises(bearing),
        *_TRUTH,
        Variable("y", "output", "m", "measured position", held=True),
        Variable("u", "output", "V", "control signal", held=True),
        *_FORCED,
        *_estimates("estimate.", filter),
        *_mode(start),
        *_rig(bearing, 0.0 if start is None else float(start.place[0])),
        *_variances(filter),
        *(_gains(controller, bearing) if start is None else [_current(float(start.current[0]))]),
    )


def of_whole(filter: Estimator, loop_controller: ControllerStart) -> tuple[Variable, ...]:
    """Return the variables of a whole controller."""
    machine = filter.machine
    axes, demanded = _axes(machine), "control current that is demanded"
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
        *_fly_input(loop_controller),
        *([] if machine.single else [
            Variable("speed", "input", "rad/s", "speed of rotation", machine.speed)
        ]),
        replace(coils[0], first="coil_0"), *coils[1:],
        *_per_name("u", "output", "V", "control signal", axes, held=True),
        *_per_name("iu", "output", "A", demanded, axes, held=True),
        Variable("on", "output", "1", "1 where there are currents, else 0", held=True),
        Variable("status", "output", "", "sum of flags, of estimator and controller", held=True),
        *_mode(loop_controller),
        *_estimates("estimate.", filter),
        *_variances(filter),
        *_per_name("start_position", "fixed", "m", "displacement at the start", axes,
               loop_controller.place.tolist()),
        *_per_name("start_current", "fixed", "A", "demanded until the start", axes,
               loop_controller.current.tolist()),
    )  # fmt: skip


AT = ("the coil towards +x", "the other coil")  #: The two coils of a pair.


def _fly_input(loop_controller: ControllerStart | None) -> list[Variable]:
    if loop_controller is None or loop_controller.controller.sequence is None:
        return []
    return [Variable("fly", "input", "1", "whether it is to fly: from 0.5 on", 1.0)]


def _mode(loop_controller: ControllerStart | None) -> list[Variable]:
    if loop_controller is None or loop_controller.controller.sequence is None:
        return []
    about = "0 off, 1 waiting, 2 lifting, 3 flying, 4 landing, 5 tripped"
    return [Variable("mode", "output", "", about, held=True)]


def of_regulator(filter: Estimator, current: float, integral: float) -> tuple[Variable, ...]:
    """Return the variables of a controller of all states, that starts with these [A]."""
    equilibrium = filter.equilibrium_state(0.0, current=current)
    described = zip(states(filter.states), filter.states, equilibrium, strict=True)
    return (
        TIME,
        Variable("r", "input", "m", "position that is demanded"),
        *(
            Variable(state.field, "input", item.unit, f"estimated {item.role}", float(start),
                     limit="losable")
            for state, item, start in described
        ),
        Variable("u", "output", "V", "control signal", held=True),
        _current(current),
        Variable("start_integral", "fixed", "A", "of the controller, in flight", integral),
    )  # fmt: skip


def of_controller(bearing: Bearing, controller: Control) -> tuple[Variable, ...]:
    """Return the variables of a PID."""
    fed = "estimated displacement" if controller.feedback == "estimate" else "measured position"
    return (
        TIME,
        Variable("r", "input", "m", "position that is demanded"),
        Variable("x", "input", "m", f"{fed}; NaN: lost", limit="losable"),
        Variable(
            "v", "input", "m/s", "estimated velocity, where an estimator feeds it", limit="losable"
        ),
        Variable("u", "output", "V", "control signal", held=True),
        *_gains(controller, bearing),
    )


def _noises(bearing: Bearing) -> list[Variable]:
    sensor = bearing.sensor
    parts = {"coloured noise": sensor.coloured_noise, "hum": sensor.hum}
    named = "".join(f", {name} too" for name, part in parts.items() if part)
    about = f"noise on the measurement{named}; NaN: the sensor is lost"
    return [
        Variable("noise_u", "input", "V", "noise on the control signal"),
        Variable("noise_y", "input", "m", about, limit="losable"),
    ]


_FAULTS = (
    Variable("fault_y_gain", "input", "1", "fault: the measurement times that", 1.0),
    Variable("fault_y_offset", "input", "m", "fault: and so much more"),
    Variable("fault_frozen", "input", "1", "fault: from 0.5 on the measurement stands still"),
    Variable("fault_u_gain", "input", "1", "fault: the control signal times that", 1.0),
    Variable("fault_current", "input", "1", "fault: share of the amplifier's range that is left",
             1.0, "not negative"),
)  # fmt: skip
_TRUTH = (
    Variable("x", "output", "m", "displacement of the rotor"),
    Variable("v", "output", "m/s", "its velocity"),
    Variable("x_m", "output", "m", "position as the sensor shows it, without noise"),
)
_FORCED = (
    Variable("iu", "output", "A", "control current until now", held=True),
    Variable("f_mag", "output", "N", "force of the magnet now", follows=("magnet_constant",)),
)


def _current(current: float) -> Variable:
    return Variable("start_current", "fixed", "A", "demanded until the start", current)


def _rig(bearing: Bearing, place: float = 0.0) -> list[Variable]:
    mass, k = bearing.rotor.mass, bearing.magnet.magnet_constant
    return [
        Variable("start_position", "fixed", "m", "displacement at the start", place),
        Variable("mass", "tunable", "kg", "mass of the rotor", mass, "positive"),
        Variable(
            "magnet_constant", "tunable", "N.m2/A2", "constant k of the magnet", k, "positive"
        ),
    ]


def _gains(controller: PID, bearing: Bearing) -> list[Variable]:
    from ambkit.machine.loading import levitation_current_at

    current = levitation_current_at(bearing)
    weight = "share of the reference that kp sees"
    return [
        Variable("start_current", "fixed", "A", "of the controller's integral", current),
        Variable("controller.kp", "tunable", "A/m", "proportional gain", controller.kp),
        Variable("controller.ki", "tunable", "A/(m.s)", "integral gain", controller.ki),
        Variable("controller.kd", "tunable", "A.s/m", "derivative gain", controller.kd),
        Variable("controller.setpoint_weight", "tunable", "1", weight, controller.setpoint_weight),
    ]
