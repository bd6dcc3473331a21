"""Interacting multiple models: filterpy's, what they find of k and how fast, where they hold."""

from __future__ import annotations

import math

import numpy as np
import oracles
import pytest
from filterpy.kalman import IMMEstimator
from filterpy.kalman import KalmanFilter as Textbook
from magnet_scale_cases import BEARING, jump, run

from ambkit import MultipleModelFilter, Record
from ambkit.machine.magnets import ConstantStiffness


@pytest.mark.parametrize("scales", [(0.7, 0.85, 1.0, 1.15, 1.3), (0.9, 1.2)])
@pytest.mark.parametrize("sojourn", [0.01, 1.0])
def test_with_a_linear_force_it_is_filterpy_s(scales: tuple[float, ...], sojourn: float) -> None:
    record, n = run(2e-4), len(scales)
    record = Record(record.t[:800], {s: record[s][:800] for s in ("y", "u")})
    linear = ConstantStiffness.of(BEARING)
    mine = MultipleModelFilter(BEARING, linear, scales=scales, sojourn=sojourn, excitation=math.inf)
    D = np.array(mine.default_std())
    estimate = mine.run(record, covariance=True)

    s, first = oracles.settings_of(BEARING), float(record["y"][0])
    filters = []
    for theta in scales:
        m = mine.linear_model(theta * linear.k_i, theta * linear.k_s).scaled(D)
        kf = Textbook(4, 1, 2)
        kf.x, kf.P = np.array([first, 0, 0, first]) / D, np.eye(4)
        kf.F, kf.B, kf.H, kf.Q = m.A, np.hstack([m.B / s["k_ui"], m.E]), m.H / D[3], m.Q
        kf.R = np.array([[s["var_y"] / D[3] ** 2]])
        filters.append(kf)
    leave = s["T"] / sojourn
    chain = np.full((n, n), leave / (n - 1))
    np.fill_diagonal(chain, 1 - leave)
    imm = IMMEstimator(filters, np.full(n, 1 / n), chain)
    for k in range(len(record)):
        if k:
            iu = np.clip(s["k_ui"] * record["u"][k - 1], s["iu_min"], s["iu_max"])
            imm.predict(np.array([iu, s["f_0"]]))
        imm.update(record["y"][k : k + 1] / D[3])
        sigma = np.sqrt(np.diag(imm.P))
        assert (np.abs(estimate.mean[k] / D - imm.x) <= 1e-9 * sigma).all()
        assert estimate.scale[k] == pytest.approx(imm.mu @ scales, rel=1e-9)
    assert list(mine.weights.values()) == pytest.approx(imm.mu, rel=1e-7)
    P = (imm.P * np.outer(D, D))[np.triu_indices(4)]
    np.testing.assert_allclose(estimate.covariance[-1], P, rtol=1e-8)
    variance = imm.mu @ np.square(scales) - (imm.mu @ scales) ** 2
    assert estimate.scale_variance[-1] == pytest.approx(variance, rel=1e-6)


def test_a_jump_while_the_rotor_moves_far_is_found_in_ten_milliseconds() -> None:
    record = jump(1.3, 3e-4)
    scale = MultipleModelFilter(BEARING).run(record).scale
    assert scale is not None
    assert np.abs(scale[record.t >= 1.01] / 1.3 - 1).max() < 0.1


def test_the_weights_are_probabilities() -> None:
    mine = MultipleModelFilter(BEARING)
    mine.run(run(3e-4))
    assert sum(mine.weights.values()) == pytest.approx(1.0, rel=1e-12)
    assert max(mine.weights, key=lambda scale: mine.weights[scale]) == 1.0
