"""Extended Kalman filter of a rotor that may lie on its touch-down bearings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.data.record import Record
from ambkit.data.signals import ON
from ambkit.estimate.core_model import Engine
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.estimator import Arguments, Estimator
from ambkit.machine.axes import ideal_laws, isolated_axes, load_capacity
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel

RESOLVED = 4.5  #: Samples that a contact lasts at least where its force is held over each.


def samples_of_contact(machine: Machine) -> list[float]:
    """Return how long a contact under load capacity lasts on each axis [samples]."""
    # Half a period; infinity without a stop.
    results = []
    for axis, isolated, load in zip(
        machine.axes, isolated_axes(machine), load_capacity(machine), strict=True
    ):
        stop = axis.bearing.stop
        k = 0.0 if stop is None else 1.5 * stop.stiffness ** (2 / 3) * load ** (1 / 3)
        period = math.sqrt(isolated.rotor.mass / k) if k else math.inf
        results.append(math.pi * period / machine.sampling_time)
    return results


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
    scatter : float, optional
        Standard deviation of the contact force over a sample, relative to it [1], in addition to
        the effect of the uncertain penetration. By default 1.25 over the samples that
        the shortest contact lasts, from 0.02 to 0.1.
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
        scatter: float | None = None,
        **options: Any,
    ) -> None:
        if scatter is not None and not (math.isfinite(scatter) and scatter >= 0):
            raise ValueError(f"scatter must be 0 or more, got {scatter!r}")
        # The force of a long contact hardly changes within a sample; limits chosen by truth.
        self._shortest = min(samples_of_contact(machine))
        by_length = min(max(1.25 / self._shortest, 0.02), 0.1)
        self._scatter = by_length if scatter is None else scatter
        super().__init__(machine, magnet, **options)

    def _arguments(self, engine: Engine, settings: dict[str, Any]) -> Arguments:
        T, dtype = self.machine.sampling_time, self.precision
        place, velocity = self.view.along_axes(engine.states)
        responses = velocity @ engine.model.b / 2  # mean velocity per force [m/s/N]
        loads, mobility = np.zeros_like(place), np.diag(responses).copy()
        loads[:, [state.role == "disturbance force" for state in engine.states]] = responses
        displacement = place + T / 2 * velocity + T / 3 * loads
        rings, at, far, fast = [], 0, 1.0, 1.0
        for bearing in self.machine.bearings:
            axes = (at, at + (bearing.type == "radial"))
            at, stop = axes[1] + 1, bearing.stop
            if stop is not None:
                most = mobility[list(axes)] = mobility[list(axes)].max()
                own = bearing.clearance, stop.stiffness, stop.damping, stop.friction or 0.0
                surface = (stop.radius or 0.0) * self.machine.speed
                rings.append((*axes, *own, surface, T / 3 * most, most))
                if stop.friction:  # a rotor rolls round the ring at most, pressed on by its inertia
                    deep = (T / (2 * most) * surface**2 / stop.stiffness) ** 0.4
                    far = max(far, 1 + deep / bearing.clearance)
                    fast = max(fast, far, abs(surface) * T / (0.1 * bearing.clearance))
        wider = {"position": far, "sensor": far, "velocity": fast}
        settings["travel"] = [far * travel for travel in settings["travel"]]
        settings["cap"] = [
            wider.get(state.role, 1.0) * cap
            for state, cap in zip(engine.states, settings["cap"], strict=True)
        ]
        self.rings = [ring[:2] for ring in rings]
        table = np.array(rings, float).reshape(-1, 9).T
        first, second = np.ascontiguousarray(table[:2], np.uint16)
        bias = self.view.known_forces(self.magnet, weight=False)
        later, coupling = self._later(engine), responses / mobility[:, None]
        of_core = table[2:], displacement, velocity + loads, later, coupling, bias
        arrays = (np.ascontiguousarray(one, dtype) for one in of_core)
        return (first, second, *arrays, self._shortest < RESOLVED, self._scatter), {}

    def _later(self, engine: Engine) -> Array:
        """Return responses to -1 N in the first half of a sample and 1 N in the second (p, n)."""
        half = engine.model_over(self.machine.sampling_time / 2)
        names = [state.name for state in half.states]
        here = [names.index(state.name) for state in engine.states]
        return (half.b - half.L @ half.b)[here].T

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
