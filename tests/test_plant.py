"""The continuous plant: its integrator's order, what it conserves, its stops and its sensor.

The plant is reached through the closed loop with a controller of gain zero, whose integrator holds
one current throughout.
"""

import numpy as np
import oracles
import pytest
from one_axis import M, driven
from scipy.integrate import solve_ivp

import ambkit
from ambkit import Machine

BEARING = Machine.preset("zittau_axial")


def released(n, T, *, current=0.0, **changes):
    """Release the rotor at x_start; n samples of T [s] under a constant current and force."""
    usual = {"T_sen": 2e-3, "substeps": 4, "x_start": 1e-4, "integral": current}
    return driven(np.zeros(n), None, T=T, **(usual | changes))


def exact(t, start, current, force, T_sen):
    """The same motion by a solver of order 8 on the naive force law: x, v, x_m as columns."""

    def slope(_, s):
        x, v, x_m = s
        f = oracles.magnet_force(BEARING, current, x) + force
        return [v, f / M, (x - x_m) / T_sen]

    options = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-18}
    return solve_ivp(slope, (0, t[-1]), [start, 0, start], t_eval=t, **options).y.T


def test_with_the_usual_steps_the_error_is_nothing_beside_the_noise():
    T, n = BEARING.sampling_time, 100
    reference = exact(T * np.arange(n), 1e-4, 0.4, -M * 9.81, BEARING.sensor.lag)
    run = released(n, T, f_0=-M * 9.81, current=0.4, T_sen=BEARING.sensor.lag)
    assert not run["touched"]
    for column, name in enumerate(("x", "v", "x_m")):
        error = np.abs(run[name] - reference[:, column]).max()
        assert error < 1e-6 * np.abs(reference[:, column]).max()


def test_the_mirrored_run_is_the_mirror_of_the_run():
    rng = np.random.default_rng(0)
    f_d = rng.uniform(-5, 5, 500)
    there = released(500, 1e-4, current=0.3, f_d=f_d)
    back = released(500, 1e-4, current=-0.3, f_d=-f_d, x_start=-1e-4)
    assert there["touched"] == back["touched"] > 0
    for name in ("x", "v", "x_m", "force", "y", "iu"):
        assert (there[name] == -back[name]).all()


def test_at_a_stop_the_rotor_stays_until_it_is_pulled_off():
    n = 4000
    f_d = np.where(np.arange(n) < 2000, -40.0, 40.0)
    run = released(n, 1e-4, f_d=f_d, x_start=0.0)
    x, v = run["x"], run["v"]
    assert np.abs(x).max() == 1e-3
    hit = int(np.argmax(x == -1e-3))
    assert 0 < hit < 500
    assert (x[hit:2001] == -1e-3).all()
    assert (v[hit:2001] == 0).all()
    # Pulled off by the force, it crosses over and comes to rest at the other stop.
    assert (np.diff(x[2001:]) >= 0).all()
    assert x[-1] == 1e-3
    assert v[-1] == 0
    at_rest = np.count_nonzero((np.abs(x) == 1e-3) & (v == 0))
    assert run["touched"] == pytest.approx(at_rest, abs=3)


def test_a_push_too_weak_for_the_magnets_pull_leaves_the_rotor_at_the_stop():
    pull = oracles.magnet_force(BEARING, 0.0, 1e-3)
    weaker = released(500, 1e-4, x_start=1e-3, f_d=-0.99 * pull)
    assert (weaker["x"] == 1e-3).all()
    stronger = released(500, 1e-4, x_start=1e-3, f_d=-1.01 * pull)
    assert stronger["x"][-1] < 1e-3


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_the_sensor_lags_by_its_time_constant(gain):
    """A rotor that has come to rest at the stop: what is left falls by exp(-T / T_sen) a sample."""
    T, T_sen = 1e-4, 1e-3
    run = released(600, T, x_start=0.0, f_d=200.0, T_sen=T_sen, K_sen=gain)
    rest = int(np.argmax(run["x"] == 1e-3)) + 1
    left = gain * 1e-3 - run["x_m"][rest : rest + 60]
    assert left[0] > 1e-4 * gain
    np.testing.assert_allclose(left[1:] / left[:-1], np.exp(-T / T_sen), rtol=1e-9)
    assert run["x_m"][-1] == pytest.approx(gain * 1e-3, rel=1e-9)


@pytest.mark.parametrize("lag", ["0.1 us", "5 us", "20 us"])
def test_a_sensor_faster_than_the_integrators_step_is_followed(lag):
    """Runge-Kutta diverges from 2.8 time constants a step on: simulate takes more steps then."""
    fast = BEARING.replace(sensor__lag=lag)
    scenario = ambkit.Scenario(
        duration=0.02, noise=False, reference=ambkit.Step(amplitude=1e-4, time=5e-3)
    )
    record = ambkit.simulate(fast, scenario).record
    assert np.abs(record["x_m"]).max() < 3e-4
    delay = fast.sensor.lag * np.abs(record["v"]).max()
    assert np.abs(record["x_m"] - record["x"]).max() < 1.1 * delay + 1e-9
