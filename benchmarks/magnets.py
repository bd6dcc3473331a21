"""Magnets from their drawings: error of the disturbance force by what a filter knows of the magnet.

    uv run python -m benchmarks.magnets [SEEDS]

A 3 kg axis stands 0.1 mm off the centre and takes a step of 20 N; plant and last filter have the
map of the drawing. The others know the law of ideal iron, the closed law with the map's k_i and k_s
in the centre, and the expert trained on the map.
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
    """Return the rms errors of f_d [N] (seeds, filters)."""
    mapped, ideal, fitted = machines(name)
    stiff = ambkit.stiffness_map(
        mapped, currents=np.linspace(-3, 3, 5), displacements=np.linspace(-2e-4, 2e-4, 5)
    )
    expert = ambkit.train(stiff).expert
    filters = [
        ambkit.ExtendedKalmanFilter(ideal), ambkit.ExtendedKalmanFilter(fitted),
        ambkit.AdaptiveKalmanFilter(mapped, expert), ambkit.ExtendedKalmanFilter(mapped),
    ]  # fmt: skip
    rows = []
    for seed in range(seeds):
        scenario = ambkit.scenario_for(
            mapped, step="0.1 mm", load="20 N", duration="0.4 s", seed=seed
        )
        record = ambkit.simulate(mapped, scenario).record
        late = record.t > SETTLED
        rows.append([
            np.sqrt(np.mean((one.run(record)["f_d"] - record["f_d"])[late] ** 2))
            for one in filters
        ])  # fmt: skip
    return np.array(rows)


if __name__ == "__main__":
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    print(
        "rms error of f_d [N], mean ± standard deviation: ideal, fitted in the centre, expert, map"
    )
    for name in DRAWINGS:
        begin = time.perf_counter()
        found = errors(name, seeds)
        cells = "  ".join(
            f"{mean:.2f} ± {std:.2f}"
            for mean, std in zip(found.mean(axis=0), found.std(axis=0), strict=True)
        )
        print(f"{name:>12}: {cells}   ({time.perf_counter() - begin:.0f} s)", flush=True)
