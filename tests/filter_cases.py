"""A filter, a record for it, and what its covariance is looked at with; for several tests."""

from dataclasses import replace
from typing import Any

import numpy as np
import oracles
from numpy.typing import NDArray

import ambkit
from ambkit import ClosedLaw, Machine
from ambkit.machine.magnets import core_module
from ambkit.models import Model
from ambkit.models.machine_parts import PAPER_CONSTANTS

Array = NDArray[np.float64]

BEARING = Machine.preset("zittau_axial")
SETTINGS = oracles.settings_of(BEARING)
START = np.array([2e-5, 0.01, -1.0, 1e-5])
STD = np.array([3e-5, 0.012, 5.0, 3e-5])
PRECISIONS = ("float64", "float32")


def core_settings(s: oracles.Settings) -> dict[str, Any]:
    """The settings as the core has them: one value for each sensor, control, force, state, noise.

    The caps are those of a rotor between its stops, which a tenth of the travel in a sample is the
    most for (``ambkit/envelope.h``).
    """
    velocity = 0.1 * (s["x_max"] / s["T"])
    cap = [s["x_max"], velocity, s["m"] * (velocity / s["T"]), 3 * abs(s["K_sen"]) * s["x_max"]]
    own = {
        "K_sen": [s["K_sen"]], "lag": [s["T_sen"]], "travel": [s["x_max"]], "cap": cap,
        **{name: [s[name]] for name in (
            "k_ui", "iu_min", "iu_max", "f_0", "x_max", "var_u", "var_d", "var_y", "rise",
            "step",
        )},
    }  # fmt: skip
    as_they_are = ("T", "dwell", "gate", "frozen_limit", "outlier_limit")
    return own | {name: s[name] for name in as_they_are if name in s}


def core_model(core: Any, s: oracles.Settings) -> Any:
    """The paper's axis, built in."""
    return core.Model(s["T"], s["m"], s["K_sen"], s["T_sen"], s["as_printed"])


def made(core: Any, kind: str, magnet: Any, s: oracles.Settings, **own: Any) -> Any:
    """An estimator of the core, of the paper's axis, straight from settings; not started.

    Parameters
    ----------
    core : module
        A build with the built-in model.
    kind : str
        Its class there.
    magnet : Magnet
        Of that build.
    s : Settings
        Flat, SI.
    **own
        What only this kind has.
    """
    return getattr(core, kind)(magnet, core_model(core, s), **own, **core_settings(s))


def core_filter(s: oracles.Settings, precision: Any = "float64", magnet: Any = None) -> Any:
    """A filter of the core, straight from settings; started at START, STD."""
    core = core_module(precision)
    kf = made(core, "Kalman", magnet or core.Constant(10.05, 7537.5), s)
    kf.reset(START, STD)
    return kf


def with_core_s_numbers(model: Model, parameters: dict[str, Any]) -> Model:
    """The paper's axis with the very numbers that the built-in one has.

    They differ by rounding, and where the sensor's lag meets the growth of the load by 1e-4: there
    the core has four points of a quadrature, the model the exact integral.
    """
    arrays: dict[str, Any] = {
        name: np.array(getattr(model, name)) for name in ("L", "b", "h", "N", "rest")
    }
    for (matrix, i, j), name in PAPER_CONSTANTS.items():
        value = parameters["model"][name]
        if matrix == "N0":
            arrays["N"][0, i, j] = arrays["N"][0, j, i] = value
        else:
            arrays[matrix][i, j] = value
    return replace(model, **arrays)


def step_matrices(kf: Any, s: oracles.Settings) -> tuple[Array, Array, Array]:
    """A (4, 4), B (4,) and Q (4, 4), read off the core's own step; of constant stiffness, f_0 0."""

    def ahead(mean: Array, u: float, std: Array) -> tuple[Array, Array]:
        kf.reset(mean, std)
        kf.predict(u)
        return kf.mean, kf.covariance

    certain, nothing = 1e-9 * STD, np.zeros(4)
    scale = np.array([s["x_max"], 0.01 * s["x_max"] / s["T"], s["m"], s["x_max"]]) / 10
    A = np.column_stack([ahead(np.eye(4)[j] * scale, 0.0, certain)[0] for j in range(4)]) / scale
    mean, P = ahead(nothing, 0.1, certain)
    return A, mean / 0.1, P - A @ np.diag(certain**2) @ A.T


def moving_record(duration: float, seed: int = 0) -> dict[str, Array]:
    """A rotor that swings by 0.3 mm under noise, and its stiffnesses, other ones at each step."""
    scenario = ambkit.Scenario(
        duration=duration,
        seed=seed,
        reference=ambkit.Sine(amplitude=3e-4, frequency=5.0),
        disturbance=ambkit.Sine(amplitude=3.0, frequency=20.0),
    )
    record = ambkit.simulate(BEARING, scenario).record
    k_i, k_s = ClosedLaw(BEARING).stiffness(record["iu"], record["x"])
    return {"y": record["y"], "u": record["u"], "k_i": k_i, "k_s": k_s}


def full(triangle: Array) -> Array:
    """Covariances (n, states, states) from upper triangles (n, states (states + 1) / 2)."""
    states = round((np.sqrt(8 * triangle.shape[1] + 1) - 1) / 2)
    P = np.empty((len(triangle), states, states))
    rows, columns = np.triu_indices(states)
    P[:, rows, columns] = P[:, columns, rows] = triangle
    return P


def least_correlation_eigenvalue(P: Array) -> float:
    """Positive exactly where P is positive definite, whatever the units of the states."""
    P = np.asarray(P, dtype=float)
    d = np.sqrt(np.diag(P))
    return float(np.linalg.eigvalsh(P / np.outer(d, d))[0])


def off(a: Array, b: Array) -> Array:
    """Greatest difference of each state, relative to its scale in b."""
    return np.asarray(np.abs(a - b).max(axis=0) / np.abs(b).max(axis=0))
