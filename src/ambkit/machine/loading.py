"""A machine by name, preset or TOML file, and its levitation current."""

from __future__ import annotations

import difflib
import os
from pathlib import Path

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.root import root
from ambkit.machine import presets
from ambkit.machine.force_law import MagnetModel, core_module
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import Law, magnet_of


def levitation_current(machine: Machine, plant: MagnetModel, x: float, balance: float) -> float:
    """Return the control current [A] that balances ``balance`` [N] at x [m], within limits."""
    # Called a dozen times for each of a million machines: the C magnet itself, in place.
    magnet, i, s = plant.in_core(core_module()), np.empty(1), np.array([x], float)

    def force(iu: float) -> float:
        i[0] = iu
        return float(magnet.force(i, s)[0]) + balance

    low, high = machine.current_min, machine.current_max
    at_low, at_high = force(low), force(high)
    if at_low * at_high > 0:
        # No current balances it: start from the limit that comes closest.
        return low if abs(at_low) < abs(at_high) else high
    return root(force, low, high, 1e-15 * (high - low))


def levitation_current_at(
    machine: Machine, x: float = 0.0, load: float = 0.0, magnet: MagnetModel | None = None
) -> float:
    """Return the control current [A] with which a magnet balances weight and disturbance at x."""
    # Used by simulation and margins of each machine of a campaign.
    known = machine.levitation_currents if magnet is None else {}
    if (x, load) not in known:
        law = magnet if isinstance(magnet, Law) else magnet_of(machine)
        balance = machine.weight + law.bias_force + load
        known[x, load] = levitation_current(machine, magnet or law, x, balance)
    return known[x, load]


def load_machine(name: str | os.PathLike[str]) -> Machine:
    """Return a preset, or the machine in a file."""
    known, text = presets.names(), os.fspath(name)
    if text in known:
        return Machine.preset(text)
    if Path(text).suffix == ".toml" or os.sep in text or Path(text).exists():
        return Machine.load(name)
    near = difflib.get_close_matches(text, known, 1)
    hint = f"did you mean {near[0]}?" if near else f"there are: {', '.join(known)}"
    raise AmbkitError(f'there is no preset and no file "{text}"; {hint}')


preset = Machine.preset
