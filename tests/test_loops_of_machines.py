"""Loops of machines against figures computed independently, and Bode's integral.

The reference is in complex coordinates: the TUM MLPS rotor with decentralised PD, continuous and
sampled.
"""

import math

import numpy as np
import pytest
from machine_cases import PRESETS, made
from quick import quick

from ambkit import Machine
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_plant import OperatingPoint, plant
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.judge.loop.margins import bode_integral, grid, highest, margins
from ambkit.judge.loop.synthesis import EDGE, _growing, _ratio, least_peaks
from ambkit.models.linear import LinearSystem, Signal

RPM = math.pi / 30
UFU = Machine.preset("ufu_rig")


def reference(**keys):
    """The TUM rotor of the reference: sensors at the magnets, amplifiers of 1.5 kHz."""
    tum = Machine.preset("tum_mlps")
    amplifier = {"bandwidth": 1500.0}
    bearings = [
        at.model_copy(update={"amplifier": at.amplifier.model_copy(update=amplifier), "angle": 0.0})
        for at in tum.bearings
    ]
    sensors = [
        tum.sensors[0].model_copy(update={"name": at.name, "place": at.place, "angle": 0.0,
                                         "lag": 16e-6})
        for at in bearings
    ]  # fmt: skip
    weightless = tum.rotor.model_copy(update={"gravity": "none"})
    return tum.model_copy(
        update={"rotor": weightless, "bearings": tuple(bearings), "sensors": tuple(sensors),
                "unbalance": (), "speed": 0.0} | keys
    )  # fmt: skip


def of_axes(A, B, C, D, system, T):
    """The same controller for each axis of a plant."""
    one = np.eye(4)
    names = [at.name for at in system.outputs[:4]]
    return LinearSystem(
        np.kron(one, A), np.kron(one, B), -np.kron(one, C), -np.kron(one, D), T,
        tuple(Signal(f"{k}_{n}", "m") for n in names for k in range(len(A))), system.outputs[:4],
        system.inputs[:4],
    )  # fmt: skip


# ---- the reference in complex coordinates


def test_continuous_reference():
    machine = reference(sampling_time=1e-6, sensor=tuple(
        at.model_copy(update={"lag": 1e-12}) for at in reference().sensors
    ))  # fmt: skip
    prompt = machine.model_copy(update={"delay": None})
    system = plant(prompt, OperatingPoint.of_machine(prompt), continuous=True)

    def sensitivity(f):
        """With a PD whose derivative has a corner of 2 kHz, and a dead time of 0.15 ms."""
        s = 2j * np.pi * f
        pd = (8000.0 + 15.0 * s / (1 + s / (2 * math.pi * 2000))) * np.exp(-1.5e-4 * s)
        return np.linalg.inv(np.eye(4) + pd[:, None, None] * system.response(f)[:, :4, :4])

    f = np.linspace(50, 500, 901)
    for axes, peak, where in (((0, 1), 1.3690, 169.4), ((2, 3), 1.3737, 200.8)):
        for axis in axes:
            found = highest(lambda at, k=axis: sensitivity(at)[:, k, k], f)
            assert found == (pytest.approx(peak, abs=5e-5), pytest.approx(where, abs=0.05))
    largest = highest(lambda at: np.linalg.norm(sensitivity(at), 2, axis=(1, 2)), f)[0]
    assert largest == pytest.approx(1.5802, abs=5e-5)
    # Both planes are twice one plane in complex coordinates.
    bode = math.pi * system.unstable().real.sum()
    assert bode == pytest.approx(4953.75, rel=1e-6)


def sampled_loop(dead_time, rpm=0.0):
    """PD by Tustin, sampled at 0.1 ms with hold."""
    T = 1e-4
    machine = reference(delay=dead_time * T, speed=rpm * RPM)
    system = plant(machine, OperatingPoint.of_machine(machine))
    steep, corner = 2 / T, 2 * math.pi * 2000
    pole, D = (steep / corner - 1) / (1 + steep / corner), 15.0 * steep / (1 + steep / corner)
    pd = of_axes(np.array([[pole]]), np.eye(1), np.array([[D * (pole - 1)]]),
                 np.array([[8000.0 + D]]), system, T)  # fmt: skip
    return Loop(system, pd, 4)


@pytest.mark.parametrize(
    ("dead_time", "peaks", "largest"), [(1.0, (1.390, 1.396), 1.602), (1.5, (1.462, 1.473), 1.674)]
)
def test_sampled_reference(dead_time, peaks, largest):
    loop = sampled_loop(dead_time)
    found = [margins(loop, axis).peak for axis in range(4)]
    assert found == pytest.approx([peaks[0], peaks[0], peaks[1], peaks[1]], abs=6e-4)
    assert highest(loop.largest_sensitivity, grid(loop))[0] == pytest.approx(largest, abs=6e-4)
    integral = bode_integral(loop)
    assert 2 * math.pi * integral.integral == pytest.approx(0.99075025, rel=1e-7)
    assert integral.holds


def test_unstable_poles_of_the_reference_at_rest_and_turning():
    poles = np.sort(np.log(sampled_loop(1.0).unstable_poles().real) / 1e-4)
    assert poles == pytest.approx([342.308, 342.308, 446.106, 446.106], abs=1e-3)
    loop = sampled_loop(1.0, rpm=30_000)
    turning = np.log(loop.unstable_poles()) / 1e-4
    assert np.sort(turning.real) == pytest.approx([342.318] * 2 + [443.757] * 2, abs=1e-3)
    assert np.sort(np.abs(turning.imag)) == pytest.approx([0.025] * 2 + [45.596] * 2, abs=1e-3)
    assert loop.is_stable
    integral = bode_integral(loop)
    assert integral.integral == pytest.approx(integral.poles, rel=1e-6)


def test_compliance_is_by_the_load_at_each_bearing():
    """At rest and at low frequency: the inverse of the static stiffness, decoupled."""
    compliance = sampled_loop(1.0).compliance(0.01)[0]
    static = 1 / (59.855034 * 8000.0 - 191_843.057)
    assert compliance.real == pytest.approx(static * np.eye(4), abs=1e-6 * static)


def least_peak_of_delay(plant, delay):
    """Return what no controller in continuous time is below, by the dead time alone [1]."""
    # Sampling, zeros, and that control is late for other reasons make it only worse. It is ``e^(p
    # delay)`` of the fastest pole where the poles' directions are at right angles.
    from scipy.linalg import expm, solve_continuous_lyapunov

    if not len(plant.unstable()):
        return 1.0
    edge = EDGE * float(np.abs(plant.poles()).max())
    R, unstable_block = _growing(plant.A, lambda pole: pole.real > edge)
    seen = plant.C @ R
    own, gramian = (
        solve_continuous_lyapunov(unstable_block.T, item.T @ item)
        for item in (seen, seen @ expm(delay * unstable_block))
    )
    return _ratio(gramian, own)


def test_least_peak_by_the_dead_time_is_that_of_the_fastest_pole():
    machine = reference()
    system = plant(machine, OperatingPoint.of_machine(machine), continuous=True)
    y = [at.name for at in system.outputs[:4]]
    found = least_peak_of_delay(system.select(y, [at.name for at in system.inputs[:4]]), 1.5e-4)
    assert found == pytest.approx(math.exp(446.106 * 1.5e-4), rel=1e-6)
    assert found == pytest.approx(1.069, abs=5e-4)
    # Sampled so fast that neither hold nor lags count, the dead time is what is left.
    fast = reference(sampling_time=1e-5, delay=1.4e-4, sensor=tuple(
        at.model_copy(update={"lag": 1e-9}) for at in machine.sensors
    ), bearings=tuple(
        at.model_copy(update={"amplifier": at.amplifier.model_copy(update={"bandwidth": None})})
        for at in machine.bearings
    ))  # fmt: skip
    sampled = plant(fast, OperatingPoint.of_machine(fast))
    bounds = least_peaks(sampled.select(y, [at.name for at in sampled.inputs[:4]]))
    assert bounds == pytest.approx((found, found), rel=2e-3)


# ---- Bode's integral


@pytest.mark.parametrize("name", quick(PRESETS, {"tum_mlps"}))
@pytest.mark.parametrize("rpm", [0.0, 30_000.0])
def test_bodes_integral_of_presets(name, rpm):
    preset = Machine.preset(name).model_copy(update={"speed": rpm * RPM, "unbalance": ()})
    for kind in (None, "linear", "extended"):
        loop = LoopBuilder(preset).loop(made(kind, preset) if kind else None)
        assert loop.is_stable
        found = bode_integral(loop)
        assert found.poles > 0.05
        assert found.integral == pytest.approx(found.poles, rel=1e-6)
        assert found.holds


# ---- the delay margin


class Turned(Loop):
    """A loop of one crossing, at 173 Hz, whose phase there is as it is made."""

    def __init__(self, phase):
        object.__setattr__(self, "phase", phase)

    measurements, shown = 2, None

    def of_axis(self, axis, f):
        return 1 / (1 + self.broken(f))

    def broken(self, f):
        return 2 * np.exp(1j * self.phase) / (1 + 1j * f / 100)


@pytest.mark.parametrize("phase", np.arange(-3.0, 3.2, 0.5))
def test_the_delay_margin_is_the_least_dead_time_that_leads_through_minus_one(phase):
    """At every angle of the crossing, above the real axis and below."""
    turned, f = Turned(phase), np.geomspace(1, 1e4, 2000)
    found = margins(turned, f=f)
    at = 100 * math.sqrt(3)
    assert found.crossover == pytest.approx(at, rel=1e-9)

    def distance(dead_time):
        return abs(1 + turned.broken(at) * np.exp(-2j * math.pi * at * dead_time))

    assert distance(found.delay) < 1e-6
    assert distance(np.linspace(0, 0.999, 500) * found.delay).min() > 5e-5
    assert found.phase == pytest.approx(abs(np.angle(-turned.broken(at))), rel=1e-6)
