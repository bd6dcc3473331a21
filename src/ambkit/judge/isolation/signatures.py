"""Signatures of faults: the forces and readings added by a fault of size 1.

A fault is data for ``core/include/ambkit/isolation.h``: signals of the running filter, the forces
or readings on which they act, and their weights. The effect of a coil, magnet or mass on the force
is its derivative with respect to the parameter; a new fault is one line of `_of_axis`,
`_of_reading` or `_in_motion`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from ambkit.data.signals import signal
from ambkit.estimate.machine_model import View
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of, own_time

OF_FORCE, OF_SENSOR = 5, 2  #: Signals of each, AMB_OF_FORCE and AMB_OF_SENSOR.
FORCE, BY_CURRENT, BY_GAP, LATE, COILS = range(OF_FORCE)
READING, LAGGED = range(OF_SENSOR)
LATE_BY, LAG_BY = 3, 5
"""Samples by which control and reading are late whose signatures are tested: the derivative by a
delay would answer to noise of a sample, which a delay does not carry on."""
LINE = 50.0  #: Frequency of the mains [Hz].
LATENCY, DYNAMICS = 1, 2
"""Groups of faults that look alike: what is late, and the force per displacement and mass."""


class Term(NamedTuple):
    """A signal that acts with a weight along a force or on a reading."""

    direction: int
    signal: int
    weight: float


@dataclass(frozen=True)
class Signature:
    """A fault: what one of size 1 adds."""

    name: str
    about: str
    unit: str  #: Of its size; 1: relative.
    columns: tuple[tuple[Term, ...], ...]  #: Two of an oscillation.
    most: float  #: A size that is as bad as can be.
    load: bool = False  #: A disturbance force, which is no fault.
    group: int = 0  #: Of those that look alike.


class Places:
    """Where signals and directions of a filter's machine stand."""

    def __init__(self, view: View) -> None:
        self.machine = view.machine
        self.forces, self.sensors = len(self.machine.axes), len(self.machine.readings)
        self._readings = 1 + OF_FORCE * self.forces
        self._forms = self._readings + OF_SENSOR * self.sensors
        self._tones = self._forms + 2 * self.forces

    def of_force(self, f: int, what: int) -> int:
        """Signal of a force."""
        return 1 + OF_FORCE * f + what

    def of_reading(self, r: int, what: int) -> int:
        """Signal of a reading."""
        return self._readings + OF_SENSOR * r + what

    def gradient(self, at: int) -> int:
        """Return the gradient of a signal, from 1 on; 0: it does not depend on the error."""
        if 0 < at < self._readings:
            f, what = divmod(at - 1, OF_FORCE)
            return f + 1 if what in (FORCE, BY_GAP) else 0
        if self._readings <= at < self._forms:
            r, what = divmod(at - self._readings, OF_SENSOR)
            past = 0 if what == READING else self.sensors + self.forces
            return self.forces + r + 1 + past
        form = at - self._forms
        return self.forces + self.sensors + form + 1 if 0 <= form < self.forces else 0

    def load(self, f: int) -> int:
        """Estimated disturbance force along an axis."""
        return self._forms + f

    def momentum(self, f: int) -> int:
        """Force along an axis that gives the rotor its velocity within a sample."""
        return self._forms + self.forces + f

    def at_onset(self, f: int) -> int:
        """Direction of a force that acts in the first sample only."""
        return self.forces + self.sensors + f

    def tone(self, k: int) -> tuple[int, int]:
        """Cosine and sine of a tone."""
        return self._tones + 2 * k, self._tones + 2 * k + 1


def lags_of(machine: Machine) -> list[float]:
    """Return the lag of each reading that has more lag [s]."""
    more = LAG_BY * machine.sampling_time
    return [machine.lag_of(reading.sensor) + more for reading in machine.readings]


def tones_of(view: View) -> list[float]:
    """Return the frequencies [rad/s] that are looked for: the mains, and the rotation."""
    speed = view.speed
    return [math.tau * LINE, *([speed] if speed else [])]


def signatures_of(view: View, magnet: Any) -> list[Signature]:
    """Return all faults of a filter's machine."""
    places = Places(view)
    machine, isolated = places.machine, view.isolated
    result: list[Signature] = []
    for f, (axis, of) in enumerate(zip(machine.axes, isolated, strict=True)):
        result += _of_axis(places, f, axis, of)
    own = own_time(isolated[0])
    for r, (reading, lag) in enumerate(zip(machine.readings, lags_of(machine), strict=True)):
        result += _of_reading(places, r, reading.name, lag, view.limits[r], own)
    return result + list(_in_motion(places, view, magnet))


def _of_axis(places: Places, f: int, axis: Any, of: Machine) -> Iterator[Signature]:
    force, current, gap, late, coils = (places.of_force(f, k) for k in range(OF_FORCE))
    law = magnet_of(of)
    k_i, bias = float(law.tangent(0.0, 0.0)[0]), float(law.bias_force)
    most = abs(k_i) * of.current_max

    def fault(
        name: str, about: str, unit: str, size: float, *terms: tuple[int, float], group: int = 0
    ) -> Signature:
        columns, load = (tuple(Term(f, at, weight) for at, weight in terms),), name == "load"
        return Signature(signal(name, axis.name), about, unit, columns, size, load, group)

    yield fault("load", "step of disturbance force, weight or bias current", "N", most, (0, 1.0))
    yield fault("magnet", "magnet constant", "1", 1.0, (force, 1.0), (0, bias), group=DYNAMICS)
    if of.magnet.type == "two-sided":
        yield fault("upper coil", "coil towards +x", "1", 1.0, (force, 0.5), (coils, 1.0))
        yield fault("lower coil", "coil towards -x", "1", 1.0, (force, 0.5), (coils, -1.0))
    yield fault("amplifier", "gain of the amplifier", "1", 1.0, (current, 1.0))
    yield fault("gap", "air gap", "1", 1.0, (gap, -3.0), group=DYNAMICS)
    delay = (late, 1 / LATE_BY)
    yield fault("dead time", "delay of the control", "samples", 10.0, delay, group=LATENCY)


def _of_reading(
    places: Places, r: int, reading: str, more_lag: float, limit: float, own: float
) -> Iterator[Signature]:
    read, lagged = (places.of_reading(r, k) for k in range(OF_SENSOR))
    along = places.forces + r

    def fault(
        name: str, about: str, unit: str, size: float, *signals: tuple[int, float],
        group: int = 0,
    ) -> Signature:  # fmt: skip
        columns = tuple((Term(along, at, weight),) for at, weight in signals)
        return Signature(signal(name, reading), about, unit, columns, size, group=group)

    yield fault("sensor gain", "gain of the sensor", "1", 1.0, (read, 1.0))
    yield fault("sensor offset", "zero of the sensor", "m", limit, (0, 1.0))
    yield fault("sensor lag", "lag of the sensor", "s", own, (lagged, 1 / more_lag), group=LATENCY)
    tone = [(k, 1.0) for k in places.tone(0)]
    yield fault("line noise", f"noise at {LINE:g} Hz", "m", limit, *tone)


def _in_motion(places: Places, view: View, magnet: Any) -> Iterator[Signature]:
    known = view.known_forces(magnet, weight=True)
    biases = [float(magnet_of(of).bias_force) for of in view.isolated]
    magnets: list[Term] = []
    weights: list[Term] = []
    for f, bias in enumerate(biases):
        magnets += [Term(f, places.of_force(f, FORCE), 1.0), Term(f, places.load(f), 1.0),
                    Term(f, 0, bias)]  # fmt: skip
        weights.append(Term(f, 0, float(known[f]) - bias))
    mass = tuple(term._replace(weight=-term.weight) for term in magnets)
    yield Signature("mass", "mass of the rotor", "1", (mass,), 1.0, group=DYNAMICS)
    clock = tuple(term._replace(weight=2 * term.weight) for term in [*magnets, *weights])
    # A clock that changes in motion also changes the velocity per sample.
    clock += tuple(Term(places.at_onset(f), places.momentum(f), 1.0) for f in range(len(biases)))
    for r, lag in enumerate(lags_of(places.machine)):  # which has fewer samples
        less = places.machine.lag_of(places.machine.readings[r].sensor) / lag
        clock += (Term(places.forces + r, places.of_reading(r, LAGGED), -less),)
    yield Signature("clock", "sampling time", "1", (clock,), 1.0)
    if places.machine.rotor.type != "mass" and places.machine.speed:
        yield from _unbalances(places, view)


def _unbalances(places: Places, view: View) -> Iterator[Signature]:
    cosine, sine = places.tone(1)
    axes = list(enumerate(places.machine.axes))
    for bearing in places.machine.bearings:
        radial = [
            (f, axis.line.cosine, axis.line.sine)
            for f, axis in axes if axis.bearing is bearing and not axis.line.axial
        ]  # fmt: skip
        if not radial:
            continue
        x = tuple(term for f, c, s in radial for term in (Term(f, cosine, c), Term(f, sine, s)))
        y = tuple(term for f, c, s in radial for term in (Term(f, cosine, s), Term(f, sine, -c)))
        of = view.isolated[radial[0][0]]
        most = abs(float(magnet_of(of).tangent(0.0, 0.0)[0])) * of.current_max
        name = signal("unbalance", bearing.name)
        yield Signature(name, "force of an unbalance", "N", (x, y), most)
