"""The posterior Cramer-Rao bound: by hand, by Riccati, by the whole information, by simulation."""

import numpy as np
import pytest

import ambkit
from ambkit import Machine
from ambkit.judge.comparison.bound import bearing_bound, posterior_bound

BEARING = Machine.preset("zittau_axial")


def test_a_random_walk_by_hand():
    """P+ = (P+1)/(P+2) from P = 1/2 on: ratios of Fibonacci numbers, towards 1/golden ratio."""
    ones = np.ones((3, 30, 1, 1))
    found = posterior_bound(ones, ones, [1.0], 1.0, [[1.0]])[:, 0, 0]
    assert found[:4] == pytest.approx([1 / 2, 3 / 5, 8 / 13, 21 / 34], rel=1e-14)
    assert found[-1] == pytest.approx((np.sqrt(5) - 1) / 2, rel=1e-12)


def test_without_noise_inside_information_adds_up():
    """A constant measured k times: the information is the prior's and k of the measurements."""
    found = posterior_bound(np.ones((2, 9, 1, 1)), np.zeros((2, 9, 1, 1)), [2.0], 0.5, [[4.0]])
    assert found[:, 0, 0] == pytest.approx([1 / (1 / 4 + k * 4 / 0.5) for k in range(1, 11)])


def test_alike_runs_give_the_riccati_covariance_with_singular_noise():
    rng = np.random.default_rng(1)
    F, G, H = np.eye(4) + 0.2 * rng.normal(size=(4, 4)), rng.normal(size=(4, 2)), rng.normal(size=4)
    R, P = 0.3, np.diag([1.0, 2.0, 3.0, 4.0])
    found = posterior_bound(np.tile(F, (5, 20, 1, 1)), np.tile(G, (5, 20, 1, 1)), H, R, P)
    for k in range(21):
        if k > 0:
            P = F @ P @ F.T + G @ G.T
        P = P - np.outer(P @ H, P @ H) / (H @ P @ H + R)
        assert found[k] == pytest.approx(P, rel=1e-9)


def test_runs_that_differ_give_the_inverse_of_the_whole_information():
    """The naive form: all derivatives by start and noises, their information, its inverse."""
    rng = np.random.default_rng(2)
    runs, steps, n, q, R = 3, 6, 3, 2, 0.7
    F = np.eye(n) + 0.3 * rng.normal(size=(runs, steps, n, n))
    G, H, prior = rng.normal(size=(runs, steps, n, q)), rng.normal(size=n), np.diag([1.0, 2.0, 0.5])
    found = posterior_bound(F, G, H, R, prior)
    information = np.linalg.inv(
        np.block([[prior, np.zeros((n, steps * q))], [np.zeros((steps * q, n)), np.eye(steps * q)]])
    )
    D = [np.hstack([np.eye(n), np.zeros((n, steps * q))]) for _ in range(runs)]
    for k in range(steps + 1):
        for a in range(runs):
            if k > 0:
                D[a] = F[a, k - 1] @ D[a]
                D[a][:, n + q * (k - 1) : n + q * k] += G[a, k - 1]
            information = information + np.outer(H @ D[a], H @ D[a]) / R / runs
        mean = sum(D) / runs
        assert found[k] == pytest.approx(mean @ np.linalg.solve(information, mean.T), rel=1e-9)


def walk_of_the_load(step, seed):
    """Simulate 60 ms in which all is as the filter's model says."""
    t = BEARING.sampling_time * np.arange(601)
    growth = ambkit.KalmanFilter(BEARING).variances.disturbance * BEARING.sampling_time
    walk = np.cumsum(np.random.default_rng([7, seed]).normal(0, np.sqrt(growth), t.size))
    return ambkit.simulate(
        BEARING,
        ambkit.Scenario(
            duration=float(t[-1]),
            reference=ambkit.Step(amplitude=step),
            disturbance=ambkit.Recorded(times=t, values=walk - walk[0]),
            seed=seed,
        ),
    ).record


def test_nobody_crosses_it_and_the_right_model_comes_close():
    records = [walk_of_the_load(5e-4, seed) for seed in range(60)]
    linear = ambkit.KalmanFilter(BEARING)
    law = ambkit.AdaptiveKalmanFilter(BEARING, ambkit.ClosedLaw(BEARING))
    bound = bearing_bound(BEARING, records[:12], linear.variances, linear.default_std())
    late = slice(300, None)
    efficiency = {}
    for kalman in (linear, law):
        for place, name in enumerate(("x", "v", "f_d")):
            error = [kalman.run(record)[name][late] - record[name][late] for record in records]
            limit = np.sqrt(np.mean(bound[late, place] ** 2))
            efficiency[kalman.name, name] = limit / np.sqrt(np.mean(np.square(error)))
    assert max(efficiency.values()) < 1.05  # an RMSE of 60 runs is known to 2 % (one sigma)
    assert min(efficiency[law.name, name] for name in ("x", "v", "f_d")) > 0.95
    assert efficiency[linear.name, "f_d"] < 0.75
