"""Edges that no preset and no log of ours reaches, each against what it is by definition."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from machine_cases import BEARINGS, bearing, machine, sensor

from ambkit import AmbkitError, Machine
from ambkit.control.control import Mode
from ambkit.control.linear.linear_plant import OperatingPoint
from ambkit.data.reading.clock import Clock, resample
from ambkit.data.reading.first_machine import weight_scale
from ambkit.data.reading.levitation_test import LevitationFit
from ambkit.data.reading.position_search import Rotor
from ambkit.export.pil.loop import compare_bits
from ambkit.fuzzy.rule_selection import BLOCKS, blocks_of
from ambkit.judge.comparison.tuning import candidate_of_kind
from ambkit.judge.faults import fault_run
from ambkit.judge.loop.capacity import of_runout
from ambkit.machine.components import Unbalance
from ambkit.machine.forces.patches import _nodes
from ambkit.models.parts.typical_sizes import Typical
from ambkit.rotordynamics.unbalance_response import permitted

NONE = np.zeros(0, dtype=np.intp)


@pytest.mark.parametrize("held", [False, True])
def test_between_the_samples_beyond_them_and_in_a_gap(held):
    clock = Clock(
        "t", np.array([0.0, 1, 2, 5, 6]), 1.0, 0.0, NONE, np.array([3]), np.array([2]), NONE
    )
    values = np.array([10.0, 20, 40, 70, 90])
    times = np.array([-0.5, 0, 0.25, 1.75, 2, 3, 5, 5.5, 6, 6.5, 7.5])
    nan = math.nan
    straight = [nan, 10, 12.5, 35, 40, nan, 70, 80, 90, nan, nan]
    steps = [nan, 10, 10, 20, 40, nan, 70, 70, 90, 90, nan]
    found = resample(values, clock, times, held=held)
    np.testing.assert_allclose(found, steps if held else straight)


@pytest.mark.parametrize("gap", [2e-3, 12e-3])
@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-6, 2.5e-2])
@pytest.mark.parametrize("way", [1, -1])
def test_gravity_tells_gap_and_unit_of_what_hangs(gap, scale, way):
    """``x'' = (2 g / gap) x + (2 g / i) di`` in units of the log."""
    step, usual, g = 1e-3, 0.8, 9.81
    fit = LevitationFit(0, 1, step * math.sqrt(2 * g / gap), 0.0, 0.9, 1, 1.0, sure=True)
    gain = way * 2 * g / usual / scale * step**2
    moves = Rotor(0, 1, fit, gain, (), (), ())
    position = np.linspace(4, 6, 101) * 1e-4 / scale
    found = weight_scale(moves, position, np.full(101, usual), step)
    assert found.gap == pytest.approx(gap)
    assert found.scale == pytest.approx(scale)
    assert found.zero == pytest.approx(5e-4 / scale + way * gap / scale)
    said = " ".join(found.describe("pos", ""))
    assert f"gap {1e3 * gap:.3g} mm" in said
    # 25 mm a unit is 25 of the nearest unit, on a logarithmic scale.
    assert ("scale = 25  #" in said) == (scale == 2.5e-2)
    assert weight_scale(moves, position, np.full(101, -usual), step) is None


def test_of_two_faults_in_a_flight_the_slower_recovery_counts():
    n, T = 1000, 1e-4
    for slow, quick in ((slice(120, 180), slice(510, 515)), (slice(510, 570), slice(120, 125))):
        error = np.zeros(n)
        error[slow] = error[quick] = 100.0
        flight = SimpleNamespace(
            _errors=lambda _run, error=error: {"x": error}, _off=lambda _record: np.zeros(n),
            _stopped=lambda _record: np.zeros(n, dtype=bool), in_loop=True, precision="float64",
            seed=0, machine=SimpleNamespace(sampling_time=T),
        )  # fmt: skip
        run = SimpleNamespace(record=range(n), estimate=None)
        band = fault_run.Band({"x": 1.0}, {"x": 1.0}, 1.0)
        windows = [slice(100, 110), slice(500, 510)]
        outcome = fault_run.Flight.evaluate(
            flight, run, windows, band, fault="two", estimator="none"
        )
        after = windows[0] if slow.start < 500 else windows[1]
        assert outcome.recovery == slow.stop - after.stop


@pytest.mark.parametrize(("low", "high"), [(-1.0, 0.3), (-0.3, 1.0), (-1.0, 1.0), (-0.5, 0.51)])
def test_nodes_of_a_force_divide_its_longer_side(low, high):
    nodes = _nodes(low, high, 8)
    step = max(-low, high) / 8
    np.testing.assert_allclose(np.diff(nodes), step)
    assert np.abs(nodes).min() == 0
    assert low - step < nodes[0] <= low
    assert high <= nodes[-1] < high + step


@pytest.mark.parametrize("name", BEARINGS)
def test_typical_sizes_are_what_they_are_reported_to_be(name):
    """Force at twice the bias current; half of it brings the rotor to the stop at that velocity."""
    axis = Machine.preset(name)
    typical, magnet = Typical.of(axis), axis.magnet
    assert (typical.displacement, typical.current) == (axis.clearance, magnet.bias_current)
    pull = magnet.magnet_constant * (2 * magnet.bias_current / magnet.air_gap) ** 2
    assert typical.force == pytest.approx(pull)
    work = 0.5 * typical.force * typical.displacement
    assert 0.5 * axis.rotor.mass * typical.velocity**2 == pytest.approx(work)


def test_points_of_a_grid_lie_in_the_middle_of_blocks():
    current, displacement = np.linspace(-2, 2, BLOCKS), np.linspace(-1e-3, 1e-3, BLOCKS)
    iu, x = (values.ravel() for values in np.meshgrid(current, displacement))
    box = ((-2.0, 2.0), (-1e-3, 1e-3))
    for off in (-0.4, 0.0, 0.4):  # of a block
        points = SimpleNamespace(
            current=iu + off * np.diff(current)[0], displacement=x - off * np.diff(displacement)[0]
        )
        np.testing.assert_array_equal(blocks_of(points, box)[0], np.arange(BLOCKS**2))


def test_a_rotor_is_held_within_the_narrowest_of_its_stops():
    narrow = machine(bearing=[bearing("A", 0.2), bearing("B", -0.3, clearance=0.2e-3)])
    OperatingPoint.of_machine(narrow, x=0.02e-3)
    with pytest.raises(AmbkitError, match=r"up to its stops at 0\.0002 m, not at 0\.00025 m"):
        OperatingPoint.of_machine(narrow, x=0.25e-3)


def test_noise_of_several_axes_is_scaled_alike():
    """Twice the number is twice the variance of each, whatever its own."""
    noisy = {"noise_variance": 16e-5}
    unlike = machine(bearing=[bearing("A", 0.2), bearing("B", -0.3, amplifier=noisy)])
    build = candidate_of_kind("linear", unlike).build
    once, twice = (
        np.array(build(**{"noise.control": value}).variances.control) for value in (1e-12, 2e-12)
    )
    np.testing.assert_allclose(twice, 2 * once)
    np.testing.assert_allclose(once[2:] / once[:2], 16.0)


def test_runout_of_an_order_acts_at_so_many_times_the_speed():
    """As the sensor shows it: behind its lag; the reading a quarter turn on sees it later."""
    order, amplitude, lag = 3, 2e-6, 5e-5
    lines = [{"order": order, "amplitude": amplitude}]
    one = machine(sensor=[sensor("A", 0.2, runout=lines), sensor("B", -0.3)])
    frequencies = []

    def response(f):
        frequencies.append(f[0])
        return np.eye(4)[None]

    loop = SimpleNamespace(noise_to_position=response, noise_to_control=response)
    (turned,) = of_runout(loop, one)
    f = order * one.speed / (2 * math.pi)
    assert frequencies == pytest.approx([f, f])
    shown = amplitude / (1 + 2j * math.pi * f * lag)
    np.testing.assert_allclose(turned.x, [shown, 1j * shown, 0, 0], atol=1e-20)


def test_of_three_planes_a_grade_is_shared_by_the_outer_two():
    """A rotor that bends has as many planes as modes more."""
    planes = tuple(Unbalance(place=at, amount=1e-6) for at in (-0.05, 0.02, 0.07))
    bends = Machine.preset("ufu_flexible").model_copy(update={"unbalance": planes})
    assert [at.place for at in permitted(bends, 2.5e-3)] == [-0.05, 0.07]


def test_a_processor_s_answers_are_counted_by_their_modes():
    kinds = [("mode", "u1"), ("instructions", "u4"), ("stack", "u4")]
    answers = np.zeros(100, kinds)
    flying = slice(20, 80)
    answers["mode"][flying] = Mode.FLYING
    answers["instructions"] = [0, *range(1001, 1100)]
    answers["stack"] = np.arange(100)
    off, moved = np.zeros((100, 2)), np.zeros((100, 2))
    off[20:26] = 9e-5  # still settling
    off[50] = [3e-6, -4e-6]
    moved[[10, 30, 31], [0, 1, 0]] = [1.0, -1.0, 1.0]  # the first one before it flew
    greeting = np.array(
        (1, 2, 3, 40), [(k, "u4") for k in ("unequal", "wrong_status", "wrong", "state")]
    )[()]
    record = SimpleNamespace(t=1e-3 * np.arange(100))
    found = compare_bits(
        answers, greeting, off=off, moved=moved, travel=np.array([1.0, 1.0]), record=record,
        unequal=0, frames=record, unequal_frames=0, run=record, board="none", built=record,
    )  # fmt: skip
    assert (found.selftest, found.state, found.stack_seen) == (6, 40, 99)
    assert (found.instructions, found.most) == (1050, 1099)
    assert found.worst == 4e-6
    assert found.rms == pytest.approx(math.sqrt((3e-6**2 + 4e-6**2) / (2 * 54)))
    assert found.touched == 2
    assert [round(1e3 * t) for t, _ in found.modes] == [0, 20, 80]
    assert not found.passed
