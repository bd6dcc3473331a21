"""A machine with one axis for the page: the parameters of ``web/core/axis.h``."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from typing import Any

from ambkit.control.control import Control
from ambkit.control.default_control import settled
from ambkit.estimate.registry import learned_magnet
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module
from ambkit.machine.parts import along_x

AMB_FUZZY_MAX_RULES = 64  #: Of ``ambkit/fuzzy.h``.

KNOWN = {
    "": ("name", "description", "source", "sampling_time", "delay", "speed"),
    "magnet": (
        "type", "magnet_constant", "turns", "pole_area", "pole_angle", "air_gap", "bias_current",
    ),
    "rotor": ("mass", "gravity", "clearance"),
    "amplifier": ("gain", "current_limit", "noise_variance", "bandwidth", "resistance"),
    "sensor": ("gain", "lag", "noise_variance", "quantisation"),
}  # fmt: skip
"""Keys of a machine that the page simulates, by table of the short form."""


EDDIES = ("eddy_current_lag", "eddy_current_corner")  #: Simulated for rotors.
PLACED = ("name", "place", "angle", "type")  #: Keys of sensors at places.


def left_out(machine: Machine) -> Iterator[str]:
    """Yield the keys of a machine that the page does not simulate."""
    stated = tomllib.loads(machine.to_toml())
    if machine.single:
        for table, value in stated.items():
            if table in KNOWN:
                yield from _unknown(table, value, ())
            elif table not in KNOWN[""]:
                yield table
        return
    for bearing in stated["bearing"]:
        yield from _unknown("magnet", bearing["magnet"], EDDIES)
        yield from _unknown("amplifier", bearing["amplifier"], ())
    for sensor in stated["sensor"]:
        yield from _unknown("sensor", sensor, PLACED)
    if machine.angle is not None:
        yield "angle"


def _unknown(table: str, stated: dict[str, Any], others: Sequence[str]) -> Iterator[str]:
    """Yield the stated but unknown keys of a table."""
    for key, value in stated.items():
        if value and key not in KNOWN[table] and key not in others:
            yield f"{table}.{key}"


def axis_parameters(machine: Machine, control: Control | None = None) -> dict[str, float]:
    """Return a machine and its controller by the names of the page, in SI."""
    magnet, amplifier, sensor = machine.magnet, machine.amplifier, machine.sensor
    pid = settled(machine, control or Control(), "estimate")
    return {
        "T": machine.sampling_time,
        "mass": machine.rotor.mass,
        "gravity": along_x(machine.rotor.gravity),
        "clearance": machine.clearance,
        "k": magnet.magnet_constant,
        "s0": magnet.air_gap,
        "i0": magnet.bias_current,
        "two_sided": float(magnet.type == "two-sided"),
        "gain": float(amplifier.gain),
        "current_limit": amplifier.current_limit,
        "noise_u": float(amplifier.noise_variance),
        "bandwidth": amplifier.bandwidth or 0.0,
        "delay": machine.delay or 0.0,
        "K_sen": sensor.gain,
        "lag": sensor.lag,
        "noise_y": sensor.noise_variance,
        "step": sensor.quantisation or 0.0,
        "kp": pid.kp,
        "ki": pid.ki,
        "kd": pid.kd,
        "T_f": pid.derivative_filter,
        "T_t": pid.anti_windup,
        "weight": pid.setpoint_weight,
        "feedback": float(pid.feedback == "estimate"),
        "filter_k": 1.0,
    }


def expert_numbers(machine: Machine) -> list[float]:
    """Return the paper's expert of a machine for ``wb_expert``."""
    rules: Any = learned_magnet("adaptive", machine)
    network = rules.in_core(core_module()).parameters
    of = [network[key] for key in ("centre_iu", "centre_x")]
    of += [network[key][part] for key in ("k_i", "k_s") for part in ("sharpness", "weight")]
    rows = [[*map(float, row), *[0.0] * (AMB_FUZZY_MAX_RULES - len(row))] for row in of]
    head = ("rules", "normalised", "per_ampere", "per_metre", "iu_min", "iu_max", "x_min", "x_max")
    return [*(float(network[key]) for key in head), *(value for row in rows for value in row)]
