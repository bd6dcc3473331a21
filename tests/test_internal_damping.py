"""What damps within a rotor turns with it: poles, sampling, simulation, and files."""

import numpy as np
import pytest
from machine_cases import directions, integrated, machine, slopes
from test_machine_bending import ROSS, ufu

from ambkit import ConfigError, KalmanFilter, Machine, campbell
from ambkit.base.errors import RecordError
from ambkit.control.control import Control
from ambkit.control.stabilising_controller import holding
from ambkit.machine.rotors.matrix_file import read_matrices
from ambkit.machine.rotors.modes import reduced
from ambkit.models.continuous import continuous, open_loop
from ambkit.models.machine_parts import machine_model
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario

FIRST = 2 * np.pi * 100
OUTER, INNER = 0.004, 0.016


def rotor(inner=INNER, outer=OUTER):
    mode = {
        "frequency": 100.0, "damping_ratio": outer, "mass": 1.5,
        "places": [-0.4, -0.3, -0.1, 0.0, 0.2, 0.4], "shape": [0.6, 0.04, -0.5, -0.6, 0.03, 1.0],
    }  # fmt: skip
    if inner is not None:
        mode["internal_damping_ratio"] = inner
    return {
        "type": "modes", "mass": 4.0, "transverse_inertia": 0.16, "polar_inertia": 0.05,
        "mode": [mode],
    }  # fmt: skip


def bent(speed, **keys):
    return machine(rotor=rotor(**keys), speed=speed)


@pytest.mark.parametrize("share", [0.0, 0.9, 1.0, 1.1])
def test_it_drives_the_whirl_beyond_the_critical_speed(share):
    """Of a free mode s^2 + 2 (z + z_i) w s - 2 j z_i w W + w^2 = 0: its edge is in closed form."""
    limit = FIRST * (1 + OUTER / INNER)
    poles = open_loop(bent(share * limit), np.zeros(4)).poles
    turning = 2j * INNER * FIRST * share * limit
    expected = np.roots([1, 2 * (OUTER + INNER) * FIRST, FIRST**2 - turning])
    for pole in expected:
        assert np.abs(poles - pole).min() < 1e-8 * FIRST
    fastest = poles[np.abs(np.abs(poles.imag) - FIRST) < 5].real.max()
    if share == 1:
        assert abs(fastest) < 1e-9 * FIRST
    else:
        assert np.sign(fastest) == np.sign(share - 1)


def test_at_rest_it_damps_as_any_other():
    model = continuous(bent(0.0))
    other = continuous(bent(0.0, inner=None, outer=OUTER + INNER))
    np.testing.assert_allclose(model.A, other.A, rtol=1e-12, atol=0)
    assert np.abs(model.spin).max() > np.abs(other.spin).max()
    assert bent(0.0).bending.damping_ratio == pytest.approx([OUTER + INNER])


def test_a_sample_is_exact_with_the_forces_held():
    one = bent(2000.0).replace(rotor__gravity="none")
    model = machine_model(one)
    size = np.array([state.size for state in model.states])
    X = np.random.default_rng(3).uniform(-1, 1, len(size)) * size
    roles = [state.role for state in model.states]
    X[[role == "disturbance force" for role in roles]] = 0.0
    F, n = np.array([3.0, -1.0, 2.0, 4.0]), len(one.positions)
    C = directions(one, one.readings)
    seen = [k for k, role in enumerate(roles) if role == "sensor"]

    def rates(t, state):
        q, w, y = state[:n], state[n : 2 * n], state[2 * n :]
        return np.r_[w, slopes(one, q, w, F), (C @ q - y) / 5e-5]

    moving = [*range(2 * n), *seen]
    exact = integrated(rates, X[moving], (0, 1e-4), size[moving])
    got = (model.L @ X + model.b @ F)[moving]
    np.testing.assert_allclose(got / size[moving], exact / size[moving], rtol=0, atol=1e-9)


def test_a_flight_shows_the_whirl_grow_that_the_poles_tell():
    """Magnets near the nodes cannot hold it: it whirls forwards, and grows by its pole."""
    one = bent(2.2 * FIRST, outer=1e-4, inner=0.03).replace(
        rotor__gravity="none", unbalance=[{"place": 0.0, "amount": 1e-9}]
    )
    (pole,) = (pole for pole in holding(one).growing if abs(pole.imag - FIRST) < 20)
    flight = Scenario(duration=0.5, noise=False, controller=Control(type="decentralised")).fed(
        "measurement"
    )
    run = simulate_run(one, flight).record
    z = run["q_m1_x"] + 1j * run["q_m1_y"]
    t = run.t
    late = t > 0.25
    along = np.polyfit(t[late], np.log(np.abs(z[late])), 1)[0]
    round_ = np.polyfit(t[late], np.unwrap(np.angle(z[late])), 1)[0]
    assert along == pytest.approx(pole.real, rel=0.05)
    assert round_ == pytest.approx(pole.imag, rel=1e-3)


def test_filters_know_it():
    """The estimate of the bent rotor is honest at a speed at which it counts."""
    one = bent(1.05 * FIRST)
    record = simulate_run(one, Scenario(duration=0.3, seed=2)).record
    knowing = KalmanFilter(one).run(record)
    assert 0.9 < np.mean(knowing.nis[1000:]) < 1.1


def test_it_is_in_the_campbell_diagram():
    found = campbell(bent(0.0), 3 * FIRST)
    near = np.abs(found.poles.imag - FIRST) < 60
    growing = (found.poles.real > 0) & near
    assert not growing[found.speed < FIRST].any()
    assert growing[found.speed > 1.6 * FIRST].any(axis=1).all()


def test_matrices_of_a_file(tmp_path):
    with np.load(ROSS) as file:
        content = dict(file)
    content["D_internal"] = 2e-5 * content["K"]
    np.savez(tmp_path / "r.npz", **content)
    matrices = read_matrices(tmp_path / "r.npz")
    found = reduced(matrices, 4000.0, 0.01)
    ratio = 2e-5 * found.frequency / 2  # proportional to K
    np.testing.assert_allclose(
        np.diag(found.internal) / (2 * found.mass * found.frequency), ratio, rtol=1e-9
    )
    content["D_internal"] = 0.1 * content["M"]
    np.savez(tmp_path / "wrong.npz", **content)
    with pytest.raises(RecordError, match="must leave the rigid body free"):
        read_matrices(tmp_path / "wrong.npz")
    assert reduced(ufu(7650.0), 4000.0, None, (), 0.01).internal.any()


def test_it_comes_back_from_toml_and_is_checked():
    one = bent(0.0)
    assert Machine.from_toml(one.to_toml()) == one
    table = Machine.preset("ufu_flexible").replace(rotor__internal_damping_ratio=0.002)
    assert Machine.from_toml(table.to_toml()).bending.internal.any()
    assert "internal" not in Machine.preset("ufu_flexible").to_toml()
    with pytest.raises(ConfigError, match=r"internal_damping_ratio.*must be less than 1, is 1\.5"):
        bent(0.0, inner=1.5)
