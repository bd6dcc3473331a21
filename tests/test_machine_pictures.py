"""Modes, unbalance response and run-ups of machines, as pictures and as figures."""

import numpy as np
import pytest
from machine_cases import machine

import ambkit
from ambkit import AmbkitError, Machine, Scenario
from ambkit.simulation.run import simulate_run
from ambkit.simulation.waveforms import Ramp

UNBALANCE = [{"place": 0.1, "amount": 5e-6, "angle": 0.4}]


def test_the_unbalance_response_is_that_of_a_flight():
    """At a speed above the rigid criticals, to what sensor lag and sampling change."""
    one = machine(speed=900.0, unbalance=UNBALANCE)
    found = ambkit.unbalance_response(one, 1800.0, count=180)
    at = int(np.argmin(np.abs(found.speed - 900.0)))
    flight = Scenario(duration=0.8, noise=False, controller={"feedback": "measurement"})
    record = simulate_run(one, flight).record
    late = record.t >= record.t[-1] - 50 * 2 * np.pi / 900.0
    for k, axis in enumerate(one.axes):
        turning = record[f"s_{axis.name}"][late] * np.exp(-900j * record.t[late])
        assert found.amplitude[at, k] == pytest.approx(
            2 * abs(turning.mean()), abs=0.15 * found.amplitude[at].max()
        )
    assert found.to_dict()["amplitude"].keys() == {"A1", "A2", "B1", "B2"}


def test_far_above_the_criticals_a_rotor_turns_about_its_axis_of_inertia():
    one = machine(unbalance=[{"place": 0.0, "amount": 8e-6}], rotor={
        "mass": 4.0, "transverse_inertia": 0.16, "polar_inertia": 1e-6,
    })  # fmt: skip
    found = ambkit.unbalance_response(one, 1e5, count=50)
    np.testing.assert_allclose(found.amplitude[-1], 2e-6, rtol=0.01)


def test_far_above_the_criticals_a_couple_of_unbalance_is_opposed_by_the_forward_whirl():
    """By I_t - I_p: it would be their sum if the unbalance turned against the rotor."""
    rotor = {"mass": 4.0, "transverse_inertia": 0.16, "polar_inertia": 0.08}
    one = machine(unbalance=[{"place": 0.1, "amount": 8e-6}], rotor=rotor)
    found = ambkit.unbalance_response(one, 1e5, count=50)
    places = np.array([axis.line.place for axis in one.axes])
    expected = abs(8e-6 * (1 / 4.0 + places * 0.1 / (0.16 - 0.08)))
    np.testing.assert_allclose(found.amplitude[-1], expected, rtol=0.01)


def test_the_limit_that_is_drawn_is_the_nearest_stop():
    one = machine(unbalance=[{"place": 0.1, "amount": 2e-3}])
    narrow = one.replace(
        bearing=(one.bearings[0].model_copy(update={"clearance": 2e-4}), *one.bearings[1:])
    )
    (picture,) = ambkit.unbalance_response(narrow).figures()
    limits = [item for item in picture.panels[0].items if item.signal == "limit"]
    assert [set(item.y) for item in limits] == [{2e-4}]


def test_a_run_up_stands_on_the_speed_of_rotation():
    one = machine(unbalance=[{"place": 0.1, "amount": 5e-5}])
    flight = Scenario(duration=1.0, noise=False, speed=Ramp(slope=1000.0))
    found = ambkit.waterfall(simulate_run(one, flight).record, "s_A1", window=0.1)
    highest = found.frequency[found.amplitude.argmax(axis=1)]
    later = found.speed > 300.0
    assert np.abs(highest - found.speed / (2 * np.pi))[later].max() < 12.0
    assert found.unit == "m"


def test_a_steady_sine_is_as_high_as_it_is():
    t = np.arange(4000) * 1e-3
    record = ambkit.Record(
        t, {"s_A1": 3e-6 * np.sin(2 * np.pi * 50 * t), "speed": 0 * t + 300.0},
        {"s_A1": "m", "speed": "rad/s"},
    )  # fmt: skip
    found = ambkit.waterfall(record, "s_A1", window=0.2)
    np.testing.assert_allclose(found.amplitude.max(axis=1), 3e-6, rtol=1e-3)
    with pytest.raises(ValueError, match="window must be"):
        ambkit.waterfall(record, "s_A1", window=10.0)


def test_without_unbalance_there_is_no_response():
    with pytest.raises(AmbkitError, match=r"no \[\[unbalance\]\]"):
        ambkit.unbalance_response(machine())
    with pytest.raises(AmbkitError, match="fastest"):
        ambkit.unbalance_response(machine(unbalance=UNBALANCE), -1.0)


def test_each_is_drawn(call, tmp_path):
    for words in ("--fastest 9000rpm tum_mlps", "modes ufu_flexible", "unbalance ufu_flexible"):
        picture = tmp_path / f"{words.split()[0]}.png"
        told = call("rotor", *words.split(), "--plot", picture)
        assert told.code == 0, told.err
        assert all(len(line) <= 80 for line in told.out.splitlines() if line.startswith(" "))
        assert picture.read_bytes()[:4] == b"\x89PNG"
    picture = tmp_path / "waterfall.png"
    words = ["tum_mlps", "--duration", "0.2 s", "--filter", "none", "--out", "run.csv"]
    assert call("simulate", *words).code == 0
    assert call("rotor", "waterfall", "run.csv", "--plot", picture).code == 0
    assert picture.exists()
    assert np.size(ambkit.campbell(Machine.preset("tum_mlps"), count=11).plot(static=True)) == 2


def test_a_notebook_shows_a_run_and_what_has_a_figure():
    run = simulate_run(machine(), Scenario(duration=0.02))
    for shown, said in (
        (run, "Simulated run"),
        (ambkit.campbell(Machine.preset("tum_mlps")), "rpm"),
    ):
        html = shown._repr_html_()
        assert "<img" in html
        assert said in html
