"""Loops of several axes: a rigid rotor in two planes, against figures computed independently.

The TUM MLPS rotor with decentralised PD (Kp 8,000 A/m, Kd 15 A s/m, corner 2 kHz, by Tustin), an
amplifier of 1.5 kHz, a sensor of 16 us, sampled at 0.1 ms with hold.
"""

import math

import numpy as np
import pytest

from ambkit.control.linear.closed_loop import Loop
from ambkit.judge.loop.margins import bode_integral, grid, highest, margins
from ambkit.models.linear import LinearSystem, Signal, linearised
from ambkit.models.parts import Amplifier, Delay, Disturbance, MagnetPlace, Rotor, Sensor

T, K_I, K_S = 1e-4, 59.855034, 191_843.057
MASS, TRANSVERSE, POLAR = 3.27306135, 0.125420374, 0.003642621
PLACES = (-0.251602551, 0.258397449)
AXES = ("xA", "xB", "yA", "yB")
CURRENT, TRAVEL = 2.5, 1e-4


def rotor(speed):
    """Rigid rotor in the displacements of its bearings."""
    to = np.linalg.inv([[1.0, z] for z in PLACES])  # to centre and tilt
    plane, turning = to.T @ np.diag([MASS, TRANSVERSE]) @ to, to.T @ np.diag([0, POLAR]) @ to
    M, G = np.kron(np.eye(2), plane), np.kron([[0, 1], [-1, 0]], turning)
    pairs = [(i, j) for i in range(4) for j in range(4)]
    return Rotor(
        {at: M[at] for at in pairs if M[at]}, TRAVEL, 1.0, AXES, tuple(f"v_{a}" for a in AXES),
        gyroscopic={at: G[at] for at in pairs if G[at]}, speed=speed,
    )  # fmt: skip


def loop(dead_time, speed=0.0):
    parts = [rotor(speed), *(MagnetPlace(100.0, f"f_{a}", a) for a in AXES)]
    parts += [Disturbance(1.0, 0.1, f"load_{a}", f"f_{a}") for a in AXES]
    parts += [Sensor(1.0, 16e-6, TRAVEL, f"y_{a}", f"m_{a}", a) for a in AXES]
    parts += [Amplifier(CURRENT, 1500.0, f"u_{a}", f"i_{a}", f"f_{a}") for a in AXES]
    parts += [Delay(dead_time * T, CURRENT, f"u_{a}") for a in AXES]
    plant = linearised(parts, T, K_I, K_S)
    # Kp + Kd s/(1 + s/wd) with s = 2/T (z - 1)/(z + 1)
    steep, corner = 2 / T, 2 * math.pi * 2000
    pole = (steep / corner - 1) / (1 + steep / corner)
    D = 15.0 * steep / (1 + steep / corner)
    one = np.eye(4)
    pd = LinearSystem(
        pole * one, one, -D * (pole - 1) * one, -(8000.0 + D) * one, T,
        tuple(Signal(f"d_{a}", "m") for a in AXES), plant.outputs[:4], plant.inputs[:4],
    )  # fmt: skip
    return Loop(plant, pd, 4)


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


@pytest.mark.parametrize(
    ("dead_time", "peaks", "largest"), [(1.0, (1.390, 1.396), 1.602), (1.5, (1.462, 1.473), 1.674)]
)
def test_peaks_of_each_axis_with_all_others_closed(dead_time, peaks, largest):
    at_rest = loop(dead_time)
    found = [margins(at_rest, axis).peak for axis in range(4)]
    assert found == pytest.approx(2 * peaks, abs=6e-4)
    value, _ = highest(at_rest.largest_sensitivity, grid(at_rest))
    assert value == pytest.approx(largest, abs=6e-4)


def test_unstable_poles_of_the_machine():
    poles = np.sort(np.log(loop(1.0).unstable_poles().real) / T)
    assert poles == pytest.approx([342.308, 342.308, 446.106, 446.106], abs=1e-3)
    turning = np.log(loop(1.0, 30_000 * 2 * math.pi / 60).unstable_poles()) / T
    assert np.sort(turning.real) == pytest.approx([342.318] * 2 + [443.757] * 2, abs=1e-3)
    assert np.sort(np.abs(turning.imag)) == pytest.approx([0.025] * 2 + [45.596] * 2, abs=1e-3)


@pytest.mark.parametrize("dead_time", [1.0, 1.5])
@pytest.mark.parametrize("rpm", [0, 30_000])
def test_bodes_integral_in_both_planes(dead_time, rpm):
    machine = loop(dead_time, rpm * 2 * math.pi / 60)
    assert machine.is_stable
    found = bode_integral(machine)
    assert found.integral == pytest.approx(found.poles, rel=1e-6)
    if rpm == 0:
        assert 2 * math.pi * found.integral == pytest.approx(0.99075025, rel=1e-7)


def test_compliance_is_by_the_load_at_each_bearing():
    """At rest and at low frequency: the inverse of the static stiffness, decoupled."""
    machine = loop(1.0)
    compliance = machine.compliance(0.01)[0]
    static = 1 / (K_I * 8000.0 - K_S)
    assert compliance.real == pytest.approx(static * np.eye(4), abs=1e-6 * static)
