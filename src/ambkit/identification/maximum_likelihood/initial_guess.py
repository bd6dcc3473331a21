"""Where the search for the maximum likelihood begins: as given, by ADALINE, or by least squares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.identification.dead_time import delayed, lagged
from ambkit.identification.maximum_likelihood.likelihood import likelihood_at
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import Parameter
from ambkit.identification.online.adaline import Adaline
from ambkit.machine.magnets import ConstantStiffness

if TYPE_CHECKING:
    from ambkit.data.record import Record


LONGEST_DELAY = 8  #: Samples of delay that are tried.
GROWTHS = (1e-6, 1e-4, 1e-2, 1.0)  #: Growths of the load that are tried, times the one given.


def initial_guess(
    records: Sequence[Record],
    initial_model: LoopModel,
    parameters: Sequence[Parameter],
    settling: float,
) -> tuple[LoopModel, str]:
    """Return the most likely of several starts, and what it is called."""
    free = {p.name for p in parameters}
    candidates = [(initial_model, "the bearing given")]
    if "magnet_constant" in free:
        candidates += [(model, "ADALINE") for model in _by_adaline(records, initial_model)]
    candidates += [
        (model, "least squares") for model in _by_least_squares(records, initial_model, free)
    ]
    if "delay" in free:
        T = initial_model.bearing.sampling_time
        candidates += [
            (model.replace(delay=(n + 0.5) * T), name)
            for model, name in candidates
            for n in range(LONGEST_DELAY)
        ]
    if "disturbance_noise" in free:
        process_noise = initial_model.disturbance_noise
        candidates += [
            (model.replace(disturbance_noise=process_noise * part), name)
            for model, name in candidates
            for part in GROWTHS[:-1]
        ]

    def likelihood(candidate: tuple[LoopModel, str]) -> float:
        # A coarse one: it is only to tell hills from valleys.
        return likelihood_at(records, candidate[0].replace(substeps=1), settling)

    return max(candidates, key=likelihood)


def _by_adaline(records: Sequence[Record], model: LoopModel) -> list[LoopModel]:
    """Take the magnet constant that ADALINE learns along the first record (paper, eq. 22-25)."""
    try:
        k = Adaline(model.undelayed_machine).run(model.corrected(records[0])).magnet_constant
        return [model.replace(magnet__magnet_constant=k)]
    except (AmbkitError, ValueError):
        return []


def _by_least_squares(
    records: Sequence[Record], model: LoopModel, free: set[str]
) -> list[LoopModel]:
    """Take k and s0 from ``m a = k_i iu + k_s x + c``, a line through smoothed accelerations."""
    # Noise in position and closed loop bias it; as a start it will do. The gap goes with k_i/k_s:
    # at the centre that is s0/i0 for ideal iron, of one side or two, and nearly so for other
    # magnets.
    from scipy.signal import savgol_filter

    b = model.bearing
    T, m = b.sampling_time, b.rotor.mass
    half = max(2, round(0.5 * math.sqrt(m / ConstantStiffness.of(b).k_s) / T))
    width = 2 * half + 1
    best: tuple[float, Array] | None = None
    for delay in range(LONGEST_DELAY + 1) if "delay" in free else (model.delay / T,):
        rows, targets = [], []
        for record in records:
            y, u = record["y"], delayed(lagged(record["u"], T, model.current_lag), delay)
            if y.size < 4 * width or not (np.isfinite(y).all() and np.isfinite(u).all()):
                continue
            # The same window for all three: what it does to one it does to the others.
            x = savgol_filter(y, width, 3) / b.sensor.gain
            a = savgol_filter(y, width, 3, deriv=2, delta=T) / b.sensor.gain
            iu = b.amplifier.gain * savgol_filter(u, width, 3)
            inside = slice(width, -width)
            rows.append(np.column_stack([iu, x, np.ones_like(x)])[inside])
            targets.append(m * a[inside])
        if not rows:
            return []
        A, f = np.concatenate(rows), np.concatenate(targets)
        size = np.linalg.norm(A, axis=0)
        if not np.all(size > 0):
            return []
        solution, *_ = np.linalg.lstsq(A / size, f, rcond=None)
        left = float(np.sum((f - A / size @ solution) ** 2))
        if best is None or left < best[0]:
            best = left, solution / size
    if best is None:
        return []
    k_i, k_s, _ = best[1].tolist()
    law, gap = ConstantStiffness.of(b), b.magnet.air_gap
    if "air_gap" in free and k_s > 0:
        gap *= (k_i / law.k_i) / (k_s / law.k_s)
    results = []
    for there in dict.fromkeys((gap, b.magnet.air_gap)):
        try:
            moved = model.replace(magnet__air_gap=there)
            if "magnet_constant" in free:
                k = b.magnet.magnet_constant * k_i / ConstantStiffness.of(moved.bearing).k_i
                moved = moved.replace(magnet__magnet_constant=k)
            if moved != model:
                results.append(moved)
        except AmbkitError:
            continue
    return results
