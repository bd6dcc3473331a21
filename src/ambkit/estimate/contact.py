"""Extended Kalman filter of a rotor that may lie on its touch-down bearings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.data.record import Record
from ambkit.data.signals import ON
from ambkit.estimate.core_model import Engine
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.estimator import Arguments, Estimator
from ambkit.machine.axes import ideal_laws
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel


class ContactKalmanFilter(Estimator):
    """Extended Kalman filter with two hypotheses: the rotor is free, or in contact with a stop.

    In contact the force of the stop acts and increases the stiffness; the step has
    :attr:`Status.CONTACT` (``core/include/ambkit/contact.h``). The stops are those of the machine's
    key ``stop``; without it this is the extended filter.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Force law; by default the closed one.
    scatter : float
        Standard deviation of the contact force over a sample, relative to it [1], in addition to
        the effect of the uncertain penetration.
    **options
        As for :class:`KalmanFilter`.

    Raises
    ------
    ValueError
        The scatter is negative or not finite.

    References
    ----------
    Hunt & Crossley, Coefficient of restitution interpreted as damping in vibroimpact, 1975.
    """

    name = "extended Kalman filter, contact with stops"
    binding = "Contact"
    _default_magnet = staticmethod(ideal_laws)
    steady = "tangent"

    def __init__(
        self,
        machine: Machine,
        magnet: MagnetModel | None = None,
        *,
        scatter: float = 0.1,
        **options: Any,
    ) -> None:
        if not (math.isfinite(scatter) and scatter >= 0):
            raise ValueError(f"scatter must be 0 or more, got {scatter!r}")
        self._scatter = scatter
        super().__init__(machine, magnet, **options)

    def _arguments(self, engine: Engine, settings: dict[str, Any]) -> Arguments:
        T, dtype = self.machine.sampling_time, self.precision
        place, velocity = self.view.along_axes(engine.states)
        mobility = np.diag(velocity @ engine.model.b) / 2  # mean velocity per force [m/s/N]
        loads = np.zeros_like(place)
        loads[:, [state.role == "disturbance force" for state in engine.states]] = np.diag(mobility)
        displacement = place + T / 2 * velocity + T / 3 * loads
        rings, at = [], 0
        for bearing in self.machine.bearings:
            axes = (at, at + (bearing.type == "radial"))
            at, stop = axes[1] + 1, bearing.stop
            if stop is not None:
                most = mobility[list(axes)].max()
                own = bearing.clearance, stop.stiffness, stop.damping, stop.friction or 0.0
                surface = (stop.radius or 0.0) * self.machine.speed
                rings.append((*axes, *own, surface, T / 3 * most, most))
        table = np.array(rings, float).reshape(-1, 9).T
        first, second = np.ascontiguousarray(table[:2], np.uint16)
        bias = self.view.known_forces(self.magnet, weight=False)
        numbers, *rows = (
            np.ascontiguousarray(one, dtype)
            for one in (table[2:], displacement, velocity + loads, bias)
        )
        return (first, second, numbers, *rows, self._scatter), {}

    def _supply(self, record: Record) -> dict[str, Any]:
        return {"on": np.ascontiguousarray(record[ON], self.precision)} if ON in record else {}

    def deenergise(self) -> None:
        """State before a step that the magnets had no current since the last sample.

        It holds for that step. Along a record, the signal ``on`` is 0 there instead.
        """
        self.core.deenergise()

    def contact_forces(self, estimate: Estimate, record: Record) -> NDArray[np.floating[Any]]:
        """Return the forces of the stops on the rotor.

        Parameters
        ----------
        estimate : Estimate
            From a run of this filter, n samples ...
        record : Record
            ... along this record.

        Returns
        -------
        ndarray (n, p)
            Along each axis, 0 without contact [N].
        """
        means = np.column_stack([estimate[state.name] for state in self.states])
        of = self.core.parameters["set"]
        u = self.view.signals(record)[1].reshape(len(means), -1)
        iu = np.clip(of["k_ui"] * u, of["iu_min"], of["iu_max"])
        means, iu = (np.ascontiguousarray(one, self.precision) for one in (means, iu))
        return np.asarray(self.core.contact_forces(means, iu, **self._supply(record)))
