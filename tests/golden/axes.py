"""Axes with odd numbers, and what every kind, plant and loop answers on them.

The paper's axis hides differences: its sampling time is 0.1 ms and its sensor's gain is 1. One line
a case: a digest of all bits, and figures that show how large a change is. Where one is meant:

    python -m tests.golden
"""

import csv
import hashlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ambkit
from ambkit.estimate.registry import KINDS

from .runs import HERE

Row = dict[str, str]

PAPER = ambkit.preset("zittau_axial")
_PARTS = {
    "delay": "0.15 ms", "amplifier__bandwidth": "900 Hz", "sensor__quantisation": "3 um",
}  # fmt: skip
_COLOURED: dict[str, Any] = {
    "sensor__coloured_noise": {"variance": "20 um^2", "bandwidth": "200 Hz"},
    "sensor__hum": ({"frequency": "50 Hz", "amplitude": "5 um", "bandwidth": "0.5 Hz"},),
}
_IRON = PAPER.to_toml().replace(
    'magnet_constant = "6.7 N mm^2/A^2"',
    'turns = 150\npole_area = "950 mm^2"\niron_length = "0.2 m"\n'
    'relative_permeability = 2000\nsaturation = "0.7 T"',
)

AXES = {
    "paper": PAPER,
    "one-sided": ambkit.preset("inteco_ml"),
    "odd numbers": PAPER.replace(
        sampling_time="0.13 ms", rotor__mass="0.4371 kg", sensor__gain=1.07, sensor__lag="0.37 ms",
        rotor__gravity="33 deg", amplifier__gain="0.83 A/V", rotor__clearance="0.77 mm",
        sensor__position_noise="-90 1/m", magnet__magnet_constant="6.3 N mm^2/A^2",
    ),
    "amplifier and delay": PAPER.replace(**_PARTS),
    "noise with states": PAPER.replace(
        **_PARTS, sensor__gain=1.07, rotor__mass="0.4371 kg", **_COLOURED
    ),
    "short lag": PAPER.replace(sensor__lag="1e-5 ms"),
    "iron": ambkit.Machine.from_toml(_IRON),
}  # fmt: skip

PLANTS = AXES | {
    "quantised": PAPER.replace(sensor__quantisation="3 um"),
    "coloured, hum": PAPER.replace(**_COLOURED),
    "delay of two samples": PAPER.replace(delay="0.2 ms"),
    "bandwidth": PAPER.replace(amplifier__bandwidth="900 Hz"),
    "voltage limit": PAPER.replace(
        amplifier__bandwidth="2 kHz", amplifier__voltage_limit="4 V", amplifier__resistance="1 ohm"
    ),
    "runout, not linear": PAPER.replace(
        speed="3000 rpm",
        sensor__runout=(
            {"order": 1, "amplitude": "9 um"},
            {"order": 3, "amplitude": "2 um", "phase": "30 deg"},
        ),
        sensor__quadratic="20 1/m",
        sensor__cubic="1e4 1/m^2",
    ),
    "soft stop": PAPER.replace(stop={"stiffness": "1e8 N/m^1.5", "damping": "0.3 s/m"}),
}
HIT = ("paper", "soft stop")  # Where the rotor is also thrown at its stop.


def record_of(axis: ambkit.Machine, n: int = 1200) -> ambkit.Record:
    """Positions with gaps, spikes, clipping and a stuck stretch, and controls: no simulation's."""
    rng, k = np.random.default_rng(3), np.arange(n)
    reach = abs(axis.sensor.gain) * axis.clearance
    wave = np.abs((k % 400) - 200.0) / 100 - 1
    y = reach * (0.3 * wave + 0.02 * (rng.random(n) - 0.5))
    u = (0.4 * np.roll(wave, 37) + 0.1 * (rng.random(n) - 0.5)) * axis.current_max
    u /= axis.amplifier.gain
    y[:2] = np.nan
    y[rng.integers(0, n, 12)] = np.nan
    y[210:250] = np.nan
    y[rng.integers(0, n, 8)] += 6 * reach
    y[450:490] = y[450]
    y[660:750] = np.clip(y[660:750], -0.1 * reach, 0.1 * reach)
    y[900:910] = 50 * reach
    u[540] = np.nan
    t = axis.sampling_time * k
    return ambkit.Record(t, {"y": y, "u": u}, {"y": "m", "u": "V"})


def _row(case: Row, columns: dict[str, NDArray[Any]]) -> Row:
    """Digest of all bits, and each column's mean magnitude."""
    digest = hashlib.sha256()
    figures = {}
    for name, values in columns.items():
        plain = np.ascontiguousarray(values) + 0.0  # one zero
        digest.update(np.where(np.isnan(plain), np.nan, plain).tobytes())
        figures[name] = f"{np.nanmean(np.abs(plain), dtype=float):.12g}"
    return case | {"bits": digest.hexdigest()[:16]} | figures


def kinds() -> Iterator[Row]:
    """Every kind in both precisions, on every axis."""
    for name, axis in AXES.items():
        record, law = record_of(axis), ambkit.ClosedLaw(axis)
        for kind, made in KINDS.items():
            magnet = law if made.magnet is None else None
            for precision in ("float64", "float32"):
                filter = made.make(axis, magnet, precision=precision)
                filter.law_error = np.zeros(0)  # the covariance that the gain follows from
                got = filter.run(record, covariance=True)
                names = ("mean", "covariance", "innovation", "innovation_variance", "status")
                yield _row(
                    {"axis": name, "kind": kind, "precision": precision},
                    {each: np.asarray(getattr(got, each), float) for each in names},
                )


def plants() -> Iterator[Row]:
    """Every plant in a loop with a PID, fed by the measurement and by the linear filter."""
    for name, axis in PLANTS.items():
        for feedback in ("measurement", "estimate"):
            for hit in (False, True) if name in HIT else (False,):
                scenario = _scenario(axis, feedback, hit)
                run = ambkit.simulate(axis, scenario, filter=ambkit.KalmanFilter(axis))
                names = ("x", "v", "x_m", "iu", "f_mag", "u", "y")
                columns = {each: np.asarray(run.record[each]) for each in names}
                case = {"axis": name, "feedback": feedback, "hit": "yes" if hit else "no"}
                yield _row(case, columns | {"estimate": np.asarray(run.estimate.mean)})


def _scenario(axis: ambkit.Machine, feedback: Any, hit: bool) -> ambkit.Scenario:
    """A step of reference and load, with gains of the plant's own size that no tuning changes."""
    k = ambkit.ConstantStiffness.of(axis)
    pole = (abs(k.k_s) / axis.rotor.mass) ** 0.5
    kp = 2.5 * abs(k.k_s) / k.k_i
    pid = ambkit.Control(
        kp=kp, ki=0.1 * pole * kp, kd=0.6 * kp / pole, derivative_filter=0.02 / pole,
        anti_windup=5 / pole, setpoint_weight=0.5, feedback=feedback,
    )  # fmt: skip
    load = 40.0 if hit else 0.4 * abs(axis.weight) or 1.0
    T = axis.sampling_time
    return ambkit.Scenario(
        duration=800 * T,
        controller=pid,
        disturbance=ambkit.Step(amplitude=load, time=400 * T),
        reference=ambkit.Step(amplitude=0.2 * axis.clearance, time=200 * T),
    )


TABLES = {"kinds": kinds, "plants": plants}


def read_rows(name: str) -> list[Row]:
    """Read a table of cases."""
    with (HERE / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def write_rows(name: str) -> None:
    """Write a table of cases anew."""
    rows = list(TABLES[name]())
    with (HERE / f"{name}.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
