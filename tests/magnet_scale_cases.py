"""Runs for the estimators of the magnet constant: motion that shows it, rest, and a jump of it."""

import functools

import numpy as np
from numpy.typing import NDArray

import ambkit
from ambkit import Machine, Record, Scenario, Step

Array = NDArray[np.float64]

BEARING = Machine.preset("zittau_axial")
LOAD_AT = 0.8


@functools.cache
def run(step: float, seed: int = 0, *, load: float = 3.0, noise: float = 1.0) -> Record:
    """Four steps of the position, 0 for none, then a load; fed back by the measurement.

    `noise`: the sensor's and the amplifier's, over the bearing's.
    """
    times = (0.1, -2), (0.25, 2), (0.4, -2), (0.55, 1)
    reference = ambkit.Constant(value=0.0) + Step(amplitude=step, time=0.02)
    for time, steps in times:
        reference = reference + Step(amplitude=steps * step, time=time)
    scenario = Scenario(
        duration=1.2,
        seed=seed,
        reference=reference,
        disturbance=Step(amplitude=load, time=LOAD_AT),
        controller=ambkit.PID.textbook(BEARING).model_copy(update={"feedback": "measurement"}),
    )
    return ambkit.simulate(quieter(noise), scenario).record


def quieter(noise: float, k: float = 1.0) -> Machine:
    """The bearing with other noise, and as one who has k wrong by this factor describes it."""
    return BEARING.replace(
        magnet__magnet_constant=k * BEARING.magnet.magnet_constant,
        sensor__noise_variance=noise**2 * BEARING.sensor.noise_variance,
        amplifier__noise_variance=noise**2 * BEARING.amplifier.noise_variance,
    )


def rms(estimate: ambkit.Estimate, record: Record, name: str = "f_d", since: float = 0.0) -> float:
    late = record.t >= since
    return float(np.sqrt(np.mean((estimate[name] - record[name])[late] ** 2)))


@functools.cache
def jump(factor: float, step: float = 1e-4, seed: int = 0) -> Record:
    """The rotor goes to and fro by `step`; k jumps after a second. A plain loop of its own."""
    b, T, substeps, n = BEARING, BEARING.sampling_time, 4, 25_000
    m, s0, i0, h = b.rotor.mass, b.magnet.air_gap, b.magnet.bias_current, T / substeps
    draw = np.random.default_rng(seed)
    noise_y = draw.normal(0, b.sensor.noise_variance**0.5, n).tolist()
    noise_u = draw.normal(0, b.amplifier.noise_variance**0.5, n).tolist()
    x = v = x_m = before = slope = 0.0
    integral = -b.weight * s0**2 / (4 * b.magnet.magnet_constant * i0)
    rows = []
    for k in range(n):
        t = k * T
        r = 0.0 if t < 0.1 else step if t % 0.2 < 0.1 else -step
        load = 3.0 if t >= 2.0 else 0.0
        y = x_m + noise_y[k]
        integral += 20_000 * (r - y) * T
        slope += (1 - np.exp(-T / 2e-4)) * ((r - y - before) / T - slope)
        before = r - y
        u = 3000 * before + integral + 12 * slope
        rows.append((x, v, load, y, u))
        iu = min(max(u + noise_u[k], -1.5), 1.5)
        constant = b.magnet.magnet_constant * (factor if t >= 1.0 else 1.0)
        for _ in range(substeps):
            force = constant * (((i0 + iu) / (s0 - x)) ** 2 - ((i0 - iu) / (s0 + x)) ** 2)
            a = (force + load + b.weight) / m
            x_m += h / b.sensor.lag * (x + h * v / 2 - x_m)
            x, v = x + h * v + h * h * a / 2, v + h * a
    columns = np.array(rows).T
    return Record(T * np.arange(n), dict(zip(("x", "v", "f_d", "y", "u"), columns, strict=True)))
