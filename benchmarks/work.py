"""The work that everyone does alike: one record, one filter, one closed loop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import ambkit

Array = NDArray[np.float64]

DISTURBANCE = 100.0  # growth of the variance of the disturbance force [N^2/s]
NOISE = ambkit.FilterNoise(disturbance=DISTURBANCE)


class Settings(NamedTuple):
    """What the four-state filter is made of, in the order of `struct hand` in hand_loop.c."""

    T: float
    m: float
    a: float  # exp(-T / T_sen)
    b: float  # K_sen (1 - a)
    c: float  # K_sen (T - T_sen (1 - a))
    d: float  # K_sen (T^2/2 - T T_sen + T_sen^2 (1 - a)) / m
    k_ui: float
    f_0: float
    var_u: float
    r: float
    q00: float  # growth of the disturbance force in a sample, the upper triangle
    q01: float
    q02: float
    q03: float
    q11: float
    q12: float
    q13: float
    q22: float
    q23: float
    q33: float

    @property
    def Q(self) -> Array:
        """What a growth of the disturbance force leaves in a sample (4, 4)."""
        matrix = np.empty((4, 4))
        rows, columns = np.triu_indices(4)
        matrix[rows, columns] = matrix[columns, rows] = self[-10:]
        return matrix


@dataclass(frozen=True)
class Work:
    """A simulated run of n samples, and a filter with its start.

    ``k_i`` and ``k_s`` (n,) are the stiffnesses of the closed law along the run, new at each
    sample; u[k], k_i[k] and k_s[k] act from sample k to k + 1.
    """

    bearing: ambkit.Machine
    scenario: ambkit.Scenario
    record: ambkit.Record
    y: Array
    u: Array
    k_i: Array
    k_s: Array
    settings: Settings
    mean: Array  # (4,)
    cov: Array  # (4, 4)

    @classmethod
    def simulated(cls, steps: int) -> Work:
        """Simulate `steps` samples of the paper's bearing in closed loop, with its noise."""
        bearing = ambkit.preset("zittau_axial")
        T = bearing.sampling_time
        scenario = ambkit.Scenario(
            duration=(steps - 1) * T,
            reference=ambkit.Sine(amplitude=0.3e-3, frequency=2.0),
            disturbance=ambkit.Step(amplitude=-3.0, time=steps * T / 2),
            seed=1,
            controller=ambkit.PID.textbook(bearing),  # as the loops written by hand have it
        )
        record = ambkit.simulate(bearing, scenario).record
        k_i, k_s = ambkit.ClosedLaw(bearing).stiffness(record["iu"], record["x"])
        kf = ambkit.KalmanFilter(bearing, noise=NOISE)
        first = float(record["y"][0])
        kf.reset([first / bearing.sensor.gain, 0.0, 0.0, first])
        return cls(
            bearing=bearing,
            scenario=scenario,
            record=record,
            y=record["y"],
            u=record["u"],
            k_i=k_i,
            k_s=k_s,
            settings=_settings(bearing, kf),
            mean=kf.mean,
            cov=kf.core.covariance,
        )

    def first(self, steps: int) -> Work:
        """Return the same work on the first samples only, for those who are slow."""
        record = ambkit.Record(
            self.record.t[:steps], {name: self.record[name][:steps] for name in ("y", "u")}
        )
        fields = {name: getattr(self, name)[:steps] for name in ("y", "u", "k_i", "k_s")}
        return Work(**(vars(self) | fields | {"record": record}))

    @property
    def std(self) -> Array:
        """Standard deviations at the start (4,)."""
        return np.asarray(np.sqrt(np.diag(self.cov)))


def _settings(bearing: ambkit.Machine, kf: ambkit.KalmanFilter) -> Settings:
    """What `KalmanFilter` makes of the bearing, computed here once more but for the growth."""
    T, m, sensor = bearing.sampling_time, bearing.rotor.mass, bearing.sensor
    a = math.exp(-T / sensor.lag)
    lagged = T - sensor.lag * (1 - a)
    c = kf.core.parameters["model"]
    growth = {(i, j): c.get(f"N{i}{j}", 1.0) for i in range(4) for j in range(i, 4)}
    return Settings(
        T,
        m,
        a,
        sensor.gain * (1 - a),
        sensor.gain * lagged,
        sensor.gain * (T**2 / 2 - sensor.lag * lagged) / m,
        bearing.amplifier.gain,
        bearing.weight,
        bearing.amplifier.noise_variance,
        sensor.noise_variance,
        *(T * DISTURBANCE * growth[place] for place in sorted(growth)),
    )
