"""What is to be said of a machine."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ambkit.base.units import engineering
from ambkit.control.default_control import default_control
from ambkit.judge.whirl_modes import stiffnesses
from ambkit.models.continuous import open_loop
from ambkit.models.machine_parts import machine_model
from ambkit.rotordynamics.flexible_rotor_checks import Remark, of_bending
from ambkit.rotordynamics.separation_margins import separations

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine

COUPLED = 0.01  #: Inertial coupling from which on axes are not bearings alone.


def described(machine: Machine) -> tuple[str, tuple[Remark, ...]]:
    """Return what a machine is in a few words, and remarks."""
    model = machine_model(machine)
    about = [
        machine.name,
        f"{len(machine.axes)} axes",
        engineering(machine.rotor.mass, "kg"),
        f"{len(machine.readings)} readings",
        f"{engineering(machine.speed * 30 / math.pi, '1')} rpm",
        f"{len(model.states)} states",
    ]
    remarks = [Remark(_of_the_poles(machine)), *of_bending(machine)]
    if machine.speed:
        remarks.append(Remark(default_control(machine).summary))
        remarks.append(Remark(separations(machine).sentence()))
    return "; ".join(about), tuple(remarks)


def _of_the_poles(machine: Machine) -> str:
    """Say what the axes would be as bearings alone, and that they are not."""
    linear, masses = stiffnesses(machine), machine.effective_masses
    same: dict[tuple[str, str], list[str]] = {}
    for axis, mass, k in zip(machine.axes, masses, linear, strict=True):
        pair = engineering(mass, "kg", 4), engineering(math.sqrt(k.k_s / mass), "rad/s", 4)
        same.setdefault(pair, []).append(axis.name)
    bearings = ", ".join(
        f"{' and '.join(names)} {mass} and {pole}" for (mass, pole), names in same.items()
    )
    share = machine.coupling
    if share < COUPLED and not machine.speed:
        return f"the axes are bearings alone, with an effective mass and a pole of: {bearings}"
    poles = open_loop(machine, [k.k_s for k in linear]).unstable
    text = " and ".join(
        dict.fromkeys(
            engineering(pole.real, "rad/s", 6)
            if abs(pole.imag) < 1e-9 * pole.real
            else f"{pole.real:.6g} ± {pole.imag:.4g}j rad/s"
            for pole in poles[poles.imag >= 0]
        )
    )
    return (
        f"without control the rotor falls away with {text}; as bearings alone the axes would have "
        f"an effective mass and a pole of: {bearings}; they couple by {share:.0%}"
    )
