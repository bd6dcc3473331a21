"""What a well-known method finds in the same record: least squares on a discrete model."""

import numpy as np

from ambkit import ClosedLaw
from ambkit.identification.maximum_likelihood import maximum_likelihood
from benchmarks.identification import START, TRUTH, closed_loops


def test_poles_agree_with_an_autoregressive_model_by_instruments_and_likelihood_is_sharper():
    """An ARX model by instrumental variables with NumPy's least squares, on a decimated record.

    The unstable pole of the magnet is what both can tell. Instruments are control signals of the
    past (Söderström and Stoica 1983); they are not quite free of the loop's noise, and the model
    has one order for all: it gets the pole to some ten per cent.
    """
    truth, record = TRUTH, closed_loops(TRUTH, 1, 2.0, first=300)[0]
    b = truth.bearing
    k_s = float(ClosedLaw(b).tangent(b.hover_current, 0.0)[1])
    own = np.sqrt(k_s / b.rotor.mass)

    found = maximum_likelihood(record, START)
    at = found.stiffness(found.bearing.hover_current, 0.0)
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
