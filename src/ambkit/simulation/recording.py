"""The record of a run: signals by the names of axes and readings, and what was simulated."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.pickling import own_version
from ambkit.data.record import Record
from ambkit.data.signals import signal

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine
    from ambkit.simulation.fields import InLoops, StraightLine


UNITS = {
    "r": "m", "y": "m", "u": "V",
    "x": "m", "v": "m/s", "f_d": "N", "x_m": "m", "iu": "A", "f_mag": "N",
}  # fmt: skip
"""Signals of a single axis, in their order."""


def recorded(
    form: StraightLine | InLoops, t: Array, out: dict[str, Any], series: dict[str, Array],
    begin: int,
) -> Record:  # fmt: skip
    """Return the record of what C says, from a sample on."""
    machine, scenario = form.machine, form.scenario
    axes = [axis.name for axis in machine.axes]
    force = form.force(out["force"])
    told = ("X", "iu", "y", "u")
    out = out | {name: np.asarray(out[name], float) for name in told}
    if scenario.off is not None:
        bias = [axis.bearing.magnet.bias_current for axis in machine.axes]
        out["iu"] = np.where((t < scenario.off)[:, None], out["iu"], np.negative(bias))
    signals: dict[str, tuple[Array, str]] = {}
    for k, reading in enumerate(machine.readings):
        signals[signal("y", reading.name)] = out["y"][:, k], "m"
    for k, axis in enumerate(machine.axes):
        unit = axis.bearing.amplifier.control_unit
        signals[signal("u", axis.name)] = out["u"][:, k], unit
    moved = form.moved(out["X"])
    of_axes = {
        "r": (series["r"], "m"), **({} if moved is None else {"s": (moved, "m")}),
        "iu": (out["iu"], "A"), "f_mag": (force, "N"),
        "f_d": (series["f_d"], "N"),
    }  # fmt: skip
    for name, (values, unit) in of_axes.items():
        signals |= {signal(name, axis): (values[:, k], unit) for k, axis in enumerate(axes)}
    signals |= {name: (out["X"][k], unit) for name, (k, unit) in form.states.items()}
    if "speed" in series:
        signals["speed"] = series["speed"], "rad/s"
    if moved is None:
        signals = {name: signals[name] for name in UNITS}
    for name, _ in scenario.by_axis("injection", axes[0]):
        signals[signal("injected", name)] = series["injected"][:, axes.index(name)], "m"
    # Just after the sample, where the voltage is limited: that of a coil, and of a pair's other.
    for name in ("u_coil", "u_coil_2"):
        if name in out:
            signals[name] = np.asarray(out[name], float), "V"
    if scenario.sequence is not None:
        signals["mode"] = out["mode"].astype(float), "1"
    for way in {item.direction for item in scenario.base}:
        signals[f"base_{way}"] = series["base"][:, "xyz".index(way)], "m/s^2"
    return Record(
        t,
        {name: values for name, (values, _) in signals.items()},
        {name: unit for name, (_, unit) in signals.items()},
        meta={
            "bearing" if moved is None else "machine": _said(machine),
            "scenario": scenario.model_dump(mode="json"),
            "seed": scenario.seed,
            "run": scenario.run,
            "version": own_version(),
            "stop_touched": int(out["touched"]),
            "first_touch": begin + int(out["first"]) if out["touched"] else None,
        },
    )


@lru_cache(maxsize=64)
def _said(machine: Machine) -> str:
    """Return a machine as text, which many runs of it share."""
    return machine.to_toml()
