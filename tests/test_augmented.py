"""k as a fifth state: the textbook's filter in two stages; what it learns, and where it holds."""

import math

import numpy as np
import oracles
import pytest
from filter_cases import made, with_core_s_numbers
from filterpy.kalman import ExtendedKalmanFilter as Textbook
from magnet_scale_cases import BEARING, LOAD_AT, jump, quieter, rms, run

import ambkit
from ambkit import (
    AugmentedKalmanFilter,
    ClosedLaw,
    ExtendedKalmanFilter,
    Machine,
    MultipleModelFilter,
    Record,
    Status,
)
from ambkit.machine.magnets import core_module


def one_sided():
    bearing = Machine.preset("inteco_ml")
    controller = ambkit.PID.textbook(bearing).model_copy(update={"feedback": "measurement"})
    scenario = ambkit.Scenario(
        duration=1.0, controller=controller, reference=ambkit.Step(amplitude=1e-3, time=0.3)
    )
    return bearing, ambkit.simulate(bearing, scenario).record


@pytest.mark.parametrize("wander", [0.0, 0.1])
@pytest.mark.parametrize("bearing", ["two-sided", "one-sided"])
def test_it_is_the_extended_filter_of_the_augmented_state(bearing, wander):
    """filterpy's, in units of the standard deviations, with full 5 x 5 matrices."""
    b, record = one_sided() if bearing == "one-sided" else (BEARING, run(3e-4))
    record = Record(record.t[:900], {s: record[s][:900] for s in ("y", "u")})
    mine = AugmentedKalmanFilter(b, excitation=math.inf, wander=wander, scale_std=0.2)
    estimate = mine.run(record, covariance=True)
    assert not (estimate.status & Status.UNEXCITED).any()

    mine.engine.model = with_core_s_numbers(mine.model, mine.core.parameters)
    s, law = oracles.settings_of(b), ClosedLaw(b)
    magnet, bias = law.in_core(core_module()), law.bias_force
    D = np.array([*mine.default_std(), 0.2])
    ekf = Textbook(5, 1)
    ekf.x, ekf.P, ekf.R = np.array([*estimate_start(b, record), 1.0]) / D, np.eye(5), s["var_y"]
    H = np.array([[0, 0, 0, 1.0, 0]]) * D
    for k in range(len(record)):
        if k:
            iu = float(np.clip(s["k_ui"] * record["u"][k - 1], s["iu_min"], s["iu_max"]))
            X = ekf.x * D
            at = np.array([iu]), X[:1] + X[1:2] * s["T"] / 2
            known = float(magnet.force(*at)[0]) + bias
            k_i, k_s = (X[4] * float(a[0]) for a in magnet.tangent(*at))
            model = mine.linear_model(k_i, k_s)
            free = mine.linear_model(0.0, 0.0)
            A, Q = np.eye(5), np.zeros((5, 5))
            A[:4, :4], A[:4, 4:], Q[:4, :4] = model.A, model.E * known, model.Q
            Q[4, 4] = wander * s["T"] if ekf.P[4, 4] < 1.0 else 0.0
            X[:4] = free.A @ X[:4] + free.E.ravel() * (X[4] * known + s["f_0"] - bias)
            ekf.x = X / D
            F = A * D / D[:, None]
            ekf.P = F @ ekf.P @ F.T + Q / np.outer(D, D)
        innovation = record["y"][k] - D[3] * ekf.x[3]
        S = float((H @ ekf.P @ H.T).item()) + s["var_y"]
        ekf.update(record["y"][k : k + 1], lambda _: H, lambda x: H @ x)
        sigma = np.sqrt(np.diag(ekf.P))
        assert (np.abs(estimate.mean[k] / D[:4] - ekf.x[:4]) <= 1e-9 * sigma[:4]).all()
        assert abs(estimate.scale[k] - D[4] * ekf.x[4]) <= 1e-9 * D[4] * sigma[4]
        assert abs(estimate.innovation[k] - innovation) <= 1e-9 * math.sqrt(S)
        assert estimate.innovation_variance[k] == pytest.approx(S, rel=1e-9)
    P = ekf.P[:4, :4] * np.outer(D, D)[:4, :4]
    np.testing.assert_allclose(estimate.covariance[-1], P[np.triu_indices(4)], rtol=1e-8)
    assert estimate.scale_variance[-1] == pytest.approx(ekf.P[4, 4] * 0.04, rel=1e-9)


def estimate_start(bearing, record):
    first = float(record["y"][0])
    return first / bearing.sensor.gain, 0.0, 0.0, first


def test_without_its_care_it_would_drift():
    record = run(0.0, load=0.0)
    eager = AugmentedKalmanFilter(BEARING, excitation=math.inf).run(record)
    assert eager.scale[-1] > 1.5
    assert rms(eager, record) > 3 * rms(ExtendedKalmanFilter(BEARING).run(record), record)


def test_a_right_k_stays_right():
    record = run(3e-4, 1)
    known = rms(ExtendedKalmanFilter(BEARING).run(record), record, since=LOAD_AT)
    estimate = AugmentedKalmanFilter(BEARING).run(record)
    assert rms(estimate, record, since=LOAD_AT) < 1.1 * known
    assert abs(estimate.scale[-1] - 1) < 0.05


def test_single_precision_finds_the_same():
    record = run(3e-4, 2)
    double, single = (
        AugmentedKalmanFilter(BEARING, precision=p).run(record) for p in ("float64", "float32")
    )
    assert abs(float(single.scale[-1]) - double.scale[-1]) < 0.01


def test_metres_and_micrometres_give_one_answer():
    """Nothing in the numerics knows an absolute size."""
    core, record, magnet = core_module(), run(3e-4), BEARING.magnet
    learn = {"bias": np.zeros(1), "fresh": 0.012, "least": 0.108}
    own = {
        "Kalman": {},
        "Extended": {},
        "Unscented": {"reach": 3**0.5, "curvature": 2.0},
        "Augmented": {"std": 0.2, "var_k": 1e-6, "min": 0.2, "max": 5.0, **learn},
        "MultipleModel": {"theta": np.array([0.7, 0.85, 1.0, 1.15, 1.3]), "leave": 1e-4, **learn},
    }

    def means(name, um):
        s, k = oracles.settings_of(BEARING), magnet.magnet_constant
        s |= {"m": s["m"] / um, "var_y": s["var_y"] * um**2, "x_max": s["x_max"] * um}
        law = core.Law(
            "closed",
            k=k * um**2,
            s0=magnet.air_gap * um,
            i0=magnet.bias_current,
            two_sided=True,
            ampere=1.0,
            metre=1e-3 * um,
        )
        estimator = made(core, name, law, s, **own[name])
        length = np.array([um, um, 1.0, um])
        estimator.reset(np.zeros(4), length * np.array([3e-5, 1e-2, 5.0, 3e-5]))
        return estimator.run(record["y"] * um, record["u"])["mean"] / length

    for name in own:
        metres, micrometres = means(name, 1.0), means(name, 1e6)
        scale = np.abs(metres).max(axis=0)
        assert (np.abs(micrometres - metres) < 1e-12 * scale).all()


# --- what the interacting multiple models do as well

BOTH = [AugmentedKalmanFilter, MultipleModelFilter]


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("wrong", [1 / 1.3, 1 / 0.7])
def test_most_of_the_lost_accuracy_comes_back(kind, wrong, seed):
    """k 30 % off and four steps of 0.3 mm, then the load: 80 % of what it costs, at least."""
    record, mistaken = run(3e-4, seed), quieter(1.0, wrong)
    estimators = ExtendedKalmanFilter(BEARING), ExtendedKalmanFilter(mistaken), kind(mistaken)
    right, lost, found = (rms(e.run(record), record, since=LOAD_AT) for e in estimators)
    assert lost > 1.4 * right
    assert (lost - found) / (lost - right) > 0.8


@pytest.mark.parametrize("noise", [1.0, 0.01])
@pytest.mark.parametrize("load", [0.0, 3.0, -3.0])
@pytest.mark.parametrize("wrong", [1 / 1.3, 1.0, 1 / 0.7])
def test_at_rest_they_say_so_and_do_no_harm(wrong, load, noise):
    """A bearing that hangs, and a load on it: not to be told from another k, and left alone."""
    record, mistaken = run(0.0, load=load, noise=noise), quieter(noise, wrong)
    plain = ExtendedKalmanFilter(mistaken).run(record)
    careful = AugmentedKalmanFilter(mistaken).run(record)
    assert (careful.status & Status.UNEXCITED).all()
    assert (careful.mean == plain.mean).all()
    assert (careful.scale == 1.0).all()
    models = MultipleModelFilter(mistaken).run(record)
    assert (models.status & Status.UNEXCITED).all()
    for name in ("x", "f_d") if noise == 1.0 else ():
        assert rms(models, record, name) < 1.01 * rms(plain, record, name)
    assert models.scale == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(("kind", "factor", "within", "error"), [
    (AugmentedKalmanFilter, 1.3, 0.5, 0.15), (AugmentedKalmanFilter, 0.7, 1.4, 0.15),
    (MultipleModelFilter, 1.3, 0.5, 0.1), (MultipleModelFilter, 0.7, 0.9, 0.1),
])  # fmt: skip
def test_a_jump_of_k_in_flight_is_found(kind, factor, within, error):
    """While the rotor goes to and fro by 0.1 mm; the load then is the rotor's own."""
    record = jump(factor)
    estimate = kind(BEARING).run(record)
    after = record.t >= 1.0 + within
    assert np.abs(estimate.scale[after] / factor - 1).max() < error
    plain = ExtendedKalmanFilter(BEARING).run(record)
    assert rms(estimate, record, since=2.0) < 0.6 * rms(plain, record, since=2.0)


@pytest.mark.parametrize(("kind", "options", "message"), [
    (AugmentedKalmanFilter, {"scale_std": 0.0}, "scale_std must be greater than 0, got 0.0"),
    (AugmentedKalmanFilter, {"wander": -1.0}, "wander must be 0 1/s or more, got -1.0"),
    (AugmentedKalmanFilter, {"least": 1.5}, "limits must be 0 < least <= 1 <= most, got 1.5, 5.0"),
    (AugmentedKalmanFilter, {"excitation": 0.0}, "excitation must be greater than 0, got 0.0"),
    (MultipleModelFilter, {"scales": (1.0,)}, "scales must be 2 to 5 positive numbers, got"),
    (MultipleModelFilter, {"scales": (1.0, math.nan)}, "scales must be 2 to 5 positive numbers"),
    (MultipleModelFilter, {"sojourn": 0.0}, "sojourn must be two samples or more"),
])  # fmt: skip
def test_a_parameter_out_of_range_is_reported(kind, options, message):
    with pytest.raises(ValueError, match=message):
        kind(BEARING, **options)
