"""Any model by loops: the paper's axis to the bit, and models with more states by the textbook."""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from filter_cases import BEARING, Array, full, made, with_core_s_numbers
from filterpy.kalman import KalmanFilter as Textbook
from oracles import settings_of
from quick import quick
from scipy.stats import chi2

import ambkit
from ambkit import ClosedLaw, Scenario, Status
from ambkit.estimate import estimator as base
from ambkit.estimate.core_model import Engine, arrays
from ambkit.estimate.registry import KINDS
from ambkit.machine import presets
from ambkit.machine.accessories import ColouredNoise, Hum
from ambkit.machine.magnets import ConstantStiffness, core_module
from ambkit.models.machine_parts import paper_pattern

# ---- the paper's axis: to the bit ----


class BuiltIn(Engine):
    """The paper's axis as ever; gains are computed from the numbers of the built-in model."""

    def __init__(self, bearing, precision, *, as_printed=False, **options):
        super().__init__(bearing, precision, as_printed=as_printed, **options)
        core = core_module(precision)
        s = settings_of(bearing.isolated_axis("")) | {"as_printed": as_printed}
        known = made(core, "Kalman", core.Constant(1.0, 1.0), s)
        self.model = with_core_s_numbers(self.model, known.parameters)


class ByLoops(BuiltIn):
    """The same numbers as arrays."""

    def __init__(self, bearing, precision, *, as_printed=False, **options):
        super().__init__(bearing, precision, as_printed=as_printed, **options)
        self.built_in, self.core = False, core_module(precision, any_model=True)
        self.model_of_core = self.core.Model(arrays(self.model))


def by(engine, monkeypatch, name, **options):
    """An estimator of a kind that computes so; a kind without a magnet asks the closed law."""
    monkeypatch.setattr(base, "Engine", engine)
    magnet = ClosedLaw(BEARING) if KINDS[name].magnet is None else None
    return KINDS[name].make(BEARING, magnet, **options)


@cache
def with_faults():
    """y and u with gaps, spikes, a frozen sensor, bad controls, an amplifier at its end.

    And of each enough to see filters start afresh and come back.
    """
    scenario = Scenario(
        duration=0.8,
        seed=5,
        reference=ambkit.Sine(amplitude=3e-4, frequency=6.0),
        disturbance=ambkit.Step(amplitude=2.0, time=0.3),
    )
    record = ambkit.simulate(BEARING, scenario).record
    y, u = record["y"].copy(), record["u"].copy()
    y[400:420] = np.nan
    y[800:1000:17] += 7e-4
    y[1500:1900] = y[1500]
    u[2300:2310], u[2400:2420] = np.nan, -np.inf
    u[2600:2640] *= 30
    y[3000:4500] = np.inf
    y[5200:5300] += 6e-4
    y[6000:6003], y[6500] = -1e3, -np.inf
    return y, u


def same_bits(ours, theirs):
    assert set(ours) == set(theirs)
    for name, values in ours.items():
        assert values.dtype == theirs[name].dtype, name
        assert values.tobytes() == theirs[name].tobytes(), name


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", [n for n in KINDS if n != "constant-velocity"])  # own model
def test_of_the_paper_s_axis_it_has_the_same_bits(name, precision, monkeypatch):
    y, u = (values.astype(precision) for values in with_faults())
    straight = by(BuiltIn, monkeypatch, name, precision=precision)
    loops = by(ByLoops, monkeypatch, name, precision=precision)
    assert type(loops.core).__module__ != type(straight.core).__module__
    history = straight.core.run(y, u, covariance=True)
    same_bits(loops.core.run(y, u, covariance=True), history)
    assert loops.covariance.tobytes() == straight.covariance.tobytes()
    seen = Status(int(np.bitwise_or.reduce(history["status"])))
    assert seen & Status.MISSING
    assert seen & Status.FROZEN
    assert seen & Status.BAD_CONTROL
    assert seen & Status.SATURATED
    if name not in ("low-pass", "observer"):
        assert seen & Status.OUTLIER
        # A constant gain does not start afresh.
        assert seen & (Status.HELD if name == "steady-state" else Status.RESTARTED)
    ahead = [e.core.forecast(history["mean"], u, 20) for e in (loops, straight)]
    assert ahead[0].tobytes() == ahead[1].tobytes()
    if straight.can_smooth:
        for e in (loops, straight):
            e.reset()
        same_bits(loops.core.smooth(y, u), straight.core.smooth(y, u))


@pytest.mark.parametrize("name", ["linear", "extended", "ud", "unscented"])
def test_as_printed_it_has_them_as_well(name, monkeypatch):
    y, u = with_faults()
    both = [by(engine, monkeypatch, name, as_printed=True) for engine in (ByLoops, BuiltIn)]
    same_bits(*(e.core.run(y, u, covariance=True) for e in both))


def test_many_along_one_record_are_each_on_its_own(monkeypatch):
    """Without lanes, by threads."""
    y, u = with_faults()
    noises = [ambkit.FilterNoise(disturbance=d) for d in (1.0, 30.0, 1000.0)]
    each = [by(ByLoops, monkeypatch, "extended", noise=noise) for noise in noises]
    batch = ambkit.run_many(each, y, u, threads=2)
    assert batch.mean is not None
    for mean, estimator in zip(batch.mean, each, strict=True):
        estimator.reset(estimator.equilibrium_state(y[0] / BEARING.sensor.gain, y[0]))
        assert (mean == estimator.core.run(y, u)["mean"]).all()


# ---- more states: by the textbook ----


T = BEARING.sampling_time
BANDWIDTH = {"amplifier__bandwidth": 2000.0}
COLOURED = {"sensor__coloured_noise": ColouredNoise(variance=(4e-6) ** 2, bandwidth=200.0)}
HUM = {"sensor__hum": (Hum(frequency=50.0, amplitude=5e-6, bandwidth=0.5),)}


class Case(NamedTuple):
    """Keys that a bearing has beside the paper's, and the states that they add."""

    keys: dict[str, Any]
    states: str


CASES = {
    "bandwidth": Case(BANDWIDTH, "i"),
    "delay 0.3 T": Case({"delay": 0.3 * T}, "u_1"),
    "delay 1.0 T": Case({"delay": 1.0 * T}, "u_1"),
    "delay 1.5 T": Case({"delay": 1.5 * T}, "u_1 u_2"),
    "coloured noise": Case(COLOURED, "n_y"),
    "hum": Case(HUM, "hum_c hum_s"),
    "all": Case(BANDWIDTH | COLOURED | HUM | {"delay": 1.5 * T}, "i u_1 u_2 n_y hum_c hum_s"),
}
cases = pytest.mark.parametrize("case", CASES)
those_of_kinds = pytest.mark.parametrize(("case", "kind"), quick(
    product(CASES, ("linear", "extended")),
    {("all", "linear"), ("all", "extended"), ("delay 1.5 T", "linear"), ("hum", "extended")},
))  # fmt: skip

SAMPLES, SEEDS = 3000, 20
SURE = {
    "position": 1e-5, "velocity": 1e-3, "disturbance force": 0.3, "sensor": 1e-5,
    "current": 0.01, "past control": 0.01,
}  # fmt: skip
"""Standard deviations at the start, by role; of noise, its own."""


@cache
def estimator_of(case, kind):
    bearing = BEARING.replace(**CASES[case].keys)
    magnet = ClosedLaw(BEARING)
    if kind == "linear":
        magnet = ConstantStiffness.of(BEARING)
    noise = ambkit.FilterNoise(disturbance=4.0)
    return KINDS[kind].make(bearing, magnet, noise=noise)


def start_std(estimator):
    return np.array([SURE.get(state.role, state.size) for state in estimator.states])


@dataclass(frozen=True)
class Motion:
    """What the model itself did; n samples."""

    X: Array  # (n, states)
    y: Array
    u: Array


@cache
def motions(case, kind):
    """Drawn from the model: control by a PD controller that sees the state, and noise; by seed."""
    e, rng = estimator_of(case, kind), np.random.default_rng(12)
    model, s = e.model, e.core.parameters["set"]
    magnet = e.magnet.in_core(core_module())
    k = ConstantStiffness.of(BEARING)
    k_ui, expected = float(s["k_ui"][0]), 200.0
    kp = (k.k_s + BEARING.rotor.mass * expected**2) / k.k_i
    kd = 1.4 * expected * BEARING.rotor.mass / k.k_i
    at = [model.index(name) for name in ("x", "v", "f_d")]
    # Of each source of noise a root; the eigenvalues that rounding makes negative are none.
    roots = []
    for N, variance in zip(model.N, s["var_d"], strict=True):
        d = np.sqrt(np.where(np.diag(N) > 0, np.diag(N), 1.0))
        values, vectors = np.linalg.eigh(N / np.outer(d, d))
        roots.append(d[:, None] * vectors * np.sqrt(np.maximum(values, 0) * variance))
    X = rng.normal(0, start_std(e), (SEEDS, len(e.states)))
    all_X, all_y, all_u = [], [], []
    for n in range(SAMPLES):
        all_X.append(X)
        all_y.append(X @ model.c[0] + rng.normal(0, np.sqrt(s["var_y"][0]), SEEDS))
        x, v, f_d = X.T[at]
        r = 2e-4 * np.sin(2 * np.pi * 8.0 * n * T)
        demanded = kp * (r - x) - kd * v + (k.k_s * -r - f_d - s["f_0"][0]) / k.k_i
        all_u.append(demanded / k_ui)
        iu = demanded + k_ui * rng.normal(0, np.sqrt(s["var_u"][0]), SEEDS)
        current, displacement = X @ model.e[0] + model.d[0, 0] * iu, X @ model.h[0]
        F = magnet.force(current, displacement) + s["f_0"] + X @ model.r[0]
        X = X @ model.L.T + np.outer(iu, model.B_u[:, 0]) + np.outer(F, model.b[:, 0])
        for root in roots:
            X = X + rng.normal(size=X.shape) @ root.T
    series = (np.stack(all_of, axis=1) for all_of in (all_X, all_y, all_u))
    return [Motion(*of_seed) for of_seed in zip(*series, strict=True)]


@cases
def test_its_states_are_those_of_its_parts(case):
    e = estimator_of(case, "linear")
    assert not e.engine.built_in
    added = {state.name for state in e.states} - {"x", "v", "f_d", "x_m"}
    assert added == set(CASES[case].states.split())


def test_a_model_is_built_in_where_its_pattern_is_whatever_its_numbers():
    """It is asked once for a structure; presets, and numbers that are one, or make parts vanish."""
    changes = [{}, {"sensor__gain": 1.0}, {"sensor__gain": 1.3}, {"sensor__lag": 1e-4},
               {"amplifier__bandwidth": 800.0}, {"delay": 70e-6}]  # fmt: skip
    seen = set()
    for name in presets.names():
        for axis in (machine := ambkit.preset(name)).axes:
            for change in changes:
                engine = Engine(machine.isolated_axis(axis.name).replace(**change), "float64")
                own, pattern = paper_pattern(), engine.model.pattern
                alike = [np.array_equal(own[key], item) for key, item in pattern.items()]
                assert engine.built_in == all(alike), (name, axis.name, change)
                seen.add(engine.built_in)
    assert seen == {False, True}


@those_of_kinds
def test_it_is_the_textbook_s_with_full_matrices(case, kind):
    """filterpy's, on the estimator's matrices; the extended one's mean by the force itself."""
    e, m = estimator_of(case, kind), motions(case, kind)[0]
    s, model, n = e.core.parameters["set"], e.model, len(e.states)
    magnet, std = e.magnet.in_core(core_module()), start_std(e)
    e.core.reset(np.zeros(n), std)
    ours = e.core.run(m.y, m.u, covariance=True)
    assert not ours["status"].any()
    triangle = np.triu_indices(n)

    kf = Textbook(dim_x=n, dim_z=1)  # in units of the standard deviations
    kf.x, kf.P = np.zeros((n, 1)), np.eye(n)
    kf.R = np.array([[s["var_y"][0]]])
    kf.H = model.c * std
    for k in range(SAMPLES):
        if k:
            X, iu = kf.x[:, 0] * std, np.clip(s["k_ui"] * m.u[k - 1], s["iu_min"], s["iu_max"])
            at = model.e @ X + model.d @ iu, model.h @ X
            k_i, k_s = (float(a[0]) for a in magnet.tangent(*at))
            step = e.linear_model(k_i, k_s).scaled(std)
            if kind == "linear":
                kf.predict(
                    F=step.A, Q=step.Q, B=np.hstack([step.B, step.E]),
                    u=np.array([[m.u[k - 1]], [s["f_0"][0]]]),
                )  # fmt: skip
            else:
                F = magnet.force(*at) + s["f_0"] + model.r @ X
                kf.predict(F=step.A, Q=step.Q)
                kf.x = ((model.L @ X + model.B_u @ iu + model.b @ F) / std)[:, None]
        kf.update(m.y[k])
        sigma = np.sqrt(np.diag(kf.P))
        assert (np.abs(ours["mean"][k] / std - kf.x[:, 0]) <= 1e-8 * sigma).all(), k
        if k % 100 == 0:
            P = ours["covariance"][k] / np.outer(std, std)[triangle]
            assert (np.abs(P - kf.P[triangle]) <= 1e-8 * np.outer(sigma, sigma)[triangle]).all(), k
        assert ours["variance"][k] == pytest.approx(kf.S.item(), rel=1e-8)


@those_of_kinds
def test_on_what_the_model_did_it_is_as_good_as_it_says(case, kind):
    """NIS and NEES over 20 seeds, within what chance makes of them once in 10,000 times."""
    e = estimator_of(case, kind)
    n, std = len(e.states), start_std(e)
    looked_at = np.arange(0, SAMPLES, 500)[1:]
    nis, nees = [], np.zeros(looked_at.size)
    for m in motions(case, kind):
        e.core.reset(np.zeros(n), std)
        ours = e.core.run(m.y, m.u, covariance=True)
        assert not ours["status"].any()
        nis.append(ours["innovation"] ** 2 / ours["variance"])
        error = ((ours["mean"] - m.X) / std)[looked_at]
        P = full(ours["covariance"][looked_at]) / np.outer(std, std)
        nees += np.einsum("ki,ki->k", error, np.linalg.solve(P, error[..., None])[..., 0])
    count = np.size(nis)
    low, high = chi2.ppf([0.5e-4, 1 - 0.5e-4], count) / count
    assert low < np.mean(nis) < high
    # Five times at which each is looked at, some 50 ms apart.
    low, high = chi2.ppf([1e-5, 1 - 1e-5], n * SEEDS) / SEEDS
    assert (nees / SEEDS > low).all()
    assert (nees / SEEDS < high).all()
    # And together they tell more than each.
    low, high = chi2.ppf([0.5e-4, 1 - 0.5e-4], n * nees.size * SEEDS) / (n * nees.size * SEEDS)
    assert low < nees.sum() / (n * nees.size * SEEDS) < high
