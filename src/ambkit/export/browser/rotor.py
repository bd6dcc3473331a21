"""A rotor on several bearings for the page: the input of ``web/core/rotor_description.c``."""

from __future__ import annotations

import math
from typing import Any, Literal, get_args

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.rebuild import Rebuild
from ambkit.estimate.registry import KINDS
from ambkit.export.browser.model import model_numbers
from ambkit.machine import geometry
from ambkit.machine.machine import Machine
from ambkit.simulation.run import Loop
from ambkit.simulation.scenario import Scenario

Feedback = Literal["measurement", "estimate"]

PLANT = (
    "positions", "axes", "sensors", "states", "T", "delay", "delay_rest", "substeps", "H", "B", "C",
    "A", "spin", "g", "bias", "farthest", "gain", "lag", "current", "shows", "k_ui", "iu_min",
    "iu_max",
)  # fmt: skip
"""Fields of a loop that are passed on unchanged."""

#: And those that depend on the feedback.
CONTROLLERS = ("reference", "position", "velocity", "spread")

VIEW = (
    "mass", "clearance", "k_ui", "current_limit", "var_u", "K_sen", "lag", "step", "var_y", "range",
    "run_out", "travel", "seen", "bent",
)  # fmt: skip
"""Fields of ``amb_view`` (``sim/settings.h``) in the page, in order."""

MOST = {"axes": 10, "sensors": 10, "positions": 24, "states of the filter": 48}
"""Limits of a machine in the page (``web/core/bench.h``)."""

STATIONS = 33  #: Plotted points along the shaft.


def rotor_parameters(machine: Machine) -> dict[str, Any]:
    """Return a machine with one PID per axis, in SI."""
    kf = KINDS["extended"].make(machine)
    loops = {feedback: _arguments(machine, feedback, kf) for feedback in get_args(Feedback)}
    arguments = loops["measurement"]
    loop = arguments["loop"]
    counts = {name: loop.get(name, len(kf.states)) for name in MOST}
    for name, count in counts.items():
        if count > MOST[name]:
            limit = f"machine: the workbench shows up to {MOST[name]} {name}"
            raise AmbkitError(f"{limit}; {machine.name} has {count}")
    zero = [0.0] * loop["positions"]
    laws = [machine.isolated_axis(axis.name).magnet for axis in machine.axes]
    return {
        **{name: _plain(loop[name]) for name in PLANT},
        "cosine": _plain(loop.get("cosine", zero)), "sine": _plain(loop.get("sine", zero)),
        "magnets": [
            [m.magnet_constant, m.air_gap, m.bias_current, float(m.type == "two-sided")]
            for m in laws
        ],
        "corner": [part.get("corner", 0.0) for part in loop["amplifiers"]],
        "behind": [
            _behind(part, at) for part, at in zip(loop["amplifiers"], loop["behind"], strict=True)
        ],
        "step": [part.get("step", 0.0) for part in loop["sensor_parts"]],
        "rings": [
            [ring[key] for key in ("first", "second", "travel")]
            + [ring["stop"][key] for key in ("stiffness", "damping")]
            for ring in loop["rings"]
        ],
        "place": _plain(arguments["place"]), "held": _plain(arguments["current"]),
        "controllers": {
            feedback: {
                "pid": [list(pid)[:6] for pid in item["loop"]["pid"]],
                "integral": _plain(item["integral"]),
                **{name: _plain(item["loop"][name]) for name in CONTROLLERS},
            }
            for feedback, item in loops.items()
        },
        "var_u": [float(axis.bearing.amplifier.noise_variance) for axis in machine.axes],
        "var_y": [reading.sensor.noise_variance for reading in machine.readings],
        "speed": machine.speed,
        "mass": machine.rotor.mass,
        "names": [axis.name for axis in machine.axes],
        "bearings": [
            {"name": b.name, "place": b.place, "angle": b.angle, "type": b.type}
            for b in machine.bearings
        ],
        "filter": _filter_of(machine, kf),
        "discs": [place for place, _, _ in machine.unbalances()],
        **_shape(machine),
    }  # fmt: skip


def _arguments(machine: Machine, feedback: Feedback, kf: Estimator) -> dict[str, Any]:
    """Return the arguments of a loop with measurement or estimate feedback."""
    controller = Control(type="decentralised", feedback=feedback)
    scenario = Scenario(duration=2 * machine.sampling_time, controller=controller)
    estimator = kf if feedback == "estimate" else None
    return Loop(machine, scenario, estimator=estimator).arguments(slice(0, 2))


def _behind(part: dict[str, Any], at: list[int]) -> list[float]:
    """Return the linear states between a magnet's force and the rotor, as a sequence of numbers."""
    if not at:
        return [0]
    parts = [np.ravel(part[f"behind_{name}"]).tolist() for name in ("A", "b", "c", "d", "rest")]
    return [len(at), *at, *(item for row in parts for item in row)]


def _shape(machine: Machine) -> dict[str, Any]:
    """Return the shaft's displacement at points along it: rows over the coordinates, x and y."""
    places = [bearing.place for bearing in machine.bearings if bearing.type == "radial"]
    places += [place for place, _, _ in machine.unbalances()]
    bending = machine.bending
    low, high = (min(places), max(places)) if bending is None else bending.ends
    room = 0.16 * (high - low) if bending is None else 0.0
    stations = np.linspace(low - room, high + room, STATIONS)
    lines = [machine.line(z, angle) for angle in (0.0, math.pi / 2) for z in stations]
    rows = geometry.matrix(lines, machine.positions)
    across = {"x": rows[:STATIONS].tolist(), "y": rows[STATIONS:].tolist()}
    modes = [] if bending is None else (bending.frequency / (2 * math.pi)).tolist()
    return {"stations": stations.tolist(), "shape": across, "modes": modes}


def _filter_of(machine: Machine, kf: Estimator) -> dict[str, Any]:
    """Return the data of the page's filters, for any speed."""
    rebuild = Rebuild.of(machine)
    constant, by_reading = kf.view.start_form(kf.states, kf.levitation_current)
    view, axes = kf.view.seen_by, kf.view.H
    displayed = np.hstack([axes @ one[:, None] for one in kf.view.displayed.T])
    bent = kf.view.bent(kf.states)
    return {
        "names": list(rebuild.names), "values": rebuild.values.tolist(),
        "model": model_numbers(kf, rebuild),
        "view": {name: view[name] for name in VIEW} | {"bent": bent.tolist()},
        "lag": kf._settings["lag"], "f_0": kf._settings["f_0"],
        "rest": constant.tolist(), "by_reading": by_reading.tolist(),
        "displayed": displayed.tolist(), "added": np.linalg.pinv(displayed).tolist(),
        "loads": [state.role for state in kf.states].index("disturbance force"),
        **dict(zip(("along", "moving"), _plain(kf.view.along_axes(kf.states)), strict=True)),
    }  # fmt: skip


def _plain(value: Any) -> Any:
    """Return numbers, arrays and tuples of them in JSON types."""
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return np.asarray(value).tolist()
