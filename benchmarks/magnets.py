"""Magnets from their drawings: error of the disturbance force by what a filter knows of the magnet.

    uv run python -m benchmarks.magnets [SEEDS]

A 3 kg axis moves from the centre to a place anywhere within 0.2 mm, another for each seed, and
takes a step of 20 N either way; plant and last filter have the map of the drawing. The others know
the law of ideal iron, the closed law with the map's k_i and k_s in the centre, and the expert
trained on the map, 7 by 7 rules over all currents and the clearance. With the map a filter knows
the truth: its error is that of sensor noise and of the step, which no filter follows at once.
Second line: without 15 ms after each step.
"""

import sys
import time
from pathlib import Path

import numpy as np

import ambkit

FOLDER = Path(__file__).parents[1] / "examples" / "magnets"
DRAWINGS = ("eight_poles", "twelve_poles", "e_core", "u_core", "thrust")
MACHINE = """name = "axis"
sampling_time = "0.1 ms"
rotor = {mass = "3 kg", gravity = "none", clearance = "0.25 mm"}
amplifier = {gain = "1 A/V", current_limit = "3 A", noise_variance = "1e-4 V^2"}
sensor = {gain = 1, lag = "0.05 ms", noise_variance = "1 µm^2"}
"""
SETTLED = 0.02  #: Time after which errors count [s].
FOLLOWED = 0.015  #: Time in which a filter follows a step [s].


def machines(name):
    """Return the machine with the map, that of ideal iron, and that fitted in the centre."""
    path = (FOLDER / f"{name}.toml").as_posix()
    mapped = ambkit.Machine.from_toml(MACHINE + f'[magnet]\nforce_map = "{path}"\n')
    k_i, k_s = (float(v) for v in ambkit.magnet_of(mapped).tangent(0.0, 0.0))
    m = mapped.magnet
    ideal = mapped.replace(magnet__force_map=None)
    gap = m.bias_current * k_i / k_s  # k_s / k_i = i0 / s0
    fitted = ideal.replace(
        magnet__air_gap=gap, magnet__magnet_constant=k_i * gap**2 / (4 * m.bias_current)
    )
    return mapped, ideal, fitted


def errors(name, seeds):
    """Return the mean square errors of f_d [N^2] (seeds, filters, with steps and without)."""
    mapped, ideal, fitted = machines(name)
    stiff = ambkit.stiffness_map(
        mapped, currents=np.linspace(-3, 3, 7), displacements=np.linspace(-2.5e-4, 2.5e-4, 7)
    )
    expert = ambkit.train(stiff).expert
    filters = [
        ambkit.ExtendedKalmanFilter(ideal), ambkit.ExtendedKalmanFilter(fitted),
        ambkit.AdaptiveKalmanFilter(mapped, expert), ambkit.ExtendedKalmanFilter(mapped),
    ]  # fmt: skip
    rows = []
    for seed in range(seeds):
        random = np.random.default_rng(seed)
        place, load = random.uniform(-2e-4, 2e-4), 20 * random.choice([-1, 1])
        scenario = ambkit.scenario_for(mapped, step=place, load=load, duration="0.4 s", seed=seed)
        record = ambkit.simulate(mapped, scenario).record
        late = record.t > SETTLED
        settled = late.copy()
        for at in (scenario.reference.time, scenario.disturbance.time):
            settled &= (record.t < at) | (record.t > at + FOLLOWED)
        squares = [(one.run(record)["f_d"] - record["f_d"]) ** 2 for one in filters]
        rows.append([[square[at].mean() for at in (late, settled)] for square in squares])
    return np.array(rows)


if __name__ == "__main__":
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    print(
        "rms error of f_d over the seeds [N]: ideal, fitted in the centre, expert, map; ideal / map"
    )
    for name in DRAWINGS:
        begin = time.perf_counter()
        rms = np.sqrt(errors(name, seeds).mean(axis=0)).T
        for what, of in zip((name, "settled"), rms, strict=True):
            cells = "  ".join(f"{value:6.2f}" for value in of)
            print(f"{what:>12}: {cells}   {of[0] / of[-1]:.1f}")
        print(f"{'':>12}  {time.perf_counter() - begin:.0f} s", flush=True)
