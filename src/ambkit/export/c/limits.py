"""Limits of what can be calibrated on the running rig: within all of them the loop has margins."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_controller import compensator, controllers, fed
from ambkit.control.linear.linear_plant import POSITION, VELOCITY, OperatingPoint, plant
from ambkit.control.linear.steady_state_filter import estimator_at
from ambkit.control.stabilising_controller import frequencies
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.noise_model import FilterNoise
from ambkit.machine.magnets import ConstantStiffness

if TYPE_CHECKING:
    from ambkit.control.controller_states import Controller


PEAK = 4.0
"""Of abs(S): the end of zone B of ISO 14839-3, or a tenth above that of the exported numbers."""

WIDEST = {
    "var_y": (0.01, 100.0), "var_u": (0.01, 100.0), "var_d": (0.01, 100.0),
    "mass": (0.5, 2.0), "strong": (0.5, 2.0),
    "kp": (0.33, 3.0), "ki": (0.1, 10.0), "kd": (0.33, 3.0), "T_f": (0.2, 5.0),
}  # fmt: skip
"""Parts of the exported numbers, beyond which nothing is looked for."""

SHARES = np.arange(0.05, 1.001, 0.05)
"""Of the logarithms of these, that are tried from the smallest on."""

GATE = (4.0, 100.0)  #: Standard deviations: a closer gate rejects sound measurements.
TRACKING = (0.2, 5.0)  #: Parts of the exported tracking time, see `LEAST_TRACKING`.

LEAST_TRACKING = 10

SIGMAS = (6.0, 3.0)
"""Of the position and of the current, by the sensor's noise: so many are to be within the
clearance, and within what holding the rotor leaves of the current's range. Where the exported
numbers take more of either, a twentieth more than that."""

DIGITS = 3
POINTS = 200


class Limits(NamedTuple):
    """Of each number, in the order of ``amb_parameter``, and the peak of abs(S) between them."""

    low: dict[str, float]
    high: dict[str, float]
    peak: float


def limits(controller: Controller, exported: dict[str, float]) -> Limits:
    """Return the widest limits between which every set of numbers leaves margins."""
    loops = _Loops(controller, exported)
    one = dict.fromkeys(WIDEST, 1.0)
    least = loops.peak(one, one)
    most = max(PEAK, 1.1 * least)
    low, high, peak = one, one, least
    for share in SHARES:
        ends = [{name: span[k] ** share for name, span in WIDEST.items()} for k in (0, 1)]
        wider = loops.peak(*ends)
        if not wider <= most:
            break
        low, high, peak = *ends, wider
    results = [
        {name: _rounded(by[name] * exported[name], up) if by[name] != 1.0 else exported[name]
         for name in WIDEST}
        for by, up in ((low, True), (high, False))
    ]  # fmt: skip
    T_t = exported["T_t"]
    sampled = LEAST_TRACKING * controller.bearing.sampling_time
    beside = {
        "gate": (min(GATE[0], exported["gate"]), max(GATE[1], exported["gate"])),
        "T_t": (min(T_t, max(sampled, TRACKING[0] * T_t)), TRACKING[1] * T_t),
        "weight": (0.0, max(1.0, exported["weight"])),
    }  # fmt: skip
    lowest, highest = (
        {name: beside[name][k] if name in beside else results[k][name] for name in exported}
        for k in (0, 1)
    )
    return Limits(lowest, highest, peak)


def _rounded(value: float, up: bool) -> float:
    """Return a limit with so many digits as can be read, on the inner side."""
    if value == 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - DIGITS + 1)
    unit_count = math.ceil(value / unit) if up else math.floor(value / unit)
    return float(f"{unit_count * unit:.{DIGITS}g}")


class _Loops:
    """The loop of a controller with other numbers than those of the export."""

    def __init__(self, controller: Controller, exported: dict[str, float]) -> None:
        self.controller, self.exported = controller, exported
        bearing = controller.bearing
        self.point = OperatingPoint.nearest(bearing)
        P = plant(bearing, self.point)
        self.plant = P.select(["y", "x"], P.inputs[0][:1])
        self.f = frequencies(bearing, POINTS)
        self.y, self.x = self.plant.response(self.f)[:, :, 0].T
        room = min(bearing.current_max - self.point.iu, self.point.iu - bearing.current_min)
        self.room = np.array([bearing.rotor.clearance, room]) / SIGMAS
        one = dict.fromkeys(WIDEST, 1.0)
        self.share = max(1.0, 1.05 * self._corners(one, one)[1])

    def peak(self, low: dict[str, float], high: dict[str, float]) -> float:
        """Return the highest peak of abs(S) of all corners."""
        # Infinite where one is not stable, or where noise takes too much of the room that there is.
        peak, share = self._corners(low, high)
        return peak if share <= self.share else math.inf

    def _corners(self, low: dict[str, float], high: dict[str, float]) -> tuple[float, float]:
        """Return the highest peak of abs(S), and the greatest share of the room for noise [1]."""
        bearing = self.controller.bearing
        measured = self.controller.pid.feedback == "measurement"
        filters = [None] if measured else [
            self._filter(m, s, noise)
            for m, s in itertools.product(*_ends(("mass", "strong"), low, high))
            for noise in ({"var_y": low, "var_u": high, "var_d": high},
                          {"var_y": high, "var_u": low, "var_d": low})
        ]  # fmt: skip
        names = ("kp", "ki", "kd", *(("T_f",) if measured else ()))
        worst = share = 0.0
        for E in filters:
            for gains in itertools.product(*_ends(names, low, high)):
                law = self._law(dict(zip(names, gains, strict=True)))
                K = compensator(law, E, np.array([[1 / bearing.sensor.gain]]))
                loop = Loop(self.plant, K)
                if not loop.is_stable:
                    return math.inf, math.inf
                C = K.response(self.f)[:, 0, 0]
                S = 1 / (1 - self.y * C)
                worst = max(worst, float(np.abs(S).max()))
                moved = np.abs(np.array([self.x * C * S, bearing.amplifier.gain * C * S])) ** 2
                noise_density = 2 * bearing.sampling_time * bearing.sensor.noise_variance
                noise = np.sqrt(noise_density * np.trapezoid(moved, self.f))
                share = max(share, float((noise / self.room).max()))
        return worst, share

    def _law(self, by: dict[str, float]) -> Any:
        """Return the controllers with gains of these parts of the exported ones."""
        result = self.controller.law
        (pid,) = result.pids
        names = ("kp", "ki", "kd", "T_f")
        other = [gain * by.get(name, 1.0) for name, gain in zip(names, pid, strict=False)]
        law = type(result)([[*other, *pid[4:]]], *list(vars(result).values())[1:])
        measured = self.controller.pid.feedback == "measurement"
        return controllers(law, self.controller.bearing, measured=measured)

    def _filter(self, m: float, s: float, noise: dict[str, dict[str, float]]) -> Any:
        """Return the filter of a rotor and a magnet of these parts, and with such noise."""
        controller, nominal = self.controller, self.exported
        bearing = controller.bearing
        rotor = bearing.rotor.model_copy(update={"mass": m * nominal["mass"]})
        other = bearing.model_copy(update={"rotor": rotor})
        k = ConstantStiffness.of(bearing)
        variances = {name: by[name] * nominal[name] for name, by in noise.items()}
        assumed = FilterNoise(
            measurement=variances["var_y"], control=variances["var_u"],
            disturbance=variances["var_d"] / bearing.sampling_time,
        )  # fmt: skip
        filter = KalmanFilter(
            other, ConstantStiffness(s * k.k_i, s * k.k_s), noise=assumed,
            as_printed=controller.estimator.engine.as_printed,
        )  # fmt: skip
        rows = fed(controller.law, len(filter.states), 0.0)
        signals = (POSITION, VELOCITY, POSITION)
        return estimator_at(filter, self.point, (rows, signals))


def _ends(
    names: tuple[str, ...], low: dict[str, float], high: dict[str, float]
) -> list[tuple[float, ...]]:
    """Return the two ends of each, or its one."""
    return [(low[n],) if low[n] == high[n] else (low[n], high[n]) for n in names]
