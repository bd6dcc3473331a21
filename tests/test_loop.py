"""The closed loop: the same as a plain loop in Python, at rest where it should be, repeatable."""

import numpy as np
import oracles
import pytest
from filter_cases import off

import ambkit
from ambkit import ClosedLaw, Machine, Scenario
from ambkit.simulation.recording import UNITS
from ambkit.simulation.run import simulate_run

BEARING = Machine.preset("zittau_axial")
STEP = Scenario(
    duration=0.1,
    seed=3,
    reference=ambkit.Step(amplitude=1e-4, time=0.01),
    disturbance=ambkit.Step(amplitude=-3.0, time=0.05),
    controller=ambkit.PID.textbook(BEARING),
)


def naive_loop(bearing, scenario, record, *, fed_back):
    """Plant, sensor, PID and adaptive filter sample by sample; truth and estimates.

    Of the simulation it uses nothing but the noise, which the record shows: in y, and in the
    current where that does not meet its limit.
    """
    s = oracles.settings_of(bearing)
    T, m = s["T"], s["m"]
    pid = scenario.controller
    control = oracles.Pid(
        T, pid.kp, pid.ki, pid.kd, pid.derivative_filter, pid.anti_windup,
        (s["iu_min"], s["iu_max"]), integral=m * 9.81 / 10.05,  # hovers at x = 0
    )  # fmt: skip
    noise_y = record["y"] - record["x_m"]
    noise_u = record["iu"] / s["k_ui"] - record["u"] if scenario.noise else np.zeros(len(record))

    def magnet(iu, x):
        return oracles.magnet_force(bearing, iu, x)

    start = record["r"][0]
    kf = oracles.Kalman(s, np.array([start, 0, 0, s["K_sen"] * start]),
                        np.array(ambkit.KalmanFilter(bearing).default_std()))  # fmt: skip
    state = np.array([start, 0.0, s["K_sen"] * start])
    u, path, mean = 0.0, [], []
    for k in range(len(record)):
        y = state[2] + noise_y[k]
        if k > 0:
            held = min(max(s["k_ui"] * u, s["iu_min"]), s["iu_max"])
            at = kf.X[0] + kf.X[1] * T / 2
            kf.predict(*oracles.least_squares_stiffness(magnet, held, at, 1e-4, 1e-7), u)
        kf.update(y)
        r = record["r"][k]
        demanded = (
            control.step(r, kf.X[0], kf.X[1])
            if fed_back == "estimate"
            else control.step(r, y / s["K_sen"])
        )
        u = demanded / s["k_ui"]
        iu = min(max(s["k_ui"] * (u + noise_u[k]), s["iu_min"]), s["iu_max"])
        path.append([*state, y, u, iu])
        mean.append(kf.X)

        def slope(z, iu=iu, f_d=record["f_d"][k]):
            force = magnet(iu, z[0]) - m * 9.81 + f_d
            return np.array([z[1], force / m, (s["K_sen"] * z[0] - z[2]) / s["T_sen"]])

        h = T / scenario.substeps
        for _ in range(scenario.substeps):
            k1 = slope(state)
            k2 = slope(state + h / 2 * k1)
            k3 = slope(state + h / 2 * k2)
            k4 = slope(state + h * k3)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(path), np.array(mean)


@pytest.mark.parametrize("fed_back", ["measurement", "estimate"])
@pytest.mark.parametrize(("noise", "amplitude"), [(True, 1e-4), (False, 5e-4)])
def test_the_loop_is_the_plain_loop_in_python(fed_back, noise, amplitude):
    """With noise within the current's limits; and without, where the large step meets them."""
    quiet = {"sensor__noise_variance": "1 um^2"}
    b = BEARING.replace(sensor__gain=0.8, amplifier__gain=1.25, **quiet)
    scenario = STEP.replace(
        controller__feedback=fed_back, noise=noise, reference__amplitude=amplitude
    )
    run = simulate_run(b, scenario, estimator=ambkit.AdaptiveKalmanFilter(b, ClosedLaw(b)))
    assert (np.abs(run.record["iu"]).max() == 1.5) == (not noise)
    path, mean = naive_loop(b, scenario, run.record, fed_back=fed_back)
    assert np.abs(run.record["x"]).max() > 0.5 * amplitude  # it moved, and never met a stop
    assert run.record.meta["stop_touched"] == 0
    for column, name in enumerate(("x", "v", "x_m", "y", "u", "iu")):
        assert off(run.record[name], path[:, column]) < 1e-6
    assert off(run.estimate.mean, mean).max() < 1e-5


# ---- at rest ----


@pytest.mark.parametrize("bearing", ["zittau_axial", "inteco_ml"])
@pytest.mark.parametrize("offset", [0.0, 2e-4])
def test_started_in_hover_the_rotor_stays_put(bearing, offset):
    """Without noise: by less than a nanometre in a second of an unstable plant."""
    b = Machine.preset(bearing)
    scenario = Scenario(
        duration=1.0, noise=False, reference=ambkit.Constant(value=offset),
        controller={"feedback": "measurement"},
    )  # fmt: skip
    record = ambkit.simulate(b, scenario).record
    assert np.abs(record["x"] - offset).max() < 1e-9
    assert np.abs(record["f_mag"] + b.weight).max() < 1e-6 * abs(b.weight)


def test_hover_carries_the_load_that_is_there_from_the_start():
    scenario = Scenario(
        duration=0.1, noise=False, disturbance=ambkit.Constant(value=-3.0),
        controller={"feedback": "measurement"},
    )  # fmt: skip
    record = ambkit.simulate(BEARING, scenario).record
    assert np.abs(record["x"]).max() < 1e-9
    assert record["iu"][0] == pytest.approx((0.518 * 9.81 + 3) / 10.05, rel=1e-12)


def test_in_hover_the_filter_in_the_loop_does_no_harm():
    """A measurement that never moves counts as frozen, and the filter goes on without it."""
    run = simulate_run(BEARING, Scenario(duration=1.0, noise=False))
    assert np.abs(run.record["x"]).max() < 1e-6


def test_started_at_rest_the_rotor_is_lifted_from_its_fall():
    record = ambkit.simulate(BEARING, Scenario(duration=1.0, start="released", noise=False)).record
    assert record["x"][0] == 0
    assert record["x"].min() < -1e-5
    assert abs(record["x"][-1]) < 5e-6


def test_where_no_current_can_hold_it_the_rotor_lies_on_the_stop():
    scenario = Scenario(duration=0.2, disturbance=ambkit.Constant(value=-60.0))
    run = simulate_run(BEARING, scenario)
    assert run.record["x"][-1] == -BEARING.clearance
    assert run.record["iu"][-1000:].mean() > 1.4
    assert run.record.meta["stop_touched"] > 1000
    assert np.isfinite(run.estimate.mean).all()


# ---- noise and repetition ----


def same(a, b):
    return bool((a.estimate.mean == b.estimate.mean).all()) and all(
        (a.record[name] == b.record[name]).all() for name in UNITS
    )


def test_a_seed_gives_one_run_and_another_seed_another():
    one, again, other = (simulate_run(BEARING, STEP.replace(seed=n)) for n in (1, 1, 2))
    assert same(one, again)
    assert not same(one, other)


def test_the_noise_is_the_bearings_and_does_not_depend_on_the_estimator():
    scenario = Scenario(duration=5.0, seed=5, disturbance=ambkit.Sine(amplitude=1, frequency=7))
    linear = ambkit.simulate(BEARING, scenario).record
    adaptive = ambkit.simulate(
        BEARING, scenario, filter=ambkit.AdaptiveKalmanFilter(BEARING, ClosedLaw(BEARING))
    ).record
    on_y = linear["y"] - linear["x_m"]
    on_u = linear["iu"] - linear["u"]
    assert not (linear["x"] == adaptive["x"]).all()
    np.testing.assert_allclose(on_y, adaptive["y"] - adaptive["x_m"], atol=1e-17)
    n = len(linear)
    for noise, variance in ((on_y, 8.3e-11), (on_u, 8e-5)):
        assert noise.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / n))
        assert abs(noise.mean()) < 5 * np.sqrt(variance / n)
        assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 5 / np.sqrt(n)
    assert abs(np.corrcoef(on_y, on_u)[0, 1]) < 5 / np.sqrt(n)


def test_the_record_says_what_the_magnet_does():
    """f_mag is the whole force of the magnet, eq. 1, at the current and the place of the sample."""
    for name in ("zittau_axial", "inteco_ml"):
        b = Machine.preset(name)
        record = ambkit.simulate(b, STEP.replace(controller__feedback="measurement")).record
        law = [
            oracles.magnet_force(b, i, x) for i, x in zip(record["iu"], record["x"], strict=True)
        ]
        np.testing.assert_allclose(record["f_mag"], law, rtol=1e-9, atol=1e-12)


def test_the_plant_can_have_a_magnet_of_its_own():
    """The filter and the weight are the bearing's; the rotor obeys a weaker magnet."""
    weak = ambkit.ConstantStiffness(8.0, 6000.0)
    record = ambkit.simulate(BEARING, STEP.replace(noise=False), plant=weak).record
    np.testing.assert_allclose(
        record["f_mag"], 8.0 * record["iu"] + 6000.0 * record["x"], atol=1e-12
    )


def test_a_filter_in_single_precision_makes_a_loop_in_single_precision():
    """Close to the one in double, and not the same."""
    double = simulate_run(BEARING, STEP, estimator=ambkit.KalmanFilter(BEARING))
    single = simulate_run(
        BEARING, STEP, estimator=ambkit.KalmanFilter(BEARING, precision="float32")
    )
    for name, room in (("x", 2e-8), ("iu", 2e-3)):
        off = np.abs(single.record[name] - double.record[name]).max()
        assert 0 < off < room
