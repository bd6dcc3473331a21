"""Loops along the orbit of an unbalance: against the simulation, whose magnets are not linear."""

import math

import numpy as np
import pytest
from quick import quick

import ambkit
from ambkit import Machine
from ambkit.assessment.assess import MEASUREMENT, on_orbit
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.linear_plant import OperatingPoint, Orbit, plant
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.machine.magnets import magnet_of
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario

TUM = Machine.preset("tum_mlps").replace(speed="6000 rpm")
GAP = TUM.bearings[0].magnet.air_gap
ZITTAU = Machine.preset("zittau_axial").replace(speed="1500 rpm")


@pytest.mark.parametrize(("filter", "share"), quick([(None, 0.2), ("linear", 0.2)], [(None, 0.2)]))
def test_along_an_orbit_model_and_simulation_agree_within_two_percent(filter, share):
    """A fifth of the gap: what the rotor at rest would have is a sixth off."""
    found = ambkit.assess_sweep(TUM, filter, amplitudes=["1 um"], axis="A1", orbit=share * GAP)
    (swept,) = found.swept
    assert np.abs(found.loop.of.point.orbit.x).max() == pytest.approx(share * GAP, rel=1e-4)
    assert not swept.limited
    assert swept.deviation < 0.02
    rest = ambkit.assess(TUM, filter).loops[found.loop.name].loop.of_axis(0, swept.frequency)
    assert np.max(np.abs(swept.sensitivity - rest) / np.abs(rest)) > 0.15


def test_of_one_axis_a_load_makes_the_orbit():
    far = 0.08 * ZITTAU.magnet.air_gap
    (swept,) = ambkit.assess_sweep(ZITTAU, "linear", amplitudes=["2 um"], orbit=far).swept
    assert swept.deviation < 0.02
    rest = ambkit.assess(ZITTAU, "linear").loops["linear"].loop.of_axis(0, swept.frequency)
    assert np.max(np.abs(swept.sensitivity - rest) / np.abs(rest)) > 0.03


def test_the_orbit_is_the_simulations():
    """By harmonic balance: nearer to it than the linear answer to the same unbalance."""
    of = on_orbit(LoopBuilder(TUM), None, 0.2 * GAP)
    run = simulate_run(
        of.machine, Scenario(duration=1.0, noise=False, controller={"feedback": "measurement"})
    ).record
    turn = 2 * math.pi / TUM.speed / TUM.sampling_time
    late = slice(-round(20 * turn), None)
    turned = np.exp(-1j * TUM.speed * run.t[late])
    for k, name in enumerate(of.axes):
        seen = abs(2 * np.mean(run[f"s_{name}"][late] * turned))
        flows = abs(2 * np.mean(run[f"iu_{name}"][late] * turned))
        assert abs(of.point.orbit.x[k]) == pytest.approx(seen, rel=0.01)
        assert abs(of.point.orbit.iu[k]) == pytest.approx(flows, rel=0.01)
        held = np.mean(run[f"iu_{name}"][late])
        assert of.point.iu[k] == pytest.approx(held, rel=0.02, abs=2e-3)


def test_stiffnesses_are_means_over_a_turn():
    law, iu, x = magnet_of(ZITTAU), 0.1, 2e-4
    swing = Orbit(np.array([0.2 + 0.1j]), np.array([3e-4 - 1e-4j]), None)
    angles = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    k_i, k_s = (
        np.mean(k) for k in law.tangent(
            iu + np.real(swing.iu[0] * np.exp(1j * angles)),
            x + np.real(swing.x[0] * np.exp(1j * angles)),
        )
    )  # fmt: skip
    m = ZITTAU.rotor.mass
    found = plant(ZITTAU, OperatingPoint(iu, x, swing))
    fastest = np.log(np.abs(found.unstable()).max()) / found.T
    assert fastest == pytest.approx(math.sqrt(k_s / m), rel=1e-6)
    at_rest = plant(ZITTAU, OperatingPoint(iu, x))
    ratio = found.response([200.0])[0, 0, 0] / at_rest.response([200.0])[0, 0, 0]
    w2 = (2 * math.pi * 200.0) ** 2
    rest = [float(k) for k in law.tangent(iu, x)]
    assert ratio.real == pytest.approx(
        k_i / rest[0] * (w2 + rest[1] / m) / (w2 + k_s / m), rel=1e-3
    )


def test_what_is_reported_of_an_orbit():
    found = ambkit.assess(TUM, "linear", orbit=0.1 * GAP)
    loop = found.loops["linear"]
    assert loop.integral.holds
    assert found.to_dict()["loops"]["linear"]["orbit"][0] == pytest.approx(0.1 * GAP, rel=1e-4)
    assert "along the orbit of" in found.facts
    far = max(at.demands.displacement for at in loop.axes.values())
    assert far == pytest.approx(0.1 * GAP, rel=0.05)
    own = ambkit.assess(TUM, "none", orbit="own").loops[MEASUREMENT]
    assert own.peak == pytest.approx(ambkit.assess(TUM, "none").loops[MEASUREMENT].peak, rel=1e-3)
    over = ambkit.assess_speed(TUM, "none", fastest=TUM.speed, count=2, orbit="own")
    assert over.peaks[1] == pytest.approx([at.peak for at in own.axes.values()], rel=1e-5)


@pytest.mark.parametrize(("machine", "orbit", "message"), [
    (TUM.model_copy(update={"speed": 0.0, "unbalance": ()}), "own", "does not rotate"),
    (TUM.model_copy(update={"unbalance": ()}), "own", "no unbalance for an orbit"),
    (ZITTAU, "own", "give its amplitude"),
    (TUM, -1e-6, "greater than 0 m"),
    (TUM, 0.95 * GAP, "where the air gap is"),
])  # fmt: skip
def test_what_has_no_orbit_is_refused(machine, orbit, message):
    with pytest.raises(AmbkitError, match=message):
        ambkit.assess(machine, "none", orbit=orbit)


@pytest.mark.parametrize(("arguments", "code", "message"), [
    (["tum_mlps", "--filter", "none", "--orbit", "30 um", "--json"], 0, '"orbit": ['),
    (["zittau_axial", "--orbit", "own"], 2, "does not rotate: it has no orbit"),
    (["tum_mlps", "--orbit", "far"], 2, "not a number with a unit"),
    (["speed", "tum_mlps", "--orbit", "1 um"], 2, "invalid choice: '1 um' (choose from 'own')"),
])  # fmt: skip
def test_command(arguments, code, message, call):
    told = call("assess", *arguments)
    assert told.code == code
    assert message in told.out + " ".join(told.err.split())
