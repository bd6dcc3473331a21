"""Modes left out: the kept set against the full matrices over the speed, and how many are kept."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambkit import Machine, campbell
from ambkit.machine.rotors.described import ShaftRotor
from ambkit.machine.rotors.whirl import end_of_range, whirl, whirl_error
from ambkit.workflow.assessing import assess
from ambkit.workflow.assessment import Assessment
from ambkit.workflow.campbell import CriticalSpeed
from ambkit.workflow.inspection import inspect
from ambkit.workflow.reduction import Reduction, reduction
from ambkit.workflow.separation import Separation, separations
from ambkit.workflow.verdict import verdict, write_verdict

RPM = math.pi / 30


def overhung(**rotor: Any) -> Machine:
    """A direct-drive compressor, 3 kg, that turns at 50,000 rpm near its first bending mode."""
    sections = [(40, 24), (60, 34), (110, 26), (60, 34), (30, 24), (40, 20)]
    magnet = {"type": "two-sided", "turns": 100, "pole_area": 350e-6, "pole_angle": math.radians(
        22.5), "air_gap": 0.4e-3, "bias_current": 2.0}  # fmt: skip
    amplifier = {"gain": 1.0, "current_limit": 2.0, "noise_variance": 1e-6, "bandwidth": 2500.0}
    sensor = {"angle": math.pi / 4, "gain": 1.0, "lag": 15e-6, "noise_variance": 0.04e-12}
    return Machine(
        name="overhung", sampling_time=50e-6, delay=60e-6, speed=50_000 * RPM,
        rotor={
            "type": "shaft", "damping_ratio": 0.002,
            "section": [{"length": a * 1e-3, "outer_diameter": b * 1e-3} for a, b in sections],
            "disc": [
                {"place": 0.325, "mass": 0.9, "transverse_inertia": 6e-4, "polar_inertia": 9e-4},
                {"place": 0.015, "mass": 0.45, "transverse_inertia": 2.2e-4,
                 "polar_inertia": 4e-4},
            ],
        } | rotor,
        bearing=[
            {"name": name, "place": place, "angle": math.pi / 4, "travel_limit": 0.15e-3,
             "magnet": magnet, "amplifier": amplifier}
            for name, place in (("A", 0.07), ("B", 0.24))
        ],
        sensor=[sensor | {"name": "A", "place": 0.105}, sensor | {"name": "B", "place": 0.275}],
    )  # fmt: skip


def rotor_of(machine: Machine) -> ShaftRotor:
    assert isinstance(machine.rotor, ShaftRotor)
    return machine.rotor


@pytest.fixture(scope="module")
def one_mode() -> Machine:
    return overhung(modes_up_to=1500.0)


@pytest.fixture(scope="module")
def chosen() -> Machine:
    return overhung()


@pytest.fixture(scope="module")
def assessment(one_mode: Machine) -> Assessment:
    return assess(one_mode)


def compared(machine: Machine) -> Reduction:
    found = reduction(machine)
    assert found is not None
    return found


def naive(machine: Machine) -> Any:
    """Whirl frequencies of the finite elements themselves [rad/s]: no modes, no symmetry used."""
    matrices, speed = rotor_of(machine).matrices, machine.speed
    size = np.ones(len(matrices.M))
    size[1::2] = 10.0  # turns in tenths of a metre
    M, K, G = (each * np.outer(size, size) for each in (matrices.M, matrices.K, matrices.G))
    n = len(M)
    A = np.block([
        [np.zeros((n, n)), np.eye(n)],
        [-np.linalg.solve(M, K), 1j * speed * np.linalg.solve(M, G)],
    ])  # fmt: skip
    return np.sort(np.linalg.eigvals(A).imag)


def test_the_full_whirl_is_that_of_the_finite_elements(chosen: Machine) -> None:
    rotor = rotor_of(chosen)
    expected, found = naive(chosen), whirl(rotor, rotor.every_mode, chosen.speed)
    near = [
        each[(abs(each) > 100.0) & (abs(each) < 2 * math.pi * 5e3)] for each in (expected, found)
    ]
    np.testing.assert_allclose(near[1], near[0], rtol=1e-6)
    assert len(near[0]) >= 9


def test_one_mode_is_too_few_and_that_is_said(one_mode: Machine) -> None:
    """At 50,000 rpm the forward whirl is 822 Hz with it and 795 Hz in the full rotor."""
    rotor, bending = rotor_of(one_mode), one_mode.bending
    assert bending is not None
    there = whirl_error(rotor, bending, 1000.0, [one_mode.speed])
    assert there.kept / (2 * math.pi) == pytest.approx(822.2, abs=0.1)
    assert there.full / (2 * math.pi) == pytest.approx(794.7, abs=0.1)
    found = compared(one_mode)
    assert found.kept == 1
    assert not found.good
    assert found.whirl.share > 0.03
    assert found.whirl.left_out < 0  # the second mode whirls backwards into the range
    assert found.critical_error > 0.03
    assert found.grows is not None  # its default loop does not hold the full rotor
    assert found.grows.real > 0
    assert "leave out rotor.modes_up_to" in found.text()


def test_modes_are_chosen_for_the_speed(chosen: Machine) -> None:
    found, rotor = compared(chosen), rotor_of(chosen)
    assert found.kept == 4
    assert 0 < found.whirl.error < 0.01
    assert found.critical_error < 0.01
    # Its default controllers are a regulator, fed by the estimate: the fifth mode moves their peak.
    assert found.peak is not None
    assert 0.01 < found.peak.share < 0.06
    assert "give rotor.modes_up_to = " in found.text()
    top = end_of_range(chosen.sampling_time, chosen.speed)
    three = whirl_error(rotor, rotor.every_mode, top, [found.fastest], 3)
    assert three.error > 0.01  # so that none is kept for nothing
    slow = overhung().replace(speed=0.0)
    assert slow.positions == chosen.positions  # what was chosen stays
    again = Machine.from_toml(chosen.to_toml())
    assert rotor_of(again).modes_up_to == rotor.modes_up_to
    assert chosen.model_copy(update={"speed": 0.0}).positions == chosen.positions


def test_a_tolerance_is_a_key(chosen: Machine) -> None:
    rough, fine = overhung(modes_within=0.05), overhung(modes_within=1e-3)
    kept = [compared(each).kept for each in (rough, chosen, fine)]
    assert kept == sorted(kept)
    assert kept[0] < kept[-1]
    assert "modes_within = 0.05" in rough.to_toml()


@pytest.mark.parametrize("name", ["compressor", "tum_mlps_flexible", "ufu_flexible"])
def test_presets_keep_enough(name: str) -> None:
    """The compressor had two modes: its default controllers shook the fifth of the full rotor."""
    found = compared(Machine.preset(name))
    assert found.good, found.text()
    assert found.peak is not None
    assert found.peak.share > 0


def test_check_and_rotor_print_the_comparison(call: Any, one_mode: Machine, tmp_path: Path) -> None:
    path = tmp_path / "overhung.toml"
    one_mode.save(path)
    remarks = " ".join(inspect(path).remarks)
    assert "1 of 128 bending modes kept, against all" in remarks
    assert "raise it to 5300 Hz" in remarks
    assert "too near to 49" in remarks
    found = call("rotor", str(path))
    assert found.code == 0, found.err
    assert "not within 1 %" in found.out
    assert "too near to 49" in found.out
    data = call("rotor", str(path), "--json").json
    assert data["modes_left_out"]["within"] is False
    assert data["separation"][-1]["kept"] is False


def test_separation_margins() -> None:
    """API 617: none where the amplification is below 2.5, 16 % and 26 % where it is infinite."""
    near = Separation(CriticalSpeed(990.0, 0.0), 1000.0)
    assert (near.margin, near.needed, near.kept) == (pytest.approx(0.01), 0.16, False)
    above = Separation(CriticalSpeed(1280.0, 1e-9), 1000.0)
    assert above.needed == pytest.approx(0.26)
    assert above.kept
    assert Separation(CriticalSpeed(1000.0, 0.21), 1000.0).kept
    assert Separation(CriticalSpeed(900.0, 0.1), 1000.0).needed == pytest.approx(
        0.17 * (1 - 1 / 3.5)
    )
    assert separations(overhung().replace(speed=0.0)) == []


def test_no_limit_is_kept_at_a_critical_speed(
    one_mode: Machine, assessment: Assessment, tmp_path: Path
) -> None:
    """At 50,000 rpm, a hundredth above a critical speed: it was told to keep all limits."""
    (at,) = [each for each in assessment.separations if not each.kept]
    assert at.critical.speed == pytest.approx(campbell(one_mode).critical[-1], rel=1e-9)
    assert at.margin < 0.015
    name = list(assessment.loops)[-1]
    lines = [each for each in verdict(assessment, name) if "critical speed" in each.what]
    assert [each.good for each in lines].count(False) == 1
    write_verdict(assessment, tmp_path / "v.html")
    page = (tmp_path / "v.html").read_text(encoding="utf-8")
    assert "Not kept: " in page
    assert "All that has a limit keeps it" not in page
    assert assessment.to_dict()["critical_speeds"][-1]["kept"] is False
