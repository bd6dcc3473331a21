"""Optional plant parts, for ``sim/parts.h``: beyond magnet, rotor, sensor lag and hard stops."""

import cmath
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base.units import engineering
from ambkit.machine.accessories import SHORTEST_LAG, Runout
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of
from ambkit.machine.parts import Amplifier, Sensor
from ambkit.models.continuous import ForceLag, behind_magnets, continuous
from ambkit.models.parts import BEHIND_MAGNETS


def substeps(
    machine: Machine, behind: Sequence[ForceLag | None], least: int, max_speed: float
) -> int:
    """Runge-Kutta steps per sample: fast dynamics need short ones."""
    # Two per sensor lag, which is unstable beyond 2.8 lags per step; four per time constant of a
    # current, which moves the rotor; four per radian of the fastest runout; eight per radian of the
    # fastest bending, whose numerical damping is below 1e-7 then.
    T, turns = machine.sampling_time, int(machine.rotor.type != "mass")
    orders = [line.order for sensor in machine.sensors for line in sensor.runout]
    needed = [4 * T * (max(orders, default=turns) * max_speed)]
    needed += [2 * T / machine.lag_of(sensor) for sensor in machine.sensors]
    needed += [4 * T * _corner(bearing.amplifier, T) for bearing in machine.bearings]
    needed += [4 * T * fastest(item) for item in behind]
    if machine.bending is not None:
        needed.append(8 * T * float(machine.bending.frequency.max()))
    return max(least, *(math.ceil(item) for item in needed))


def _corner(amplifier: Amplifier, T: float) -> float:
    """Bandwidth of the amplifier [rad/s]; 0 if unlimited."""
    if amplifier.bandwidth is None:
        return 0.0
    return min(2 * math.pi * amplifier.bandwidth, 1 / (SHORTEST_LAG * T))


CURRENTS = (3, 4)  #: Indices of the two control currents of an isolated axis, after x, v and x_m.


def axis_fields(
    machine: Machine, magnet: Any, coil: Any, bias: float, least: int, dtype: str = "float64"
) -> dict[str, Any]:
    """Return the fields of ``amb_plant`` of an isolated axis, whose C has no loops."""
    sensor = of_sensor(machine.sensor, machine.sensor.runout, dtype)
    if machine.sensor.runout:
        sensor["speed"] = machine.speed
    amplifier, of_magnet = amplifier_of(machine), _behind(machine)
    between = behind_fields(of_magnet, dtype)
    clearance, stop = machine.clearance, machine.stop
    far = clearance if stop is None else max_displacement(clearance, machine.magnet.air_gap)
    bent = any(name in sensor for name in ("orders", "quadratic"))
    states, behind = CURRENTS[-1] + 1, between.get("behind", 0)
    return {
        "states": states + behind, "positions": 1, "axes": 1, "sensors": 1,
        "mass": [machine.rotor.mass], "g": [machine.weight + bias], "bias": [bias],
        "magnets": [magnet], "coils": [coil], "amplifiers": [amplifier | between],
        "behind": [[states + k for k in range(behind)]],
        "current": [CURRENTS[0] if amplifier else -1],
        "second": [CURRENTS[1] if amplifier.get("pair") else -1],
        "farthest": [far], "shows": [2], "sensor_parts": [sensor],
        "gain": [machine.sensor.gain], "lag": [machine.lag_of(machine.sensor)],
        "rings": [{"first": 0, "second": -1, "travel": clearance,
                   "stop": {} if stop is None else stop.core()}],
        **({"delay": 0, "delay_rest": 0.0} | delay_of(machine)),
        "substeps": substeps(machine, [of_magnet], least, machine.speed),
        "plain": not (bent or amplifier or between or stop),
    }  # fmt: skip


def max_displacement(clearance: float, air_gap: float) -> float:
    """Return the maximum displacement of a rotor, with contact depth but outside the magnet [m]."""
    return clearance + 0.9 * (air_gap - clearance)


def between_magnet_and_rotor(machine: Machine) -> tuple[str, ...]:
    """Return the names of the linear states between the magnet of an axis and its rotor."""
    behind = _behind(machine)
    return () if behind is None else behind.states


def _behind(machine: Machine) -> ForceLag | None:
    """Return the dynamics between the magnet of an axis and its rotor."""
    # A machine is only built if there is any: campaigns ask for each run.
    if all(getattr(machine.magnet, kind.key) is None for kind in BEHIND_MAGNETS):
        return None
    return behind_magnets(continuous(machine))[0]


def fastest(behind: ForceLag | None) -> float:
    """Rate of the fastest of the states between a magnet and its rotor [rad/s]."""
    if behind is None or not behind.states:
        return 0.0
    return float(np.abs(np.linalg.eigvals(behind.A)).max())


def behind_fields(behind: ForceLag | None, dtype: str) -> dict[str, Any]:
    """Return the dynamics between a magnet and its rotor, by the names of ``amb_parts``."""
    if behind is None or not behind.states:
        return {}
    parts = {"A": behind.A.ravel(), "b": behind.b, "c": behind.c, "rest": behind.rest}
    arrays = {f"behind_{name}": values.astype(dtype) for name, values in parts.items()}
    return {"behind": len(behind.states), "behind_d": behind.d} | arrays


def in_words(machine: Machine) -> list[str]:
    """Return the name and values of each part, in words."""
    magnet, amplifier = machine.magnet, machine.amplifier
    sensor, stop = machine.sensor, machine.stop
    features = []
    if magnet.saturation is not None:
        features.append(f"iron that saturates at {engineering(magnet.saturation, 'T')}")
    if magnet.force_map is not None:
        features.append(f"the force of {Path(magnet.force_map).name}")
    late = "force that lags behind the current"
    if magnet.eddy_current_lag is not None:
        features.append(f"{late} by {engineering(magnet.eddy_current_lag, 's')}")
    if magnet.eddy_current_corner is not None:
        features.append(f"{late} by half an order, {engineering(magnet.eddy_current_corner, 'Hz')}")
    if amplifier.bandwidth is not None:
        volts = amplifier.voltage_limit
        within = "" if volts is None else f" within {engineering(volts, 'V')}"
        features.append(f"amplifier of {engineering(amplifier.bandwidth, 'Hz')}{within}")
    if machine.delay is not None:
        samples = machine.delay / machine.sampling_time
        unit = "sample" if samples == 1 else "samples"
        features.append(f"delay of {engineering(machine.delay, 's')}, {samples:.3g} {unit}")
    if sensor.quantisation is not None:
        features.append(f"quantisation of {engineering(sensor.quantisation, 'm')}")
    if sensor.position_noise:
        features.append("sensor noise that depends on the position")
    if sensor.quadratic or sensor.cubic:
        features.append("non-linear sensor")
    if sensor.coloured_noise is not None:
        features.append(f"coloured noise to {engineering(sensor.coloured_noise.bandwidth, 'Hz')}")
    if sensor.hum:
        features.append(
            f"hum at {', '.join(engineering(line.frequency, 'Hz') for line in sensor.hum)}"
        )
    if sensor.runout:
        orders = ", ".join(f"{line.order}x" for line in sensor.runout)
        features.append(f"runout {orders} of {engineering(machine.speed / (2 * math.pi), 'Hz')}")
    if stop is not None:
        features.append(f"stops of {engineering(stop.stiffness, 'N/m^1.5')}")
    return features


def coil_fields(machine: Machine) -> dict[str, Any] | None:
    """Return the law of one coil of a pair with different currents, by fields, or None."""
    # Without such a law, the force follows from the mean of both currents.
    pair = machine.amplifier.voltage_limit is not None and machine.magnet.type == "two-sided"
    return magnet_of(machine).of_one_coil() if pair else None


def amplifier_of(machine: Machine) -> dict[str, Any]:
    """Return an amplifier's dynamics, by the names of ``amb_parts``; empty if it has none."""
    amplifier, magnet = machine.amplifier, machine.magnet
    if amplifier.bandwidth is None:
        return {}
    parts: dict[str, Any] = {"corner": _corner(amplifier, machine.sampling_time)}
    if amplifier.voltage_limit is not None:
        parts |= {
            "voltage": amplifier.voltage_limit,
            "R": amplifier.resistance,
            "k": magnet.magnet_constant,
            "s0": magnet.air_gap,
            "i0": magnet.bias_current,
            "pair": magnet.type == "two-sided",
        }
    return parts


def delay_of(machine: Machine) -> dict[str, Any]:
    """Return the dead time of a loop by the names of ``amb_parts``; empty if there is none."""
    if machine.delay is None:
        return {}
    samples = machine.delay / machine.sampling_time
    if abs(samples - round(samples)) < 1e-9:  # tolerance for the rounding of a whole number
        return {"delay": round(samples), "delay_rest": 0.0}
    integer_part = math.floor(samples)
    return {"delay": integer_part, "delay_rest": (samples - integer_part) * machine.sampling_time}


def of_sensor(
    sensor: Sensor, runout: Sequence[Runout], dtype: str, around: float = 0.0
) -> dict[str, Any]:
    """Return a sensor's dynamics besides gain and lag, by the names of ``amb_parts``."""
    parts = dict[str, Any]()
    if sensor.quadratic or sensor.cubic:
        parts |= {"quadratic": sensor.quadratic, "cubic": sensor.cubic}
    if sensor.quantisation is not None:
        parts["step"] = sensor.quantisation
    if sensor.position_noise:
        parts["rise"] = sensor.position_noise
    if runout:
        lines = np.zeros(max(line.order for line in runout), dtype=complex)
        for line in runout:  # amplitude cos(n phi + phase)
            lines[line.order - 1] += cmath.rect(line.amplitude, line.phase - line.order * around)
        parts |= {
            "orders": len(lines),
            "runout_cosine": np.ascontiguousarray(lines.real, dtype=dtype),
            "runout_sine": np.ascontiguousarray(-lines.imag, dtype=dtype),
        }
    return parts
