"""What others find in the same record: filterpy's likelihood, least squares on a discrete model."""

from dataclasses import replace

import numpy as np
import oracles
import pytest
from scipy.optimize import minimize

from ambkit import ClosedLaw, ConstantStiffness
from ambkit.identification.maximum_likelihood import maximum_likelihood
from ambkit.identification.maximum_likelihood.likelihood import Data
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import named
from ambkit.identification.maximum_likelihood.search import maximise
from benchmarks.identification import START, TRUTH, closed_loops


@pytest.mark.long
def test_poles_agree_with_an_autoregressive_model_by_instruments_and_likelihood_is_sharper():
    """An ARX model by instrumental variables with NumPy's least squares, on a decimated record.

    The unstable pole of the magnet is what both can tell. Instruments are control signals of the
    past (Söderström and Stoica 1983); they are not quite free of the loop's noise, and the model
    has one order for all: it gets the pole to some ten per cent.
    """
    truth, record = TRUTH, closed_loops(TRUTH, 1, 2.0, first=300)[0]
    b = truth.isolated
    k_s = float(ClosedLaw(b).tangent(b.levitation_current, 0.0)[1])
    own = np.sqrt(k_s / b.rotor.mass)

    found = maximum_likelihood(record, START)
    at = found.stiffness(found.isolated.levitation_current, 0.0)
    ours = np.sqrt(at["k_s"][0] / b.rotor.mass)
    assert abs(ours / own - 1) < 3 * 0.5 * at["k_s"][1] / at["k_s"][0]

    every = 20
    y, u = (record[s].reshape(-1, every).mean(axis=1) for s in ("y", "u"))
    y, u = y - y.mean(), u - u.mean()
    past = range(1, 4)
    rows = np.arange(16, y.size)
    A = np.column_stack([y[rows - k] for k in past] + [u[rows - k] for k in past])
    Z = np.column_stack([u[rows - k] for k in range(1, 13)])
    projected = Z @ np.linalg.lstsq(Z, A, rcond=None)[0]
    theta = np.linalg.lstsq(projected, y[rows], rcond=None)[0]
    poles = np.roots([1, *(-theta[:3])])
    unstable = float(np.max(np.abs(poles)))
    theirs = np.log(unstable) / (every * b.sampling_time)
    assert abs(theirs / own - 1) < 0.4
    assert abs(ours / own - 1) < abs(theirs / own - 1)


@pytest.mark.long
def test_filterpy_and_scipy_find_the_same_noises():
    """The same linear model in filterpy's filter, its likelihood maximised by SciPy."""
    filterpy = pytest.importorskip("filterpy.kalman")
    bearing = TRUTH.isolated
    truth = LoopModel(bearing, disturbance_noise=TRUTH.disturbance_noise, load_std=0.05, substeps=1,
                      magnet=ConstantStiffness.of(bearing))  # fmt: skip
    record = closed_loops(replace(truth, magnet=None), 1, 0.15, first=400)[0]
    assert truth.nearest_limit(record) > 5.5  # so that the limit takes nothing from the control
    begin, settled = 0.02, 200
    first = record["y"][0]
    std = [*truth.kalman().default_std()]
    std[2] = truth.load_std

    def others(noises):
        """Log likelihood by filterpy at ln of measurement noise and load growth."""
        measurement, growth = np.exp(noises)
        s = oracles.settings_of(bearing)
        F, b, H = oracles.system_matrices(s, truth.magnet.k_i, truth.magnet.k_s)
        _, pushed, grown = oracles.held_force(s)
        kf = filterpy.KalmanFilter(dim_x=4, dim_z=1, dim_u=2)
        kf.x = np.array([[first], [0.0], [0.0], [first]])
        kf.P, kf.F, kf.H, kf.R = np.diag(np.square(std)), F, H[None], np.array([[measurement]])
        kf.B = np.column_stack([b, pushed])
        kf.Q = s["var_u"] * np.outer(b, b) + growth * s["T"] * grown
        total = 0.0
        for k, (y, u) in enumerate(zip(record["y"], record["u"], strict=True)):
            kf.update(y)
            if k >= settled:
                total += kf.log_likelihood
            kf.predict(u=np.array([[u], [s["f_0"]]]))
        return float(total)

    free = named(["measurement_noise", "disturbance_noise"])
    found = maximise(Data([record], begin), truth, free)  # as it is, before any bias is taken off
    at = np.log([p.of(found.model) for p in free])
    assert others(at) == pytest.approx(found.local.value, rel=1e-9)
    theirs = minimize(lambda z: -others(z), at + 0.3, method="BFGS", options={"gtol": 0.01})
    errors = np.sqrt(np.diag(np.linalg.inv(found.local.information)))
    np.testing.assert_allclose(at, theirs.x, atol=0.1 * errors.min())
