"""Machines of several axes for the core's loops: composed of parts, or of random patterns."""

from dataclasses import replace
from typing import Any

import numpy as np
from filter_cases import BEARING, Array
from model_oracles import Settings, random_model, random_settings

from ambkit import ClosedLaw
from ambkit.estimate.core_model import arrays
from ambkit.machine.magnets import ConstantStiffness, core_module
from ambkit.models import Model, compose
from ambkit.models.declaration import Part
from ambkit.models.parts import Amplifier, Disturbance, MagnetForce, Rotor, Sensor

CORE = core_module(any_model=True)
T = BEARING.sampling_time
BIAS = ClosedLaw(BEARING).bias_force
KNOWN = BEARING.weight + BIAS
TRAVEL = BEARING.clearance


def model_in_core(model: Model) -> Any:
    return CORE.Model(arrays(model))


def with_roles(model: Model, *roles: str) -> Model:
    """The model with these roles, one after the other; further states are noise."""
    named = [*roles, *["noise"] * (len(model.states) - len(roles))]
    states = tuple(replace(at, role=role) for at, role in zip(model.states, named, strict=True))
    return replace(model, states=states)


def random_machine(seed: int, roles: tuple[str, ...]) -> tuple[Model, Settings]:
    """A random pattern of several states, forces and sensors, and settings for it."""
    rng = np.random.default_rng(seed)
    n, p, m = int(rng.integers(6, 11)), int(rng.integers(2, 5)), int(rng.integers(2, 5))
    model = with_roles(random_model(seed, n, p, m), *roles)
    return model, random_settings(model, seed)


def wide(model: Model, s: Settings) -> dict[str, Any]:
    """Settings of the core in which nothing is out of the ordinary."""
    n, p, c, m = (
        len(getattr(model, of)) for of in ("states", "forces", "controls", "measurements")
    )
    return {
        "T": model.T, "K_sen": [1.0] * m, "lag": [0.0] * m, "travel": [1e6] * m,
        "k_ui": s.k_ui.tolist(), "iu_min": [-1e6] * c, "iu_max": [1e6] * c,
        "f_0": np.linspace(-0.3, 0.5, p).tolist(), "x_max": [1e6] * p, "cap": [1e6] * n,
        "var_u": s.var_u.tolist(), "var_d": s.var_noise.tolist(), "var_y": s.var_y.tolist(),
        "rise": [0.0] * m,
        "step": [0.0] * m,
        "dwell": 0.0,
        "gate": 1e6, "frozen_limit": 0, "outlier_limit": 0,
    }  # fmt: skip


# ---- axes of the paper's bearing, beside each other ----


def axes(names: tuple[str, ...], *, coupling: float = 0.0) -> Model:
    """Axes of these names; coupled by their masses or not at all."""
    m, law = BEARING.rotor.mass, ConstantStiffness.of(BEARING)
    mass = {(i, i): m for i in range(len(names))}
    if coupling:
        which = range(len(names))
        mass |= {(i, j): coupling * m for i in which for j in which if i != j}
    velocity, force = 0.1, law.k_i * BEARING.amplifier.current_limit
    current, sensor = BEARING.amplifier.current_limit, BEARING.sensor
    parts: list[Part] = [
        Rotor(mass, TRAVEL, velocity, tuple(f"x{a}" for a in names), tuple(f"v{a}" for a in names))
    ]
    parts += [MagnetForce(force, f"f{a}", f"x{a}") for a in names]
    parts += [Disturbance(force, 1e-3 * force, f"f_d{a}", f"f{a}") for a in names]
    parts += [
        Sensor(sensor.gain, BEARING.lag_of(sensor), TRAVEL, f"y{a}", f"x_m{a}", f"x{a}")
        for a in names
    ]
    parts += [Amplifier(current, None, f"u{a}", f"i{a}", f"f{a}") for a in names]
    return compose(parts, T)


def axes_settings(model: Model) -> dict[str, Any]:
    """Settings of the core for `axes`."""
    p = len(model.forces)
    b, velocity = BEARING, 0.1 * TRAVEL / T
    caps = {
        "position": TRAVEL, "velocity": velocity, "disturbance force": b.rotor.mass * velocity / T,
        "sensor": 3 * b.sensor.gain * TRAVEL,
    }  # fmt: skip
    each = {
        "K_sen": b.sensor.gain, "lag": b.lag_of(b.sensor), "travel": TRAVEL,
        "k_ui": b.amplifier.gain,
        "iu_min": b.current_min, "iu_max": b.current_max, "f_0": KNOWN, "x_max": TRAVEL,
        "var_u": b.amplifier.noise_variance, "var_y": b.sensor.noise_variance,
        "rise": b.sensor.position_noise,
        "step": 0.0,
    }  # fmt: skip
    return {
        **{name: [value] * p for name, value in each.items()},
        "T": T, "var_d": [(2 * BEARING.weight) ** 2 * T] * p, "dwell": 0.0, "gate": 8.0,
        "frozen_limit": 10,
        "outlier_limit": 3, "cap": [caps[state.role] for state in model.states],
    }  # fmt: skip


def axes_std(model: Model) -> Array:
    by_role = {"position": 1e-5, "velocity": 1e-2, "disturbance force": 3.0, "sensor": 1e-5}
    return np.array([by_role[state.role] for state in model.states])


def magnets(model: Model) -> list[Any]:
    return [ClosedLaw(BEARING).in_core(CORE) for _ in model.forces]


def motion(
    model: Model,
    n: int,
    seed: int,
    *,
    scale: float = 1.0,
    swing: Array | None = None,
    rate: float = 8.0,
    load: Array | None = None,
) -> tuple[Array, Array, Array]:
    """States (n, states), y (n, axes) and u (n, axes) of axes that a PD controller holds.

    Parameters
    ----------
    scale : float
        Of the magnets' force.
    swing : ndarray (axes,)
        Amplitudes of the reference [m].
    rate : float
        Its frequency [Hz].
    load : ndarray (axes,)
        Amplitudes of the loads, 3 Hz [N].
    """
    rng, p, s = np.random.default_rng(seed), len(model.forces), axes_settings(model)
    at = {role: [i for i, x in enumerate(model.states) if x.role == role]
          for role in ("position", "velocity", "disturbance force")}  # fmt: skip
    k = ConstantStiffness.of(BEARING)
    law = ClosedLaw(BEARING)
    expected = 200.0
    mass = BEARING.rotor.mass
    kp, kd = (k.k_s + mass * expected**2) / k.k_i, 1.4 * expected * mass / k.k_i
    swing = np.zeros(p) if swing is None else swing
    load = np.zeros(p) if load is None else load
    force = law.in_core(CORE)
    X = np.zeros(len(model.states))
    all_X, all_y, all_u = np.zeros((n, len(X))), np.zeros((n, p)), np.zeros((n, p))
    for j in range(n):
        X[at["disturbance force"]] = load * np.sin(2 * np.pi * 3.0 * j * T)
        all_X[j] = X
        all_y[j] = model.c @ X + rng.normal(0, np.sqrt(s["var_y"]))
        r = swing * np.sin(2 * np.pi * rate * j * T)
        x, v = X[at["position"]], X[at["velocity"]]
        iu = kp * (r - x) - kd * v - (k.k_s * r + KNOWN + X[at["disturbance force"]]) / k.k_i
        all_u[j] = iu / s["k_ui"]
        iu = iu + np.array(s["k_ui"]) * rng.normal(0, np.sqrt(s["var_u"]))
        F = scale * (force.force(model.d @ iu, model.h @ X) + BIAS) - BIAS
        X = model.L @ X + model.b @ (F + s["f_0"] + model.r @ X)
    return all_X, all_y, all_u
