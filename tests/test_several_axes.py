"""Kinds on machines of several forces, loads and sensors: by the textbook, axis by axis."""

from itertools import product

import numpy as np
import pytest
from filter_cases import full
from machines import (
    BIAS,
    CORE,
    axes,
    axes_settings,
    axes_std,
    magnets,
    model_in_core,
    motion,
    random_machine,
    wide,
    with_roles,
)
from model_oracles import random_model, random_settings
from quick import quick

from ambkit import Status

LOADED = ("position", "velocity", "disturbance force", "noise", "disturbance force")
SEEDS = range(5)
BIASES = 0.4
THETAS = (0.7, 1.0, 1.3)


class Dense:
    """A linear machine with full matrices, and naive steps."""

    def __init__(self, model, s, settings):
        self.model, self.s, self.f_0 = model, s, np.array(settings["f_0"])
        self.var_noise, self.var_y = s.var_noise.copy(), s.var_y.copy()
        self.n, self.p, self.m = (
            len(of) for of in (model.states, model.forces, model.measurements)
        )

    def known(self, X, u):
        """Forces of the known magnets [N]."""
        m, iu = self.model, self.s.k_ui * u
        return self.s.k_i * (m.e @ X + m.d @ iu) + self.s.k_s * (m.h @ X)

    def predict(self, X, P, u, theta=1.0, bias=0.0):
        m, k_i = self.model, theta * self.s.k_i
        F = theta * (self.known(X, u) + bias) + (self.f_0 - bias) + m.r @ X
        A = m.jacobian(k_i, theta * self.s.k_s)
        Q = m.process_noise(k_i, self.s.k_ui**2 * self.s.var_u, self.var_noise)
        return m.L @ X + m.B_u @ (self.s.k_ui * u) + m.b @ F, A @ P @ A.T + Q

    def update(self, X, P, y):
        """One sensor after the other; also innovations and their variances."""
        e, S = np.zeros(self.m), np.zeros(self.m)
        for r, c in enumerate(self.model.c):
            e[r], S[r] = y[r] - c @ X, c @ P @ c + self.var_y[r]
            K = P @ c / S[r]
            X, P = X + K * e[r], P - np.outer(K, K) * S[r]
        return X, (P + P.T) / 2, e, S

    def motion(self, n, theta, seed):
        """Measurements (n, m) and controls (n, c) of the machine itself, magnets of this scale."""
        rng, s = np.random.default_rng(seed), self.s
        X, y, u = np.zeros(self.n), np.zeros((n, self.m)), rng.normal(0, 1, (n, len(s.k_ui)))
        for k in range(n):
            y[k] = self.model.c @ X + rng.normal(0, np.sqrt(s.var_y))
            X, Q = self.predict(X, np.zeros((self.n, self.n)), u[k], theta, BIASES)
            X = X + rng.multivariate_normal(np.zeros(self.n), Q, method="eigh")
        return y, u


def constants(s):
    return [CORE.Constant(*k) for k in zip(s.k_i.tolist(), s.k_s.tolist(), strict=True)]


def case(seed, theta=1.2, n=300):
    model, s = random_machine(seed, LOADED)
    settings = wide(model, s)
    dense = Dense(model, s, settings)
    return dense, settings, *dense.motion(n, theta, seed)


def close(ours, theirs, sigma):
    assert (np.abs(ours - theirs) <= 1e-8 * sigma).all()


# ---- the magnets' scale ----


@pytest.mark.parametrize("seed", SEEDS)
def test_the_augmented_filter_is_the_textbook_s_with_the_scale_as_a_state(seed):
    dense, settings, y, u = case(seed)
    n, p = dense.n, dense.p
    ours = CORE.Augmented(
        constants(dense.s), model_in_core(dense.model), bias=np.full(p, BIASES), std=0.3,
        var_k=1e-5, min=1e-3, max=1e3, fresh=0.1, least=0.0, **settings,
    )  # fmt: skip
    ours.reset(np.zeros(n), np.ones(n))
    got = ours.run(y, u, covariance=True)
    X, P = np.r_[np.zeros(n), 1.0], np.diag(np.r_[np.ones(n), 0.3**2])
    m = dense.model
    for k in range(len(y)):
        if k:
            A, Q = np.eye(n + 1), np.zeros((n + 1, n + 1))
            theta, known = X[n], dense.known(X[:n], u[k - 1]) + BIASES
            A[:n, :n], A[:n, n] = m.jacobian(theta * dense.s.k_i, theta * dense.s.k_s), m.b @ known
            mean, Q[:n, :n] = dense.predict(X[:n], np.zeros((n, n)), u[k - 1], theta, BIASES)
            Q[n, n] = 1e-5 * (P[n, n] < 0.3**2)
            X, P = np.r_[mean, theta], A @ P @ A.T + Q
        for r, c in enumerate(m.c):
            H = np.r_[c, 0.0]
            S = H @ P @ H + dense.s.var_y[r]
            K = P @ H / S
            assert got["innovation"][k, r] == pytest.approx(y[k, r] - H @ X, abs=1e-8 * S**0.5)
            assert got["variance"][k, r] == pytest.approx(S, rel=1e-8)
            X, P = X + K * (y[k, r] - H @ X), P - np.outer(K, K) * S
        sigma = np.sqrt(np.diag(P))
        close(np.r_[got["mean"][k], got["scale"][k]], X, sigma)
        close(full(got["covariance"][k : k + 1])[0], P[:n, :n], np.outer(sigma, sigma)[:n, :n])
        assert got["scale_variance"][k] == pytest.approx(P[n, n], rel=1e-8)


@pytest.mark.parametrize("seed", SEEDS)
def test_multiple_models_are_the_textbook_s_with_all_sensors_likelihoods(seed):
    """Blom and Bar-Shalom's, with sums over all pairs of models."""
    dense, settings, y, u = case(seed)
    n, count, leave = dense.n, len(THETAS), 0.02
    ours = CORE.MultipleModel(
        constants(dense.s), model_in_core(dense.model), np.array(THETAS), leave=leave,
        bias=np.full(dense.p, BIASES), fresh=0.1, least=0.0, **settings,
    )  # fmt: skip
    ours.reset(np.zeros(n), np.ones(n))
    got = ours.run(y, u, covariance=True)
    change = np.full((count, count), leave / (count - 1))
    np.fill_diagonal(change, 1 - leave)
    X, P, mu = np.zeros((count, n)), np.array([np.eye(n)] * count), np.full(count, 1 / count)
    for k in range(len(y)):
        if k:
            after = change.T @ mu
            share = change * mu[:, None] / after
            mixed = share.T @ X
            spread = [
                sum(
                    share[i, j] * (P[i] + np.outer(X[i] - mixed[j], X[i] - mixed[j]))
                    for i in range(count)
                )
                for j in range(count)
            ]
            mu = after
            for j, theta in enumerate(THETAS):
                X[j], P[j] = dense.predict(mixed[j], spread[j], u[k - 1], theta, BIASES)
        likely = np.zeros(count)
        for j in range(count):
            X[j], P[j], e, S = dense.update(X[j], P[j], y[k])
            likely[j] = -0.5 * np.sum(e**2 / S + np.log(S))
        mu = mu * np.exp(likely - likely.max())
        mu /= mu.sum()
        mean = mu @ X
        cov = sum(w * (p + np.outer(x - mean, x - mean)) for w, x, p in zip(mu, X, P, strict=True))
        sigma = np.sqrt(np.diag(cov))
        close(got["mean"][k], mean, sigma)
        close(full(got["covariance"][k : k + 1])[0], cov, np.outer(sigma, sigma))
        assert got["scale"][k] == pytest.approx(mu @ np.array(THETAS), rel=1e-8)


def of_scale(kind, model, std=0.2):
    """On axes of the paper's bearing, holding the scale where it cannot be told."""
    bias, common = np.full(len(model.forces), BIAS), {"fresh": 0.012, "least": 0.1}
    asked, of = magnets(model), model_in_core(model)
    if kind == "augmented":
        own = {"bias": bias, "std": std, "var_k": 1e-6, "min": 0.2, "max": 5.0} | common
        e = CORE.Augmented(asked, of, **own, **axes_settings(model))
    else:
        own = {"leave": 1e-4, "bias": bias} | common
        e = CORE.MultipleModel(asked, of, np.array((0.7, 0.85, 1.0, 1.15, 1.3)), **own,
                               **axes_settings(model))  # fmt: skip
    e.reset(np.zeros(len(model.states)), axes_std(model))
    return e


@pytest.mark.parametrize("kind", ["augmented", "multiple-model"])
def test_a_load_on_any_axis_counts_and_motion_on_any_axis_tells(kind):
    """What is learned of the scale is the same whichever axis comes first."""
    model = axes(("1", "2"))
    other = [model.index(f"{name}{axis}") for name in ("x", "v", "f_d", "x_m") for axis in "21"]
    swing, load = np.array([2e-4, 0.0]), np.array([0.0, 12.0])
    learned = {}
    for loaded in (False, True):
        _, y, u = motion(model, 6000, 1, scale=1.15, swing=swing, rate=40.0, load=loaded * load)
        first = of_scale(kind, model).run(y, u)
        second = of_scale(kind, model).run(
            np.ascontiguousarray(y[:, ::-1]), np.ascontiguousarray(u[:, ::-1])
        )
        np.testing.assert_allclose(second["scale"], first["scale"], rtol=1e-9)
        np.testing.assert_allclose(second["mean"][:, other], first["mean"], rtol=0, atol=1e-7)
        np.testing.assert_array_equal(second["status"], first["status"])
        learned[loaded] = first
    # Quiet loads: the scale is found; a load that swings more than the magnets move: it is held.
    assert learned[False]["scale"][-1] == pytest.approx(1.15, abs=0.02)
    assert not (learned[False]["status"][-1000:] & Status.UNEXCITED).any()
    assert (learned[True]["status"] & Status.UNEXCITED).all()
    assert np.ptp(learned[True]["scale"]) == 0


# ---- noise found online ----


@pytest.mark.parametrize(("seed", "window"), quick(
    product(SEEDS, [1, 10]), [(0, 1), (1, 10), (2, 1), (3, 10)]
))  # fmt: skip
def test_noise_is_found_of_each_sensor_and_each_load(seed, window):
    """By the formulas of core/include/ambkit/adaptive_noise.h, with full matrices."""
    dense, settings, y, u = case(seed, theta=1.0, n=700)
    n, share, most = dense.n, 1 / 200, 100.0
    inner = CORE.Kalman(constants(dense.s), model_in_core(dense.model), **settings)
    ours = CORE.AdaptiveNoise(
        inner, measurement=True, disturbance=True, share=share, first_share=share, most=most,
        window=window,
    )  # fmt: skip
    ours.reset(np.zeros(n), np.ones(n))
    loads = [i for i, at in enumerate(dense.model.states) if at.role == "disturbance force"]
    drives = dense.model.pattern["N"][:, loads, loads] != 0  # (k, loads)
    X, P = np.zeros(n), np.eye(n)
    R, V = dense.var_y.copy(), dense.var_noise.copy()
    c, expected, samples, amiss = np.zeros(len(loads)), np.zeros(len(loads)), 0, False
    for k in range(len(y)):
        if k:
            X, P = dense.predict(X, P, u[k - 1])
            ours.step(y[k], u[k - 1])
        else:
            ours.update(y[k])
        before, variances = X[loads], np.diag(P)[loads]
        X, P, e, S = dense.update(X, P, y[k])
        sigma = np.sqrt(np.diag(P))
        close(ours.mean, X, sigma)
        if k < 256:
            amiss = amiss or bool((e**2 > 25 * S).any() or (dense.var_y > 4 * R).any())
            if amiss:
                dense.var_y, dense.var_noise = R.copy(), V.copy()
                c, expected, samples = 0 * c, 0 * c, 0
                continue
        found = dense.var_y * (1 + share * (e**2 / S - 1))
        dense.var_y = np.clip(found, R / most, R * most)
        c = c + X[loads] - before
        expected = expected + variances - np.diag(P)[loads]
        samples = samples + 1
        if samples == window:
            for source, on in enumerate(drives):
                if expected[on].sum() > 0:
                    ratio = (c[on] ** 2).sum() / expected[on].sum()
                    grown = dense.var_noise[source] * (1 + min(share * window, 0.5) * (ratio - 1))
                    dense.var_noise[source] = np.clip(grown, V[source] / most, V[source] * most)
            c, expected, samples = 0 * c, 0 * c, 0
    var_y, var_d = ours.noise
    np.testing.assert_allclose(var_y, dense.var_y, rtol=1e-7)
    np.testing.assert_allclose(var_d, dense.var_noise, rtol=1e-7)
    assert (dense.var_y != R).all()
    assert (dense.var_noise[drives.any(1)] != V[drives.any(1)]).all()


# ---- states that are not there ----


def without(*missing):
    roles = [role for role in LOADED if role not in missing]
    model = random_model(3, 6, 1, 1)
    return with_roles(model, *roles), random_settings(model, 3)


def make(kind, model, s):
    settings, of, asked = wide(model, s), model_in_core(model), constants(s)
    learn = {"fresh": 0.1, "least": 0.1}
    if kind == "augmented":
        return CORE.Augmented(asked, of, bias=np.zeros(1), std=0.2, var_k=0.0, min=0.5, max=2.0,
                              **learn, **settings)  # fmt: skip
    if kind == "multiple-model":
        return CORE.MultipleModel(asked, of, np.array(THETAS), leave=0.1, bias=np.zeros(1),
                                  **learn, **settings)  # fmt: skip
    if kind == "low-pass":
        return CORE.LowPass(asked, of, m=1.0, position=0.1, velocity=0.1, force=0.1, **settings)
    inner = CORE.Kalman(asked, of, **settings)
    if kind == "linear":
        return inner
    return CORE.AdaptiveNoise(
        inner, measurement=True, disturbance=kind == "growth", share=0.01, first_share=0.01,
        most=10.0, window=1,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "missing"),
    [
        ("augmented", "disturbance force"),
        ("multiple-model", "disturbance force"),
        ("growth", "disturbance force"),
        ("low-pass", "disturbance force"),
        ("low-pass", "velocity"),
        ("low-pass", "position"),
    ],
)
def test_who_needs_a_state_that_is_not_there_is_refused(kind, missing):
    with pytest.raises(ValueError, match=f"needs a {missing}"):
        make(kind, *without(missing))
    assert make(kind, *without()) is not None


def test_a_low_pass_filter_is_one_axis_s():
    model, s = random_machine(1, LOADED)
    with pytest.raises(ValueError, match="one sensor and one control; the model has"):
        make("low-pass", model, s)


def test_who_needs_no_load_does_without():
    """Filter, its noise found online, and smoother, by the textbook."""
    model, s = without("disturbance force")
    dense = Dense(model, s, wide(model, s))
    y, u = dense.motion(200, 1.0, 0)
    n = dense.n
    kf = make("linear", model, s)
    kf.reset(np.zeros(n), np.ones(n))
    smoothed = kf.smooth(y, u)
    X, P, past = np.zeros(n), np.eye(n), []
    for k in range(len(y)):
        predicted = dense.predict(X, P, u[k - 1]) if k else (X, P)
        X, P, _, _ = dense.update(*predicted, y[k])
        past.append((X, P, *predicted))
    A = model.jacobian(s.k_i, s.k_s)
    for k in range(len(y) - 1, -1, -1):  # Rauch, Tung and Striebel
        if k < len(y) - 1:
            filtered, cov, (_, _, ahead, wide_ahead) = *past[k][:2], past[k + 1]
            G = cov @ A.T @ np.linalg.inv(wide_ahead)
            X, P = filtered + G @ (X - ahead), cov + G @ (P - wide_ahead) @ G.T
        close(smoothed["mean"][k], X, 10 * np.sqrt(np.diag(P)))
    online = make("measurement", model, s)
    online.reset(np.zeros(n), np.ones(n))
    online.run(y, u)
    assert (online.noise[1] == s.var_noise).all()


# ---- a sensor that is lost ----


def filter_of(kind, model):
    if kind == "unscented":
        e = CORE.Unscented(
            magnets(model), model_in_core(model), 3**0.5, 2.0, **axes_settings(model)
        )
    else:
        e = getattr(CORE, kind)(magnets(model), model_in_core(model), **axes_settings(model))
    e.reset(np.zeros(len(model.states)), axes_std(model))
    return e


def faulty(fault, y):
    """Sensor 1 gone for 0.2 s, or elsewhere for 5 ms."""
    y = y.copy()
    if fault == "lost":
        y[500:2500, 0] = np.nan
    else:
        y[500:550, 0] += 3e-4
    return y


@pytest.mark.parametrize("fault", ["lost", "elsewhere"])
@pytest.mark.parametrize("kind", ["Kalman", "Extended", "UD", "unscented"])
def test_another_axis_goes_on_as_if_it_were_alone(kind, fault):
    both, alone = axes(("1", "2")), axes(("2",))
    X, y, u = motion(both, 4000, 2, swing=np.array([1e-4, 2e-4]))
    ours = filter_of(kind, both).run(faulty(fault, y), u, covariance=True)
    theirs = filter_of(kind, alone).run(
        np.ascontiguousarray(y[:, 1:]), np.ascontiguousarray(u[:, 1:]), covariance=True
    )
    second = [both.index(state.name) for state in alone.states]
    P = full(ours["covariance"])[:, second][:, :, second]
    sigma = np.sqrt(np.diagonal(full(theirs["covariance"]), axis1=1, axis2=2))
    assert (np.abs(ours["mean"][:, second] - theirs["mean"]) <= 1e-9 * sigma).all()
    close(P, full(theirs["covariance"]), sigma[:, :, None] * sigma[:, None])
    assert ours["status"].any()
    assert not (ours["health"][:, 1] & ~np.uint16(Status.INCONSISTENT)).any()
    seen = Status(int(np.bitwise_or.reduce(ours["status"])))
    assert seen & (Status.HELD if fault == "lost" else Status.RESTARTED)
    # And the first is found again.
    first = [i for i in range(len(both.states)) if i not in second]
    at_end = np.sqrt(np.diagonal(full(ours["covariance"][-1:])[0]))[first]
    assert (np.abs(ours["mean"][-1] - X[-1])[first] < 6 * at_end).all()


def test_what_the_scale_is_correlated_with_on_another_axis_stays():
    """The same beside a scale that is uncertain and held: as wide as alone, and no wider."""
    both, alone = axes(("1", "2")), axes(("2",))
    _, y, u = motion(both, 4000, 2)
    ours = of_scale("augmented", both).run(faulty("lost", y), u, covariance=True)
    theirs = of_scale("augmented", alone).run(
        np.ascontiguousarray(y[:, 1:]), np.ascontiguousarray(u[:, 1:]), covariance=True
    )
    assert (ours["scale"] == 1).all()
    second = [both.index(state.name) for state in alone.states]
    sigma = np.sqrt(np.diagonal(full(theirs["covariance"]), axis1=1, axis2=2))
    assert (np.abs(ours["mean"][:, second] - theirs["mean"]) <= 1e-9 * sigma).all()
    P = full(ours["covariance"])[:, second][:, :, second]
    close(P, full(theirs["covariance"]), sigma[:, :, None] * sigma[:, None])


@pytest.mark.parametrize("kind", ["Kalman", "Extended", "UD", "unscented"])
def test_of_coupled_axes_the_one_that_is_seen_stays_as_good_as_it_says(kind):
    model = axes(("1", "2"), coupling=0.02)
    X, y, u = motion(model, 4000, 3, swing=np.array([1e-4, 1e-4]))
    ours = filter_of(kind, model).run(faulty("lost", y), u, covariance=True)
    assert (ours["status"] & Status.HELD).any()
    assert not (ours["health"][:, 1] & (Status.OUTLIER | Status.RESTARTED)).any()
    sigma = np.sqrt(np.diagonal(full(ours["covariance"]), axis1=1, axis2=2))
    seen = model.index("x2")
    assert (np.abs(ours["mean"] - X)[100:, seen] < 6 * sigma[100:, seen]).all()
    assert sigma[2400, seen] < 3e-5
    assert (np.abs(ours["mean"] - X)[-1] < 6 * sigma[-1]).all()


def test_an_observer_that_starts_afresh_at_one_axis_leaves_the_other_alone():
    from scipy.linalg import solve_discrete_are

    both, alone = axes(("1", "2")), axes(("2",))
    made = []
    for model in (both, alone):
        s = axes_settings(model)
        k_i, k_s = (a[0] for a in magnets(model)[0].tangent(np.zeros(1), np.zeros(1)))
        unit = axes_std(model)
        A = model.jacobian(k_i, k_s) * unit / unit[:, None]
        H = model.c * unit
        Q = model.process_noise(k_i, np.square(s["k_ui"]) * s["var_u"], s["var_d"])
        P = solve_discrete_are(A.T, H.T, Q / np.outer(unit, unit), np.diag(s["var_y"]))
        S = H @ P @ H.T + np.diag(s["var_y"])
        gain = (P @ H.T @ np.linalg.inv(S)).T * unit
        upper = (P * np.outer(unit, unit))[np.triu_indices(len(unit))]
        e = CORE.Observer(magnets(model), model_in_core(model), gain, upper, np.diag(S),
                          np.array(s["cap"]), **s)  # fmt: skip
        made.append(e)
    ours, theirs = made
    start = np.zeros(8)
    start[both.index("v1")] = 5 * axes_settings(both)["cap"][both.index("v1")]
    ours.reset(start)
    theirs.reset(np.zeros(4))
    y, y_2 = np.array([1e-4, 5e-5]), np.array([5e-5])
    assert ours.update(y) & Status.RESTARTED
    assert not theirs.update(y_2) & Status.RESTARTED
    second = [both.index(state.name) for state in alone.states]
    np.testing.assert_allclose(ours.mean[second], theirs.mean, rtol=1e-9)
    assert ours.mean[both.index("v1")] == 0
    assert ours.mean[both.index("x1")] == pytest.approx(1e-4, rel=1e-6)
