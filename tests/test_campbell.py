"""The Campbell diagram of a machine."""

import numpy as np
import pytest
from machine_cases import PRESETS, five_axes, machine, uncoupled

from ambkit import AmbkitError, ConstantStiffness, Machine, campbell
from ambkit.control.pid import PID
from ambkit.machine.axes import isolated_axes
from ambkit.result.report import Rule


def test_modes_at_rest_are_those_of_its_axes_alone():
    one = uncoupled()
    found = campbell(one, 100.0, count=3)
    expected = []
    for alone in isolated_axes(one):
        k, pid, m = ConstantStiffness.of(alone), PID.for_bearing(alone), alone.rotor.mass
        expected += [p for p in np.roots([m, k.k_i * pid.kd, k.k_i * pid.kp - k.k_s]) if p.imag > 0]
    np.testing.assert_allclose(np.sort(found.poles[0].imag), np.sort(np.imag(expected)), rtol=1e-9)


def test_a_free_wheel_s_nutation_goes_with_its_inertias():
    """Fast, a tilt forwards turns with I_p/I_t of the speed."""
    rotor = {"mass": 4.0, "transverse_inertia": 0.16, "polar_inertia": 0.15}
    found = campbell(machine(rotor=rotor), 20_000.0)
    fastest = found.poles[-1].imag
    assert fastest[found.forwards].max() == pytest.approx(20_000 * 0.15 / 0.16, rel=0.01)
    assert found.forwards.sum() == 2


@pytest.mark.parametrize("name", PRESETS)
def test_presets_have_as_many_whirls_forwards_as_backwards(name):
    one = Machine.preset(name)
    found = campbell(one, 6000.0)
    pairs = len(one.positions) // 2
    assert found.forwards.tolist().count(True) == pairs
    forwards, backwards = (found.poles[-1].imag[found.forwards == way] for way in (True, False))
    assert forwards.sum() > backwards.sum()
    assert (found.poles.real < 0).all()
    # One that bends is stiffened by gyroscopics: its third mode stays ahead of the rotation. The
    # compressor's third to fifth are far above the speeds that are looked at.
    crossed = {"compressor": 4, "tum_mlps_flexible": 7, "ufu_flexible": 4}
    assert len(found.critical) == crossed.get(name, pairs)
    for speed in found.critical:
        near = np.argmin(np.abs(found.speed - speed))
        assert np.abs(found.poles[near].imag - speed).min() < 60.0


def test_the_axial_motion_is_neither_forward_nor_backward():
    """It was told to go backwards, or forwards by rounding: then it gave a critical speed."""
    with_thrust = five_axes()
    found = campbell(with_thrust, 2000.0, count=21)
    assert found.whirl.count("axial") == 1
    assert found.whirl.count("forward") == found.whirl.count("backward") == 2
    along = found.poles[:, found.axial]
    assert np.ptp(along.imag) < 1e-6 * along.imag.mean()  # the speed does nothing to it
    assert len(found.critical) == 2
    modes = found.to_dict()["modes"].values()
    assert [mode["whirl"] for mode in modes] == found.whirl
    assert [mode["standstill"] for mode in modes] == list(found.poles[0].imag)
    assert [mode["at_maximum_speed"] for mode in modes] == list(found.poles[-1].imag)


def test_it_is_drawn():
    assert campbell(machine(), count=11).figure().image(".png")[:4] == b"\x89PNG"
    turning = Machine.preset("tum_mlps_flexible")
    found = campbell(turning, count=11)
    frequencies = found.figure().panels[0]
    assert {item.value for item in frequencies.items if isinstance(item, Rule)} == {turning.speed}
    assert frequencies.y.limits[1] < 0.5 * found.poles.imag.max()  # high modes hide the others
    with pytest.raises(AmbkitError, match="fastest"):
        campbell(machine(), -1.0)
    with pytest.raises(AmbkitError, match="count"):
        campbell(machine(), count=1)
