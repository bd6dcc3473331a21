"""ADALINE (paper, eq. 22-25), and common parts of online identification."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array, Bools, real
from ambkit.base.pickling import Copyable
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.data.record import Record
from ambkit.identification.dead_time import acting
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, core_module, magnet_of
from ambkit.result.row import Row

CONSTANT = "N m^2/A^2"  #: Unit of a magnet constant.
CONFIDENCE = 1.96  #: Standard errors on either side that contain 95 % of normal estimates.

DRIFTING = 0.02
"""Relative change of a magnet constant in the last quarter above which it has not settled."""


@dataclass(frozen=True, eq=False)
class OnlineResult:
    """Online identification of a magnet constant along a record, n samples."""

    t: Array  #: (n,) Time [s].
    k: Array  #: (n,) Identified magnet constant [N m^2/A^2].
    #: (n,) Whether k was held for lack of excitation, or because of a bad sample.
    held: Bools

    @property
    def magnet_constant(self) -> float:
        """Mean of k over the last quarter of the record [N m^2/A^2]."""
        return float(self.k[last_quarter(self.k)].mean())

    @property
    def spread(self) -> float:
        """Standard deviation of k over the last quarter of the record [N m^2/A^2]."""
        return float(self.k[last_quarter(self.k)].std())

    @property
    def drift(self) -> float:
        """Change of k over the last quarter of the record [N m^2/A^2]."""
        late = self.k[last_quarter(self.k)]
        return float(late[-1] - late[0])

    @property
    def settled(self) -> bool:
        """Whether k was nearly constant in the last quarter of the record."""
        return abs(self.drift) <= DRIFTING * abs(self.magnet_constant)

    @property
    def standard_error(self) -> float:
        """Standard error of `magnet_constant` [N m^2/A^2]; NaN if unknown."""
        raise NotImplementedError

    def rows(self) -> list[Row]:
        """Return the result with its uncertainty."""
        k, error = self.magnet_constant, self.standard_error
        return [
            Row("magnet_constant", "identified magnet constant", k, CONSTANT),
            Row("standard_error", "  standard error", error, CONSTANT, 2, like=k),
            Row("half_width", "  95 % interval, ±", CONFIDENCE * error / k, "%"),
            Row("spread", "  standard deviation, last quarter", self.spread, CONSTANT, 2,
                like=k, detail=True),
            Row("drift", "  drift over the last quarter", self.drift, CONSTANT, 2, like=k),
            Row("held_share", "held for lack of excitation", float(self.held.mean()), "%"),
        ]  # fmt: skip


def last_quarter(values: Array) -> slice:
    """Return the last quarter of values, at least one."""
    return slice(len(values) - max(1, len(values) // 4), None)


def mean_error(values: Array, memory: float) -> float:
    """Return the standard error of the mean of an exponentially weighted estimate."""
    # For a first-order process with correlation time `memory`, over an interval of `a` times that,
    # the mean has the share ``v = 2/a (1 - (1 - exp(-a))/a)`` of the process's variance, and the
    # scatter about the mean the rest (Priestley 1981, ch. 5). values (n,)
    if values.size < 2:
        return math.nan
    a = values.size / memory
    share = 2 / a * (1 + math.expm1(-a) / a)
    return float(values.std()) * math.sqrt(share / (1 - share))


@dataclass(frozen=True, eq=False)
class AdalineResult(OnlineResult):
    """Result of the two elements along a record; the rest as in :class:`OnlineResult`."""

    force: Array  #: (n,) Identified force of the magnet [N], low-passed.
    #: (n,) Root mean square of the regressor over the learning time, relative to the regressor at
    #: iu = i0, x = 0 [1].
    excitation: Array
    memory: float  #: Samples over which k is averaged.

    def rows(self) -> list[Row]:
        end = Row("excitation", "excitation", float(self.excitation[-1]), digits=3, detail=True)
        return [*super().rows(), end]

    @property
    def standard_error(self) -> float:
        """Standard error of `magnet_constant`, from the scatter of k [N m^2/A^2]."""
        # As k forgets exponentially, its scatter is that of a first-order process. It does not
        # include effects that do not scatter: an unknown disturbance, a wrong mass. NaN if nothing
        # was learned in the last quarter.
        late = last_quarter(self.k)
        return mean_error(self.k[late][~self.held[late]], self.memory)


Learned = TypeVar("Learned", bound=AdalineResult)


class OnlineIdentifier(Copyable, Generic[Learned]):
    """Online identification of the magnet constant, in the C core.

    The C has no delay and no lag of the current: `run` takes them into account before
    (`ambkit.identification.dead_time`); the arguments of `step` are the acting signals.
    """

    core: Any
    machine: Machine
    memory: float  #: Samples over which k is averaged.
    _learned: type[Learned]
    _more: ClassVar[Sequence[str]] = ()  # further outputs of the core

    def step(self, y: float, u: float, f_d: float = 0.0) -> float:
        """Process one sample.

        Parameters
        ----------
        y : float
            Measured position [m].
        u : float
            Control signal that acted since the last sample [V].
        f_d : float
            Known disturbance force [N].

        Returns
        -------
        float
            Present magnet constant [N m^2/A^2].
        """
        self.core.step(y, float(self._ideal(y, u)), f_d)
        return float(self.core.k)

    def _ideal(self, y: Any, u: Any) -> Any:
        """Return the control signal for the core, whose iron is ideal."""
        return u if self._of_ideal_iron else as_ideal(self.machine, y, u)

    @cached_property
    def _of_ideal_iron(self) -> bool:
        return magnet_of(self.machine).ideal  # evaluated at every sample

    def run(self, record: Record, *, disturbance: ArrayLike | None = None) -> Learned:
        """Process a record.

        Parameters
        ----------
        record : Record
            With ``y`` [m] and ``u`` [V], n samples.
        disturbance : array_like (n,), optional
            Known disturbance force [N].
        """
        y = record["y"]
        known = real("disturbance", 0.0 if disturbance is None else disturbance)
        f_d = np.ascontiguousarray(np.broadcast_to(known, y.shape))
        out = self.core.run(y, self._ideal(y, acting(self.machine, record["u"])), f_d)
        return self._learned(
            t=record.t, k=out["k"], held=out["status"] != 0, force=out["force"],
            excitation=np.sqrt(out["excitation"]), memory=self.memory,
            **{name: out[name] for name in self._more},
        )  # fmt: skip


class Adaline(OnlineIdentifier[AdalineResult]):
    """Two adaptive linear elements with the normalised Widrow-Hoff rule.

    The first identifies the magnet force from the motion (eq. 24), the second the magnet constant
    from force, current and gap (eq. 25). A learning rate r averages over about 2/r samples: the
    error decays as ``(1 - r)**n``, and a share ``r / (2 - r)`` of the noise variance remains.
    ``core/include/ambkit/adaline.h`` describes the common filtering of position and regressor.

    Parameters
    ----------
    machine : Machine
        Provides mass, weight, gap, bias current, lag and limits; its magnet constant is the initial
        value.
    start : float or str, optional
        Other initial magnet constant [N m^2/A^2].
    bandwidth : float or str, optional
        Bandwidth of the low-pass of position and regressor [Hz]; default: twice the plant's
        unstable frequency ``sqrt(k_s/m) / (2 pi)``.
    rate_force, rate_k : float
        Learning rates, between 0 and 2.
    least_excitation : float
        k is held while the excitation is below this.

    Raises
    ------
    ValueError
        An argument is out of range.
    """

    _learned = AdalineResult

    def __init__(
        self,
        machine: Machine,
        *,
        start: QuantityLike | None = None,
        bandwidth: QuantityLike | None = None,
        rate_force: float = 0.05,
        rate_k: float = 0.002,
        least_excitation: float = 0.02,
    ) -> None:
        if not 0 < rate_k < 2:
            raise ValueError(f"rate_k must be greater than 0 and less than 2, got {rate_k!r}")
        settings = first_element(machine, start, bandwidth, rate_force, least_excitation)
        self.machine = machine
        self.bandwidth = settings["bandwidth"] / (2 * math.pi)
        self.rate_k, self.memory = rate_k, 1 / rate_k
        self.core = core_module().Adaline(**settings, rate_k=rate_k)


def start_of(machine: Machine, start: QuantityLike | None) -> float:
    """Return the initial magnet constant [N m^2/A^2], by default the machine's."""
    start = machine.magnet.magnet_constant if start is None else in_si("start", start, CONSTANT)
    if not 0 < start < math.inf:
        raise ValueError(f"start must be greater than 0 N m^2/A^2 and finite, got {start!r}")
    return start


def first_element(
    machine: Machine,
    start: QuantityLike | None,
    bandwidth: QuantityLike | None,
    rate_force: float,
    least_excitation: float,
) -> dict[str, Any]:
    """Check the first element (eq. 24), which identifies the force, and return it for the core."""
    start = start_of(machine, start)
    bandwidth = in_si("bandwidth", bandwidth, "Hz")
    if not 0 < rate_force < 2:
        raise ValueError(f"rate_force must be greater than 0 and less than 2, got {rate_force!r}")
    if not 0 <= least_excitation < math.inf:
        raise ValueError(f"least_excitation must be 0 or greater, got {least_excitation!r}")
    if bandwidth is None:
        own = math.sqrt(ConstantStiffness.of(machine).k_s / machine.rotor.mass)
        bandwidth = 2 * own / (2 * math.pi)
    if not 0 < bandwidth < 0.5 / machine.sampling_time:
        raise ValueError(
            f"bandwidth must be greater than 0 and less than half the sampling rate, "
            f"{0.5 / machine.sampling_time:g} Hz, got {bandwidth!r}"
        )
    magnet, T = machine.magnet, machine.sampling_time
    # The current of ideal iron for a stronger magnet's force may be beyond the limits.
    room = 1.0 if magnet_of(machine).ideal else 1e3
    return {
        "s0": magnet.air_gap,
        "i0": magnet.bias_current,
        "two_sided": magnet.type == "two-sided",
        "T": T,
        "m": machine.rotor.mass,
        "K_sen": machine.sensor.gain,
        "a_sen": math.exp(-T / machine.lag_of(machine.sensor)),
        "k_ui": machine.amplifier.gain,
        "iu_min": room * machine.current_min,
        "iu_max": room * machine.current_max,
        "f_0": machine.weight,
        "bandwidth": 2 * math.pi * bandwidth,
        "rate_force": rate_force,
        "least_excitation": least_excitation,
        "k": start,
    }


def as_ideal(machine: Machine, y: ArrayLike, u: ArrayLike) -> Array:
    """Return the control signal for which ideal iron of the same constant has the same force."""
    # y (n,) [m]; u (n,) [V]
    m, amplifier, travel = machine.magnet, machine.amplifier, machine.clearance
    iu = np.clip(amplifier.gain * np.asarray(u), machine.current_min, machine.current_max)
    x = np.clip(np.asarray(y) / machine.sensor.gain, -travel, travel)
    i0, s0 = m.bias_current, m.air_gap
    pull = np.asarray(magnet_of(machine).force(iu, x)) / m.magnet_constant
    if m.type == "one-sided":
        ideal = (s0 - x) * np.sqrt(np.maximum(pull, 0.0)) - i0
    else:
        # 4 (i0 s0 + i x)(i0 x + i s0) = force (s0^2 - x^2)^2, the root near zero.
        right = pull * (s0**2 - x**2) ** 2 / 4
        root = np.sqrt(np.maximum((i0 * (s0**2 - x**2)) ** 2 + 4 * x * s0 * right, 0.0))
        ideal = 2 * (right - i0**2 * s0 * x) / (i0 * (s0**2 + x**2) + root)
    return np.asarray(ideal / amplifier.gain)
