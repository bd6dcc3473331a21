"""Machines for several tests: an axis with its motion by hand, a rotor of two planes."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ambkit.models import Model, compose
from ambkit.models.declaration import Part
from ambkit.models.parts import (
    Amplifier,
    ColouredNoise,
    Delay,
    Disturbance,
    Hum,
    MagnetForce,
    Rotor,
    Sensor,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Axis:
    """An axis with every part; None for what it does not have."""

    T: float = 1e-4
    m: float = 0.518
    K_sen: float = 0.8
    lag: float | None = 2e-4
    bandwidth: float | None = None
    delay: float = 0.0
    coloured: float | None = None
    hum: tuple[float, float] | None = None

    def parts(self) -> list[Part]:
        """Its parts, as a user writes them."""
        parts: list[Part] = [
            Rotor(self.m, 1e-3, 0.1),
            MagnetForce(10.0),
            Disturbance(10.0, 0.01),
            Sensor(self.K_sen, self.lag, 1e-3),
            Amplifier(1.0, self.bandwidth),
        ]
        if self.delay:
            parts.append(Delay(self.delay, 1.0))
        if self.coloured:
            parts.append(ColouredNoise(1e-12, self.coloured))
        if self.hum:
            parts.append(Hum(self.hum[0], 5e-6, self.hum[1]))
        return parts

    def model(self) -> Model:
        return compose(self.parts(), self.T, name="axis")

    def acting(self, t: float, u: list[float]) -> float:
        """What acts at a time within sample 0: the newest that was issued a delay before.

        u: demanded currents of sample 0, -1, -2 ...
        """
        return u[-math.floor((t - self.delay) / self.T + 1e-9)] if self.delay else u[0]

    def after(self, X: dict[str, float], F: float, u: list[float]) -> dict[str, float]:
        """One sample on, by stiff integration; s and i_mean are means over the sample."""
        T, names = self.T, ["x", "v", "x_m", "i", "n_y", "hum_c", "hum_s", "free", "s", "i_mean"]
        corner = 2 * math.pi * (self.bandwidth or 0.0)
        colour = 2 * math.pi * (self.coloured or 0.0)
        turn, decay = (2 * math.pi * at for at in self.hum or (0.0, 0.0))
        force = F + X["f_d"]
        z = np.array([X.get(name, 0.0) for name in names])
        z[7:] = [X["x"], 0.0, 0.0]  # the rotor that no force pushes

        def slope(t: float, z: Array, u_now: float) -> list[float]:
            x, v, x_m, i, n, c, s, free, _, _ = z
            i_now = i if self.bandwidth else u_now
            return [
                v, force / self.m, (self.K_sen * x - x_m) / self.lag if self.lag else 0.0,
                corner * (u_now - i), -colour * n, -decay * c - turn * s, turn * c - decay * s,
                X["v"], free / T, i_now / T,
            ]  # fmt: skip

        break_at = math.fmod(self.delay, T)
        ends = sorted({0.0, break_at, T}) if 1e-9 * T < break_at < T * (1 - 1e-9) else [0.0, T]
        scale = np.array([1e-3, 0.1, 1e-3, 1, 1e-6, 1e-6, 1e-6, 1e-3, 1e-3, 1])
        for start, end in pairwise(ends):
            u_now = self.acting((start + end) / 2, u)
            z = solve_ivp(
                slope, (start, end), z, "LSODA", args=(u_now,), rtol=1e-12, atol=1e-13 * scale
            ).y[:, -1]
        found = dict(zip(names, z.tolist(), strict=True)) | {"f_d": X["f_d"]}
        return found | {f"u_{k + 1}": at for k, at in enumerate(u)}


# ---- several coordinates ----


def machine(
    order: tuple[int, ...] = (0, 1), *, metre: float = 1.0, speed: float = 900.0
) -> list[Part]:
    """A rotor of two planes with gyroscopics, two magnets, two sensors; lengths in `metre`."""
    M = {(0, 0): 2.0 / metre, (1, 1): 0.5 / metre, (0, 1): 0.1 / metre, (1, 0): 0.1 / metre}
    rotor = Rotor(
        M, 1e-3 * metre, 0.1 * metre, ("x", "y"), ("vx", "vy"),
        damping={(0, 0): 3.0 / metre},
        gyroscopic={(0, 1): 0.2 / metre, (1, 0): -0.2 / metre},
        stiffness={(0, 0): 4e4 / metre}, speed=speed,
    )  # fmt: skip
    places = [{"x": 1.0, "y": 0.3}, {"x": 0.2, "y": 1.0}]
    sensors: list[Part] = [
        Sensor(0.9 + 0.1 * k, 1e-4 * (1 + k), 1e-3 * metre, f"y_{k}", f"xm_{k}", places[k])
        for k in range(2)
    ]
    parts: list[Part] = [rotor]
    for k in range(2):
        parts += [
            MagnetForce(20.0, f"f_{k}", "xy"[k]),
            Amplifier(1.0, 1500.0 * (k + 1), f"u{k}", f"i{k}", f"f_{k}"),
            Delay(1e-4 * (0.4 + 0.8 * k), 1.0, f"u{k}"),
        ]
    parts += [Disturbance(5.0, 0.1, "f_d0", "f_0"), Disturbance(5.0, 0.1, "f_d1", None, places[1])]
    return [*parts, *(sensors[k] for k in order)]


# ---- a bearing ----
