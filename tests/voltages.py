"""Logs of rotors that a voltage drives: its current is not logged, and lags behind."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Driven:
    """A rotor x'' = a (x + i) whose coil i' = r (u - i) - c v has an unknown rate r."""

    pole: float  #: Of the rotor with a constant current [1/s].
    rate: float  #: R/L of the coil [1/s].
    coupled: float  #: Share of the inductance that belongs to the gap: voltage by motion.
    step: float  #: Sampling time [s].
    noise: float  #: Of the position, whose motion is of the size 1.

    @property
    def plant(self) -> tuple[Array, Array]:
        a = self.pole**2
        A = np.array([[0, 1, 0], [a, 0, a], [0, -self.coupled, -self.rate]])
        return A, np.array([0, 0, self.rate])


def driven(rng: np.random.Generator) -> Driven:
    """Draw a rotor and its coil."""
    pole = 2 * np.pi * rng.uniform(3, 25)
    samples = 10 ** rng.uniform(1.1, 1.9)
    return Driven(
        pole, pole * 10 ** rng.uniform(-0.5, 0.8), rng.uniform(0, 0.9), 1 / (pole * samples),
        10 ** rng.uniform(-3.2, -2),
    )  # fmt: skip


def flown(rotor: Driven, rng: np.random.Generator) -> Array:
    """Fly it by an observer and its feedback: rows t, y, u, r, v of the observer."""
    (A, B), a, T = rotor.plant, rotor.pole**2, rotor.step
    cost = 10 ** rng.uniform(-1, 1)
    K = B @ solve_continuous_are(A, B[:, None], np.diag([1, 1 / a, 0]), [[cost]]) / cost
    held = expm(np.block([[A, B[:, None]], [np.zeros((1, 4))]]) * T)
    F, G, C = held[:3, :3], held[:3, 3], np.array([[1.0, 0, 0]])
    unsure = np.diag([1e-12, (0.3 * a * T) ** 2, (0.1 * T) ** 2 + 1e-12])
    P = solve_discrete_are(F.T, C.T, unsure, [[rotor.noise**2]])
    L = (P @ C.T / (C @ P @ C.T + rotor.noise**2))[:, 0]
    n = int(np.clip(60 / (rotor.pole * T), 5000, 12000))
    period, shape = rng.uniform(15, 60) / rotor.pole, rng.integers(3)
    size = 10 ** rng.uniform(-1.5, -0.5) * a * np.sqrt(0.6 * T * rotor.pole)
    x, seen, load, rows = np.zeros(3), np.zeros(3), 0.0, np.zeros((5, n))
    for k in range(n):
        angle = 2 * np.pi * k * T / period
        r = (np.sin(angle), np.sign(np.sin(angle)), np.sin(angle) * np.sin(0.8 * angle))[shape]
        y = x[0] + rotor.noise * rng.normal()
        seen = seen + L * (y - seen[0])
        u = float(np.clip(-K @ (seen - [r, 0, -r]) - r, -30, 30))
        rows[:, k] = k * T, y, u, r, seen[1]
        load += -0.3 * rotor.pole * T * load + size * rng.normal()
        seen, x = F @ seen + G * u, F @ x + G * u + np.array([0, load * T, 0])
    return rows


def logs(count: int, seed: int) -> Iterator[tuple[Array, np.random.Generator]]:
    """Yield logs that flew, half of them by converters with steps."""
    rng = np.random.default_rng(seed)
    while count:
        rotor = driven(rng)
        rows = flown(rotor, rng)
        if not np.abs(rows[1]).max() < 50:
            continue
        if rng.random() < 0.5:
            for k, step in ((1, rotor.noise * rng.uniform(0.3, 3)),
                            (2, np.ptp(rows[2]) / rng.integers(200, 4000))):  # fmt: skip
                rows[k] = np.round(rows[k] / step) * step
        count -= 1
        yield rows, rng
