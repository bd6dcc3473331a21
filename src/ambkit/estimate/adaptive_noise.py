"""Online estimation of noise, around any filter with a covariance."""

from __future__ import annotations

import math
from typing import Any, Literal, Self

from ambkit.base.quantity_arguments import QuantityLike, in_si, of_type
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.noise_model import Variances
from ambkit.machine.machine import Machine

METHODS = ("innovation", "sage-husa")
ADAPTS = ("measurement", "disturbance", "both")


class AdaptiveNoise(Estimator):
    """A filter that estimates its noise online: R, the process noise of the disturbance, or both.

    R increases while innovations are larger than the filter expects, and decreases while they are
    smaller; the process noise of the disturbance force likewise, from its corrections.

    Large innovations have several possible causes. Sample by sample the two noises cannot be
    distinguished; over a window they can, if the model is correct and the disturbance force varies.
    A wrong stiffness or a step of the disturbance is temporarily taken for process noise. Estimate
    the noise that is unknown.

    Parameters
    ----------
    inner : Estimator
        The filter, with its initial noise. It is a description: its own state is not changed.
    method : {"innovation", "sage-husa"}
        ``"innovation"``: corrections of the disturbance force are summed over `window`; repeated
        corrections in the same direction show that the process noise is too small. ``"sage-husa"``:
        sample by sample, with larger weights at the start. For R the rules are equal.
    adapts : {"measurement", "disturbance", "both"}
        Noise to estimate; sample by sample (``"sage-husa"``) only one of them.
    memory : float or str
        Averaging time [s].
    window : float or str
        Time over which ``"innovation"`` sums the corrections [s].
    most : float
        Maximum factor between estimated and initial noise, up or down; at the limit the status has
        ``NOISE_LIMIT``.

    Raises
    ------
    ValueError
        An option is unknown or out of its range; `inner` has a constant gain.

    References
    ----------
    Mehra, Approaches to adaptive filtering, 1972; Sage and Husa, Adaptive filtering with unknown
    prior statistics, 1969; Mohamed and Schwarz, Adaptive Kalman filtering for INS/GPS, 1999.
    """

    def __init__(
        self,
        inner: Estimator,
        *,
        method: Literal["innovation", "sage-husa"] = "innovation",
        adapts: Literal["measurement", "disturbance", "both"] = "measurement",
        memory: QuantityLike = 0.5,
        window: QuantityLike = 0.01,
        most: float = 100.0,
    ) -> None:
        of_type(Estimator, inner=inner)
        memory, window = in_si("memory", memory, "s"), in_si("window", window, "s")
        T = inner.machine.sampling_time
        _check_choice("method", method, METHODS)
        _check_choice("adapts", adapts, ADAPTS)
        if method == "sage-husa" and adapts == "both":
            raise ValueError(
                "method='sage-husa' has one equation a sample, and cannot tell both noises apart: "
                "adapts must be 'measurement' or 'disturbance', or method 'innovation'"
            )
        if not (math.isfinite(memory) and memory > 100 * T):
            raise ValueError(f"memory must be more than 100 samples, {100 * T:g} s, got {memory!r}")
        if not T <= window <= memory / 2:
            raise ValueError(
                f"window must be from a sample, {T:g} s, to half the memory, {memory / 2:g} s, "
                f"got {window!r}"
            )
        if not (math.isfinite(most) and most > 1):
            raise ValueError(f"most must be greater than 1, got {most!r}")
        if inner.nominal is not inner:
            raise ValueError(f"{inner.name}: its noise is already estimated online")
        if inner.steady == "constant":
            raise ValueError(
                f"{inner.name}: its noise cannot be estimated online: the gain is constant"
            )
        self.inner = inner
        self.can_smooth = inner.can_smooth
        self.machine = inner.machine
        self.view, self.magnet = inner.view, inner.magnet
        self.variances, self.precision = inner.variances, inner.precision
        self.name = f"{inner.name}, adaptive noise"
        share = T / memory
        self.engine, self._settings = inner.engine, inner._settings
        self.core: Any = self.engine.core.AdaptiveNoise(
            inner.core,
            measurement=adapts != "disturbance",
            disturbance=adapts != "measurement",
            share=share,
            # The nominal noise has the weight of the first 50 samples.
            first_share=max(share, 1 / 50) if method == "sage-husa" else share,
            most=most,
            window=round(window / T) if method == "innovation" else 1,
        )
        self.reset()

    @property
    def nominal(self) -> Estimator:
        """The inner filter, with its initial noise."""
        return self.inner

    def for_machine(self, machine: Machine) -> Self:
        return type(self)(self.inner.for_machine(machine), **self.options)

    @property
    def noise(self) -> Variances:
        """Current noise: R [m^2], control signal [V^2], process noise intensity [N^2/s]."""
        var_y, var_d = self.core.noise
        T, axes = self.machine.sampling_time, len(self._settings["f_0"])
        intensity = var_d[:axes] / T
        plain = self.view.plain
        noise: Variances = self.variances._replace(
            measurement=plain(var_y.tolist()), disturbance=plain(intensity.tolist())
        )
        return noise


def _check_choice(name: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(known)}, got {value!r}")
