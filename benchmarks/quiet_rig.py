"""A quiet loop whose current is measured with noise: is the magnet found all the same?

A ball hardly moves below one magnet, held by a regulator through a coil of 28 ms. What is logged
is the position, the control signal, and the current as a sensor shows it, with 6.3 mA of noise;
what flows moves by no more in the time in which
the ball would fall. ``python -m benchmarks.quiet_rig [seeds] [first]`` identifies
from one record of 8 s a seed; ``python -m benchmarks.quiet_rig slope [seeds] [first]`` judges the
likelihood's slope at the truth instead, at a tenth of the time.
"""

from __future__ import annotations

import math
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ambkit import Machine, Record
from ambkit.identification.maximum_likelihood import MaximumLikelihood, maximum_likelihood
from ambkit.identification.maximum_likelihood.current_state import Coil, CurrentState, propagate
from ambkit.identification.maximum_likelihood.likelihood import Data
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import named
from ambkit.machine.magnets import own_time
from benchmarks.identification import judged, print_table

Array = NDArray[np.float64]

SENSOR = 6.3e-3
"""Noise of the current's sensor [A], standard deviation."""

LAG, GAIN = 28e-3, 2.764
"""Of the coil: time constant [s] and current for full control [A]."""

DRIVE = 5e-3
"""Noise of the control signal, of full control."""

OFFSET = 47e-3
"""How well the offset of the current is known beforehand [A]: so it is drawn."""

TRUTH = LoopModel(
    Machine.preset("inteco_ml").replace(
        sensor__lag=1e-5, sensor__noise_variance=(16.8e-6) ** 2, amplifier__noise_variance=SENSOR**2
    ),
    delay=0.0,
    disturbance_noise=1e-5,
    load_std=1e-3,
    line=True,
    substeps=1,
)
"""The rig's ball and magnet."""

FREE = (
    "magnet_constant", "air_gap", "delay", "current_offset", "measurement_noise", "control_noise",
    "disturbance_noise",
)  # fmt: skip

MOVES, OFTEN = 0.3e-3, 0.7
"""Amplitude [m] and frequency [Hz] of the reference."""

STEPS = 4
"""Of the integration in a sample."""


def quiet_loops(
    seeds: int, duration: float = 8.0, first: int = 0, truth: LoopModel = TRUTH
) -> list[Record]:
    """Simulate one record a seed, all side by side: the textbook's way, for tests only.

    Parameters
    ----------
    seeds : int
        How many records.
    duration : float
        Of each [s].
    first : int
        Seed of the first one.
    truth : LoopModel
        What is simulated.
    """
    from scipy.linalg import expm, solve_discrete_are

    b, T, mass = truth.isolated, truth.isolated.sampling_time, truth.isolated.rotor.mass
    k, gap, bias = b.magnet.magnet_constant, b.magnet.air_gap, b.magnet.bias_current
    n = round(duration / T)
    streams = [np.random.default_rng([first + s, 61]) for s in range(seeds)]

    def drawn(scale: float) -> Array:
        return scale * np.array([stream.normal(size=n) for stream in streams]).T

    offset = OFFSET * np.array([stream.normal() for stream in streams])
    noise_y, noise_i, noise_u = (drawn(s) for s in (b.sensor.noise_variance**0.5, SENSOR, DRIVE))
    load = np.cumsum(drawn((truth.disturbance_noise * T) ** 0.5), axis=0) + drawn(truth.load_std)[0]

    # A regulator of x, v, i and the load, about the point of rest.
    rest = gap * math.sqrt(mass * 9.81 / k) - bias
    k_i = 2 * k * (bias + rest) / gap**2
    k_s = 2 * k * (bias + rest) ** 2 / gap**3
    A = np.array([
        [0, 1, 0, 0], [k_s / mass, 0, k_i / mass, 1 / mass], [0, 0, -1 / LAG, 0], [0, 0, 0, 0],
    ])  # fmt: skip
    both = np.zeros((5, 5))
    both[:4, :4], both[2, 4] = T * A, T * GAIN / LAG
    sampled = expm(both)
    F, G = sampled[:4, :4], sampled[:4, 4:]
    P = solve_discrete_are(F[:3, :3], G[:3], np.diag([1e6, 1.0, 1e-2]), np.eye(1))
    feedback = np.linalg.solve(1 + G[:3].T @ P @ G[:3], G[:3].T @ P @ F[:3, :3])[0]
    C = np.array([[1.0, 0, 0, 0]])
    driven = np.diag([0, 1e-12, 0, truth.disturbance_noise * T + 1e-12]) + DRIVE**2 * G @ G.T
    S = solve_discrete_are(F.T, C.T, driven, np.array([[b.sensor.noise_variance]]))
    gain = (S @ C.T / (C @ S @ C.T + b.sensor.noise_variance))[:, 0]

    x, v, i = np.zeros(seeds), np.zeros(seeds), np.full(seeds, rest)
    state = np.zeros((4, seeds))
    y, u, shown, flows = (np.empty((n, seeds)) for _ in range(4))
    for at in range(n):
        y[at], shown[at], flows[at] = x + noise_y[at], i + noise_i[at] - offset, i
        state = state + np.outer(gain, y[at] - state[0])
        aim = MOVES * math.sin(2 * math.pi * OFTEN * at * T)
        steady = -(state[3] + k_s * aim) / k_i  # what carries the load, there
        u[at] = steady / GAIN - feedback @ np.array([state[0] - aim, state[1], state[2] - steady])
        state = F @ state + G * u[at]
        u[at] += rest / GAIN
        pull, h = u[at] + noise_u[at], T / STEPS
        for _ in range(STEPS):
            there = GAIN * pull + (i - GAIN * pull) * math.exp(-h / LAG)
            mean = GAIN * pull + (i - GAIN * pull) * (1 - math.exp(-h / LAG)) * LAG / h
            middle = x + 0.5 * h * v
            force = k * (bias + mean) ** 2 / (gap - middle) ** 2 - mass * 9.81 + load[at]
            x, v, i = x + h * v + 0.5 * h * h * force / mass, v + h * force / mass, there
    t = np.asarray(T * np.arange(n), np.float64)
    return [
        Record(
            t, {"y": y[:, s], "u": shown[:, s], "control": u[:, s], "iu": flows[:, s]},
            {"control": "V"},
            {"measured": ["u"], "seed": first + s, "offset": float(offset[s])},
        )
        for s in range(seeds)
    ]  # fmt: skip


def identified(record: Record, *, use_control: bool = True) -> MaximumLikelihood:
    """Identify from one record, with or without its control signal."""
    begin = TRUTH.replace(known={"current_offset": (0.0, OFFSET)})
    return maximum_likelihood(record, begin, FREE, improve_start=False, use_control=use_control)


def study(seeds: int = 200, first: int = 0, threads: int = 1) -> dict[str, dict[str, float]]:
    """Identify from records of many seeds, and judge the errors, as `identification.study` does."""
    records = quiet_loops(seeds, first=first)
    truths = [TRUTH.replace(current_offset=record.meta["offset"]) for record in records]
    with ThreadPoolExecutor(threads) as pool:
        return judged(list(pool.map(identified, records)), truths)


def flowing_at_the_truth(record: Record) -> CurrentState:
    """Return the current that flows through the coil as it was simulated."""
    lag = LAG / record.sampling_time
    stray = (GAIN * (1 - math.exp(-1 / lag)) * DRIVE / SENSOR) ** 2
    return propagate(Coil(lag, 0.0, GAIN, -record.meta["offset"], stray), [record], 1.0)


SLOPES = ("current_offset", "measurement_noise", "control_noise", "disturbance_noise")
"""Whose slope at the truth is asked for; of the offset as that of the force that is known best."""


def slopes(seeds: int = 400, first: int = 0) -> dict[str, dict[str, float]]:
    """Slope of the likelihood at the truth over seeds: nothing, where the model is right.

    No search is in it, and so no bias of what a search finds in a short record, but the luck of the
    seeds is.

    Returns
    -------
    dict
        For each parameter the mean ``slope`` in parts of the root of its information, and the same
        ``in_errors`` of that mean.
    """
    scores, informations = [], []
    for record in quiet_loops(seeds, first=first):
        current = flowing_at_the_truth(record)
        model = current.driving(TRUTH.replace(current_offset=record.meta["offset"]))
        # How much the current's sensor has in this record is luck, too, and known here.
        luck = (SENSOR / current.noise) ** 2
        model = model.replace(
            amplifier__noise_variance=luck * model.isolated.amplifier.noise_variance
        )
        local = Data(current.records, own_time(model.isolated)).local(model, named(SLOPES))
        scores.append(local.score)
        informations.append(np.diag(local.information))
    slope = np.array(scores) / np.sqrt(np.mean(informations, axis=0))
    error = slope.std(axis=0, ddof=1) / math.sqrt(seeds)
    return {
        p.name: {"slope": float(mean), "in_errors": float(mean / one)}
        for p, mean, one in zip(named(SLOPES), slope.mean(axis=0), error, strict=True)
    }


if __name__ == "__main__":
    asked = [int(argument) for argument in sys.argv[1:] if argument != "slope"]
    if "slope" in sys.argv[1:]:
        for name, row in slopes(*asked).items():
            print(f"{name:18}{row['slope']:+8.3f} of its error{row['in_errors']:+8.2f} s.e.")
    else:
        print_table(study(*asked))
