"""Magnet models: constant stiffness, the closed law, or the law of saturating iron.

`magnet_of` returns the model that a machine describes. Each magnet model (these,
:class:`ambkit.StiffnessMap`, :class:`ambkit.Expert`) has a method ``in_core(core)`` that builds its
C implementation of ``ambkit/magnet.h``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

from ambkit.machine.force_law import MU_0 as MU_0
from ambkit.machine.force_law import IsolatedAxis
from ambkit.machine.force_law import Law as Law
from ambkit.machine.force_law import MagnetModel as MagnetModel
from ambkit.machine.force_law import Precision as Precision
from ambkit.machine.force_law import core_module as core_module
from ambkit.machine.force_law import evaluate_force as evaluate_force
from ambkit.machine.force_law import evaluate_stiffness as evaluate_stiffness
from ambkit.machine.force_law import symmetric_current_limit as symmetric_current_limit
from ambkit.machine.forces.force_map import surface_of
from ambkit.machine.laws import ClosedLaw as ClosedLaw
from ambkit.machine.laws import SaturatingLaw as SaturatingLaw
from ambkit.machine.laws import law_of as law_of

if TYPE_CHECKING:
    from ambkit._core import Magnet


def own_time(machine: IsolatedAxis) -> float:
    """Return ``sqrt(m/k_s)``: the uncontrolled rotor departs by a factor of e in that time [s]."""
    return math.sqrt(machine.rotor.mass / typical_stiffness(machine))


def typical_stiffness(machine: IsolatedAxis) -> float:
    """Return ``|k_s|`` [N/m], or ``k_i i0/s0`` if it is zero in the centre."""
    # Both are equal for ideal iron. A Lorentz actuator is an example of the second.
    k, m = ConstantStiffness.of(machine), machine.magnet
    return float(abs(k.k_s or k.k_i * m.bias_current / m.air_gap))


@dataclass(frozen=True)
class ConstantStiffness(MagnetModel):
    """Linear force law F = k_i iu + k_s x with constant stiffnesses (paper, eq. 14).

    Parameters
    ----------
    k_i : float
        Current stiffness [N/A].
    k_s : float
        Position stiffness [N/m].

    Raises
    ------
    ValueError
        A stiffness is not finite.
    """

    k_i: float
    k_s: float

    def __post_init__(self) -> None:
        for name, unit in (("k_i", "N/A"), ("k_s", "N/m")):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"{name} must be finite [{unit}], got {getattr(self, name)!r}")

    @classmethod
    def of(cls, machine: IsolatedAxis) -> ConstantStiffness:
        """Linearise the machine's magnet at iu = 0, x = 0 (paper, eq. 3-5, corrected).

        Ideal iron, two-sided: ``k_i = 4 k i0 / s0^2``, ``k_s = 4 k i0^2 / s0^3``; the paper prints
        a factor 2 and a minus sign, which its own Tables 4 and 5 contradict.

        Parameters
        ----------
        machine : IsolatedAxis
            The machine.
        """
        k_i, k_s = magnet_of(machine).tangent(0.0, 0.0)
        return cls(float(k_i), float(k_s))

    def in_core(self, core: ModuleType) -> Magnet:
        return core.Constant(self.k_i, self.k_s)  # type: ignore[no-any-return]


def magnet_of(machine: IsolatedAxis) -> Law:
    """Return the magnet model of a machine: its force map or drawing, or its law.

    Parameters
    ----------
    machine : IsolatedAxis
        The machine.

    Raises
    ------
    AmbkitError
        The force map cannot be read.
    """
    if machine.magnet.force_map is None:
        return law_of(machine)
    if str(machine.magnet.force_map).endswith(".toml"):
        from ambkit.machine.forces.drawing import computed_force

        return computed_force(machine)
    return surface_of(machine)


def bias_force_of(magnet: MagnetModel, machine: IsolatedAxis) -> float:
    """Return the force at iu = 0, x = 0 [N] of a magnet model, or of the machine's magnet."""
    return (magnet if isinstance(magnet, Law) else magnet_of(machine)).bias_force
