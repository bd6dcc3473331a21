"""Alternative structures that a description may lack, each as a force or a reading along a record.

All are causal, functions of earlier measurements, so that with the correct model no innovation
depends on them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

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
    common: float = 0.0  #: Common size in machines that many records do not show.
    experiment: str = "move the rotor over the range that it will use"  #: What shows it.
    innocent: bool = False  #: Whether it is no structural error of a plant.


JUMPS = ("load jump", "sensor jump")
ONCE = (*JUMPS, "change")  #: Kinds that belong to one record.

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
             "check turns and gaps of both; a force map describes them", "%", common=0.2,
             experiment="measure the zero of the position between the stops, and compare the "
             "steady control current at two bias currents"),
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
        out, _, kalman = model.run(record)
        u = replace(model, structures={}).acting_signals(record)[1]
        read = model.acting_signals(record)[0].reshape(len(u), -1)[:, model.reading]
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
        y = read[::every] - out["innovation"][::every]
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


@dataclass(frozen=True, eq=False)
class Alternative:
    """One structure with its scale, and its effect along a record."""

    kind: Kind
    motion: Motion
    #: (n,) At the filter's steps: force [N] or reading [m], for unit size, or for that of a scale.
    of: Callable[[Motion, float], Array]
    where: str = ""  #: Its scale, in words.
    scale: float = 1.0  #: Lag [s] or width [A] of one that is not linear in its size.
    begins: int = 0  #: Sample at which it begins.
    record: int = 0  #: Number of the first record that has it.

    @cached_property
    def signal(self) -> Array:
        """Its effect along the record."""
        return self.of(self.motion, self.scale)

    @property
    def bias(self) -> float:
        """Possible bias of its size, in the unit of the kind."""
        # Noise of the current takes a play by about its deviation further to either side.
        amplifier = self.motion.model.isolated.amplifier
        noise = abs(amplifier.gain) * math.sqrt(amplifier.noise_variance)
        return 2 * noise * (self.kind.name == "hysteresis")

    def along(self, motion: Motion, record: int) -> Iterator[Alternative]:
        """Yield it along another record, if it concerns it."""
        if record == self.record or self.kind.name not in ONCE:
            yield replace(self, motion=motion)

    def effect(self, factor: float = 1.0) -> tuple[Array, Array]:
        """Return its part of the reading [m], and the control [V] that replaces its force."""
        signal, of = factor * self.signal, self.motion
        nothing = np.zeros_like(signal)
        if self.kind.of_reading:
            return signal, nothing
        return nothing, signal / (of.k_i * of.model.isolated.amplifier.gain)


def alternatives(motion: Motion) -> Iterator[Alternative]:
    """Yield all structures without those that begin at a sample."""

    def linear(kind: str, signal: Callable[[Motion], Array]) -> Alternative:
        return Alternative(KINDS[kind], motion, lambda along, _: signal(along))

    n = motion.i.size // motion.model.substeps
    yield linear("drift", lambda of: (of.t - of.t.mean()) * of.force)
    for part in CHANGES:
        yield beginning(motion, "change", round(part * n))
    yield from _of_law(motion)
    yield from _of_current(motion)
    yield linear("friction", lambda of: -np.tanh(of.v / (SLOW * float(np.std(of.v)))))
    yield linear("damping", lambda of: -of.v)
    gain = motion.model.isolated.sensor.gain
    yield linear("sensor quadratic", lambda of: of.predicted**2 / gain)
    yield linear("sensor cubic", lambda of: of.predicted**3 / gain**2)
    yield from _resonances(motion)


def beginning(motion: Motion, kind: str, sample: int) -> Alternative:
    """Return a change of mass or magnet constant, or a jump of force or zero, at a sample."""
    where = engineering(motion.t[sample * motion.model.substeps], "s", 3)

    def signal(of: Motion, _: float) -> Array:
        return of.after(sample) * (of.inertia if kind == "change" else 1.0)

    return Alternative(KINDS[kind], motion, signal, where, begins=sample)


def _of_law(motion: Motion) -> Iterator[Alternative]:
    # Fröhlich's curve and similar ones lose by a power of the flux, to first order.
    laws: dict[tuple[str, str], Callable[[Array, Array, Array, Array], Array]] = {
        ("saturation", ""): lambda _a, _b, toward, away: away**6 - toward**6,
        ("unequal coils", ""): lambda _a, _b, toward, away: (toward**2 + away**2) / 2,
        ("force law", "x^2"): lambda _a, b, *_: b**2,
        ("force law", "x iu"): lambda a, b, *_: a * b,
        ("force law", "iu^2"): lambda a, *_: a**2,
        ("force law", "x^3"): lambda _a, b, *_: b**3,
        ("force law", "iu^3"): lambda a, *_: a**3,
    }

    def force(law: Callable[..., Array], of: Motion, _: float) -> Array:
        magnet = of.model.isolated.magnet
        pull = magnet.magnet_constant * (magnet.bias_current / magnet.air_gap) ** 2
        a, b = of.i / magnet.bias_current, of.x / magnet.air_gap
        away = (1 - a) / (1 + b) * (magnet.type == "two-sided")
        return np.asarray(pull * law(a, b, (1 + a) / (1 - b), away))

    for (kind, where), law in laws.items():
        if kind != "unequal coils" or motion.model.isolated.magnet.type == "two-sided":
            yield Alternative(KINDS[kind], motion, partial(force, law), where)


def _of_current(motion: Motion) -> Iterator[Alternative]:
    own = own_time(motion.model.isolated)
    for part in LAGS:
        where = engineering(part * own, "s", 1)
        yield Alternative(KINDS["lag"], motion, _behind, where, part * own)
    for part in PLAYS:
        width = 2 * part * motion.model.isolated.magnet.bias_current
        yield Alternative(KINDS["hysteresis"], motion, _hysteresis, scale=width)


def _behind(of: Motion, lag: float) -> Array:
    """Return the force by which a lag of the current differs from none."""
    from scipy.signal import lfilter

    keep = math.exp(-of.step / lag)
    follow, _ = lfilter([1 - keep], [1.0, -keep], of.i, zi=[keep * of.i[0]])
    return np.asarray(of.k_i * (follow - of.i))


def _hysteresis(of: Motion, width: float) -> Array:
    """Return the force by which play of the current differs from none."""
    return of.k_i * (play(of.i, width / 2) - of.i)


def play(i: Array, half: float) -> Array:
    """Return the output of play (Prandtl's operator) for a signal."""
    at, out = float(i[0]), np.empty_like(i)
    for k, now in enumerate(i.tolist()):
        at = max(now - half, min(now + half, at))
        out[k] = at
    return out


def _resonances(motion: Motion) -> Iterator[Alternative]:
    b = motion.model.isolated
    own = own_time(b)
    top = min(HIGHEST, 2 * math.pi * NYQUIST * own / b.sampling_time)
    for ratio in np.geomspace(LOWEST, top, RESONANCES) if top > LOWEST else ():
        omega = float(ratio / own)
        where = engineering(omega / (2 * math.pi), "Hz", 2)
        yield Alternative(KINDS["resonance"], motion, partial(_resonant, omega), where)


def _resonant(omega: float, of: Motion, _: float) -> Array:
    """Return the reading of a mode that the magnet excites."""
    from scipy.signal import lfilter

    pole = np.exp((-DAMPING + 1j * math.sqrt(1 - DAMPING**2)) * omega * of.step)
    denominator = np.poly([pole, pole.conj()]).real
    force = of.force - of.force.mean()
    follow = lfilter([0.0, denominator.sum()], denominator, force)
    b = of.model.isolated
    return np.asarray(b.sensor.gain / (b.rotor.mass * omega**2) * follow)
