"""The whole controller of a machine, for ``core/include/ambkit/control.h``: flown and exported."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.machine.magnets import ConstantStiffness
from ambkit.simulation.control import bound_of, settling_of
from ambkit.simulation.controllers import Controllers, arrays

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.estimate.view import View
    from ambkit.simulation.plant import Plant
    from ambkit.simulation.sequence import LiftOff

Array = NDArray[np.float64]

FLAT = 0.05
"""Where a rotor lies so near to the middle of an axis, as a share of what its stop leaves it, that
axis is held by the stiffnesses of the middle."""


@dataclass(frozen=True, eq=False)
class MachineController:
    """Estimator, controllers, lift-off and landing of a whole machine: what flies."""

    plant: Plant  #: The machine.
    estimator: Estimator  #: That feeds the controllers, or looks after the sensors beside them.
    controllers: Controllers  #: Of all axes.
    sequence: LiftOff  #: Lift-off and landing, of all axes together.
    fed: bool  #: Whether the estimator feeds the controllers; else the readings do.

    @property
    def _whole(self) -> View:
        assert self.estimator.whole is not None  # who makes one has a machine
        return self.estimator.whole

    @cached_property
    def down(self) -> Array:
        """Where the rotor lies along the axes (p,) [m]."""
        return np.asarray(self.plant.H @ self.plant.resting())

    @cached_property
    def _held(self) -> tuple[Array, Array]:
        """Currents that hold the rotor in the middle (p,) [A], and more a metre away [A/m]."""
        # On the line through the middle and where it lies, as magnets pull harder the nearer it is.
        nothing, down = np.zeros(len(self.down)), self.down
        (_, middle), (_, lying) = (self.plant.hovering(at, nothing) for at in (nothing, down))
        k = [ConstantStiffness.of(each) for each in self.plant.alone]
        travel = np.array([each.rotor.travel_limit for each in self.plant.alone])
        slope = np.array([-each.k_s / each.k_i for each in k])
        far = np.abs(down) > FLAT * travel
        slope[far] = (lying - middle)[far] / down[far]
        return middle, slope

    def integrals(self, place: Array) -> Array:
        """Return the integrals (q,) [A] with which a rotor is held at rest."""
        # place (p,) [m]
        middle, slope = self._held
        currents, whole = middle + slope * place, self._whole
        q = np.zeros(whole.H.shape[1])
        q[: whole.rigid] = np.linalg.pinv(whole.H[:, : whole.rigid]) @ place
        states = self.estimator.at_rest(q, current=currents)
        return self.controllers.integrals(currents, place, states if self.fed else None)

    @property
    def fields(self) -> dict[str, Any]:
        """The fields of ``amb_control`` and of what it points to, by their names."""
        e, whole, p = self.estimator, self._whole, len(self.down)
        start, by_reading = whole.start_form(e.states, e.hover)
        hold = self.integrals(np.zeros(p))
        hold_by = np.column_stack([self.integrals(each) - hold for each in np.eye(p)])
        return (
            arrays(self.controllers, self.plant, e if self.fed else None)
            | self.sequence.in_samples(self.plant.machine.sampling_time)
            | {
                "sequenced": True,
                "settling": settling_of(e),
                "bound": bound_of(e),
                "std": list(e.default_std()),
                "start": start.tolist(),
                "start_by": by_reading.ravel().tolist(),
                "place": whole.along_axes(e.states)[0].ravel().tolist(),
                "down": self.down.tolist(),
                "hold": hold.tolist(),
                "hold_by": hold_by.ravel().tolist(),
            }
        )

    def in_core(self, **other: Any) -> Any:
        """Return the core's controller, around the core's estimator."""
        return self.estimator.engine.core.Control(self.estimator.core, self.fields | other)
