"""The unscented filter: three forces are filterpy's nine points, and better than a tangent."""

import numpy as np
import oracles
import pytest
from filter_cases import made
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from quick import quick

import ambkit
from ambkit import ClosedLaw, Machine
from ambkit.machine.magnets import core_module

BEARING = Machine.preset("zittau_axial")
MEAN = np.array([2e-5, 0.01, -1.0, 1e-5])
STD = np.array([3e-5, 0.012, 5.0, 3e-5])


def swinging():
    scenario = ambkit.Scenario(
        duration=0.25,
        reference=ambkit.Sine(amplitude=4e-4, frequency=8.0),
        disturbance=ambkit.Step(amplitude=3.0, time=0.1),
    )
    return ambkit.simulate(BEARING, scenario).record


# filterpy takes the root of a covariance whose entries differ by 1e12: what it loses there is
# bounded by the states' own standard deviations.
@pytest.mark.parametrize(("alpha", "beta", "kappa", "blunt"), quick(
    [(1.0, 0.0, -1.0, 1.0), (0.5, 2.0, 1.0, 1.0), (1.0, 2.0, 3.0, 400.0)], [(0.5, 2.0, 1.0, 1.0)]
))  # fmt: skip
def test_it_is_filterpy_s(alpha, beta, kappa, blunt):
    """`blunt`: how much worse a sensor is, so that the points lie far apart."""
    record, law, core = swinging(), ClosedLaw(BEARING), core_module()
    s = oracles.settings_of(BEARING)
    s["var_y"] *= blunt
    mine = made(core, "Unscented", law.in_core(core), s, reach=alpha * np.sqrt(4 + kappa),
                curvature=alpha**2 * (4 + kappa) + beta - alpha**2)  # fmt: skip
    mine.reset(MEAN, STD)
    out = mine.run(record["y"], record["u"], covariance=True)

    # filterpy's in units of the standard deviations, as its Cholesky root wants them; and with the
    # displacement at which the magnet is asked as the first state, so that one pair of points moves
    # it.
    D = np.diag(STD)
    D[0, 1] = -s["T"] / 2 * STD[1]
    back = np.linalg.inv(D)
    L, b, N = oracles.held_force(s)
    magnet = law.in_core(core)

    def force(iu, x):
        return float(magnet.force(np.array([iu]), np.array([x]))[0])

    def transition(z, _dt, iu):
        X = D @ z
        at = X[0] + X[1] * s["T"] / 2
        return back @ (L @ X + b * (force(iu, at) + X[2] + s["f_0"]))

    points = MerweScaledSigmaPoints(4, alpha, beta, kappa)
    ukf = UnscentedKalmanFilter(4, 1, s["T"], lambda z: z[3:] * STD[3], transition, points)
    ukf.x, ukf.P = back @ MEAN, back @ np.diag(STD**2) @ back.T
    ukf.R = np.array([[s["var_y"]]])
    ukf.sigmas_f = points.sigma_points(ukf.x, ukf.P)
    for k in range(len(record)):
        if k:
            iu = float(np.clip(s["k_ui"] * record["u"][k - 1], s["iu_min"], s["iu_max"]))
            at = np.array([STD[0] * ukf.x[0]])
            k_i = float(magnet.tangent(np.array([iu]), at)[0][0])
            B = b * k_i * s["k_ui"]
            ukf.Q = back @ (s["var_u"] * np.outer(B, B) + s["var_d"] * N) @ back.T
            ukf.predict(iu=iu)
        ukf.update(record["y"][k : k + 1])
        sigma = np.sqrt(np.diag(D @ ukf.P @ D.T))
        assert (np.abs(out["mean"][k] - D @ ukf.x) <= 1e-9 * np.maximum(sigma, STD)).all()
    P = (D @ ukf.P @ D.T)[np.triu_indices(4)]
    rows, columns = np.triu_indices(4)
    off = np.abs(out["covariance"][-1] - P) / (sigma[rows] * sigma[columns])
    assert off.max() < 1e-9


def test_the_mean_force_is_the_integral_where_the_tangent_is_not():
    """A position known to 0.25 mm, at 0.3 mm: what force is to be expected?"""
    law, core = ClosedLaw(BEARING), core_module()
    s = oracles.settings_of(BEARING, f_0=0.0)
    mean, std = np.array([3e-4, 0, 0, 3e-4]), np.array([2.5e-4, 1e-3, 1e-3, 1e-5])
    iu = 0.4
    speed = {}
    kinds = {
        "Extended": {}, "Unscented": {"reach": np.sqrt(3), "curvature": 2.0},
    }  # fmt: skip
    for name, own in kinds.items():
        e = made(core, name, law.in_core(core), s, **own)
        e.reset(mean, std)
        e.predict(iu)
        speed[name] = e.mean[1] * s["m"] / s["T"], e.covariance[1, 1] * (s["m"] / s["T"]) ** 2
    x = 3e-4 + 2.5e-4 * np.linspace(-2.6, 2.6, 2001)  # within the stops
    weight = np.exp(-0.5 * ((x - 3e-4) / 2.5e-4) ** 2)
    F = law.force(np.full_like(x, iu), x)
    exact = float((weight * F).sum() / weight.sum())
    assert abs(speed["Unscented"][0] - exact) < 0.2 * abs(speed["Extended"][0] - exact)
    assert speed["Unscented"][1] > speed["Extended"][1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"alpha": 0.0}, "alpha must be greater than 0, got 0.0"),
        ({"kappa": -4.0}, "kappa must be greater than -4, got -4.0"),
        ({"kappa": -3.5}, "beta must be 0.5 or more for a variance, got 0.0"),
    ],
)
def test_parameters_that_leave_no_spread_are_reported(options, message):
    with pytest.raises(ValueError, match=message):
        ambkit.UnscentedKalmanFilter(BEARING, **options)
