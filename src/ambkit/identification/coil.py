"""Identification of a magnet's coil: from the control signal to the current, with its lag.

A switched amplifier with a diode in parallel to the coil lets the current decay freely::

    tau(z) di/dt = G (u - u0) - i,     i >= 0,     tau(z) = L/R = a + b exp(-z/c)

The target may be negative: limiting it to zero would slow the decay. Control signal and current
determine ``G = V/R`` and ``tau = L/R``, not resistance or voltage.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base import files
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.base.units import engineering, figure
from ambkit.data.record import Record
from ambkit.estimate.errors import rms
from ambkit.identification.noise import white_noise
from ambkit.machine.machine import Machine
from ambkit.result.report import Axis, Figure, Line, Panel, Points, Rule
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put

BLOCK = 0.5
"""Seconds within which errors may be correlated; the standard errors count each block once."""

LEAST_RANGE = 20.0  #: Minimum range of a current, over its noise.


@dataclass(frozen=True)
class Coil:
    """A coil with its amplifier."""

    gain: float  #: Gain G, static current per volt of control signal [A/V].
    dead_zone: float  #: Dead zone u0, control signal up to which no current flows [V].
    far_time: float  #: a, b [s] and c [m] of the time constant ``a + b exp(-z/c)``.
    near_time: float
    length: float
    delay: float  #: Dead time from the control signal to the current [s].
    zero: float = 0.0  #: Reading of the current sensor without current [A].

    def time_constant(self, z: Array | float) -> Any:
        """Return L/R [s] with the rotor at a distance z [m] from the magnet."""
        return self.far_time + self.near_time * np.exp(-np.asarray(z) / self.length)

    def current(self, record: Record) -> Array:
        """Return the noise-free readings of the current along a record (n,) [A]."""
        # Exact for a control signal that is held and a rotor at rest within a sample. The first
        # current is the record's.
        T = record.sampling_time
        tau = self.time_constant(record["z"])
        target = self.gain * (record["u"] - self.dead_zone)
        integer_part = math.floor(self.delay / T)
        part = self.delay / T - integer_part
        k = np.arange(target.size)
        now, before = (target[np.clip(k - integer_part - more, 0, k.size - 1)] for more in (0, 1))
        keep_before, keep_now = np.exp(-part * T / tau), np.exp(-(1 - part) * T / tau)
        pulls = zip(
            keep_before.tolist(), ((1 - keep_before) * before).tolist(),
            keep_now.tolist(), ((1 - keep_now) * now).tolist(), strict=True,
        )  # fmt: skip
        i, result = max(float(record["i"][0]) - self.zero, 0.0), []
        for keep_1, pull_1, keep_2, pull_2 in pulls:
            result.append(i)
            i = max(keep_1 * i + pull_1, 0.0)  # the diode
            i = max(keep_2 * i + pull_2, 0.0)
        return np.array(result) + self.zero


@dataclass(frozen=True, eq=False, repr=False)
class CoilFit(Result):
    """A coil identified from logs, with errors."""

    coil: Coil  #: Identified coil.
    #: By the names of `Coil`, SI; from blocks of half a second.
    standard_errors: Mapping[str, float]
    residual_rms: float  #: Residual current over all logs [A].
    #: Noise of the current sensor, from neighbouring samples without switching [A].
    noise: float
    #: Residual of each log [A].
    residuals: Mapping[str, float]
    #: The same for a coil identified from all other logs; empty with fewer than three.
    left_out: Mapping[str, float]
    distance: Mapping[str, float]  #: Mean of z in each log [m].
    records: Mapping[str, Record]  #: The logs.
    #: Prior of the machine, and the position of its rotor [m], for derived results.
    known: Machine | None = None
    operating_point: float | None = None

    TITLE = "A coil: tau di/dt = G (u - u0) - i, i >= 0, tau = a + b exp(-z/c)"
    SECTIONS = {
        ("coil",): Section("{0.TITLE}"),
        (): Section("With all logs"),
        ("logs",): Section("Residual current, rms", across=True),
    }

    @property
    def finding(self) -> str:
        left, noise = (figure(of, "A", 3) for of in (self.residual_rms, self.noise))
        return f"The residual of the coil's current is {left} rms, its noise {noise} rms."

    @property
    def rows(self) -> list[Row]:
        coil, at = self.coil, self.operating_point
        result = put([
            Row(name, words, getattr(coil, name), unit, error=self.standard_errors[name])
            for name, (words, unit) in WORDS.items()
        ], section=("coil",))  # fmt: skip
        result += [
            Row("residual_rms", "residual current, rms", self.residual_rms, "A", 3),
            Row("noise", "current noise, rms", self.noise, "A", 3),
        ]
        if at is not None:
            tau = float(coil.time_constant(at))
            result.append(Row("time_constant", f"time constant at {figure(at, 'm')}", tau, "s"))
        if self.known is not None:
            zero = self.offset(self.known)
            result.append(Row("control_offset", "offset of the control signal", zero, "V"))
        for name in sorted(self.residuals, key=self.distance.__getitem__):
            result += put([
                Row("distance", "distance", self.distance[name], "m"),
                Row("each", "from this log", self.residuals[name], "A", 3),
                Row("left_out", "without this log", self.left_out.get(name), "A", 3),
            ], section=("logs",), of=name)  # fmt: skip
        return result

    @property
    def notes(self) -> list[str]:
        return ["Control signal and current determine G (voltage over resistance) and tau "
                "(inductance over resistance), not the three separately."]  # fmt: skip

    def figures(self) -> list[Figure]:
        return [coil_figure(self)]

    def machine(self, known: Machine, operating_point: float) -> Machine:
        """Return a machine driven by the control signal through this coil."""
        # Its amplifier has the time constant at the operating point, and its loop the coil's dead
        # time. `offset` must be added to the control signal.
        tau = float(self.coil.time_constant(operating_point))
        gain = self.coil.gain
        return known.replace(
            amplifier__gain=gain,
            amplifier__bandwidth=1 / (2 * math.pi * tau),
            amplifier__noise_variance=(self.residual_rms / gain) ** 2,
            delay=max(self.coil.delay, 0.0) or None,
        )

    def save_toml(self, path: str | os.PathLike[str]) -> None:
        """Write the machine, with the lines of its channel map."""
        if self.known is None or self.operating_point is None:
            raise AmbkitError("operating_point is missing: the lag depends on where the rotor is")
        offset = engineering(self.offset(self.known), "V", digits=6)
        header = (
            "# Driven by the control signal, through a coil that was identified. In its map:\n"
            f'# [signals.u] offset = "{offset}", so that 0 is the bias current.\n'
        )
        machine = self.machine(self.known, self.operating_point)
        files.write_text(path, header + machine.to_toml(Path(path).parent))

    def offset(self, known: Machine) -> float:
        """Offset of the control signal in a channel map, so that 0 is the bias current [V]."""
        return -(self.coil.dead_zone + known.magnet.bias_current / self.coil.gain)


WORDS = {
    "gain": ("gain G", "A/V"),
    "dead_zone": ("dead zone u0", "V"),
    "far_time": ("time constant far away, a", "s"),
    "near_time": ("more at the magnet, b", "s"),
    "length": ("falls within, c", "m"),
    "delay": ("delay", "s"),
    "zero": ("current's sensor shows at none", "A"),
}
"""Names and units of a coil's figures."""

NAMES = tuple(field.name for field in fields(Coil))


def fit_coil(
    records: Sequence[Record],
    names: Sequence[str] | None = None,
    *,
    note: Callable[[str], object] = lambda _: None,
) -> CoilFit:
    """Identify a coil by least squares of its current along complete logs."""
    names = list(names or (f"log {number}" for number in range(1, len(records) + 1)))
    if not records:
        raise RecordError("there is no log to find a coil from")
    for name, record in zip(names, records, strict=True):
        _check(name, record)
    note("fitting the coil")
    began = _begin(records)
    coil, misses, slopes = _least_squares(records, began)
    inverse = np.linalg.pinv(slopes.T @ slopes)
    scores = _blocks(slopes * np.concatenate(misses)[:, None], records)
    errors = np.sqrt(np.diag(inverse @ (scores.T @ scores) @ inverse))
    left_out = {}
    if len(records) > 2:
        note("leaving out one log after the other")
        ends = np.cumsum([len(record) for record in records])
        for name, record, end in zip(names, records, ends, strict=True):
            others = np.ones(ends[-1], bool)
            others[end - len(record) : end] = False
            # Gauss-Newton step from all logs: hardly a standard error long.
            step, *_ = np.linalg.lstsq(slopes[others], -np.concatenate(misses)[others], rcond=None)
            theta = np.array([getattr(coil, at) for at in NAMES]) + step
            left_out[name] = rms(Coil(*theta.tolist()).current(record) - record["i"])
    return CoilFit(
        coil,
        dict(zip(NAMES, errors.tolist(), strict=True)),
        rms(np.concatenate(misses)),
        float(np.median([white_noise(record["i"]) for record in records])),
        {name: rms(miss) for name, miss in zip(names, misses, strict=True)},
        left_out,
        {name: float(np.mean(r["z"])) for name, r in zip(names, records, strict=True)},
        dict(zip(names, records, strict=True)),
    )


def _check(name: str, record: Record) -> None:
    for signal, unit in (("z", "m"), ("i", "A"), ("u", "V")):
        if signal not in record:
            raise RecordError(f"{name}: lacks {signal} [{unit}], required to identify a coil")
        if not np.isfinite(record[signal]).all():
            raise RecordError(f"{name}: samples of {signal} are missing")
    if len(record) < 50 or np.ptp(record["u"]) == 0:
        raise RecordError(f"{name}: the control signal never changes")
    if np.ptp(record["i"]) < LEAST_RANGE * white_noise(record["i"]):
        raise RecordError(f"{name}: the current is too constant to identify a coil")


def _begin(records: Sequence[Record]) -> Coil:
    """Return the initial coil: static gain, and a lag of some samples."""
    u, i, z = (np.concatenate([r[name] for r in records]) for name in ("u", "i", "z"))
    most = float(u.max())
    gain = float(np.quantile(i[u > 0.95 * most], 0.9)) / most
    zero = float(np.median(i[u <= 0.02 * most])) if (u <= 0.02 * most).any() else 0.0
    T = records[0].sampling_time
    # From the area between command and current: the time constant of a first-order lag.
    area = sum(float(np.abs(gain * r["u"] + zero - r["i"]).sum()) for r in records)
    jumps = sum(float(np.abs(gain * np.diff(r["u"])).sum()) for r in records)
    tau = max(T * area / max(jumps, 1e-12), T)
    spread = max(float(np.ptp(z)), 1e-3)
    return Coil(gain, 0.01 * most, 0.8 * tau, 0.2 * tau, 0.3 * spread, 0.3 * T, zero)


def _least_squares(records: Sequence[Record], begin: Coil) -> tuple[Coil, list[Array], Array]:
    """Return the least-squares coil, the residuals of each record, and their derivatives (n, 7)."""
    from scipy.optimize import least_squares

    size = np.array([
        begin.gain, 0.1 * abs(begin.gain), begin.far_time, begin.far_time,
        max(begin.length, 1e-4), records[0].sampling_time, 0.05 * abs(begin.gain),
    ])  # fmt: skip
    low = np.full(size.size, -np.inf)
    low[[0, 2, 4, 5]] = 1e-3 * size[[0, 2, 4, 5]]

    def misses(theta: Array) -> list[Array]:
        coil = Coil(*theta.tolist())
        return [coil.current(record) - record["i"] for record in records]

    def in_a_row(theta: Array) -> Array:
        return np.concatenate(misses(theta))

    first = np.maximum(np.array([getattr(begin, name) for name in NAMES]), low + 1e-3 * size)
    result = least_squares(
        in_a_row, first, x_scale=size, bounds=(low, np.inf), diff_step=np.full(size.size, 1e-5),
        xtol=1e-7, ftol=1e-7,
    )  # fmt: skip
    return Coil(*result.x.tolist()), misses(result.x), np.asarray(result.jac)


def _blocks(scores: Array, records: Sequence[Record]) -> Array:
    """Sum rows (n, p) over blocks of `BLOCK` seconds of each record."""
    edges, at = [], 0
    for record in records:
        length = max(1, round(BLOCK / record.sampling_time))
        edges += list(range(at, at + len(record), length))
        at += len(record)
    return np.asarray(np.add.reduceat(scores, edges, axis=0))


SHOWN = 0.6  #: Seconds around the largest step of a log in the figure.


def coil_figure(fit: Any) -> Figure:
    """Plot the largest downward step of one log, the time constant, and the residuals."""
    names, records = list(fit.records), list(fit.records.values())
    distance = Axis("distance $z$", "mm", 1e3)
    at = np.linspace(0.0, 1.05 * max(fit.distance.values()), 200)
    far = sorted(range(len(names)), key=lambda k: fit.distance[names[k]])[len(names) // 2]
    record = records[far]
    jump = int(np.argmax(np.abs(np.diff(record["u"]))))
    half_window = round(SHOWN / 2 / record.sampling_time)
    cut = slice(max(jump - half_window // 3, 0), jump + half_window)
    parts = np.array(
        [(fit.distance[n], fit.residuals[n], fit.left_out.get(n, np.nan)) for n in names]
    )
    return Figure(
        id="coil",
        title="A coil, from steps of its control signal",
        caption=f"Above the largest step of {names[far]}.",
        panels=[
            Panel(Axis("time $t$", "s"), Axis("coil current $i$", "A"), [
                Line(record.t[cut], record["i"][cut], signal="measurement", label="measured"),
                Line(record.t[cut], fit.coil.current(record)[cut], signal="fit", label="fit"),
            ]),
            Panel(distance, Axis("time constant", "ms", 1e3), [
                Line(at, fit.coil.time_constant(at), signal="fit", label="fit"),
            ]),
            Panel(distance, Axis("left, rms", "mA", 1e3), [
                Rule(fit.noise, signal="bound", label="noise"),
                Points(parts[:, 0], parts[:, 1], signal="measurement", label="from this log"),
                Points(parts[:, 0], parts[:, 2], signal="estimate", label="without this log"),
            ]),
        ],
    )  # fmt: skip
