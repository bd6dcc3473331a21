"""Alternative structures that a description may lack, each as a force or a reading along a record.

All are causal, functions of earlier measurements, so that with the correct model no innovation
depends on them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.machine.magnets import magnet_of, own_time

LAGS = (0.02, 0.06, 0.2, 0.6)  #: Lags of the force, in time constants of the plant.
PLAYS = (0.01, 0.03, 0.09)  #: Half widths of a hysteresis, in bias currents.
CHANGES = (0.2, 0.35, 0.5, 0.65, 0.8)  #: Times at which the mass may change, over the record.
SLOW = 0.1  #: Share of the rms velocity below which friction is viscous.

RESONANCES, LOWEST, HIGHEST, DAMPING = 24, 2.0, 60.0, 0.05
"""Candidate frequencies, from and to, over the inverse of the plant's time constant, and the
damping ratio.
"""

NYQUIST = 0.4  #: Upper limit of resonances, over the sampling frequency.


@dataclass(frozen=True)
class Kind:
    """A structure that a description may lack."""

    name: str
    statement: str  #: Description; ``{size}`` and ``{where}`` are inserted.
    advice: str
    unit: str = "1"  #: SI unit of its size.
    digits: int = 2
    sign: int = 0  #: Only possible sign of its size; 0: both.
    of_reading: bool = False  #: Whether it is part of the reading, not a force.
    common: float = 0.0  #: Common size in machines, if only a large motion shows it.
    innocent: bool = False  #: Whether it is no structural error of a plant.


KINDS = {
    kind.name: kind
    for kind in (
        Kind("drift", "The force per mass drifts by {size} per second",
             "identify short windows; `--filter augmented` estimates the magnet constant", "%"),
        Kind("change", "The force per mass changes by {size} at {where}, as of a payload",
             "identify the parts separately with `--window`", "%"),
        Kind("saturation", "The magnet saturates: {size} of the force is lost at the bias flux",
             "add iron_length, relative_permeability and saturation to [magnet], or a force map",
             "%", sign=1, common=0.1),
        Kind("force law", "The force differs from the law of [magnet] by a term in {where}",
             "measure a force map, and check bias_current and air_gap", "%"),
        Kind("unequal coils", "The magnets pull with constants that differ by {size}",
             "check turns and gaps of both; a force map describes them", "%", common=0.2),
        Kind("lag", "The force follows the current with a lag of about {size}",
             "set [amplifier] bandwidth or [magnet] eddy_current_lag; a dead time or a sensor lag "
             "does not replace it", "s", sign=1),
        Kind("hysteresis", "The force has hysteresis over the current, {size} wide",
             "no force law models it: the identified dead time is partly hysteresis, which biases "
             "the force estimate", "A", sign=1),
        Kind("friction", "Friction of {size} opposes the motion",
             "check the clearance for rub", "N", sign=1),
        Kind("damping", "The motion is damped by {size}",
             "look for eddy currents in the rotor, or for a medium", "N s/m"),
        Kind("sensor quadratic", "The sensor is not linear: quadratic {size}",
             "calibrate it, and set [sensor] quadratic", "1/m", of_reading=True),
        Kind("sensor cubic", "The sensor is not linear: cubic {size}",
             "calibrate it, and set [sensor] cubic", "1/m^2", of_reading=True),
        Kind("sensor jump", "The zero of the position jumps by {size} at {where}",
             "check the sensor's mount and cable; identify the parts separately with `--window`",
             "m", of_reading=True),
        Kind("resonance", "The magnet excites a resonance near {where}",
             "describe the flexible rotor, or stiffen the foundation", "%", of_reading=True),
        Kind("load jump", "The disturbance force jumps by {size} at {where}", "", "N",
             innocent=True),
    )
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Alternative:
    """One structure with its scale, and its effect along a record."""

    kind: Kind
    signal: Array  #: (n,) At the filter's steps: force [N] or reading [m], for unit size.
    where: str = ""  #: Its scale, in words.
    scale: float = 1.0  #: Factor from that of `signal` to a size in the unit of the kind.
    begins: int = 0  #: Sample at which it begins.


@dataclass(frozen=True, eq=False)
class Motion:
    """States of a model's filter along a record, at the filter's n steps."""

    model: LoopModel
    i: Array  #: Acting control current [A].
    x: Array  #: Displacement [m], velocity [m/s] and disturbance force [N], filtered.
    v: Array
    f_d: Array
    predicted: Array  #: Predicted reading [m].

    @classmethod
    def of(cls, model: LoopModel, record: Record) -> Motion:
        """Run the filter along a record."""
        out, u, kalman = model.run(record)
        every, gain = model.substeps, model.isolated.sensor.gain
        mean, own = out["mean"], model.number
        if kalman.machine.single:
            at = [[s.name for s in kalman.states].index(name) for name in ("x", "v", "f_d")]
            x, v, f_d = mean.T[at]
        else:
            x, v = (mean @ rows[own] for rows in kalman.view.along_axes(kalman.states))
            # It includes the effect of the other axes: only its mean is subtracted.
            u = u[:, own]
            iu = model.isolated.amplifier.gain * u
            force = magnet_of(model.isolated).force(iu, x)
            f_d = np.full(x.size, -float(force.mean()) - model.isolated.weight)
        y = record["y"] - model.position_offset - out["innovation"][::every]
        seen = np.where(np.isfinite(y), y, gain * x[::every])
        return cls(model, model.isolated.amplifier.gain * u, x, v, f_d, np.repeat(seen, every))

    @property
    def step(self) -> float:
        """Time step of the filter [s]."""
        return self.model.isolated.sampling_time / self.model.substeps

    @cached_property
    def t(self) -> Array:
        """Time from the start of the record [s]."""
        return np.asarray(self.step * np.arange(self.i.size), np.float64)

    @cached_property
    def force(self) -> Array:
        """Force of the magnet [N]."""
        return magnet_of(self.model.isolated).force(self.i, self.x)

    @cached_property
    def k_i(self) -> Array:
        """Current stiffness along the record [N/A]."""
        return magnet_of(self.model.isolated).tangent(self.i, self.x)[0]

    @cached_property
    def inertia(self) -> Array:
        """Mass times acceleration [N]."""
        return self.force + self.f_d + self.model.isolated.weight

    def after(self, sample: int) -> Array:
        """Return 1 from a sample on, 0 before."""
        return np.asarray(np.arange(self.i.size) >= sample * self.model.substeps, np.float64)


def alternatives(motion: Motion) -> Iterator[Alternative]:
    """Yield all structures without those that begin at a sample."""
    n = motion.i.size // motion.model.substeps
    yield Alternative(KINDS["drift"], (motion.t - motion.t.mean()) * motion.force)
    for part in CHANGES:
        yield change(motion, round(part * n))
    yield from _of_law(motion)
    yield from _of_current(motion)
    speed = float(np.std(motion.v))
    yield Alternative(KINDS["friction"], -np.tanh(motion.v / (SLOW * speed)))
    yield Alternative(KINDS["damping"], -motion.v)
    gain, seen = motion.model.isolated.sensor.gain, motion.predicted
    yield Alternative(KINDS["sensor quadratic"], seen**2 / gain)
    yield Alternative(KINDS["sensor cubic"], seen**3 / gain**2)
    yield from _resonances(motion)


def change(motion: Motion, sample: int) -> Alternative:
    """Return a change of mass or magnet constant at a sample."""
    where = engineering(motion.t[sample * motion.model.substeps], "s", 3)
    return Alternative(KINDS["change"], motion.after(sample) * motion.inertia, where)


def jump(motion: Motion, kind: str, sample: int) -> Alternative:
    """Return a jump of the disturbance force or the sensor's zero at a sample."""
    where = engineering(motion.t[sample * motion.model.substeps], "s", 3)
    return Alternative(KINDS[kind], motion.after(sample), where, begins=sample)


def _of_law(motion: Motion) -> Iterator[Alternative]:
    magnet, i, x = motion.model.isolated.magnet, motion.i, motion.x
    pull = magnet.magnet_constant * (magnet.bias_current / magnet.air_gap) ** 2
    a, b = i / magnet.bias_current, x / magnet.air_gap
    toward, away = (1 + a) / (1 - b), (1 - a) / (1 + b) * (magnet.type == "two-sided")
    # Fröhlich's curve and similar ones lose by a power of the flux, to first order.
    yield Alternative(KINDS["saturation"], pull * (away**6 - toward**6))
    if magnet.type == "two-sided":
        yield Alternative(KINDS["unequal coils"], pull / 2 * (toward**2 + away**2))
    terms = {"x^2": b**2, "x iu": a * b, "iu^2": a**2, "x^3": b**3, "iu^3": a**3}
    for name, term in terms.items():
        yield Alternative(KINDS["force law"], pull * term, name)


def _of_current(motion: Motion) -> Iterator[Alternative]:
    from scipy.signal import lfilter

    i, own = motion.i, own_time(motion.model.isolated)
    for part in LAGS:
        keep = math.exp(-motion.step / (part * own))
        follow, _ = lfilter([1 - keep], [1.0, -keep], i, zi=[keep * i[0]])
        where = engineering(part * own, "s", 1)
        yield Alternative(KINDS["lag"], motion.k_i * (follow - i), where, part * own)
    for part in PLAYS:
        half = part * motion.model.isolated.magnet.bias_current
        signal = motion.k_i * (play(i, half) - i)
        yield Alternative(KINDS["hysteresis"], signal, scale=2 * half)


def play(i: Array, half: float) -> Array:
    """Return the output of play (Prandtl's operator) for a signal."""
    at, out = float(i[0]), np.empty_like(i)
    for k, now in enumerate(i.tolist()):
        at = max(now - half, min(now + half, at))
        out[k] = at
    return out


def _resonances(motion: Motion) -> Iterator[Alternative]:
    from scipy.signal import lfilter

    b, force = motion.model.isolated, motion.force - motion.force.mean()
    own, h = own_time(b), motion.step
    top = min(HIGHEST, 2 * math.pi * NYQUIST * own / b.sampling_time)
    for ratio in np.geomspace(LOWEST, top, RESONANCES) if top > LOWEST else ():
        omega = ratio / own
        pole = np.exp((-DAMPING + 1j * math.sqrt(1 - DAMPING**2)) * omega * h)
        denominator = np.poly([pole, pole.conj()]).real
        follow = lfilter([0.0, denominator.sum()], denominator, force)
        compliance = b.sensor.gain / (b.rotor.mass * omega**2)
        where = engineering(omega / (2 * math.pi), "Hz", 2)
        yield Alternative(KINDS["resonance"], compliance * follow, where)
