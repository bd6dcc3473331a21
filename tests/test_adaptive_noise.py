"""Noise found online: by the rules, from wrong starts, and not from what is no noise."""

from functools import cache

import numpy as np
import oracles
import pytest
from filter_cases import SETTINGS, START, STD, made, moving_record

import ambkit
from ambkit import AdaptiveNoise, FilterNoise, Machine, Record, Scenario, Status
from ambkit.estimate.registry import KINDS
from ambkit.machine.magnets import core_module

BEARING = Machine.preset("zittau_axial")
R = BEARING.sensor.noise_variance
GROWTH = 1.0  # N^2/s


@cache
def wandering(duration, seed=1):
    """A load that is a random walk, beside a swing."""
    T = BEARING.sampling_time
    t = T * np.arange(round(duration / T) + 1)
    steps = np.random.default_rng(seed).normal(0, np.sqrt(GROWTH * T), t.size)
    walk = np.cumsum(steps) - steps[0]
    scenario = Scenario(
        duration=duration,
        seed=seed,
        reference=ambkit.Sine(amplitude=1e-4, frequency=2.0),
        disturbance=ambkit.Recorded(times=t, values=walk),
    )
    return ambkit.simulate(BEARING, scenario).record


def found(kind, *, noise=(1.0, 1.0), precision="float64", record=None, **options):
    """What is found each 0.1 s, R and growth as multiples of the truth, from multiples of it."""
    record = record or wandering(6.0)
    inner = KINDS[kind].make(
        BEARING,
        noise=FilterNoise(measurement=noise[0] * R, disturbance=noise[1] * GROWTH),
        precision=precision,
    )
    estimator = AdaptiveNoise(inner, **options)
    whole = estimator.run(record)
    y, u = record["y"], record["u"]
    estimator.reset([y[0], 0, 0, y[0]])
    estimator.update(y[0])
    every, seen = 1000, []
    for k in range(1, len(y) - every + 1, every):
        # Of a run the first sample is only taken in; so it is repeated as a step of its own.
        estimator.step(y[k], u[k - 1])
        estimator.core.predict(u[k])
        estimator.core.run(y[k + 1 : k + every], u[k + 1 : k + every])
        seen.append((estimator.noise.measurement / R, estimator.noise.disturbance / GROWTH))
    return np.array(seen), whole


COVARIANCE_KINDS = (
    "linear", "closed-law", "extended", "ud", "unscented", "augmented", "multiple-model",
)  # fmt: skip


class Textbook(oracles.Kalman):
    """The filter of eq. 9-13, and the rules of Mehra, of Sage and Husa beside it."""

    def __init__(self, own):
        super().__init__(dict(SETTINGS), START, STD)
        self.own, self.nominal = own, dict(SETTINGS)
        self.d, self.sum, self.expected, self.n = own["first_share"], 0.0, 0.0, 0

    def take(self, y):
        before, P = self.X.copy(), self.P.copy()
        self.update(y)
        # K e e' K' and its expectation P - P+, of the third state.
        self.sum += self.X[2] - before[2]
        self.expected += P[2, 2] - self.P[2, 2]
        self.n += 1
        most = self.own["most"]
        if self.own["measurement"]:
            R = self.s["var_y"]
            new = R + self.d * R / self.S * (self.innovation**2 - self.S)
            self.s["var_y"] = np.clip(
                new, self.nominal["var_y"] / most, self.nominal["var_y"] * most
            )
        if self.n == self.own["window"]:
            if self.own["disturbance"] and self.expected > 0:
                Q, N = self.s["var_d"], self.n
                d = min(self.d * N, 0.5)
                new = Q + d * N * Q / self.expected * (self.sum**2 - self.expected) / N
                self.s["var_d"] = np.clip(
                    new, self.nominal["var_d"] / most, self.nominal["var_d"] * most
                )
            self.sum, self.expected, self.n = 0.0, 0.0, 0
        b = 1 - self.own["share"]
        self.d = max(self.own["share"], self.d / (self.d + b))


@pytest.mark.parametrize("window", [1, 7])
@pytest.mark.parametrize("finds", [(True, False), (False, True), (True, True)])
@pytest.mark.parametrize("first", [1e-3, 0.05])
def test_it_is_the_textbook_s(window, finds, first):
    core = core_module()
    own = {"measurement": finds[0], "disturbance": finds[1], "share": 1e-3, "first_share": first,
           "most": 3.0, "window": window}  # fmt: skip
    inner = made(core, "Kalman", core.Constant(10.05, 7537.5), SETTINGS)
    kf = core.AdaptiveNoise(inner, **own)
    assert kf.own == own
    kf.reset(START, STD)
    naive = Textbook(own)
    record = moving_record(0.08, seed=2)
    for k in range(len(record["y"])):
        if k:
            kf.predict(record["u"][k - 1])
            naive.predict(10.05, 7537.5, record["u"][k - 1])
        kf.update(record["y"][k])
        naive.take(record["y"][k])
        assert np.ravel(kf.noise) == pytest.approx((naive.s["var_y"], naive.s["var_d"]), rel=1e-8)
        assert (np.abs(kf.mean - naive.X) <= 1e-8 * np.sqrt(np.diag(naive.P))).all()
    changed = np.ravel(kf.noise) / [SETTINGS["var_y"], SETTINGS["var_d"]] != 1
    assert tuple(changed) == finds


@pytest.mark.parametrize("kind", COVARIANCE_KINDS)
@pytest.mark.parametrize("wrong", [0.1, 10.0])
@pytest.mark.parametrize("method", ["innovation", "sage-husa"])
def test_a_wrong_r_is_found_in_3_s(kind, wrong, method):
    seen, whole = found(kind, noise=(wrong, 1.0), method=method)
    assert abs(seen[30, 0] - 1) < 0.05
    assert np.abs(seen[40:, 0] - 1).max() < 0.05
    assert (seen[:, 1] == 1).all()
    nis = whole.nis[1:]
    if method == "innovation":  # the other one has learned by then
        assert np.mean(nis[:500]) < 0.3 if wrong > 1 else np.mean(nis[:500]) > 3
    assert np.mean(nis[40_000:]) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("adapts", ["measurement", "both"])
def test_what_is_right_stays_right(adapts):
    seen, whole = found("extended", adapts=adapts)
    assert np.abs(seen[:, 0] - 1).max() < 0.05
    assert ((seen[:, 1] > 0.5) & (seen[:, 1] < 2)).all()
    assert not (whole.status & Status.NOISE_LIMIT).any()


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("wrong", [0.1, 10.0])
def test_a_wrong_growth_is_found_in_3_s(wrong, precision):
    seen, _ = found("extended", noise=(1.0, wrong), adapts="disturbance", precision=precision)
    assert seen[30:, 1].mean() == pytest.approx(1, abs=0.25)
    assert ((seen[30:, 1] > 0.5) & (seen[30:, 1] < 2)).all()
    assert (np.abs(seen[:, 0] - 1) < 1e-6).all()


@pytest.mark.parametrize("wrong", [(0.1, 0.1), (0.1, 10.0), (10.0, 0.1), (10.0, 10.0)])
def test_over_a_window_both_are_reported_apart(wrong):
    seen, whole = found("extended", noise=wrong, adapts="both")
    assert np.abs(seen[35:, 0] - 1).max() < 0.06
    assert ((seen[35:, 1] > 0.5) & (seen[35:, 1] < 2)).all()
    assert np.mean(whole.nis[40_000:]) == pytest.approx(1, abs=0.05)


def test_sample_by_sample_the_growth_hardly_shows():
    """Why there is a window."""
    by_sample, _ = found("extended", noise=(1, 10), adapts="disturbance", method="sage-husa")
    by_window, _ = found("extended", noise=(1, 10), adapts="disturbance")
    assert by_sample[-1, 1] > 4
    assert by_window[-1, 1] < 2


@pytest.mark.parametrize("kind", ["linear-adaptive-noise", "extended-adaptive-noise"])
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_sensor_that_becomes_noisier_is_followed(kind, precision):
    calm = wandering(6.0)
    more = np.random.default_rng(2).normal(0, np.sqrt(3 * R), len(calm))
    y = calm["y"] + np.where(calm.t > 3.0, more, 0.0)
    record = Record(calm.t, {"y": y, "u": calm["u"]})
    estimator = KINDS[kind].make(
        BEARING, noise=FilterNoise(disturbance=GROWTH), precision=precision
    )
    estimate = estimator.run(record)
    assert estimator.noise.measurement == pytest.approx(4 * R, rel=0.06)
    assert np.mean(estimate.nis[30_000:31_000]) > 1.5
    assert np.mean(estimate.nis[45_000:]) == pytest.approx(1, abs=0.05)
    fixed = KINDS[kind.removesuffix("-adaptive-noise")].make(
        BEARING, noise=FilterNoise(disturbance=GROWTH)
    )
    late = slice(45_000, None)
    errors = [np.std((e.v - calm["v"])[late]) for e in (estimate, fixed.run(record))]
    assert errors[0] < errors[1]


def test_nothing_is_learned_from_what_is_not_used():
    estimator = AdaptiveNoise(ambkit.KalmanFilter(BEARING), adapts="both")
    record = wandering(6.0)
    y, u = record["y"], record["u"]
    estimator.reset([y[0], 0, 0, y[0]])
    for k in range(1, 300):
        estimator.step(y[k], u[k - 1])
    before = estimator.noise
    for k in range(300, 350):
        estimator.step(np.nan, u[k - 1])
        assert estimator.status & Status.MISSING
    for k in range(350, 353):
        estimator.step(0.9e-3 * (1 + 1e-3 * k), u[k - 1])
        assert estimator.status & Status.OUTLIER
    assert estimator.noise == before


def test_the_end_of_the_range_is_reported():
    seen, whole = found("linear", noise=(1e-3, 1.0), most=10.0)
    assert seen[:, 0].max() == pytest.approx(1e-2)
    assert seen[-1, 0] == pytest.approx(1e-2, rel=1e-3)  # what is found moves a little below it
    assert (whole.status[-1000:] & Status.NOISE_LIMIT).any()
    assert np.mean(whole.nis[-1000:]) > 2


def test_the_inner_filter_is_left_alone():
    inner = ambkit.KalmanFilter(BEARING, noise=FilterNoise(measurement=10 * R))
    state = inner.mean.copy(), inner.covariance.copy()
    estimator = AdaptiveNoise(inner)
    first = estimator.run(wandering(6.0))
    assert estimator.noise.measurement < 2 * R
    assert (inner.mean == state[0]).all()
    assert (inner.covariance == state[1]).all()
    estimator.reset()
    assert estimator.noise.measurement == pytest.approx(10 * R, rel=1e-12)
    assert (estimator.run(wandering(6.0)).mean == first.mean).all()


def test_it_can_be_smoothed():
    record = wandering(6.0)
    estimator = KINDS["extended-adaptive-noise"].make(BEARING)
    filtered, made = estimator.run(record), estimator.smooth(record)
    late = slice(30_000, 55_000)
    off = [np.std((e.f_d - record["f_d"])[late]) for e in (made, filtered)]
    assert off[0] < 0.8 * off[1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "mehra"}, "method must be one of innovation, sage-husa, got 'mehra'"),
        ({"adapts": "control"}, "adapts must be one of measurement, disturbance, both"),
        ({"method": "sage-husa", "adapts": "both"}, "cannot tell both noises apart"),
        ({"memory": 0.001}, "memory must be more than 100 samples, 0.01 s, got 0.001"),
        ({"memory": np.nan}, "memory must be"),
        ({"window": 1e-6}, "window must be from a sample, 0.0001 s, to half the memory"),
        ({"window": 0.3}, "window must be"),
        ({"most": 1.0}, "most must be greater than 1, got 1.0"),
    ],
)
def test_an_option_out_of_range_is_reported(options, message):
    with pytest.raises(ValueError, match=message):
        AdaptiveNoise(ambkit.KalmanFilter(BEARING), **options)


@pytest.mark.parametrize(
    "wrong",
    [
        {"measurement": False},
        *({"share": share} for share in (0.0, -1.0, np.nan, np.inf, 0.5, 1.0)),
        {"first_share": 1.0},
        *({"most": most} for most in (1.0, 0.0, np.nan, np.inf)),
        {"window": 0},
    ],
)
def test_the_core_takes_no_parameter_outside_its_range(wrong):
    core = ambkit.KalmanFilter(BEARING).core
    good = {
        "measurement": True, "disturbance": False, "share": 0.01, "first_share": 0.1, "most": 1e4,
        "window": 10,
    }  # fmt: skip
    around = core_module().AdaptiveNoise(core, **good)
    with pytest.raises(ValueError, match="outside its range"):
        core_module().AdaptiveNoise(core, **good | wrong)
    with pytest.raises(ValueError, match="outside its range"):  # has no room in itself
        core_module().AdaptiveNoise(around, **good)


def test_a_scale_of_the_magnet_is_still_told():
    record = wandering(6.0)
    inner = KINDS["augmented"].make(BEARING, noise=FilterNoise(disturbance=GROWTH))
    plain, around = inner.run(record), AdaptiveNoise(inner).run(record)
    assert around.scale_variance is not None
    assert np.abs(around.scale - plain.scale).max() < 0.05
    assert (around.scale_variance > 0).all()
    assert ambkit.KalmanFilter(BEARING).scale is None


def test_it_is_not_put_around_itself():
    with pytest.raises(ValueError, match="its noise is already estimated online"):
        AdaptiveNoise(KINDS["linear-adaptive-noise"].make(BEARING))


@pytest.mark.parametrize("name", ["low-pass", "observer", "steady-state"])
def test_what_has_no_noise_to_find_is_refused(name):
    with pytest.raises(ValueError, match="its noise cannot be estimated"):
        AdaptiveNoise(KINDS[name].make(BEARING))
