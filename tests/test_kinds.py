"""Every kind of estimator: the same interface, the same care of bad input, and each one's own."""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import oracles
import pytest
from filter_cases import core_model, core_settings, made

import ambkit
from ambkit import ClosedLaw, KalmanFilter, Machine, Record, Scenario, Status
from ambkit.estimate.observer import ExtendedStateObserver, SteadyStateKalmanFilter
from ambkit.estimate.registry import KINDS, core_kernel
from ambkit.machine.magnets import ConstantStiffness, core_module
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import simulate_run

BEARING = Machine.preset("zittau_axial")
RECORD = ambkit.simulate(
    BEARING,
    Scenario(
        duration=0.6,
        seed=3,
        reference=ambkit.Step(amplitude=3e-4, time=0.1),
        disturbance=ambkit.Step(amplitude=2.0, time=0.3),
    ),
).record
kinds = pytest.mark.parametrize(
    "kind", [k for k in KINDS.values() if k.magnet], ids=lambda k: k.name
)


@kinds
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_it_follows_the_rotor_and_finds_the_load(kind, precision):
    estimate = kind.make(BEARING, precision=precision).run(RECORD)
    late = RECORD.t > 0.5
    assert np.abs(estimate.x - RECORD["x"])[late].max() < 4e-5
    if kind.name != "constant-velocity":  # which estimates no force
        assert estimate.f_d[late].mean() == pytest.approx(2.0, abs=0.6)


@kinds
def test_step_by_step_is_the_whole_record(kind):
    estimator = kind.make(BEARING)
    whole = estimator.run(RECORD)
    estimator.reset(estimator.initial_state(RECORD["y"]))
    estimator.update(RECORD["y"][0])
    for k in range(1, 400):
        mean = estimator.step(RECORD["y"][k], RECORD["u"][k - 1])
        assert (mean == whole.mean[k]).all()
        assert estimator.status == whole.status[k]


class Fault(NamedTuple):
    """What is done to y and u from sample 2000 on, for how long, and the flag that tells."""

    samples: int
    y: Callable[[np.ndarray], Any] | None
    u: Callable[[np.ndarray], Any] | None
    flag: Status


def spikes(y):
    y = y.copy()
    y[::37] += 0.7e-3
    return y


FAULTS = {
    "drop-out": Fault(100, lambda y: np.nan, None, Status.MISSING),
    "long drop-out": Fault(1500, lambda y: np.nan, None, Status.MISSING),
    "far off": Fault(100, lambda y: 1e3, None, Status.MISSING),
    "infinite": Fault(100, lambda y: np.inf, None, Status.MISSING),
    "frozen": Fault(300, lambda y: y[0], None, Status.FROZEN),
    "outliers": Fault(1000, spikes, None, Status.OUTLIER),
    "infinite control": Fault(100, None, lambda u: -np.inf, Status.BAD_CONTROL),
    "missing control": Fault(100, None, lambda u: np.nan, Status.BAD_CONTROL),
}
RECOVERED = 2000  # Samples after a fault, 0.2 s, by when every kind has forgotten it.


@kinds
@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_faults_are_reported_and_forgotten(kind, fault):
    if kind.name == "low-pass" and fault.flag == Status.OUTLIER:
        pytest.skip("a low-pass has no idea of what an outlier is")
    y, u = RECORD["y"].copy(), RECORD["u"].copy()
    during = slice(2000, 2000 + fault.samples)
    if fault.y:
        y[during] = fault.y(y[during])
    if fault.u:
        u[during] = fault.u(u[during])
    calm = kind.make(BEARING).run(RECORD)
    estimator = kind.make(BEARING)
    estimator.reset(estimator.initial_state(y))
    estimator.update(y[0])
    told, means = Status.OK, [estimator.mean]
    for k in range(1, len(y)):
        means.append(estimator.step(y[k], u[k - 1]))
        assert np.isfinite(means[-1]).all()
        told |= estimator.status
    assert told & fault.flag
    off = np.abs(np.array(means) - calm.mean)[during.stop + RECOVERED :]
    assert off[:, 0].max() < 1e-5
    assert off[:, 2].max() < 0.5


@kinds
def test_an_amplifier_at_its_end_is_reported_and_known(kind):
    """A controller that asks for more than there is, where the plant was given what there is."""
    weak = BEARING.replace(amplifier__current_limit=0.6)
    eager = ambkit.PID(kp=3000.0, kd=12.0, setpoint_weight=1.0)
    step = ambkit.Step(amplitude=3e-4, time=0.1)
    scenario = Scenario(duration=0.6, seed=5, reference=step, controller=eager)
    record = ambkit.simulate(weak, scenario).record
    u = record["u"].copy()
    at_limit = np.abs(u) >= 0.999 * weak.current_max / weak.amplifier.gain
    assert at_limit.sum() > 10
    u[at_limit] *= 3
    estimate = kind.make(weak).run(Record(record.t, {"y": record["y"], "u": u}))
    assert np.count_nonzero(estimate.status & Status.SATURATED) >= at_limit.sum()
    assert (estimate.mean == kind.make(weak).run(record).mean).all()


@kinds
def test_a_jump_of_the_magnet_constant_ends_nobody(kind):
    """Who has not learned k takes it for a load, which is then in f_d; the position stays."""
    T = BEARING.sampling_time
    scenario = Scenario(duration=0.8, seed=4, reference=ambkit.Sine(amplitude=2e-4, frequency=8.0))
    n = round(scenario.duration / T) + 1
    scale = np.where(np.arange(n) < 3000, 1.0, 0.7)
    run = simulate_run(BEARING, scenario, external_inputs=ExternalInputs(magnet_scale=scale))
    estimate = kind.make(BEARING).run(run.record)
    assert np.isfinite(estimate.mean).all()
    late = slice(3000 + RECOVERED, None)
    off = np.abs(estimate.x - run.record["x"])[late]
    assert off.max() < 5e-5


# ---- extended ----


def test_the_extended_filter_is_the_textbook_s():
    """Force in the mean, tangent in the covariance, written naively beside it."""
    law = ClosedLaw(BEARING)
    s = oracles.settings_of(BEARING)
    core = core_module()
    mean, std = np.array([2e-5, 0.01, -1.0, 1e-5]), np.array([3e-5, 0.012, 5.0, 3e-5])
    ekf = made(core, "Extended", law.in_core(core), s)
    ekf.reset(mean, std)
    out = ekf.run(RECORD["y"], RECORD["u"], covariance=True)
    x, P = mean.copy(), np.diag(std**2)
    known = KINDS["extended"].make(BEARING)
    magnet = law.in_core(core)
    for k in range(len(RECORD)):
        if k:
            iu = float(np.clip(s["k_ui"] * RECORD["u"][k - 1], s["iu_min"], s["iu_max"]))
            at = np.array([iu]), np.array([x[0] + x[1] * s["T"] / 2])
            force = float(magnet.force(*at)[0])
            k_i, k_s = (float(a[0]) for a in magnet.tangent(*at))
            model = known.linear_model(k_i, k_s)
            free = known.linear_model(0.0, 0.0)
            x = free.A @ x + free.E.ravel() * (force + s["f_0"])
            P = model.A @ P @ model.A.T + model.Q
        H = np.array([0, 0, 0, 1.0])
        S = H @ P @ H + s["var_y"]
        K = P @ H / S
        x = x + K * (RECORD["y"][k] - x[3])
        left = np.eye(4) - np.outer(K, H)
        P = left @ P @ left.T + s["var_y"] * np.outer(K, K)
        sigma = np.sqrt(np.diag(P))
        assert (np.abs(out["mean"][k] - x) <= 1e-9 * sigma).all()
    np.testing.assert_allclose(out["covariance"][-1], P[np.triu_indices(4)], rtol=1e-9)


# ---- observers ----


def linear_model():
    k = ConstantStiffness.of(BEARING)
    return KalmanFilter(BEARING).linear_model(k.k_i, k.k_s)


@pytest.mark.parametrize("lag", [2e-3, 2e-4, 1e-9])
def test_all_poles_of_the_observer_are_where_they_were_put(lag):
    bearing = BEARING.replace(sensor__lag=lag)
    observer = ExtendedStateObserver(bearing, bandwidth=800.0)
    k = ConstantStiffness.of(bearing)
    m = observer.linear_model(k.k_i, k.k_s)
    units = np.array(observer.default_std())
    small = m.scaled(units)
    error = (np.eye(4) - np.outer(observer.gain / units, small.H)) @ small.A
    poles = np.sort(np.linalg.eigvals(error))
    expected, own = np.exp(-bearing.sampling_time * np.array([800.0, 1 / lag]))
    # A pole of order four is found to the fourth root of what numbers have.
    assert np.abs(poles[-3:] - expected).max() < 3e-3
    assert np.abs(poles[0] - min(expected, own)) < 3e-3  # a sensor is not slowed down


def test_the_steady_state_gain_is_dlqe_s():
    control = pytest.importorskip("control")
    steady = SteadyStateKalmanFilter(BEARING)
    units = np.array(steady.default_std())
    m = linear_model().scaled(units)
    L, *_ = control.dlqe(m.A, np.eye(4), m.H, m.Q, np.array([[m.R]]))
    np.testing.assert_allclose(m.A @ (steady.gain / units), L.ravel(), rtol=1e-9)


def test_the_linear_filter_settles_to_the_steady_state():
    steady = SteadyStateKalmanFilter(BEARING)
    linear = KalmanFilter(BEARING)
    late = linear.run(RECORD, covariance=True)
    np.testing.assert_allclose(steady.core.covariance, linear.core.covariance, rtol=1e-6)
    estimate = steady.run(RECORD)
    assert estimate.innovation_variance[-1] == pytest.approx(late.innovation_variance[-1], rel=1e-9)
    far = np.abs(estimate.mean - late.mean)[-1000:] / np.sqrt(np.diag(steady.covariance))
    assert far.max() < 1e-3


# ---- low-pass ----


def test_the_low_pass_is_three_exponential_averages():
    low = KINDS["low-pass"].make(BEARING)
    out = low.run(RECORD)
    c, T, b = low.corners, BEARING.sampling_time, BEARING
    a = {name: 1 - np.exp(-corner * T) for name, corner in c.items()}
    k = ConstantStiffness.of(b)
    x, v, f = RECORD["y"][0] / b.sensor.gain, 0.0, 0.0
    for n in range(1, 300):
        iu = np.clip(b.amplifier.gain * RECORD["u"][n - 1], b.current_min, b.current_max)
        known = k.k_i * iu + k.k_s * x + b.weight
        dx = a["position"] * (RECORD["y"][n] / b.sensor.gain - x)
        dv = a["velocity"] * (dx / T - v)
        f += a["force"] * (b.rotor.mass * dv / T - known - f)
        x, v = x + dx, v + dv
        if n > 1:
            assert out.x[n] == pytest.approx(x, rel=1e-6)
    assert np.isnan(out.nis).all()


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("observer", {"bandwidth": 0.0}, "bandwidth must be greater than 0 rad/s, got 0.0"),
        ("observer", {"damping": math.inf}, "damping must be greater than 0, got inf"),
        ("low-pass", {"force": -1.0}, "force must be greater than 0 rad/s, got -1.0"),
    ],
)
def test_a_parameter_out_of_range_is_reported(name, options, message):
    with pytest.raises(ValueError, match=message):
        KINDS[name].make(BEARING, **options)


def test_settings_are_complete_and_known():
    core = core_module()
    s = oracles.settings_of(BEARING)
    model, given = core_model(core, s), core_settings(s)
    with pytest.raises(ValueError, match="the setting var_y is missing"):
        core.Kalman(core.Constant(1, 1), model, **{k: v for k, v in given.items() if k != "var_y"})
    with pytest.raises(ValueError, match="a setting that no estimator has"):
        core.Kalman(core.Constant(1, 1), model, **given, colour=1.0)
    with pytest.raises(ValueError, match="var_y has 2 samples, expected 1"):
        core.Kalman(core.Constant(1, 1), model, **given | {"var_y": [1e-10, 1e-10]})
    with pytest.raises(ValueError, match="2 magnets for 1 forces"):
        core.Kalman([core.Constant(1, 1)] * 2, model, **given)


def test_a_record_is_a_record_for_all():
    empty = Record(RECORD.t[:3], {"y": RECORD["y"][:3], "u": RECORD["u"][:3]})
    for kind in KINDS.values():
        if kind.magnet:
            assert len(kind.make(BEARING).run(empty).x) == 3


@kinds
def test_the_core_calls_it_as_the_registry_says(kind):
    core = Path(__file__).parents[1] / "core"
    estimator = kind.make(BEARING)
    assert core_kernel(estimator) is kind.core
    declared = "".join(file.read_text() for file in core.glob("include/ambkit/*.h"))
    for name in filter(None, (kind.core.methods, kind.core.state, kind.core.own)):
        assert re.search(rf"\b{name}\b", declared)
    for stem in (kind.core.source, *kind.core.calls):
        assert (core / "src" / f"{stem}.c").is_file()
    assert (kind.core.own != "") == bool(estimator.core.own)
