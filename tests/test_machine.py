"""The machine as a description: what it holds, what cannot be, and its poles."""

import math

import numpy as np
import pytest
from machine_cases import PRESETS, bearing, five_axes, machine, sensor, uncoupled

from ambkit import ConfigError, ConstantStiffness, Machine
from ambkit.judge.whirl_modes import stiffnesses
from ambkit.machine import geometry, presets
from ambkit.machine.loading import load_machine
from ambkit.models.continuous import open_loop
from ambkit.workflow.check import inspect

RPM = math.pi / 30

# ---- presets, held to figures that were computed independently ----


@pytest.mark.parametrize(("name", "speed", "poles"), [
    ("tum_mlps", 0.0, [342.308, 342.308, 446.106, 446.106]),
    ("tum_mlps", 30_000 * RPM,
     [342.318 - 0.025j, 342.318 + 0.025j, 443.757 - 45.596j, 443.757 + 45.596j]),
    ("hindawi_2011", 0.0, [325.105, 325.105, 453.088, 453.088]),
    ("ufu_rig", 0.0, [204.525, 204.525, 248.576, 248.576]),
    ("heart_pump", 0.0, [401.9052, 401.9052, 485.2912, 485.2912]),
    # Gyroscopics turn its tilt round before it has fallen far.
    ("heart_pump", 10_000 * RPM, [391.4457 - 286.8411j, 391.4457 + 286.8411j, 401.9052, 401.9052]),
])  # fmt: skip
def test_open_loop_poles(name, speed, poles):
    preset = Machine.preset(name)
    found = open_loop(preset, [k.k_s for k in stiffnesses(preset)], speed).unstable
    np.testing.assert_allclose(found, poles, rtol=0, atol=1.5e-3)


def test_stiffnesses_of_the_presets():
    given = {"tum_mlps": (59.855034, 191_843.057), "hindawi_2011": (38.0, 144_000.0),
             "ufu_rig": (55.7335, 129_013.0)}  # fmt: skip
    for name, (k_i, k_s) in given.items():
        for found in stiffnesses(Machine.preset(name)):
            assert found.k_i == pytest.approx(k_i, rel=1e-6)
            assert found.k_s == pytest.approx(k_s, rel=3e-6)


def test_a_bearing_alone_has_the_effective_mass_never_the_whole():
    tum = Machine.preset("tum_mlps")
    masses = [tum.isolated_axis(axis.name).rotor.mass for axis in tum.axes]
    np.testing.assert_allclose(masses, [1.234, 1.234, 1.193, 1.193], atol=5e-4)
    alone = [tum.isolated_axis(name) for name in ("A1", "B1")]
    poles = [math.sqrt(ConstantStiffness.of(b).k_s / b.rotor.mass) for b in alone]
    np.testing.assert_allclose(poles, [394, 401], atol=0.5)
    assert tum.coupling == pytest.approx(0.26, abs=0.005)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_come_back_from_their_toml(name):
    preset = Machine.preset(name)
    assert Machine.from_toml(preset.to_toml()) == preset
    assert preset.source
    assert preset.name == name


def test_check_says_what_axes_would_be_alone(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(presets.text("tum_mlps").replace("3000 rpm", "0 rpm"))
    found = inspect(path)
    assert (found.kind, found.ok) == ("machine", True)
    (remark,) = found.remarks
    for told in ("342.308", "446.106", "1.234 kg", "1.193 kg", "394.3", "400.9", "26 %"):
        assert told in remark


def test_axes_that_do_not_couple_are_bearings_alone(tmp_path):
    one = uncoupled()
    one.save(tmp_path / "machine.toml")
    assert "axes are independent" in inspect(tmp_path / "machine.toml").remarks[0]
    poles = open_loop(one, [k.k_s for k in stiffnesses(one)]).unstable
    alone = [one.isolated_axis(axis.name) for axis in one.axes]
    own = sorted(math.sqrt(ConstantStiffness.of(b).k_s / b.rotor.mass) for b in alone)
    np.testing.assert_allclose(poles, own, rtol=1e-9)


# ---- geometry ----


def test_a_point_moves_by_its_arm():
    at = geometry.Line.across(0.3, math.pi / 6)
    c, s = math.cos(math.pi / 6), 0.5
    assert at.form == pytest.approx({"x": c, "y": s, "th_y": 0.3 * c, "th_x": -0.3 * s})
    assert geometry.Line.across(0.3, math.pi).form == {"x": -1.0, "th_y": -0.3}
    assert geometry.Line.across(0.3, math.pi / 2).form == {"y": 1.0, "th_x": -0.3}


def test_the_axes_carry_the_weight():
    one = machine(bearing=[bearing("A", 0.2, angle=0.4), bearing("B", -0.3, angle=1.0)])
    forces = geometry.supporting_forces(one.rotor, one.axes, 9.81)
    H = geometry.matrix([axis.line for axis in one.axes], one.positions)
    np.testing.assert_allclose(H.T @ forces, [4 * 9.81, 0, 0, 0], atol=1e-12)


def test_a_grade_is_shared_by_the_planes():
    """ISO 21940-11: U_per = m G / speed, and each plane by the other's distance."""
    planes = [{"place": 0.1, "grade": 2.5e-3}, {"place": -0.3, "grade": 2.5e-3}]
    one = machine(unbalance=planes)
    whole = 4.0 * 2.5e-3 / 500.0
    assert [each[1] for each in one.unbalances()] == pytest.approx([0.75 * whole, 0.25 * whole])
    assert machine(unbalance=planes[:1]).unbalances()[0][1] == pytest.approx(whole)


def test_five_axes():
    one = five_axes().replace(rotor__gravity="-z")
    assert one.positions == ("x", "y", "th_x", "th_y", "z")
    assert [axis.name for axis in one.axes] == ["A1", "A2", "B1", "B2", "T"]
    poles = open_loop(one, [k.k_s for k in stiffnesses(one)], 0.0).unstable
    k_s = ConstantStiffness.of(one.isolated_axis("T")).k_s
    assert min(abs(poles - math.sqrt(k_s / 4.0))) < 1e-6


# ---- what cannot be ----


@pytest.mark.parametrize(("old", "new", "problems"), [
    ('polar_inertia = "0.003642621 kg m^2"', 'polar_inertia = "0.3 kg m^2"',
     ["15: rotor.polar_inertia: must be at most 0.250841 kg m^2, twice transverse_inertia"]),
    ('transverse_inertia = "0.125420374 kg m^2"', 'transverse_inertia = "0.5 kg m^2"',
     ["14: rotor.transverse_inertia: must be at most 0.404"]),
    ('first_end = "-364.602551 mm"', 'first_end = "-0.25 m"',
     ["bearing[0].place: -0.251603 m is beyond the rotor", "sensor[0].place"]),
    ('name = "La"', 'name = "La"\nrunout = "3 um"',
     ["61: sensor[0].runout: must be a list of tables, each written in double brackets"]),
    ('current_limit = "2.5 A"', 'current_limit = "0.1 A"',
     ["36: bearing[0].amplifier.current_limit: must be at least 0.192188 A, which carries"]),
    ('current_limit = "2.5 A"', 'current_limit = "3 A"',
     ["bearing[0].amplifier.current_limit: must be at most magnet.bias_current, 2.5 A"]),
    ('clearance = "0.35 mm"', 'clearance = "0.9 mm"',
     ["bearing[0].clearance: must be less than magnet.air_gap"]),
    ('place = "258.397449 mm"', 'place = "-251.602551 mm"',
     ["bearing[0]: no bearing holds the rotor's th_"]),
    ('name = "B"', 'name = "A"', ['bearing[1].name: there is another bearing "A"']),
    ('amount = "10 g mm"', 'grade = "2.5 mm/s"\namount = "1 g mm"', ["unbalance[0].grade"]),
    ('speed = "3000 rpm"', 'speed = "400000 rpm"', ["10: speed: must be less than half"]),
    ('gravity = "-x"', 'gravity = "-z"', ['rotor.gravity: must not be "-z"']),
])  # fmt: skip
def test_what_cannot_be_is_reported_with_its_line(old, new, problems):
    text = presets.text("tum_mlps")
    assert old in text
    with pytest.raises(ConfigError) as found:
        Machine.from_toml(text.replace(old, new), "m.toml")
    for problem in problems:
        assert problem in str(found.value)


def test_a_sensor_that_sees_no_tilt_is_reported():
    with pytest.raises(ConfigError, match="no sensor sees the rotor's th_"):
        machine(sensor=[sensor("A", 0.2)])
    with pytest.raises(ConfigError, match="no thrust bearing"):
        machine(sensor=[sensor("A", 0.2), sensor("B", -0.3), sensor("T", 0, type="axial")])


def test_a_sensor_without_a_gain_is_reported_of_the_gain_alone():
    axial = {"name": "T", "type": "axial", "lag": 5e-5, "noise_variance": 1e-13}
    with pytest.raises(ConfigError, match=r"sensor.2..gain: missing") as found:
        machine(sensor=[sensor("A", 0.2), sensor("B", -0.3), axial])
    assert "angle" not in str(found.value)


def test_a_machine_with_one_axis_is_written_short_and_read_either_way(tmp_path):
    axis = Machine.preset("zittau_axial")
    assert Machine(**axis.model_dump(exclude_none=True)) == axis
    long = axis.to_toml()
    for table in ("magnet", "amplifier"):
        long = long.replace(f"[{table}]", f"[bearing.{table}]")
    long = (
        long.replace("[sensor]", '[[sensor]]\ntype = "single"')
        .replace(
            "[bearing.magnet]", '[[bearing]]\ntype = "single"\nclearance = "1 mm"\n[bearing.magnet]'
        )
        .replace("[rotor]", '[rotor]\ntype = "mass"')
        .replace('\nclearance = "1 mm"\n\n', "\n\n")
    )
    for name, text in (("short", axis.to_toml()), ("long", long)):
        path = tmp_path / f"{name}.toml"
        path.write_text(text, encoding="utf-8")
        assert load_machine(path) == axis
    assert load_machine("tum_mlps") == Machine.preset("tum_mlps")


def test_a_part_of_an_axis_is_found_where_there_is_one():
    axis = Machine.preset("zittau_axial")
    assert axis.magnet is axis.magnet
    with pytest.raises(AttributeError, match=r'has several axes: use machine\["A1"\]'):
        _ = Machine.preset("tum_mlps").amplifier
    with pytest.raises(AttributeError, match=r'has several axes: use machine\["A1"\]'):
        Machine.preset("tum_mlps").plot()
