"""Test cases of the self-test: runs of measurements and control signals.

Each begins with a start. Together they cover the range of displacement and current, all kinds of
inputs, and all flags of a step; ``vectors.Coverage`` reports what was reached.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ambkit._core import Magnet
from ambkit.base.arrays import Array, Bools
from ambkit.control.control import Control
from ambkit.estimate.estimate import Status
from ambkit.estimate.estimator import Estimator
from ambkit.machine.parts import GRAVITY
from ambkit.simulation.run import simulate
from ambkit.simulation.scenario import Disturbance, Scenario
from ambkit.simulation.waveforms import Step

FLIGHT = 130  #: Samples of a run that a controller flies.
LONGEST_OUTAGE = 400
"""Samples without a measurement, until nothing is known but that the rotor is between its stops."""
NOISY = 80  #: Samples until an innovation in four of the last 128 was too large, and some.
MOST_SETTLING = 200  #: Samples of a plant's time constant that are lived through twice.
MOST_PLACES = 24  #: Rows, and columns, of the box that are visited.


class TestCase(NamedTuple):
    """One run, n samples."""

    name: str
    y: Array  # (n,) or (n, readings) [m]; NaN: lost
    u: Array  # (n,) or (n, axes) [V]; u[k] acts from sample k to k + 1
    amplifies: int | None = None  # sample from which on rounding is amplified; None: nowhere


def of(filter: Estimator, magnets: list[Magnet], settling: int) -> list[TestCase]:
    """Return the runs for an estimator."""
    if not filter.view.single:
        settled = [_settled_machine(filter, settling)] if settling <= MOST_SETTLING else []
        return [*_of_machine(filter), *settled]
    return [*_of_axis(filter, settling), *_box(filter, magnets[0])]


def quiet(filter: Estimator) -> TestCase:
    """A rotor that is moved once."""
    if filter.view.single:
        return _flight(filter, 1.0)
    return TestCase("a force", *_levitated(filter, 1.0))


# ---- One axis ----


def _of_axis(filter: Estimator, settling: int) -> Iterator[TestCase]:
    yield _corrupted(filter, _flight(filter, 1.0))
    yield _jumping(filter, _flight(filter, -1.0))
    yield _outage(filter)
    yield _inconsistent(filter)
    if settling <= MOST_SETTLING:
        yield _settled(filter, settling)


def _flight(filter: Estimator, sign: float) -> TestCase:
    """Hover, then a step of half the expert's reach."""
    machine = filter.machine
    T = machine.sampling_time
    reference = Step(amplitude=sign * machine.clearance / 4, time=20 * T)
    controller = Control.for_bearing(machine)
    scenario = Scenario(duration=(FLIGHT - 1) * T, reference=reference, controller=controller)
    record = simulate(machine, scenario)
    name = "a step up" if sign > 0 else "a step down"
    return TestCase(name, record["y"].copy(), record["u"].copy())


def _corrupted(filter: Estimator, case: TestCase) -> TestCase:
    """Measurements far away and lost, a frozen sensor, demands beyond the limits and no numbers."""
    machine, (_, y, u, _) = filter.machine, case
    far = 1e3 * machine.sensor.gain * machine.clearance
    just = 1e-2 * far * np.array([0.98, -0.98, 1.02, -1.02])  # ten travels and more: no rotor
    y[30:38:2] = just
    y[40:46] = far, -far, np.nan, np.inf, -np.inf, np.nan
    y[60:76] = y[60]
    for k, limit in ((86, machine.current_max), (92, machine.current_min)):
        u[k] = (
            limit + np.copysign(machine.amplifier.current_limit, limit)
        ) / machine.amplifier.gain
    u[98:101] = np.nan, np.inf, -np.inf
    y[104], u[104] = np.nan, np.nan
    return case._replace(name=f"{case.name}, with losses, freezing and saturation")


def _jumping(filter: Estimator, case: TestCase) -> TestCase:
    """Measurements that jump: just not, and just as far as an outlier; and one that stays."""
    settings = filter.core.parameters["set"]
    name, y, u, _ = case
    if not settings["outlier_limit"]:
        return case
    gate, var_y = settings["gate"], float(settings["var_y"][0])
    var_y += float(filter.core.parameters["rounding"][0])
    acceleration_step = 100.0 * settings["K_sen"][0] * settings["T"] ** 2
    turns = [(40 + 6 * n, part) for n, part in enumerate((1.001, 0.999, -1.001, -0.999))]
    # The more are left out, the farther may the next one be.
    turns += [(66, 1.5), (67, 1.001), (74, -1.5), (75, -0.999), (82, 1.5), (83, 1.5), (84, 1.001)]
    turns += [(30, -1.5), (31, -1.5), (32, -0.999)]
    for k, part in sorted(turns):
        output = run(filter, y[: k + 1], u[: k + 1])
        e, S = output["innovation"].ravel(), output["variance"].ravel()
        if not S[k] > 0:
            return case
        out = int(k - 1 - np.flatnonzero(output["status"][:k].ravel() & Status.OUTLIER == 0)[-1])
        last = k - 1 - out  # that was taken in, and left
        left = e[last] * var_y / S[last]
        goes_on = np.sqrt(2 * gate**2 * var_y + (acceleration_step * (out + 1) ** 2) ** 2)
        least = max(gate * np.sqrt(S[k]), goes_on + np.sign(part) * left)
        y[k] += part * least - e[k]
    # Where no rotor is, but a sensor that has slipped shows it: the estimate is held at the stop.
    there = 1.2 * np.copysign(filter.machine.clearance, -y[90])
    y[90:] += settings["K_sen"][0] * there - y[90]
    u[0] = np.nan  # before any was good
    return case._replace(name=f"{name}, with jumps about the gate, and one that stays")


def _outage(filter: Estimator) -> TestCase:
    """On a stop, then nothing, until the filter says so; then the rotor on the other side."""
    machine = filter.machine
    sensor_range = machine.sensor.gain * machine.clearance
    y, u = np.full(LONGEST_OUTAGE + 30, np.nan), np.zeros(LONGEST_OUTAGE + 30)
    y[0] = -0.9 * sensor_range
    u[:] = 0.3 * machine.current_max / machine.amplifier.gain
    held = np.flatnonzero(run(filter, y, u)["status"] & Status.HELD)
    n = int(held[0]) + 5 if held.size and held[0] < LONGEST_OUTAGE else 60
    there = 0.6 * sensor_range * (1 + 1e-3 * np.resize([1.0, -1.0], 30))
    return TestCase("an outage", np.concatenate([y[:n], there]), u[: n + 30])


def _settled(filter: Estimator, settling: int) -> TestCase:
    """At rest until it may be fed back, then nothing until it may not."""
    machine = filter.machine
    n = settling + 6
    here = 1e-2 * machine.sensor.gain * machine.clearance * np.resize([1.0, -1.0, 0.5], n)
    y = np.concatenate([here, np.full(n, np.nan)])
    holding = machine.current_min / 4 / machine.amplifier.gain
    return TestCase("settled, and then nothing", y, np.full(2 * n, holding))


def _inconsistent(filter: Estimator) -> TestCase:
    """A noise six times as large as was said."""
    machine = filter.machine
    std = float(np.sqrt(filter.core.parameters["set"]["var_y"][0]))
    off = 6.0 * std * np.random.default_rng(0).choice([-1.0, 1.0], NOISY)
    here = -0.2 * machine.sensor.gain * machine.clearance
    holding = machine.current_min / 4 / machine.amplifier.gain
    return TestCase("too much noise", here + off, np.full(NOISY, holding))


def _box(filter: Estimator, magnet: Magnet) -> Iterator[TestCase]:
    """From each displacement, all currents, one after the other, before the rotor has moved far."""
    # Of a table every other cell is met in its middle, and so each of its nodes is asked.
    machine = filter.machine
    x_max, gain = machine.clearance, machine.sensor.gain
    of = magnet.parameters
    xs = _places(-x_max, x_max, of, "x_min", "per_metre", "rows")
    currents = _places(
        machine.current_min, machine.current_max, of, "iu_min", "per_ampere", "columns"
    )
    for row, x in enumerate(xs):
        # From both ends in turn: the rotor stays where it is.
        turns = np.stack([currents, currents[::-1]])[:, : -(-len(currents) // 2)].T.ravel()
        ordered = turns[: len(currents)][:: 1 if row % 2 else -1]
        u = np.append(ordered / machine.amplifier.gain, 0.0)
        step = 1e-4 * machine.clearance * np.resize([1.0, -1.0], len(u))
        inwards = np.where(np.arange(len(u)) > 0, step, 0.0) * (-1.0 if x > 0 else 1.0)
        yield TestCase(f"all currents at {1e3 * x:.3g} mm", gain * (x + inwards), u)


def _places(low: float, high: float, of: dict[str, Any], at: str, per: str, count: str) -> Array:
    """Return both ends, and between them the middles of every other cell of a table; or nine."""
    if count not in of:
        return np.linspace(low, high, 9)
    cells = np.append(np.arange(0, of[count] - 1, 2), of[count] - 2)
    inside = np.unique(np.clip(of[at] + (cells + 0.5) / of[per], low, high))
    few = np.linspace(0, len(inside) - 1, min(len(inside), MOST_PLACES)).round().astype(int)
    return np.array([low, *inside[few], high])


# ---- A machine ----


def _of_machine(filter: Estimator) -> Iterator[TestCase]:
    view = filter.view
    yield _corrupted_machine(filter, *_levitated(filter, 1.0))
    y, u = _levitated(filter, -1.0)
    y[60:] += 0.3 * view.gains * view.travel_seen  # all of them, and it stays
    y[90:, 0] = np.nan
    u[0, 0] = np.nan  # before any was good
    name = "a load the other way, a jump that stays, and a sensor that is lost"
    yield TestCase(name, y, u, amplifies=60)
    every = np.ones(len(view.gains), bool)
    yield _outage_of_machine(filter, every, "an outage")
    half = np.arange(len(view.gains)) % 2 == 0
    yield _outage_of_machine(filter, half, "an outage of every other sensor")


def _settled_machine(filter: Estimator, settling: int) -> TestCase:
    """At rest until it may be fed back, with readings that are of no use; then nothing."""
    view = filter.view
    seen = view.gains * view.travel_seen
    frozen = int(filter.core.parameters["set"]["frozen_limit"])
    n = settling + frozen + 30
    y = 1e-2 * seen * np.resize([1.0, -1.0, 0.5], (2 * n, 1))
    y[6:9] = np.nan
    y[12 : 15 + frozen] = y[12]
    y[18 + frozen] = 5 * seen
    y[n:] = np.nan
    return TestCase("settled, and then nothing", y, np.zeros((2 * n, len(view.isolated))))


def _outage_of_machine(filter: Estimator, lost: Bools, name: str) -> TestCase:
    """Off the middle, then nothing of some, until the filter says so; the first is back first."""
    # What is left of a large covariance by a sharp sensor is what rounding leaves of it.
    view = filter.view
    seen = view.gains * view.travel_seen
    limits = np.array([b.current_max / b.amplifier.gain for b in view.isolated])
    n = LONGEST_OUTAGE
    y = -0.5 * seen * (1 + 1e-3 * np.resize([1.0, -1.0, 0.5], (n, 1)))
    u = np.tile(0.3 * limits, (n, 1))
    y[1:, lost] = np.nan
    held = np.flatnonzero(run(filter, y, u)["status"].ravel() & Status.HELD)
    until = int(held[0]) + 5 if held.size else 40
    back = 0.4 * seen * (1 + 1e-3 * np.resize([1.0, 0.0], (20, 1)))
    back[:3, 1:] = np.where(lost[1:], np.nan, back[:3, 1:])
    amplifies = until if lost.all() else 1
    return TestCase(name, np.concatenate([y[:until], back]), u[: until + 20], amplifies)


def _levitated(filter: Estimator, sign: float) -> tuple[Array, Array]:
    """Let a machine hover under a load."""
    machine, view = filter.machine, filter.view
    T = machine.sampling_time
    tenth = Step(amplitude=sign * 0.1 * machine.rotor.mass * GRAVITY, time=20 * T)
    force = Disturbance(axis=machine.axes[0].name, force=tenth)
    scenario = Scenario(duration=(FLIGHT - 1) * T, disturbance=(force,))
    y, u = view.signals(simulate(machine, scenario))
    return y.copy(), u.copy()


def _corrupted_machine(filter: Estimator, y: Array, u: Array) -> TestCase:
    """Measurements far away, frozen sensors, and demands beyond the limits."""
    view = filter.view
    far = 1e3 * view.gains * view.travel_seen
    y[40:43] = far, -far, far  # all of them
    y[46, 0] = far[0]  # one of them
    y[48, -1] = np.nan
    y[60:76] = y[60]
    y[80:96, -1] = y[80, -1]
    limits = [2 * b.amplifier.current_limit / b.amplifier.gain for b in view.isolated]
    u[100], u[106] = limits, np.negative(limits)
    u[112, 0], u[113, -1] = np.nan, np.inf
    most = float(np.finfo(filter.precision).max)
    u[116, 0], u[117, -1] = most / 4, -most / 4  # numbers, whose products are none
    return TestCase("a load, with losses, freezing and saturation", y, u)


def run(filter: Estimator, y: Array, u: Array) -> dict[str, Any]:
    """Run from a fresh start at the first measurement; inputs may be no numbers."""
    number = np.dtype(filter.precision).type
    y, u = (np.asarray(values, number) for values in (y, u))
    filter.reset(filter.initial_state(y))
    output: dict[str, Any] = filter.core.run(y, u, covariance=True)
    return output
