"""Common parts of the force laws in `ambkit.machine.laws`.

Each model of a magnet (these, :class:`ambkit.StiffnessMap`, :class:`ambkit.Expert`) has the
method ``in_core(core)`` that builds the C implementation of ``ambkit/magnet.h`` from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import real
from ambkit.base.root import root

if TYPE_CHECKING:
    from ambkit._core import Magnet

Precision = Literal["float64", "float32"]

_BUILDS = {"float64": "ambkit._core", "float32": "ambkit._core_f32"}
_ANY_MODEL = {"float64": "ambkit._any", "float32": "ambkit._any_f32"}

MU_0 = 1.25663706127e-6  #: Vacuum magnetic permeability [N/A^2] (CODATA 2022).


class IsolatedAxis(Protocol):
    """A machine with one axis, as its force law sees it."""

    @property
    def magnet(self) -> Any:
        """Its ``[magnet]``."""

    @property
    def rotor(self) -> Any:
        """Its ``[rotor]``."""

    @property
    def clearance(self) -> float:
        """Greatest displacement [m]."""

    @property
    def current_min(self) -> float:
        """Least control current [A]."""

    @property
    def current_max(self) -> float:
        """Greatest control current [A]."""


def symmetric_current_limit(machine: IsolatedAxis) -> tuple[float, float]:
    """Current [A] and displacement [m] that count as equally far from the origin."""
    # The paper's least squares steps 0.01 A and 0.01 mm (eq. 27): on its rig, with 1.5 A and 2 mm,
    # one ampere weighs as one millimetre. Another bearing keeps the ratio to its bias current and
    # air gap, so that its stiffnesses divide the force between them as the paper's do.
    return machine.magnet.bias_current / 1.5, machine.magnet.air_gap / 2


@runtime_checkable
class MagnetModel(Protocol):
    """What an estimator knows of its magnet: anything that can be asked for force, k_i and k_s."""

    def in_core(self, core: ModuleType) -> Magnet:
        """Build the C implementation.

        Parameters
        ----------
        core : module
            Build of the core, see `core_module`.
        """


NEAR = 2e-15  #: Of a current, how far from the root that is found the last bits are looked for.


@cache
def core_module(precision: Precision = "float64", *, any_model: bool = False) -> ModuleType:
    """Return a build of the C core."""
    if precision not in _BUILDS:
        raise ValueError(f"precision must be 'float64' or 'float32', got {precision!r}")
    return import_module((_ANY_MODEL if any_model else _BUILDS)[precision])


class Law(MagnetModel):
    """The force of a bearing's magnet, as the C core computes it."""

    machine: IsolatedAxis
    ideal: ClassVar[bool] = False
    """Whether it is that of ideal iron, in which ADALINE and a coil's voltage are stated."""

    def of_one_coil(self) -> dict[str, Any] | None:
        """Return the fields of the law of one coil; None where only their sum is known."""
        return None

    @property
    def bias_force(self) -> float:
        """Force at iu = 0, x = 0 [N]: zero for a two-sided magnet."""
        m = self.machine.magnet
        # Forces are relative to it, and without any current there is no force.
        if m.type == "two-sided":
            return 0.0
        return -float(_evaluate(self, "force", -m.bias_current, 0.0)[0])

    def carries(self, force: float, low: float, high: float) -> bool:
        """Whether the magnet exerts at least this force at x = 0 at one of two control currents.

        Parameters
        ----------
        force : float
            Total force of the magnet [N].
        low, high : float
            Minimum and maximum control current [A].
        """
        magnet_force, middle = force - self.bias_force, np.zeros(1)
        at = np.array([low if magnet_force < 0 else high])
        pulled = float(self.in_core(core_module()).force(at, middle)[0])
        enough = pulled <= magnet_force if magnet_force < 0 else pulled >= magnet_force
        return enough and math.isfinite(pulled)

    def current_for(self, force: float) -> float:
        """Return the control current iu [A] for a force at x = 0.

        Parameters
        ----------
        force : float
            Total force of the magnet [N].

        Returns
        -------
        float
            Infinite if no current gives it.
        """
        magnet, middle, at = self.in_core(core_module()), np.zeros(1), np.zeros(1)
        magnet_force = force - self.bias_force

        def lacks(iu: float) -> float:
            """Return what the magnet pulls less than is wanted, in the direction of that."""
            at[0] = iu
            return math.copysign(1.0, magnet_force) * (
                magnet_force - float(magnet.force(at, middle)[0])
            )

        if magnet_force == 0:
            return 0.0
        low, high = 0.0, math.copysign(self.machine.magnet.bias_current, magnet_force)
        while not lacks(high) <= 0:
            low, high = high, 2 * high
            if not math.isfinite(high):
                return high
        if lacks(low) > 0:
            near = root(lacks, low, high, 1e-15 * abs(high))
            for end in (near * (1 - NEAR), near * (1 + NEAR)):
                if min(low, high) < end < max(low, high):
                    low, high = (low, end) if lacks(end) <= 0 else (end, high)
        while low < (half := 0.5 * (low + high)) < high or high < half < low:
            low, high = (low, half) if lacks(half) <= 0 else (half, high)
        return high

    def force(self, iu: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Total force of the magnet.

        Parameters
        ----------
        iu, x : array_like
            Control current [A] and displacement [m], with shapes that broadcast.

        Returns
        -------
        ndarray
            Force [N] with the bias force, broadcast shape.
        """
        (f,) = _evaluate(self, "force", iu, x)
        return f + self.bias_force

    def stiffness(self, iu: ArrayLike, x: ArrayLike) -> tuple[NDArray[np.float64], ...]:
        """k_i [N/A] and k_s [N/m] with ``F - F(0, 0) = k_i iu + k_s x`` (paper, eq. 26).

        The limit of the paper's least squares (eq. 28-31) for small steps.

        Parameters
        ----------
        iu, x : array_like
            Control current [A] and displacement [m], with shapes that broadcast.
        """
        return _evaluate(self, "through_origin", iu, x)

    def tangent(self, iu: ArrayLike, x: ArrayLike) -> tuple[NDArray[np.float64], ...]:
        """``dF/diu`` [N/A] and ``dF/dx`` [N/m], of the shape that `iu` and `x` broadcast to.

        Parameters
        ----------
        iu, x : array_like
            Control current [A] and displacement [m], with shapes that broadcast.
        """
        return _evaluate(self, "tangent", iu, x)


@dataclass(frozen=True)
class ForceLaw(Law):
    """A force law of models/laws.

    Parameters
    ----------
    machine : Machine
        A machine with one axis.
    """

    machine: IsolatedAxis
    name: ClassVar[str]  #: As the core calls it.

    @classmethod
    def holds_for(cls, m: Any) -> bool:
        """Whether the keys of a ``[magnet]`` define this law.

        Parameters
        ----------
        m : Magnet
            The ``[magnet]`` of a machine.
        """
        return False

    @classmethod
    def parameters_of(cls, m: Any) -> dict[str, float]:
        """Return the parameters of a ``[magnet]``, by their names in C.

        Parameters
        ----------
        m : Magnet
            The ``[magnet]`` of a machine.
        """
        raise NotImplementedError

    @property
    def fields(self) -> dict[str, Any]:
        """The fields of the core's struct."""
        ampere, metre = symmetric_current_limit(self.machine)
        m = self.machine.magnet
        common = {"two_sided": m.type == "two-sided", "ampere": ampere, "metre": metre}
        return self.parameters_of(m) | common

    def of_one_coil(self) -> dict[str, Any] | None:
        return self.fields | {"two_sided": False} if self.ideal else None

    def in_core(self, core: ModuleType) -> Magnet:
        return core.Law(self.name, **self.fields)  # type: ignore[no-any-return]


def _evaluate(
    magnet: MagnetModel, method: str, iu: ArrayLike, x: ArrayLike
) -> tuple[NDArray[np.float64], ...]:
    """Call a method of the C magnet with arrays that broadcast; always a tuple of arrays."""
    i, d = np.broadcast_arrays(real("iu", iu), real("x", x))
    result = getattr(magnet.in_core(core_module()), method)(i.ravel(), d.ravel())
    parts = result if isinstance(result, tuple) else (result,)
    return tuple(np.asarray(part).reshape(i.shape) for part in parts)


def evaluate_stiffness(
    magnet: MagnetModel, iu: ArrayLike, x: ArrayLike
) -> tuple[NDArray[np.float64], ...]:
    """Return k_i [N/A], k_s [N/m] of any magnet, through-origin form, at (iu [A], x [m])."""
    return _evaluate(magnet, "through_origin", iu, x)


def evaluate_force(magnet: MagnetModel, iu: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
    """Force relative to the bias force [N] of any magnet at (iu [A], x [m])."""
    return _evaluate(magnet, "force", iu, x)[0]
