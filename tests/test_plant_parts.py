"""What a plant can have beside the plain axis, each part against a closed form or scipy's solver.

The control signal is set by its noise, with a controller of gain zero.
"""

import itertools
from functools import partial

import numpy as np
import pytest
from machine_cases import BEARINGS
from one_axis import I0, S0, K, M, driven, law
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import ambkit
from ambkit import Machine
from ambkit.machine.magnets import core_module
from ambkit.models import plant_parts as plant_parts
from ambkit.models.parts import ColouredNoise, Hum
from ambkit.models.plant import Plant
from ambkit.simulation import recording as plant_noise
from ambkit.simulation.recording import Stream
from ambkit.simulation.run import Loop

BEARING = Machine.preset("zittau_axial")
HEAVY = 1e9  # a rotor that stays where it is [kg]
ALL = {
    "amplifier__bandwidth": "2 kHz",
    "amplifier__voltage_limit": "30 V",
    "amplifier__resistance": "2 ohm",
    "delay": "0.03 ms",
    "speed": "6000 rpm",
    "sensor__runout": [{"order": 1, "amplitude": "3 um"}, {"order": 3, "amplitude": "1 um"}],
    "sensor__quantisation": "0.5 um",
    "sensor__quadratic": "20 1/m",
    "sensor__cubic": "1e4 1/m^2",
    "sensor__hum": [{"frequency": "50 Hz", "amplitude": "5 um"}],
    "sensor__coloured_noise": {"variance": "1 um^2", "bandwidth": "200 Hz"},
    "stop": {"stiffness": "1e8 N/m^1.5", "damping": "0.3 s/m"},
}  # fmt: skip


def coils(**changes):
    pair = {"voltage": 20.0, "R": 2.0, "k": K, "s0": S0, "i0": I0, "pair": True}
    return {"corner": 2 * np.pi * 500} | pair | changes


# ---- No part ----


def test_a_bearing_without_parts_is_simulated_without_them():
    for name in BEARINGS:
        bearing = Machine.preset(name)
        fields = plant_parts.axis_fields(bearing, None, None, 0.0, 4)
        assert fields["plain"]
        assert (fields["amplifiers"], fields["sensor_parts"], fields["delay"]) == ([{}], [{}], 0)
        assert plant_parts.coil_fields(bearing) is None


def test_parts_that_are_all_off_change_nothing_but_the_order_of_sums():
    command = np.random.default_rng(0).uniform(-0.2, 0.2, 400)
    plain, off = driven(command, None, x_start=1e-4), driven(command, {}, x_start=1e-4)
    assert np.abs(plain["x"]).max() > 3e-4
    for name in ("x", "v", "x_m", "force", "iu"):
        scale = np.abs(plain[name]).max()
        np.testing.assert_allclose(off[name], plain[name], rtol=0, atol=1e-10 * scale)


def test_the_core_takes_no_part_that_it_does_not_know():
    with pytest.raises(ValueError, match="a plant has no part corners"):
        driven([0.0], {"corners": 1.0})
    with pytest.raises(ValueError, match="delay must be 0 to 16 samples"):
        driven([0.0], {"delay": 17})
    with pytest.raises(ValueError, match="runout_sine has 1 samples, expected 2"):
        driven([0.0], {"orders": 2, "runout_sine": np.zeros(1)})


# ---- Amplifier ----


def test_the_current_follows_as_a_first_order_lag():
    corner, T = 2 * np.pi * 800, 1e-4
    run = driven(np.full(40, 0.5), {"corner": corner}, m=HEAVY, substeps=16)
    np.testing.assert_allclose(
        run["iu"], 0.5 * (1 - np.exp(-corner * T * np.arange(40))), atol=1e-8
    )
    np.testing.assert_allclose(run["force"], 10.05 * run["iu"], rtol=1e-9)
    assert "u_coil" not in run


def naive(t, s, parts, demanded, turned=0.0):
    """Right-hand side of the whole plant as the field writes it: x, v, x_m, i1, i2."""
    x, v, x_m, i1, i2 = s
    rates = []
    for i, expected, gap, opening in (
        (i1, I0 + demanded, S0 - x, -v),
        (i2, I0 - demanded, S0 + x, v),
    ):
        L = 2 * parts["k"] / gap
        emf = -L / gap * i * opening
        u = L * parts["corner"] * (expected - i) + parts["R"] * i + emf
        u = min(max(u, -parts["voltage"]), parts["voltage"])
        rates.append((u - parts["R"] * i - emf) / L)
    F = K * ((i1 / (S0 - x)) ** 2 - (i2 / (S0 + x)) ** 2)
    angle = parts.get("speed", 0.0) * t
    for order, a in enumerate(parts.get("runout_cosine", ())):
        turned += a * np.cos((order + 1) * angle)
    for order, b in enumerate(parts.get("runout_sine", ())):
        turned += b * np.sin((order + 1) * angle)
    seen = x + turned
    seen = seen + parts.get("quadratic", 0.0) * seen**2 + parts.get("cubic", 0.0) * seen**3
    d = max(abs(x) - 1e-3, 0.0)
    give = 1 + 1.5 * parts.get("damping", 0.0) * v * np.sign(x)
    push = -np.sign(x) * parts.get("stiffness", 0.0) * d**1.5 * max(give, 0.0)
    return [v, (F + push) / M, (seen - x_m) / 2e-4, *rates]


def exact(command, T, parts, x_start):
    """Solve piece by piece with solve_ivp; the state at each sample."""
    seen = x_start + sum(parts.get("runout_cosine", ()))
    s = np.array([x_start, 0, seen, I0, I0])
    seen += parts.get("quadratic", 0.0) * seen**2 + parts.get("cubic", 0.0) * seen**3
    s[2] = seen
    late = parts.get("delay", 0) * T + parts.get("delay_rest", 0.0)
    rows = [s]
    for k in range(command.size - 1):
        edges = np.unique([k * T, *(T * np.arange(command.size) + late), (k + 1) * T])
        edges = edges[(edges >= k * T - 1e-15) & (edges <= (k + 1) * T + 1e-15)]
        for low, high in itertools.pairwise(edges):
            if high - low < 1e-12:
                continue
            issued = int(np.floor(((low + high) / 2 - late) / T))
            demanded = command[issued] if issued >= 0 else 0.0
            s = solve_ivp(
                naive, (low, high), s, args=(parts, demanded), method="DOP853",
                rtol=1e-12, atol=1e-16,
            ).y[:, -1]  # fmt: skip
        rows.append(s)
    return np.array(rows)


WHOLE = coils() | {
    "delay": 1, "delay_rest": 1.7e-4, "quadratic": 30.0, "cubic": -2e4, "speed": 300.0,
    "orders": 2,
    "runout_cosine": np.array([3e-5, 0.0]), "runout_sine": np.array([1e-5, -2e-5]),
}  # fmt: skip


def test_with_all_that_is_smooth_the_integrator_is_of_order_four():
    """Amplifier, back-EMF, a dead time of 1.425 samples, runout and a bent sensor at once."""
    T = 4e-4
    command = SWINGS
    reference = exact(command, T, WHOLE, 1e-4)
    errors = []
    for substeps in (7, 14, 28, 56):
        run = driven(
            command, WHOLE, T=T, x_start=1e-4, substeps=substeps, coil=law(two_sided=False)
        )
        ours = np.column_stack([run["x"], run["v"], run["x_m"], run["iu"]])
        theirs = np.column_stack([reference[:, :3], (reference[:, 3] - reference[:, 4]) / 2])
        errors.append((np.abs(ours - theirs) / np.abs(theirs).max(axis=0)).max(axis=0))
    assert np.abs(run["u_coil"]).max() < 20  # nowhere limited
    assert errors[-1].max() < 1e-6
    order = np.log2(errors[0] / errors[-1]) / 3
    assert order == pytest.approx([4, 4, 4, 4], abs=0.4)


SWINGS = np.array([0.3, -0.2, 0.1, -0.3, 0.2, -0.1, 0.3, 0.0])
HARD = {
    "limited now and then": (WHOLE | {"voltage": 6.0}, SWINGS, 1e-4, 1e-5),
    "slewing": (coils(corner=2 * np.pi * 20e3, voltage=3.0), 4 * SWINGS, 2e-4, 1e-4),
    "impact": (coils() | {"stiffness": 1e8, "damping": 0.5, "farthest": 1.9e-3},
               np.full(40, 0.6), 8e-4, 2e-6),
}  # fmt: skip


@pytest.mark.parametrize("name", HARD)
def test_where_it_is_not_smooth_the_solver_says_the_same(name):
    """Of both coils, each of which pulls by its own current."""
    parts, command, x_start, within = HARD[name]
    reference = exact(command, 4e-4, parts, x_start)
    run = driven(command, parts, T=4e-4, x_start=x_start, substeps=64, coil=law(two_sided=False))
    volts = np.abs([run["u_coil"], run["u_coil_2"]])
    assert (volts <= parts["voltage"] * (1 + 1e-12)).all()
    limited = (volts > parts["voltage"] - 1e-9).sum()
    assert limited > 0
    assert (limited == volts.size) == (name == "slewing")
    assert (np.abs(reference[:, 0]).max() > 1.05e-3) == (name == "impact")
    iu = (reference[:, 3] - reference[:, 4]) / 2
    of = dict(zip(("x", "v", "x_m"), reference.T[:3], strict=True)) | {"iu": iu}
    for signal, values in of.items():
        np.testing.assert_allclose(
            run[signal], values, atol=within * np.abs(values).max(), err_msg=signal
        )


def test_a_scaled_magnet_is_scaled_with_its_coils():
    command = np.random.default_rng(1).uniform(-1, 1, 60)
    parts = coils(voltage=8.0)
    one = driven(command, parts, scale=np.full(60, 0.8), x_start=1e-4, coil=law(two_sided=False))
    weaker = {"magnet": law(k=0.8 * K), "coil": law(k=0.8 * K, two_sided=False)}
    other = driven(command, parts | {"k": 0.8 * K}, x_start=1e-4, **weaker)
    for name in ("x", "force", "iu", "u_coil", "u_coil_2"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-9, atol=1e-15)


# ---- Delay ----


@pytest.mark.parametrize("halves", [1, 2, 3, 4, 7])
def test_a_delay_shifts_the_control_between_the_samples(halves):
    """The same plant sampled twice as often, and its control shifted by whole samples there."""
    T, command = 1e-4, np.random.default_rng(2).uniform(-0.4, 0.4, 50)
    delay = {"delay": halves // 2, "delay_rest": T / 2 * (halves % 2)}
    late = driven(command, delay, T=T, substeps=8, x_start=5e-5)
    shifted = np.concatenate([np.zeros(halves), np.repeat(command, 2)])[:100]
    fine = driven(shifted, {}, T=T / 2, substeps=4 + (halves % 2), x_start=5e-5)
    for name in ("x", "v", "x_m", "iu", "force"):
        np.testing.assert_allclose(late[name], fine[name][::2], rtol=1e-8, atol=1e-14)


def test_a_delay_is_reported_in_whole_samples_and_the_rest():
    def delay(text):
        parts = plant_parts.axis_fields(BEARING.replace(delay=text), None, None, 0.0, 4)
        return parts["delay"], parts["delay_rest"]

    assert delay("0.1 ms") == (1, 0)
    assert delay("0.3 ms") == (3, 0)
    assert delay("0.7 ms") == (7, 0)
    assert delay("0.15 ms") == (1, pytest.approx(5e-5, rel=1e-9))
    assert delay("20 us") == (0, pytest.approx(2e-5, rel=1e-9))


# ---- Sensor ----


def test_runout_comes_through_the_lag():
    """Each line's amplitude and phase behind 1/(1 + j n speed T_sen), after 10^5 turns as well."""
    T, lag, speed = 1e-4, 2e-4, 6000 * 2 * np.pi / 60
    bearing = BEARING.replace(
        speed="6000 rpm",
        sensor__runout=[
            {"order": 1, "amplitude": "3 um", "phase": "30 deg"},
            {"order": 5, "amplitude": "2 um", "phase": "-1 rad"},
            {"order": 5, "amplitude": "1 um"},
        ],
    )
    assert bearing.speed == speed
    (parts,) = plant_parts.axis_fields(bearing, None, None, 0.0, 4)["sensor_parts"]
    n = 200_000
    run = driven(np.zeros(n), parts, m=HEAVY, magnet=core_module().Constant(0.0, 0.0), substeps=16)
    t = T * np.arange(n)
    lines = {1: 3e-6 * np.exp(1j * np.pi / 6), 5: 2e-6 * np.exp(-1j) + 1e-6}
    expected = sum(
        (a * np.exp(1j * n * speed * t) / (1 + 1j * n * speed * lag)).real for n, a in lines.items()
    )
    np.testing.assert_allclose(run["x_m"][100:], expected[100:], atol=3e-11)


def test_substeps_follow_the_fastest_part():
    def steps(**changes):
        bearing = BEARING.replace(**changes)
        result = plant_parts.substeps(bearing, [None], 4, bearing.speed)
        loops = core_module("float64", any_model=True)
        assert Plant(bearing).arrays(loops, 4, bearing.speed)["substeps"] == result
        return result

    assert steps(sensor__lag="20 us") == 10
    assert steps(amplifier__bandwidth="2 kHz") == 6
    assert steps(amplifier__bandwidth="1 GHz") == 4000
    runout = [{"order": 5, "amplitude": "1 um"}]
    assert steps(speed="30000 rpm", sensor__runout=runout) == 7


def test_a_bent_sensor_settles_on_its_curve():
    for x in (-5e-4, 3e-4):
        run = driven(
            np.zeros(100), {"quadratic": 50.0, "cubic": 1e5}, m=HEAVY, x_start=x, K_sen=2.0,
            magnet=core_module().Constant(0.0, 0.0),
        )  # fmt: skip
        np.testing.assert_allclose(run["x_m"], 2 * (x + 50 * x**2 + 1e5 * x**3), rtol=1e-12)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_quantised_measurement_is_off_by_half_a_step_at_most(precision):
    step = 2e-6
    bearing = BEARING.replace(sensor__quantisation=step)
    kalman = ambkit.KalmanFilter(bearing, precision=precision)
    record = ambkit.simulate(bearing, ambkit.Scenario(duration=0.2), filter=kalman).record
    noise = plant_noise.noise_samples(bearing, ambkit.Scenario(duration=0.2), len(record))[1][:, 0]
    error = record["y"] - record["x_m"] - noise
    eps = np.finfo(precision).eps
    assert np.abs(error).max() <= step / 2 + 100 * eps * 1e-3
    assert error.std() == pytest.approx(step / np.sqrt(12), rel=0.1)
    whole = record["y"] / step
    np.testing.assert_allclose(whole, np.round(whole), atol=10 * eps * np.abs(whole).max())


def test_what_is_no_number_stays_what_it_is_in_the_rounding():
    noise = np.array([0.0, np.nan, np.inf, -np.inf, 1e300, 0.6e-6, -0.6e-6, 0.4e-6])
    still = {"m": HEAVY, "magnet": core_module().Constant(0.0, 0.0), "noise_y": noise}
    y = driven(np.zeros(8), {"step": 1e-6}, **still)["y"]
    np.testing.assert_array_equal(y, [0, np.nan, np.inf, -np.inf, 1e300, 1e-6, -1e-6, 0])


# ---- Noise ----


def test_the_white_noise_is_what_it_was_whatever_stands_beside_it():
    scenario, n = ambkit.Scenario(seed=7, run=3), 500
    white_u, white_y = (
        Stream(7, 3, number).normal(np.sqrt(variance), n)
        for number, variance in enumerate((8e-5, 8.3e-11))
    )
    noise_u, noise_y = (noise[:, 0] for noise in plant_noise.noise_samples(BEARING, scenario, n))
    assert (noise_u == white_u).all()
    assert (noise_y == white_y).all()
    noisy = BEARING.replace(**{k: ALL[k] for k in ("sensor__hum", "sensor__coloured_noise")})
    only_hum = BEARING.replace(sensor__hum=ALL["sensor__hum"])
    also_u, both_y = (noise[:, 0] for noise in plant_noise.noise_samples(noisy, scenario, n))
    assert (also_u == white_u).all()
    hum = plant_noise.noise_samples(only_hum, scenario, n)[1][:, 0] - white_y
    assert np.ptp(both_y - white_y - hum) > 1e-6
    silent = plant_noise.noise_samples(noisy, scenario.replace(noise=False), n)
    assert not np.any(silent)


def autocovariance(z, lags):
    n = z.shape[-1]
    return np.array([np.mean(z[..., : n - lag] * z[..., lag:]) for lag in lags])


def test_coloured_noise_has_the_autocovariance_of_first_order():
    T, n = 1e-4, 200_000
    noise = ColouredNoise(variance=1e-12, bandwidth=200.0)
    z = np.array([noise.draw(T, n, Stream(s)) for s in range(20)])
    lags = range(0, 40, 4)
    expected = 1e-12 * np.exp(-2 * np.pi * 200 * T * np.arange(0, 40, 4))
    np.testing.assert_allclose(autocovariance(z, lags), expected, atol=0.01e-12)
    start = np.array([noise.draw(T, 1, Stream(s)) for s in range(4000)])
    assert start.var() == pytest.approx(1e-12, rel=5 * np.sqrt(2 / 4000))  # stationary at once


@pytest.mark.parametrize("part", [ColouredNoise(1e-12, 200.0), Hum(50.0, 5e-6, 100.0)])
def test_noise_drawn_from_equations_is_that_of_the_part(part):
    """A new part needs no text of its own to fly."""
    n, T = 400, 1e-4
    own, z = (
        np.array([draw(T, n, Stream(s)) for s in range(600)])
        for draw in (part.draw, partial(plant_noise.by_equations, part))
    )
    lags = range(0, 100, 20)
    room = 5 * autocovariance(own, [0])[0] / np.sqrt(600)
    np.testing.assert_allclose(autocovariance(z, lags), autocovariance(own, lags), atol=room)
    assert z[:, 0].var() == pytest.approx(own[:, 0].var(), rel=0.3)  # stationary at once


@pytest.mark.parametrize("bandwidth", [0.0, 2.0])
def test_hum_has_its_line(bandwidth):
    T, n, f, A = 1e-4, 100_000, 50.0, 5e-6
    line = Hum(frequency=f, amplitude=A, bandwidth=bandwidth)
    z = np.array([line.draw(T, n, Stream(s)) for s in range(40)])
    lags = range(0, 400, 50)
    at = T * np.arange(0, 400, 50)
    wide = 2 * np.pi * line.bandwidth
    expected = A**2 / 2 * np.cos(2 * np.pi * f * at) * np.exp(-wide * at)
    room = 0.02 if line.bandwidth == 0 else 0.15
    np.testing.assert_allclose(autocovariance(z, lags), expected, atol=room * A**2 / 2)
    if line.bandwidth == 0:
        assert np.abs(z).max() == pytest.approx(A, rel=1e-3)
        assert np.ptp(z[:, 0]) > A  # each seed has a phase of its own


# ---- Contact ----

STOP = {"stiffness": 1e8, "damping": 0.5, "farthest": 1.9e-3}


def impact(v_in, n=1500, T=1e-5, **changes):
    """Push the rotor to a velocity with one sample's force, towards the stop at +1 mm."""
    push = np.zeros(n)
    push[0] = M * v_in / T
    parts = STOP | changes.pop("parts", {})
    nothing = core_module().Constant(0.0, 0.0)
    return driven(np.zeros(n), parts, T=T, f_d=push, magnet=nothing, x_start=0.9e-3, **changes)


def restitution(v_in, damping):
    """Hunt and Crossley's equation integrated: a v - ln(1 + a v) is the same before and after."""
    a = 1.5 * damping

    def lost(v):
        return a * v - np.log1p(a * v)

    return float(brentq(lambda v: lost(-v) - lost(v_in), 1e-9 * v_in, v_in) / v_in)


@pytest.mark.parametrize("v_in", [0.02, 0.1, 0.4])
def test_the_rotor_comes_back_as_the_formula_says(v_in):
    run = impact(v_in, n={0.02: 1500, 0.1: 600, 0.4: 300}[v_in])
    assert run["v"][-1] == run["v"][-2]  # free again
    e = -run["v"][-1] / v_in
    assert e == pytest.approx(restitution(v_in, 0.5), rel=1e-6)
    assert e == pytest.approx(1 - 0.5 * v_in, abs=(0.5 * v_in) ** 2)  # where it is little
    depth = run["x"].max() - 1e-3
    elastic = (5 * M * v_in**2 / (4 * 1e8)) ** 0.4
    assert 0.9 * elastic < depth < elastic


@pytest.mark.parametrize("damping", [0.1, 0.5, 20.0])
def test_the_energy_never_rises(damping):
    """Under a weight that keeps it bouncing between and against the stops, with a lossy one too."""
    weight = -M * 9.81
    nothing = core_module().Constant(0.0, 0.0)
    parts = STOP | {"damping": damping}
    run = driven(np.zeros(6000), parts, f_0=weight, magnet=nothing, x_start=9e-4)
    x, v = run["x"], run["v"]
    depth = np.maximum(np.abs(x) - 1e-3, 0)
    energy = M * v**2 / 2 + 1e8 * depth**2.5 / 2.5 - weight * x
    assert np.diff(energy).max() <= 1e-6 * np.ptp(energy)
    bounces = np.flatnonzero((v[:-1] < -1e-4) & (v[1:] > 1e-4)).size
    assert bounces > 3 or damping == 20.0
    rest = (M * 9.81 / 1e8) ** (2 / 3)
    if damping == 20.0:
        assert x[-1] == pytest.approx(-1e-3 - rest, abs=1e-9)
    assert 0 < run["touched"] <= 6000


@pytest.mark.parametrize("stiffness", [1e8, 1e10, 1e12])
def test_the_impact_does_not_depend_on_the_steps(stiffness):
    """Also where the whole of it is over in a fraction of a step."""
    nothing = core_module().Constant(0.0, 0.0)
    runs = [
        driven(
            np.zeros(120), STOP | {"stiffness": stiffness}, f_0=-M * 9.81, magnet=nothing,
            x_start=-9e-4, substeps=substeps,
        )
        for substeps in (1, 4, 64)
    ]  # fmt: skip
    assert runs[-1]["v"].max() > 0.02  # it came back
    for run in runs[:-1]:
        for name in ("x", "v"):
            scale = np.abs(runs[-1][name]).max()
            np.testing.assert_allclose(run[name], runs[-1][name], rtol=0, atol=1e-6 * scale)


def test_a_stop_too_soft_ends_before_the_magnet():
    run = driven(np.zeros(2000), STOP | {"stiffness": 1.0}, f_d=100.0)
    assert run["x"].max() == 1.9e-3
    assert np.isfinite(run["force"]).all()


# ---- All of it, from the bearing's file ----


def test_all_parts_at_once_hover_and_are_reported():
    bearing = BEARING.replace(**ALL)
    run = ambkit.simulate(bearing, ambkit.Scenario(duration=0.3)).record
    assert run.units["u_coil"] == run.units["u_coil_2"] == "V"
    assert np.abs(run["x"]).max() < 1e-4
    assert np.abs(run["u_coil"]).max() <= 30 * (1 + 1e-12)
    assert "u_coil" not in ambkit.simulate(BEARING, ambkit.Scenario(duration=0.01)).record


def test_stretches_are_the_whole_with_all_parts():
    bearing, scenario = BEARING.replace(**ALL), ambkit.Scenario(duration=0.02)
    whole = Loop(bearing, scenario).run().record
    loop = Loop(bearing, scenario)
    first, second = loop.run(until=0.0071).record, loop.run().record
    for name in whole.signals:
        joined = np.concatenate([first[name], second[name]])
        np.testing.assert_array_equal(joined, whole[name], err_msg=name)


def test_single_precision_does_nearly_the_same():
    bearing = BEARING.replace(**ALL | {"sensor__quantisation": None})
    scenario = ambkit.Scenario(duration=0.05, controller={"feedback": "measurement"})
    runs = {
        p: ambkit.simulate(
            bearing, scenario, filter=ambkit.KalmanFilter(bearing, precision=p)
        ).record
        for p in ("float64", "float32")
    }
    off = np.abs(runs["float32"]["x"] - runs["float64"]["x"]).max()
    assert 0 < off < 1e-3 * np.abs(runs["float64"]["x"]).max()


def test_another_magnet_gets_the_mean_of_both_currents():
    bearing = BEARING.replace(amplifier__bandwidth="1 kHz", amplifier__voltage_limit="8 V",
                              amplifier__resistance="2 ohm")  # fmt: skip
    record = ambkit.simulate(
        bearing, ambkit.Scenario(duration=0.05), plant=ambkit.ConstantStiffness(10.05, 7500.0)
    ).record
    np.testing.assert_allclose(
        record["f_mag"], 10.05 * record["iu"] + 7500.0 * record["x"], atol=1e-12
    )
