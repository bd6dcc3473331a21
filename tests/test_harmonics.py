"""What is said of unbalance and runout: an amplitude where a record tells it, or a covariance."""

import numpy as np
import pytest
from test_machine_synchronous import BOTH, RUN_UP, SERVICE, spoilt, steady

from ambkit import ExtendedKalmanFilter, Machine, Scenario, harmonics, simulate
from ambkit.rotordynamics.harmonics import Harmonic
from ambkit.simulation.waveforms import Ramp

TRUE = 20 / SERVICE**2


def message(flight, **options):
    dirty, _ = spoilt()
    kf = ExtendedKalmanFilter(dirty, synchronous=BOTH, **options)
    record = simulate(dirty, flight, filter=kf).record
    return {each.name: each for each in harmonics(kf, record)}


def test_at_constant_speed_there_is_a_covariance_and_no_amplitude():
    found = message(Scenario(duration=0.3, seed=1))
    assert set(found) == {"U1", "r1_La", "r1_Lb", "r1_Ra", "r1_Rb"}
    for each in found.values():
        assert each.by_start
        assert each.amplitude is None
        assert each.angle is None
        said = {row.key: row.value for row in each.rows(())}
        assert said["start_dominates"]
        assert "amplitude" not in said
        assert said["cosine_std"] == np.sqrt(each.covariance[0, 0])
    off = complex(found["U1"].cosine, found["U1"].sine) - TRUE * np.exp(0.6j)
    assert abs(off) < 4 * found["U1"].std


@pytest.mark.parametrize("duration", [2.05, 2.0507])  # after whole turns, and at 50 degrees
def test_after_a_run_up_there_is_an_amplitude_with_its_angle(duration):
    dirty, _ = spoilt()
    found = message(Scenario(duration=duration, seed=1, speed=RUN_UP), noise=steady(dirty))
    one = found["U1"]
    assert abs(one.amplitude[0] - TRUE) < 4 * one.amplitude[1] < 0.1 * TRUE
    assert abs(one.angle[0] - 0.6) < 4 * one.angle[1] < 0.1
    assert not any(each.by_start for each in found.values())


def test_the_errors_of_amplitude_and_angle_are_those_of_the_vector():
    std = np.array([0.1, 0.2])
    one = Harmonic("U1", "unbalance", "kg m", 3.0, 0.0, np.diag(std**2), 10.0, 0.0)
    assert one.amplitude == pytest.approx((3.0, 0.1))
    assert one.angle == pytest.approx((0.0, 0.2 / 3))
    assert (
        Harmonic("U1", "unbalance", "kg m", 0.3, 0.0, np.diag(std**2), 10.0, 0.0).amplitude is None
    )
    assert Harmonic("U1", "unbalance", "kg m", 3.0, 0.0, np.diag(std**2), 0.3, 0.9).by_start


def test_the_commands_say_so(call, tmp_path):
    dirty, _ = spoilt()
    (tmp_path / "m.toml").write_text(dirty.to_toml())
    both = ("--filter", "linear+unbalance+runout")
    for words in (
        ("simulate", "m.toml", "--out", "r.csv"),
        ("filter", "r.csv", "--machine", "m.toml"),
    ):
        run = ("--duration", "0.1 s") if words[0] == "simulate" else ()
        data = call(*words, *run, *both, "--json").json
        data = next(iter(data.get("estimators", {"linear": data}).values()))
        assert data["synchronous"]["U1"]["start_dominates"]
        assert "amplitude" not in data["synchronous"]["U1"]
        assert "the machine file carries more" in " ".join(call(*words, *run, *both).out.split())


def test_without_such_states_there_is_nothing_to_say():
    machine = Machine.preset("tum_mlps")
    kf = ExtendedKalmanFilter(machine)
    flight = Scenario(duration=0.02, speed=Ramp(slope=100.0))
    assert harmonics(kf, simulate(machine, flight, filter=kf).record) == []
