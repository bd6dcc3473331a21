"""One axis in the C of the simulation, by numbers alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambkit.machine.magnets import core_module

PID = ("kp", "ki", "kd", "T_f", "T_t", "weight", "iu_min", "iu_max")


def fly(magnet: Any, **told: Any) -> dict[str, Any]:
    """A run with a PID that the measurement feeds: columns by the names of a record."""
    f_0 = told["f_0"]
    gains = {"weight": 1.0} | {name: told[name] for name in PID if name in told}
    names = ("m", "f_0", "K_sen", "T_sen", "travel", "substeps")
    axis = {"magnet": magnet, "bias": told.get("f_bias", 0.0), "coil": told.get("coil"),
            "parts": told.get("parts") or {}} | {name: told[name] for name in names}  # fmt: skip
    loop = {"axis": axis, "T": told["T"], "k_ui": [told["k_ui"]], "feedback_estimate": False,
            "pid": [gains[name] for name in PID]}  # fmt: skip
    held = np.array([told["integral"]])
    out = core_module().simulate(
        loop, r=told["r"], load=told["f_d"], noise_u=told["noise_u"], noise_y=told["noise_y"],
        scale=told.get("scale"), place=np.array([told.get("x_start", 0.0)]), integral=held,
        current=np.clip(held, told["iu_min"], told["iu_max"]),
    )  # fmt: skip
    columns = {name: out[name][:, 0] for name in ("iu", "y", "u")}
    columns |= dict(zip(("x", "v", "x_m"), out["X"], strict=True))
    return out | columns | {"force": out["force"][:, 0] + f_0}
