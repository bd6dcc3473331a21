"""Input of the page's C: a machine with one axis, or a rotor on several bearings."""

import math
import tomllib
from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Any, Literal, get_args

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.control.default_control import settled
from ambkit.estimate.core_model import NUMBERS, arrays, numbers
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.rebuild import Rebuild
from ambkit.estimate.registry import KINDS, learned_magnet
from ambkit.machine import geometry
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module
from ambkit.machine.parts import along_x
from ambkit.models.machine_parts import PAPER_CONSTANTS
from ambkit.simulation.run import Loop
from ambkit.simulation.scenario import Scenario

MOST_PAST = 3  #: Maximum dead time in samples of an axis's filters in the page.


def model_numbers(kf: Estimator, rebuild: Rebuild) -> list[float]:
    """Return pattern, plan and states of a filter's model in the order of ``web/core/model.c``."""
    of, pattern, settings = rebuild.fields, arrays(kf.model), kf._settings
    sparse = [pattern[name] for name in ("L", "b", "B_u", "h", "d", "c", "N", "rest")]
    counts = ("states", "forces", "controls", "sensors", "noises")
    lists = [[len(of[name]), *of[name]] for name in ("constant", "operation")]
    terms = (of[name] for name in ("row", "column", "use", "value", "k_i", "intensity"))
    _, *states = kf.view.sized(kf.states)
    loads = len(kf.machine.axes)
    return [
        *(pattern[name] for name in counts),
        *(item for start, column, _ in sparse for item in (*start, *column)), *pattern["role"],
        len(rebuild.names), *of["low"], *of["high"], *lists[0], *lists[1], *of["left"],
        *of["right"], len(of["row"]), *(item for part in terms for item in part),
        len(of["from"]), *of["from"],
        len(of["late"]), *(item for k, past, q in of["late"] for item in (k, len(past), *past, q)),
        *(item for part in states for item in part), loads, *settings["var_d"][loads:],
        settings["gate"], settings["frozen_limit"], settings["outlier_limit"],
        *_named(kf),
    ]  # fmt: skip


def _named(kf: Estimator) -> list[int]:
    """Return the number of values, and the index of each in the paper's axis, from 1."""
    if not kf.engine.built_in:
        return [0]
    places: dict[str, Any] = {name: np.zeros_like(getattr(kf.model, name)) for name in NUMBERS}
    for k, (matrix, *at) in enumerate(PAPER_CONSTANTS, 1):
        name = matrix.rstrip("0")
        places[name][(0, *at) if name == "N" else tuple(at)] = k
    described: Any = SimpleNamespace(**vars(kf.model) | places)
    of_numbers = numbers(described).astype(int).tolist()
    return [len(of_numbers), *of_numbers]


def axis_models() -> list[list[float]]:
    """Return the models of an axis by samples of dead time, each without and with a bandwidth."""
    paper = Machine.preset("zittau_axial")
    results = []
    for past in range(MOST_PAST + 1):
        for bandwidth in (None, 1e3):
            machine = paper.replace(
                delay=past * paper.sampling_time or None, amplifier__bandwidth=bandwidth
            )
            rebuild = Rebuild.of(machine, timed=True)
            any_value = {"low": [0.0] * len(rebuild.names), "high": [1e300] * len(rebuild.names)}
            rebuild = rebuild._replace(fields=rebuild.fields | any_value)
            results.append(model_numbers(KINDS["extended"].make(machine), rebuild))
    return results


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
        "names": machine.axis_names,
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
