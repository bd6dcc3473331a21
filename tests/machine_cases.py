"""Machines for several tests."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from quick import quick
from scipy.integrate import solve_ivp

from ambkit import Machine, Recorded
from ambkit.estimate.registry import KINDS, learned_magnet
from ambkit.identification.excitation.signals import sparse_multisine
from ambkit.machine import presets
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Injection, Scenario

Array = NDArray[np.float64]

BEARINGS = [name for name in presets.names() if Machine.preset(name).single]
PRESETS = [name for name in presets.names() if name not in BEARINGS]
RIGS = ["hindawi_2011", "tum_mlps", "ufu_flexible", "ufu_rig"]
RIGID = [name for name in RIGS if name != "ufu_flexible"]
AND_LONG = quick(PRESETS, RIGS)
"""All presets, those that are not among the first ones in the long tests alone."""
OF_KILOGRAMS = quick([*RIGS, "compressor", "tum_mlps_flexible"], RIGID)
"""Those that loads of some newtons do not throw into their touch-down bearings."""

UFU = Machine.preset("ufu_rig")

MAGNET = {
    "type": "two-sided", "magnet_constant": 3.6e-6, "air_gap": 0.7e-3, "bias_current": 2.0,
}  # fmt: skip


def bearing(name: str, place: float, **keys: Any) -> dict[str, Any]:
    amplifier = {"gain": 1.0, "current_limit": 2.0, "noise_variance": 1e-5}
    amplifier |= keys.pop("amplifier", {})
    given = {"name": name, "place": place, "clearance": 0.3e-3, "magnet": MAGNET}
    return given | {"amplifier": amplifier} | keys


def sensor(name: str, place: float, **keys: Any) -> dict[str, Any]:
    given = {"name": name, "place": place, "gain": 1.0, "lag": 5e-5, "noise_variance": 0.25e-12}
    return given | keys


def machine(**keys: Any) -> Machine:
    """A rotor of 4 kg on bearings at 0.2 and -0.3 m."""
    data: dict[str, Any] = {
        "name": "made", "sampling_time": 1e-4, "speed": 500.0,
        "rotor": {"mass": 4.0, "transverse_inertia": 0.16, "polar_inertia": 0.05},
        "bearing": [bearing("A", 0.2), bearing("B", -0.3)],
        "sensor": [sensor("A", 0.2), sensor("B", -0.3)],
    }  # fmt: skip
    return Machine(**data | keys)


def five_axes() -> Machine:
    """That with a thrust bearing and its sensor."""
    bearings = [bearing("A", 0.2), bearing("B", -0.3), bearing("T", 0.0, type="thrust")]
    sensors = [sensor("A", 0.2), sensor("B", -0.3), sensor("T", 0.0, type="axial")]
    return machine(bearing=bearings, sensor=sensors)


def gained(name: str) -> Machine:
    """A preset whose gains are not 1, where a product would be a quotient; noisy amplifiers."""
    one = Machine.preset(name)
    bearings = [
        each.model_copy(update={"amplifier": each.amplifier.model_copy(
            update={"gain": 1.6 * each.amplifier.gain, "noise_variance": 1e-3})})
        for each in one.bearings
    ]  # fmt: skip
    sensors = [each.model_copy(update={"gain": 0.8 * each.gain}) for each in one.sensors]
    return one.model_copy(update={"bearings": tuple(bearings), "sensor": tuple(sensors)})


def uncoupled() -> Machine:
    """Bearings in each other's centre of percussion: a push on one does not move the other."""
    m, I_t, z = 4.0, 0.16, 0.2
    other = -I_t / (m * z)
    rotor = {"mass": m, "transverse_inertia": I_t, "polar_inertia": 0.05, "gravity": "none"}
    return machine(
        speed=0.0, rotor=rotor, bearing=[bearing("A", z), bearing("B", other)],
        sensor=[sensor("A", z), sensor("B", other)],
    )  # fmt: skip


def directions(machine: Machine, lines: Any) -> Array:
    """Displacements along lines by (x, y, th_x, th_y, m1_x, m1_y, ...), written anew."""
    rows = []
    for each in lines:
        z, c, s, shape = each.line
        rows.append([c, s, -z * s, z * c, *(out * way for out in shape for way in (c, s))])
    return np.array(rows)


def slopes(machine: Machine, q: Array, w: Array, F: Array, speed: float | None = None) -> Array:
    """Second derivatives of q, by the equations of the issue: both planes as x + j y.

    In a plane ``M q'' + (D - j speed G) q' + K q`` over x, tilt and the modes, and of what damps
    within the rotor ``D_internal (q' - j speed q)``.
    """
    rotor, bending = machine.rotor, machine.bending
    speed = machine.speed if speed is None else speed
    modes = 0 if bending is None else len(bending.frequency)
    M, K = np.zeros((2, 2 + modes))
    M[:2], G, D = [rotor.mass, rotor.transverse_inertia], np.zeros((2 + modes,) * 2), 0
    G[1, 1] = rotor.polar_inertia
    if bending is not None:
        M[2:], K[2:] = bending.mass, bending.stiffness
        G[1:, 1:], D = bending.polar, bending.damping
        inner = np.pad(bending.internal, (2, 0))
    H = directions(machine, machine.axes)
    weight = np.array([-rotor.mass * 9.81 if rotor.gravity == "-x" else 0.0, 0, 0, 0])
    push = H.T @ F
    if bending is None:
        push += weight
    else:  # as forces along the axes: it bends the rotor no more than when it hangs in them
        push += H.T @ np.linalg.solve(H[:, :4].T, weight)
    p, u, v = _in_planes(push), _in_planes(q), _in_planes(w)
    a = p + 1j * speed * G @ v
    if modes:
        a = a - D @ v - K * u - inner @ (v - 1j * speed * u)
    a = a / M
    found = np.empty_like(q)
    found[0], found[1], found[2], found[3] = a[0].real, a[0].imag, -a[1].imag, a[1].real
    found[4::2], found[5::2] = a[2:].real, a[2:].imag
    return found


def _in_planes(q: Array) -> Any:
    """(x + j y, th_y - j th_x, m1_x + j m1_y, ...)."""
    return np.r_[q[0] + 1j * q[1], q[3] - 1j * q[2], q[4::2] + 1j * q[5::2]]


def integrated(rhs: Any, state: Array, ends: tuple[float, float], scale: Array) -> Array:
    """Stiff integration to 1e-10."""
    found = solve_ivp(rhs, ends, state, "Radau", rtol=1e-10, atol=1e-12 * scale)
    return np.asarray(found.y[:, -1])


def uncontrolled(one: Machine) -> dict[str, Any]:
    """What the core is told of controllers that let the demanded currents stand."""
    p, m = len(one.axes), len(one.readings)
    return {
        "T": one.sampling_time, "k_ui": [1.0] * p, "feedback_estimate": False,
        "pid": [[0.0, 0.0, 0.0, 0.0, 1.0, 1.0, -9.0, 9.0]] * p, "position": [0.0] * (p * m),
        "reference": np.eye(p).ravel().tolist(),
        "spread": np.eye(p).ravel().tolist(), "iu_min": [-9.0] * p, "iu_max": [9.0] * p,
        **dict.fromkeys(
            ("velocity", "fed_back", "fed_back_by_speed", "fed_back_by_square",
             "unbalance_control_motion", "schedule_speed")
        ),
    }  # fmt: skip


def made(name: str, machine: Machine, **options: Any) -> Any:
    """An estimator of a kind for a machine, with what its kind knows of the magnets."""
    return KINDS[name].make(machine, learned_magnet(name, machine), **options)


def injected(seed: int, axis: str = "B1", noise: bool = True) -> tuple[Machine, Any]:
    """A record of the machine with a multisine at the summing point of an axis."""
    T = UFU.sampling_time
    period = sparse_multisine(2000, T, (10.0, 1500.0), per_decade=12).values
    values = np.concatenate([np.zeros(500), 4e-6 * np.tile(period, 8)])
    t = T * np.arange(len(values))
    signal = Recorded.model_construct(times=tuple(t.tolist()), values=tuple(values.tolist()))
    there = Injection.model_construct(axis=axis, position=signal)
    flight = Scenario(
        duration=float(t[-1]), noise=noise, seed=seed, controller={"feedback": "measurement"}
    )
    still = UFU.model_copy(update={"unbalance": (), "speed": 0.0})
    return still, simulate_run(still, flight.model_copy(update={"injection": (there,)})).record
