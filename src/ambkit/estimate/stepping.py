"""An estimator sample by sample."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import real
from ambkit.estimate.core_model import Engine
from ambkit.estimate.estimate import Status
from ambkit.estimate.law_error import law_errors
from ambkit.estimate.machine_model import View
from ambkit.machine.magnets import Precision
from ambkit.models.model import Descriptor, Model


class Stepping:
    """An estimator sample by sample."""

    name: str
    start_std: Mapping[str, float]
    by_model: bool
    machine: Any
    view: View
    magnet: Any
    precision: Precision
    engine: Engine
    core: Any  # The core's estimator: parameters, state, last result.
    variances: Any
    _steps = 0  # since the bias by the law's error was asked for
    _last_bias: tuple[Any, Any] = (None, None)  # the mean that it is of, and the bias

    @property
    def states(self) -> tuple[Descriptor, ...]:
        """The states in order: name, unit, typical size, role."""
        return self.engine.states

    @property
    def model(self) -> Model:
        """The sampled model of its prediction."""
        return self.engine.model

    def default_std(self) -> tuple[float, ...]:
        """Return the initial standard deviations; see :meth:`reset`."""
        names = [state.name for state in self.states]
        return tuple(
            (dict(zip(names, self._usual_std, strict=True)) | dict(self.start_std)).values()
        )

    @cached_property
    def _usual_std(self) -> tuple[float, ...]:
        """Defaults of its kind, for its machine and variances."""
        return self.view.start_std(self.variances, self.states)

    def reset(
        self, mean: ArrayLike | None = None, std: Sequence[float] | Literal["diffuse"] | None = None
    ) -> None:
        """Reset.

        The filter converges from any start. Values beyond the physical limits of a rotor between
        its stops are limited (``core/include/ambkit/envelope.h``).

        Parameters
        ----------
        mean : array_like (n,), optional
            States: displacement [m], velocity [m/s], disturbance force [N], lagged position [m],
            and further states of the model; finite. Default: in equilibrium at the centre.
        std : sequence of n floats, or "diffuse", optional
            Standard deviations, finite and positive. Default: three times the measurement noise, a
            tenth of the clearance per time constant of the plant, the weight, and three times the
            measurement noise; currents within their range, noise states with their stationary
            variance. ``"diffuse"``: no information but the stops and the sensor.

        Raises
        ------
        ValueError
            The number of values is wrong, a mean is not finite, or a standard deviation is not
            finite and positive.
        """
        if isinstance(std, str) and std != "diffuse":
            raise ValueError(f"std must be {len(self.states)} numbers or 'diffuse', got {std!r}")
        initial_std = self.default_std() if std is None else std
        start = self.equilibrium_state(0.0) if mean is None else mean
        for name, item in (("mean", start), ("std", initial_std)):
            if not isinstance(item, str) and np.ndim(item) != 1:
                raise ValueError(
                    f"{name} must be {len(self.states)} numbers, one for each state, has shape "
                    f"{np.shape(item)}"
                )
        self._last_bias = None, None
        self.core.reset(
            self._representable(real("mean", start)),
            None
            if isinstance(initial_std, str)
            else self._representable(real("std", initial_std), positive=True),
        )

    def _representable(self, values: ArrayLike, *, positive: bool = False) -> NDArray[np.float64]:
        """Return finite values rounded to this precision, others unchanged."""
        a = np.asarray(values, dtype=float)
        known = np.finfo(self.precision)
        near = np.clip(a, -float(known.max), float(known.max))
        if positive:
            near = np.where(near > 0, np.maximum(near, float(known.tiny)), near)
        return np.where(np.isfinite(a), near, a)

    def transfer_from(self, other: Stepping) -> None:
        """Bumpless transfer: copy mean, covariance and fault counters from another filter.

        A newly trained filter can replace the running one between two samples. In C, where the
        caller owns the state, no transfer is needed: pass the new parameters with the same state.

        Parameters
        ----------
        other : Estimator
            For linear, adaptive, extended and unscented Kalman filters any of these; for the UD
            filter another of its kind. Sampling time and sensor should be equal.

        Raises
        ------
        ValueError
            One of the two has further states that depend on its parameters, such as a scale of the
            magnet; or their precisions differ.
        """
        if self.precision != other.precision:
            raise ValueError(
                f"both must have one precision, got {self.precision} and {other.precision}"
            )
        self.core.transfer_from(other.core)

    def equilibrium_state(
        self,
        x: float | NDArray[np.float64],
        shown: float | NDArray[np.float64] | None = None,
        current: Any = None,
    ) -> NDArray[np.float64]:
        """Return the states (n,), each in its unit [m, m/s, N ...], of a rotor in equilibrium.

        Parameters
        ----------
        x : float or ndarray (runs,)
            Displacement [m]; for several runs the states are (runs, n).
        shown : float or ndarray (runs,), optional
            Sensor reading [m]; by default that at x.
        current : float, optional
            Current of the magnet and of earlier samples [A]; by default that in equilibrium, see
            :attr:`levitation_current`.

        Notes
        -----
        With several axes x are the rotor's coordinates (q,), 0 at the centre, `shown` the readings
        (m,) and `current` the axes' currents (p,).
        """
        return self.view.equilibrium_state(
            self.states, self.levitation_current, x, shown, current, self.precision
        )

    def initial_state(self, y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the equilibrium states at the first measurement within the clearance.

        Parameters
        ----------
        y : ndarray (N,) or (runs, N)
            Measured positions [m].

        Returns
        -------
        ndarray (n,) or (runs, n)
            The states, each in its unit [m, m/s, N ...].
        """
        return self.view.initial_state(self.states, self.levitation_current, y, self.precision)

    @cached_property
    def levitation_current(self) -> Any:
        """Levitation current at the centre [A], and its slope [A/m].

        According to the filter's magnet model; 0 without a current among the states. With several
        axes a pair for each.
        """
        return self.view.levitation_current(self.magnet, self.states)

    def predict(self, u: float) -> NDArray[np.float64]:
        """Time update (eq. 9, 10).

        Parameters
        ----------
        u : float
            Control signal that acted since the last sample [V].

        Returns
        -------
        ndarray (n,)
            State estimate: x [m], v [m/s], f_d [N], x_m [m], and further states of the model.
        """
        self.core.predict(u)
        return self.mean

    def update(self, y: float) -> NDArray[np.float64]:
        """Measurement update (eq. 11-13).

        Parameters
        ----------
        y : float
            Measured position [m].

        Returns
        -------
        ndarray (n,)
            State estimate: x [m], v [m/s], f_d [N], x_m [m], and further states of the model.
        """
        self.core.update(y)
        self._steps += 1
        return self.mean

    def step(self, y: float, u: float) -> NDArray[np.float64]:
        """Time update, then measurement update. Never raises on bad input: see :attr:`status`.

        Parameters
        ----------
        y : float
            Measured position [m].
        u : float
            Control signal that acted since the last sample [V].

        Returns
        -------
        ndarray (n,)
            State estimate: x [m], v [m/s], f_d [N], x_m [m], and further states of the model.
        """
        self._core_step(y, u)
        self._steps += 1
        return self._live_mean.copy()

    # Looked up once: used at every sample.
    @cached_property
    def _core_step(self) -> Callable[[float, float], int]:
        return self.core.step  # type: ignore[no-any-return]

    @cached_property
    def _live_mean(self) -> NDArray[np.float64]:
        return self.core.live_mean  # type: ignore[no-any-return]

    @property
    def mean(self) -> NDArray[np.float64]:
        """State estimate (n,): x [m], v [m/s], f_d [N], x_m [m], and the model's further states."""
        return self._live_mean.copy()

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the state estimate (n, n) [products of the states' units].

        It includes the bias by the error of the filter's force law: carried from sample to sample
        if the covariance was also read after the previous sample, otherwise that in equilibrium.
        """
        P = np.asarray(self.core.covariance)
        if self.law_error.size:
            bias = self._bias(P)
            P += np.outer(bias, bias)
        return P

    @cached_property
    def law_error(self) -> NDArray[np.float64]:
        """Error of its force law (``ambkit/law_error.h``), empty if there is none.

        Coefficients of a polynomial in current and displacement, axis by axis.
        """
        return law_errors(self.machine, self.magnet) if self.by_model else np.zeros(0)

    def _law_bias(
        self, mean: ArrayLike, upper: ArrayLike, u: ArrayLike, health: ArrayLike, **how: Any
    ) -> NDArray[Any]:
        """Return the bias of the states (n, states) along n samples, after controls (n, p)."""
        gain = getattr(self, "gain", ())  # where it is constant
        arrays = (
            np.ascontiguousarray(item, self.precision)
            for item in (self.law_error, gain, mean, upper, u)
        )
        unused = Status.MISSING | Status.FROZEN | Status.OUTLIER
        used = (np.asarray(health) & int(unused)) == 0
        return np.asarray(self.core.law_bias(*arrays, used, **how))

    def _bias(self, P: NDArray[Any]) -> NDArray[Any]:
        """Return the bias (n,) of now: carried on where it was asked for a sample ago."""
        mean, (of, before) = self.mean, self._last_bias
        if not np.array_equal(mean, of):
            how = {"before": before} if self._steps == 1 else {}
            upper = P[np.triu_indices(len(P))]
            bias = self._law_bias(mean, upper, self.core.last_u, [self.core.health], **how)[0]
            self._last_bias, self._steps = (mean, bias), 0
        return np.asarray(self._last_bias[1])

    @property
    def innovation(self) -> Any:
        """Last measurement minus its prediction [m]; of several readings (m,)."""
        return self.core.innovation

    @property
    def innovation_variance(self) -> Any:
        """Its variance S [m^2]; of several readings (m,)."""
        return self.core.variance

    @property
    def scale(self) -> tuple[float, float] | None:
        """Estimated factor on the magnet constant, and its standard deviation.

        None if this kind does not estimate it.
        """
        if self.core.scale is None:
            return None
        value, variance = self.core.scale
        return float(value), math.sqrt(variance)

    @property
    def status(self) -> Status:
        """Status of the last step."""
        return Status(self.core.status)
