"""Eddy currents: a part of one file and one key, seen in plant, filter, margins, C and FMU.

The plant has no text of it: its linear states come from the model (`behind_magnets`).
"""

import math

import control
import numpy as np
import pytest
from oracles import magnet_force
from scipy.integrate import solve_ivp
from scipy.special import erfcx
from test_plant_parts import HEAVY, driven

import ambkit
from ambkit import PID, Machine, Scenario, Sine
from ambkit.control.control import Control
from ambkit.control.linear.linear_plant import OperatingPoint, plant
from ambkit.estimate.registry import KINDS, learned_magnet
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models import plant_parts
from ambkit.models.continuous import ForceLag, behind_magnets, continuous
from ambkit.simulation.run import simulate_run

LAG = 0.3e-3
ZITTAU = Machine.preset("zittau_axial")
LATE = ZITTAU.replace(magnet__eddy_current_lag=LAG)
QUIET = {"sensor__noise_variance": "0.09 um^2"}
MOVED = Scenario(duration=0.3, reference=Sine(amplitude=2e-4, frequency=40.0))


# ---- The plant


def between(bearing):
    """Return what is between the control and the force, as the plant takes it."""
    (parts,) = plant_parts.axis_fields(bearing, None, None, 0.0, 4)["amplifiers"]
    return parts


def test_the_force_of_a_held_rotor_follows_as_a_first_order_lag():
    run = driven(np.full(40, 0.5), between(LATE), m=HEAVY, substeps=16)
    expected = 10.05 * 0.5 * (1 - np.exp(-1e-4 * np.arange(40) / LAG))
    np.testing.assert_allclose(run["force"], expected, atol=1e-7)


def test_a_chain_of_states_is_what_its_matrices_say():
    """The next part needs no C: two lags and a share that acts at once."""
    A, b = np.array([[-2e3, 0.0], [5e3, -5e3]]), np.array([2e3, 0.0])
    chain = ForceLag(("a", "b"), A, b, np.array([0.3, 0.5]), 0.2)
    run = driven(
        np.full(30, 0.5), plant_parts.behind_fields(chain, "float64"), m=HEAVY, substeps=16
    )
    response = control.ss(A, b[:, None], chain.c[None], [[chain.d]])
    _, y = control.step_response(response, 1e-4 * np.arange(30))
    np.testing.assert_allclose(run["force"], 10.05 * 0.5 * y, atol=1e-7)


def test_the_rotor_moves_as_another_solver_says():
    """With an amplifier that lags too, from rest, over 4 ms."""
    bearing = LATE.replace(amplifier__bandwidth="800 Hz", rotor__gravity="none")
    demanded, corner = 0.4, 2 * math.pi * 800
    n, m = 41, bearing.rotor.mass

    def slope(_, s):
        x, v, i, e = s
        force = magnet_force(bearing, i, x)
        return [v, (e + 1.0) / m, corner * (demanded - i), (force - e) / LAG]

    T = 1e-4
    exact = solve_ivp(slope, (0, (n - 1) * T), [0.0] * 4, t_eval=T * np.arange(n),
                      method="DOP853", rtol=1e-12, atol=1e-18).y  # fmt: skip
    run = driven(np.full(n, demanded), between(bearing), f_d=1.0, substeps=16)
    assert exact[0].max() > 5e-5
    np.testing.assert_allclose(run["x"], exact[0], rtol=0, atol=1e-14)
    np.testing.assert_allclose(run["iu"], exact[2], rtol=0, atol=1e-8)
    np.testing.assert_allclose(run["force"], exact[3], rtol=0, atol=1e-7)


def test_a_machine_s_filter_explains_what_its_magnets_do():
    """Four axes with a lag each: innovations are as large as the filter that knows it says."""
    rig = Machine.preset("ufu_rig")
    magnet = {"eddy_current_lag": LAG}
    late = rig.model_copy(update={"bearings": tuple(
        each.model_copy(update={"magnet": each.magnet.model_copy(update=magnet)})
        for each in rig.bearings
    )})  # fmt: skip
    flight = Scenario(duration=0.2, controller={"feedback": "measurement"}, seed=1)
    record = simulate_run(late, flight).record
    estimate = ambkit.KalmanFilter(late).run(record)
    share = estimate.innovation[400:] ** 2 / estimate.innovation_variance[400:]
    assert 0.9 < np.mean(share) < 1.0


def test_it_is_seen_in_simulate():
    """What acts follows what the law gives of current and place, at the frequency of both."""
    record = ambkit.simulate(LATE, MOVED.replace(noise=False)).record
    law = np.array(magnet_force(LATE, record["iu"], record["x"]))
    t, omega = record.t, 2 * math.pi * 40
    turn = np.exp(-1j * omega * t) * (t >= t[-1] - 0.1)
    lagged = (record["f_mag"] * turn).sum() / (law * turn).sum()
    # The current recorded is held from its sample on: it is half a sample ahead of its mean.
    assert abs(lagged - 1 / (1 + 1j * omega * LAG)) < 0.02
    assert abs(lagged - 1) > 0.08
    prompt = ambkit.simulate(ZITTAU, MOVED.replace(noise=False)).record
    same = np.array(magnet_force(ZITTAU, prompt["iu"], prompt["x"]))
    np.testing.assert_allclose(prompt["f_mag"], same, atol=1e-9)


def test_unbalance_is_kept_still_through_the_lag():
    """At 12,000 rpm the force is 20 degrees late, and the current that far ahead."""
    rig = Machine.preset("ufu_rig").model_copy(update={"speed": 2 * math.pi * 200})
    magnet = {"eddy_current_lag": LAG}
    late = rig.model_copy(update={"bearings": tuple(
        each.model_copy(update={"magnet": each.magnet.model_copy(update=magnet)})
        for each in rig.bearings
    )})  # fmt: skip
    orbit = {}
    for unbalance in ("off", "compensation"):
        flight = Scenario(duration=0.8, noise=False, controller=Control(unbalance=unbalance)).fed(
            "estimate"
        )
        kalman = ambkit.KalmanFilter(late, synchronous=("unbalance",))
        record = simulate_run(late, flight, estimator=kalman).record
        orbit[unbalance] = np.ptp(record["s_A1"][-1000:])
    assert orbit["compensation"] < 0.1 * orbit["off"]


# ---- Filters


def test_the_filter_that_knows_it_beats_the_one_that_does_not():
    """In the force it is told apart by: a rotor that is moved, over ten seeds and more.

    Of the position a sensor tells more than any force: there both are alike.
    """
    late, prompt = LATE.replace(**QUIET), ZITTAU.replace(**QUIET)
    rms = {}
    nis = []
    for seed in range(10):
        record = ambkit.simulate(late, MOVED.replace(seed=seed)).record
        for knows, bearing in ((True, late), (False, prompt)):
            estimate = KINDS["extended"].make(bearing).run(record)
            for name in ("x", "f_d"):
                error = (estimate[name] - record[name])[200:]
                rms.setdefault((knows, name), []).append(float(np.sqrt(np.mean(error**2))))
            if knows:
                share = estimate.innovation**2 / estimate.innovation_variance
                nis.append(float(np.mean(share[200:])))
    ratio = np.array(rms[True, "f_d"]) / np.array(rms[False, "f_d"])
    assert (ratio < 0.75).all()
    assert np.mean(ratio) < 0.65
    assert np.mean(rms[True, "x"]) < 1.03 * np.mean(rms[False, "x"])
    assert 0.9 < np.mean(nis) < 1.05


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_flies_with_it(kind):
    bearing = LATE.replace(**QUIET)
    record = ambkit.simulate(bearing, MOVED.replace(duration=0.1)).record
    estimator = KINDS[kind].make(bearing, learned_magnet(kind, bearing))
    naive = kind in ("low-pass", "constant-velocity")
    assert kind == "constant-velocity" or estimator.states[-1].name == "f_e"
    error = (estimator.run(record)["x"] - record["x"])[200:]
    raw = (record["y"] - record["x"])[200:]
    assert np.std(error) < (4.0 if naive else 0.5) * np.std(raw)


# ---- Margins and identification


def test_margins_are_those_of_python_control():
    """The lag, held stiffness and all: the plant of `assess` is ``1/(1 + s lag)`` in the force."""
    pid = PID().completed(ZITTAU).model_copy(update={"feedback": "measurement"})
    late = ambkit.assess(LATE, "none", controller=pid).to_dict()
    prompt = ambkit.assess(ZITTAU, "none", controller=pid).to_dict()
    k, m, T = ConstantStiffness.of(LATE), LATE.rotor.mass, LATE.sampling_time
    # States x, v, f_e, x_m by hand.
    A = np.array([
        [0, 1, 0, 0], [0, 0, 1 / m, 0], [k.k_s / LAG, 0, -1 / LAG, 0],
        [1 / LATE.lag_of(LATE.sensor), 0, 0, -1 / LATE.lag_of(LATE.sensor)],
    ])  # fmt: skip
    B = np.array([[0], [0], [k.k_i / LAG], [0]])
    P = control.c2d(control.ss(A, B, [[0, 0, 0, 1.0]], 0), T)
    ours = plant(LATE, OperatingPoint(0.0, 0.0))
    f = np.geomspace(1, 4900, 200)
    z = np.exp(2j * np.pi * f * T)
    np.testing.assert_allclose(ours.response(f)[:, 0, 0], P(z), rtol=1e-7)
    assert late != prompt


def test_it_is_identified():
    """Of a loop that is moved, from a start 2.5 times too short; no other force acts."""
    truth = LATE.replace(**QUIET)
    record = ambkit.simulate(truth, MOVED.replace(seed=3)).record
    start = truth.replace(magnet__eddy_current_lag=0.12e-3)
    found = ambkit.identify(start, record, free=["eddy_current_lag", "disturbance_noise"])
    lag = found.isolated.magnet.eddy_current_lag
    error = found.likelihood.standard_error("eddy_current_lag")
    assert abs(lag - LAG) < 3 * error
    assert error < 0.03 * LAG
    with pytest.raises(ambkit.AmbkitError, match=r"has no magnet\.eddy_current_lag to"):
        ambkit.identify(ZITTAU, record, free=["eddy_current_lag"])


# ---- Solid iron: half an order

CORNER = 100.0
SOLID = ZITTAU.replace(magnet__eddy_current_corner=CORNER)
BAND = np.geomspace(
    1.6, 1590, 61
)  # three decades up to 1/(2 pi T), twenty frequencies in each [Hz]


def half_order(f, corner):
    return 1 / (1 + np.sqrt(1j * f / corner))


@pytest.mark.parametrize("corner", [20.0, 50.0, 100.0, 300.0, 1000.0])
def test_solid_iron_lags_by_half_an_order(corner):
    lags = behind_magnets(continuous(SOLID.replace(magnet__eddy_current_corner=corner)))[0]
    ratio = [lags.at(2 * math.pi * f)[1] for f in BAND] / half_order(BAND, corner)
    assert np.abs(20 * np.log10(np.abs(ratio))).max() < 0.6
    assert np.abs(np.degrees(np.angle(ratio))).max() < 3.2
    assert lags.at(0.0)[1] == pytest.approx(1, abs=1e-14)


def test_far_above_its_corner_it_falls_by_10_db_a_decade_at_45_degrees():
    lags = behind_magnets(continuous(SOLID.replace(magnet__eddy_current_corner=2.0)))[0]
    high = BAND[BAND > 100]
    response = np.array([lags.at(2 * math.pi * f)[1] for f in high])
    slope = np.polyfit(np.log10(high), 20 * np.log10(np.abs(response)), 1)[0]
    assert slope == pytest.approx(-9.5, abs=0.5)
    assert np.degrees(np.angle(response)) == pytest.approx(-43.5, abs=4.5)


def test_the_force_of_a_held_rotor_creeps_as_half_an_order_does():
    """The step response is ``1 - exp(w t) erfc(sqrt(w t))``, w the corner."""
    run = driven(np.full(400, 0.5), between(SOLID), m=HEAVY, substeps=18)
    exact = 1 - erfcx(np.sqrt(2 * math.pi * CORNER * 1e-4 * np.arange(400)))
    np.testing.assert_allclose(run["force"][3:] / (10.05 * 0.5), exact[3:], atol=0.012)


def moved_behind_half_an_order(bearing, seed, samples=3000, steps=10):
    """Fly a rotor by hand, its iron as 141 lags over 14 decades; return x, y, u and f_d."""
    rng, T, m = np.random.default_rng(seed), bearing.sampling_time, bearing.rotor.mass
    dt, k = T / steps, ConstantStiffness.of(bearing)
    around = np.linspace(-16.0, 16.0, 141)  # of the logarithm of rate over corner
    share = 1 / np.cosh(around / 2)
    share /= share.sum()
    left = np.exp(-2 * math.pi * CORNER * np.exp(around) * dt)
    kept = math.exp(-dt / bearing.lag_of(bearing.sensor))
    x, v, x_m, weight, rows = 0.0, 0.0, 0.0, 9.81 * m, []
    e = share * weight
    for sample in range(samples):
        f_d = 2.0 if sample > samples // 2 else 0.0
        expected = 2e-4 * math.sin(2 * math.pi * 40 * sample * T)
        u = (weight - f_d - 2.5 * k.k_s * (x - expected) - 350 * m * v) / k.k_i
        iu = u + rng.normal(0, math.sqrt(bearing.amplifier.noise_variance))
        y = x_m + rng.normal(0, math.sqrt(bearing.sensor.noise_variance))
        rows.append((x, y, u, f_d))
        for _ in range(steps):
            e = left * e + (1 - left) * share * magnet_force(bearing, iu, x)
            v += dt * ((e.sum() + f_d) / m - 9.81)
            x += dt * v
            x_m = kept * x_m + (1 - kept) * x
    return np.array(rows).T


def test_against_iron_of_half_an_order_the_filter_is_right_about_its_force():
    """The truth shares nothing with the model: 0.20 N against 1.17 N of a filter without it."""
    known, unknown = SOLID.replace(**QUIET), ZITTAU.replace(**QUIET)
    rms = {True: [], False: []}
    for seed in range(4):
        x, y, u, f_d = moved_behind_half_an_order(known, seed)
        for knows, bearing in ((True, known), (False, unknown)):
            estimate = (
                KINDS["extended"]
                .make(bearing)
                .run(ambkit.Record(1e-4 * np.arange(len(y)), {"y": y, "u": u}))
            )
            quiet = np.r_[500:1450, 2000:3000]
            rms[knows].append(np.sqrt(np.mean((estimate["f_d"] - f_d)[quiet] ** 2)))
            assert np.std((estimate["x"] - x)[quiet]) < 0.3e-6
    assert max(rms[True]) < 0.25
    assert min(rms[False]) > 1.0


@pytest.mark.long
@pytest.mark.parametrize("name", ["zittau_axial", "ufu_rig", "tum_mlps"])
def test_with_solid_iron_filters_are_as_sure_as_they_say(name):
    """One axis and several, over 20 seeds, with a random walk of the disturbance force."""
    machine = Machine.preset(name)
    iron = {"eddy_current_corner": 200.0}
    solid = machine.model_copy(update={"bearings": tuple(
        bearing.model_copy(update={"magnet": bearing.magnet.model_copy(update=iron)})
        for bearing in machine.bearings
    )})  # fmt: skip
    figures = ambkit.compare(solid, ["extended"], case="model").to_dict()["default"]["extended"]
    assert 0.9 < figures["nees"] <= 1  # share of samples within its 95 % bounds
    assert 0.97 < figures["nis"] < 1.03


def test_margins_of_solid_iron_are_those_of_half_an_order():
    """The plant in continuous time is ``k_i H / (m s^2 - k_s H)``, read through its lag."""
    ours = plant(SOLID, OperatingPoint(0.0, 0.0), continuous=True)
    k, s = ConstantStiffness.of(SOLID), 2j * math.pi * BAND
    H = half_order(BAND, CORNER)
    exact = k.k_i * H / (SOLID.rotor.mass * s**2 - k.k_s * H) / (1 + s * SOLID.sensor.lag)
    resolvents = [np.linalg.solve(at * np.eye(len(ours.A)) - ours.A, ours.B[:, 0]) for at in s]
    np.testing.assert_allclose(np.array(resolvents) @ ours.C[0] / exact, 1, atol=0.055)


@pytest.mark.long
def test_the_corner_of_solid_iron_is_identified():
    truth = SOLID.replace(**QUIET)
    record = ambkit.simulate(truth, MOVED.replace(seed=3)).record
    start = truth.replace(magnet__eddy_current_corner=250.0)
    found = ambkit.identify(start, record, free=["eddy_current_corner", "disturbance_noise"])
    error = found.likelihood.standard_error("eddy_current_corner")
    assert abs(found.isolated.magnet.eddy_current_corner - CORNER) < 3 * error
    assert error < 0.1 * CORNER


def test_solid_iron_beyond_the_band_of_its_lags_is_refused():
    for corner in ("1.5 Hz", "5.1 kHz"):
        with pytest.raises(ambkit.AmbkitError, match=r"1\.59155 Hz to 5000 Hz"):
            SOLID.replace(magnet__eddy_current_corner=corner)
    with pytest.raises(ambkit.AmbkitError, match="goes without eddy_current_lag"):
        SOLID.replace(magnet__eddy_current_lag="1 ms")
