"""An estimator of the user: an object with ``step(y, u)``."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Sequence
from typing import Any, Literal, Protocol, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.own_class import OwnStep, made
from ambkit.data.signals import signal
from ambkit.estimate.core_model import Engine
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.estimator import Arguments, Estimator
from ambkit.estimate.machine_model import several
from ambkit.machine.axes import slowest_time
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import Precision
from ambkit.models.linear import LinearSystem, Signal, realised
from ambkit.models.parts.free import plain_parts

SETTLES = 2000  #: Minimum number of samples after which an estimator has settled.
BLOCKS = 150  #: Samples of the response for the identification of a linear system.


@runtime_checkable
class EstimatorProtocol(Protocol):
    """Interface of the user's estimator.

    The class is constructed with the machine, or without arguments. With a method ``reset(mean,
    std)`` it receives the initial estimate as all others do; otherwise it is constructed for each
    run. It is named as ``file.py:Class``; in Python the class itself is passed.
    """

    def step(self, y: Any, u: Any) -> ArrayLike:
        """Process a sample.

        Parameters
        ----------
        y : float or ndarray (m,)
            Measured position [m]; with several axes all readings; NaN if missing.
        u : float or ndarray (p,)
            Control signal that acted since the last sample [V]; with several axes all; 0 at the
            first sample.

        Returns
        -------
        array_like (n,)
            Displacement x [m], velocity v [m/s], disturbance force f_d [N] and lagged position x_m
            [m]; with several axes the states of :class:`ambkit.KalmanFilter` up to those of the
            sensors. NaN: not estimated.
        """


class OwnEstimator(OwnStep, Estimator):
    """An object with ``step(y, u)`` as an estimator; see `EstimatorProtocol`."""

    _of_core = (*Estimator._of_core, "wrapped")
    by_model = side_by_side = False
    binding = "Own"
    steady = "constant"
    _parts = staticmethod(plain_parts)

    def __init__(
        self,
        machine: Machine,
        make: Callable[..., Any],
        name: str = "",
        *,
        precision: Precision = "float64",
    ) -> None:
        self.name = name or getattr(make, "__name__", "own")
        self._make: Any = make
        self._for: Any = machine
        self.wrapped = made(self.name, make, machine)
        super().__init__(machine, precision=precision)
        self._call, self._single = "step(y, u)", self.machine.single
        names = ", ".join(state.name for state in self.states)
        self._returns = f"the {len(self.states)} numbers {names}"

    def _arguments(self, engine: Engine, settings: dict[str, Any]) -> Arguments:
        of = weakref.ref(self)  # a reference held by C would keep it forever

        def answer(y: list[float], u: list[float]) -> list[float]:
            own = of()
            return [] if own is None else own.numbers(len(own.states), own.plain(y), own.plain(u))

        return [answer], {}

    def reset(
        self, mean: ArrayLike | None = None, std: Sequence[float] | Literal["diffuse"] | None = None
    ) -> None:
        """Reset, as all others; see :meth:`ambkit.Estimator.reset`."""
        super().reset(mean, std)
        self._failed, self._sample = None, 0
        if callable(getattr(self.wrapped, "reset", None)):
            initial_std = self.default_std() if std is None or isinstance(std, str) else std
            self.wrapped.reset(self.mean, np.asarray(initial_std, float))
        else:
            self.wrapped = made(self.name, self._make, self._for)

    def step(self, y: Any, u: Any) -> Any:
        """Process a sample; see :meth:`ambkit.Estimator.step`."""
        mean = super().step(y, u)
        self.check()
        return mean

    def _estimated(self, t: Any, history: dict[str, Any], name: str | None = None) -> Estimate:
        """Wrap the core's results of a record."""
        self.check()
        return super()._estimated(t, history, name)

    def linear_system(self) -> LinearSystem:
        """Return the linear system of its response to a small pulse of each input, once settled."""
        # Position and velocity along the axes by y and by u, which acts from its sample on.
        T, view = self.machine.sampling_time, self.view
        axes, readings = [a.name for a in self.machine.axes], self.machine.readings
        n = max(SETTLES, math.ceil(10 * slowest_time(self.machine) / T))
        seen = np.vstack(view.along_axes(self.states))
        sizes = [*np.sqrt(several(self.variances.measurement)),
                 *np.sqrt(several(self.variances.control))]  # fmt: skip
        m = len(readings)
        # With noise: a constant reading is a stuck sensor.
        noise = np.random.default_rng(0).normal(size=(2 * n, len(sizes))) * sizes

        def moved(which: int | None) -> NDArray[np.float64]:
            y, u = noise[:, :m].copy(), noise[:, m:].copy()
            if which is not None:
                (y if which < m else u)[n, which if which < m else which - m] += sizes[which]
            self.reset()
            mean = self.core.run(*(view.column(a.astype(self.precision)) for a in (y, u)))["mean"]
            self.check()
            return np.asarray(mean[n:] @ seen.T, float)

        still = moved(None)
        pulses = [(moved(k) - still) / size for k, size in enumerate(sizes)]
        self.reset()
        inputs = [Signal(signal("y", r.name), "m") for r in readings]
        inputs += [Signal(signal("u", name), "V") for name in axes]
        outputs = [Signal(signal("position", name), "m") for name in axes]
        outputs += [Signal(signal("velocity", name), "m/s") for name in axes]
        blocks = BLOCKS if len(axes) == 1 else BLOCKS // 4
        return realised(np.stack(pulses, axis=2), T, inputs, outputs, blocks)


def is_own(candidate: Any) -> TypeGuard[type[EstimatorProtocol]]:
    """Return whether it is a class of the user."""
    return isinstance(candidate, type) and not issubclass(candidate, Estimator)


def own_factory(
    name: str, make: Callable[..., Any], machine: Machine
) -> Callable[..., OwnEstimator]:
    """Return the builder of a user's class."""

    def build(_noise: Any = None, *, precision: Precision = "float64") -> OwnEstimator:
        return OwnEstimator(machine, make, name, precision=precision)

    build()  # reports errors before the work begins
    return build
