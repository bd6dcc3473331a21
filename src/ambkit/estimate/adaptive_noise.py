"""Online estimation of noise, around any filter with a covariance."""

from __future__ import annotations

import math
from typing import Any, Literal, Self

from ambkit.base.quantity_arguments import Given, in_si, of_type
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.noise_model import Variances
from ambkit.machine.machine import Machine

METHODS = ("innovation", "sage-husa")
ADAPTS = ("measurement", "disturbance", "both")


class AdaptiveNoise(Estimator):
    """A filter that estimates its noise online: R, the process noise of the disturbance, or both.

    R is raised while innovations are larger than the filter expects, and lowered while they are
    smaller; the growth of the disturbance force likewise by the corrections of that force.

    Too large an innovation has more than one reason, and sample by sample both noises cannot be
    told apart; over a window they can, as long as the model is right and the load does wander. A
    wrong stiffness, or a step of the load, is taken for growth, until it is forgotten. Choose what
    is not known.

    Parameters
    ----------
    inner : Estimator
        The filter, with the noise to start from. It is used as a description: its own state is left
        alone.
    method : {"innovation", "sage-husa"}
        ``"innovation"``: corrections of the load are summed over `window`, where a growth assumed
        too small shows as corrections that go the same way again and again. ``"sage-husa"``: sample
        by sample, and the first samples weigh more. For R they are the same rule.
    adapts : {"measurement", "disturbance", "both"}
        What is found. Sample by sample there is one equation, so ``"sage-husa"`` finds one of them.
    memory : float or str
        Time that the averages reach back [s].
    window : float or str
        Time over which ``"innovation"`` sums the corrections of the load [s].
    most : float
        Neither is taken to be more than this many times off what `inner` assumes, up or down; at
        the end of that range the status says ``NOISE_LIMIT``.

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
        memory: Given = 0.5,
        window: Given = 0.01,
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
        self.smooths = inner.smooths
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
