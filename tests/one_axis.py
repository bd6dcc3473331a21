"""One axis in the C of the simulation, by numbers alone."""

from typing import Any

import numpy as np

from ambkit.machine.magnets import core_module

M, K, S0, I0 = 0.518, 6.7e-6, 2e-3, 1.5  # of the paper's bearing

PID = ("kp", "ki", "kd", "T_f", "T_t", "weight", "iu_min", "iu_max")


SENSOR = ("quadratic", "cubic", "step", "rise", "orders", "speed", "runout_cosine", "runout_sine")
STOP = ("stiffness", "damping")


def plant(magnet: Any, told: dict[str, Any]) -> dict[str, Any]:
    """The fields of ``amb_plant``: parts by the names of ``amb_parts``, and what is beside them."""
    amplifier = dict(told.get("parts") or {})
    sensor, stop, late = (
        {name: amplifier.pop(name) for name in names if name in amplifier}
        for names in (SENSOR, STOP, ("delay", "delay_rest"))
    )
    far, behind = amplifier.pop("farthest", told["travel"]), amplifier.get("behind", 0)
    bent = any(name in sensor for name in ("orders", "quadratic", "cubic"))
    lags = amplifier.get("corner", 0) > 0
    return {
        "states": 5 + behind, "positions": 1, "axes": 1, "sensors": 1,
        "mass": [told["m"]], "g": [told["f_0"]], "bias": [told.get("f_bias", 0.0)],
        "magnets": [magnet], "coils": [told.get("coil")], "amplifiers": [amplifier],
        "behind": [[5 + k for k in range(behind)]], "current": [3 if lags else -1],
        "second": [4 if lags and amplifier.get("pair") else -1],
        "farthest": [far if stop.get("stiffness", 0) > 0 else told["travel"]], "shows": [2],
        "sensor_parts": [sensor], "gain": [told["K_sen"]], "lag": [told["T_sen"]],
        "rings": [{"first": 0, "second": -1, "travel": told["travel"], "stop": stop}],
        **({"delay": 0, "delay_rest": 0.0} | late), "substeps": told["substeps"],
        "plain": not (bent or lags or behind or stop),
    }  # fmt: skip


def fly(magnet: Any, **told: Any) -> dict[str, Any]:
    """A run with a PID that the measurement feeds: columns by the names of a record."""
    f_0 = told["f_0"]
    gains = {"weight": 1.0} | {name: told[name] for name in PID if name in told}
    loop = plant(magnet, told) | {
        "T": told["T"], "k_ui": [told["k_ui"]], "feedback_estimate": False,
        "pid": [gains[name] for name in PID],
    }  # fmt: skip
    held = np.array([told["integral"]])
    out = core_module().simulate(
        loop, r=told["r"], load=told["f_d"], noise_u=told["noise_u"], noise_y=told["noise_y"],
        scale=told.get("scale"), place=np.array([told.get("x_start", 0.0)]), integral=held,
        current=np.clip(held, told["iu_min"], told["iu_max"]),
    )  # fmt: skip
    columns = {name: out[name][:, 0] for name in ("iu", "y", "u")}
    columns |= dict(zip(("x", "v", "x_m"), out["X"], strict=True))
    touched = int(out["at_stop"].sum())
    return out | columns | {"force": out["force"][:, 0] + f_0, "touched": touched}


def law(**changes: Any) -> Any:
    """The magnet of the paper's bearing, in the core."""
    fields = {"k": K, "s0": S0, "i0": I0, "two_sided": True, "ampere": 1.0, "metre": 1e-3}
    return core_module().Law("closed", **(fields | changes))


def driven(command: Any, parts: Any, *, T: float = 1e-4, **changes: Any) -> dict[str, Any]:
    """The plant of the paper's axis with control currents demanded at each sample [A]."""
    command = np.asarray(command, dtype=float)
    n = command.size
    magnet, f_d = changes.pop("magnet", None) or law(), changes.pop("f_d", 0.0)
    zero = np.zeros(n)
    loop = {
        "T": T, "m": M, "f_0": 0.0, "K_sen": 1.0, "T_sen": 2e-4, "travel": 1e-3, "substeps": 8,
        "k_ui": 1.0, "iu_min": -1.5, "iu_max": 1.5, "kp": 0.0, "ki": 0.0, "kd": 0.0, "T_f": 0.0,
        "T_t": 0.0, "integral": 0.0, "r": zero,
        "f_d": np.broadcast_to(f_d, n).astype(float), "noise_u": command, "noise_y": zero,
        "x_start": 0.0, "parts": parts,
    }  # fmt: skip
    return fly(magnet, **(loop | changes))
