"""A rotor on several bearings as the page has it: what ``web/core/rotor/rotor.c`` reads."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.estimate.core_model import arrays
from ambkit.estimate.rebuild import Rebuild
from ambkit.estimate.registry import KINDS
from ambkit.machine.machine import Machine
from ambkit.simulation.run import Loop
from ambkit.simulation.scenario import Scenario

PLANT = (
    "positions", "axes", "sensors", "states", "T", "delay", "delay_rest", "substeps", "H", "B", "C",
    "A", "spin", "g", "bias", "farthest", "gain", "lag", "current", "shows", "k_ui", "iu_min",
    "iu_max", "reference", "position", "spread",
)  # fmt: skip
"""Fields of a loop that the page has as they are."""

SETTINGS = (
    "K_sen", "lag", "travel", "k_ui", "iu_min", "iu_max", "f_0", "x_max", "cap", "var_u", "var_d",
    "var_y", "step",
)  # fmt: skip
"""Settings of a filter, in the order of the page."""

MOST = 8  #: Positions, axes and sensors of a machine in the page.


def rotor_parameters(machine: Machine) -> dict[str, Any]:
    """Return a machine under one PID an axis, fed by the sensors, in SI."""
    if machine.bending is not None:
        raise AmbkitError(f"machine: the workbench shows rigid rotors; {machine.name} bends")
    controller = Control(type="decentralised", feedback="measurement")
    scenario = Scenario(duration=2 * machine.sampling_time, controller=controller)
    arguments = Loop(machine, scenario).arguments(slice(0, 2))
    loop = arguments["loop"]
    if max(loop[name] for name in ("positions", "axes", "sensors")) > MOST:
        raise AmbkitError(
            f"machine: the workbench shows up to {MOST} axes; {machine.name} has more"
        )
    radial = all(bearing.type == "radial" for bearing in machine.bearings)
    if len(machine.bearings) < 2 or not radial or any(map(len, loop["behind"])):
        raise AmbkitError(
            "machine: the workbench shows rotors on radial bearings without eddy currents; "
            f"{machine.name} is another"
        )
    zero = [0.0] * loop["positions"]
    laws = [machine.isolated_axis(axis.name).magnet for axis in machine.axes]
    places = ("place", "integral")
    return {
        **{name: _plain(loop[name]) for name in PLANT},
        "cosine": loop.get("cosine", zero), "sine": loop.get("sine", zero),
        "magnets": [
            [m.magnet_constant, m.air_gap, m.bias_current, float(m.type == "two-sided")]
            for m in laws
        ],
        "corner": [part.get("corner", 0.0) for part in loop["amplifiers"]],
        "step": [part.get("step", 0.0) for part in loop["sensor_parts"]],
        "rings": [
            [ring[key] for key in ("first", "second", "travel")]
            + [ring["stop"][key] for key in ("stiffness", "damping")]
            for ring in loop["rings"]
        ],
        "pid": [list(pid)[:6] for pid in loop["pid"]],
        **{name: _plain(arguments[name]) for name in places}, "held": _plain(arguments["current"]),
        "var_u": [float(axis.bearing.amplifier.noise_variance) for axis in machine.axes],
        "var_y": [reading.sensor.noise_variance for reading in machine.readings],
        "speed": machine.speed,
        "mass": machine.rotor.mass,
        "names": [axis.name for axis in machine.axes],
        "bearings": [
            {"name": b.name, "place": b.place, "angle": b.angle, "type": b.type}
            for b in machine.bearings
        ],
        "filter": _filter_of(machine),
        "discs": [place for place, _, _ in machine.unbalances()],
    }  # fmt: skip


def _filter_of(machine: Machine) -> dict[str, Any] | None:
    """Return what the page makes a Kalman filter of at any speed; None where the loop is late."""
    kf = KINDS["extended"].make(machine)
    rebuild, pattern = Rebuild.of(machine), arrays(kf.model)
    if rebuild.fields["late"]:
        return None
    sparse = [pattern[name] for name in ("L", "b", "B_u", "h", "d", "c", "N", "rest")]
    counts = ("states", "forces", "controls", "sensors", "noises")
    of = rebuild.fields
    lists = [[len(of[name]), *of[name]] for name in ("constant", "operation")]
    terms = (of[name] for name in ("row", "column", "use", "value", "k_i", "intensity"))
    settings = (kf._settings[name] for name in SETTINGS)
    return {
        "names": list(rebuild.names), "values": rebuild.values.tolist(),
        "pattern": [
            *(pattern[name] for name in counts),
            *(item for start, column, _ in sparse for item in (*start, *column)), *pattern["role"],
        ],
        "plan": [
            len(rebuild.names), *of["low"], *of["high"], *lists[0], *lists[1], *of["left"],
            *of["right"], of["T"], len(of["row"]), *(item for part in terms for item in part),
            len(of["from"]), *of["from"],
        ],
        "settings": {name: list(item) for name, item in zip(SETTINGS, settings, strict=True)},
        "dwell": kf._settings["dwell"], "std": list(kf.default_std()),
        "start": kf.equilibrium_state(0.0).tolist(),
        "loads": [state.role for state in kf.states].index("disturbance force"),
    }  # fmt: skip


def _plain(value: Any) -> Any:
    """Return numbers, arrays and tuples of them as JSON has them."""
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return np.asarray(value).tolist()
