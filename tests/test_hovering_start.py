"""Where a filter starts that knows currents: at what holds the rotor, from the first sample on."""

import numpy as np
import pytest
from filter_cases import BEARING, full
from scipy.stats import chi2

import ambkit
from ambkit import ClosedLaw, FilterNoise, Scenario
from ambkit.estimate.registry import KINDS
from ambkit.machine.magnets import evaluate_force

T = BEARING.sampling_time
LATE = BEARING.replace(amplifier__bandwidth=2000.0, delay=1.5 * T)
SEEDS, FIRST = range(30), 60
JUDGED = ("x", "v", "f_d")
kinds = pytest.mark.parametrize("kind", ["linear", "closed-law", "extended", "ud", "unscented"])


def errors(kind, **options):
    """Of the first samples of hovering rotors (seeds, 60, states); stated covariances with them.

    A fresh filter as `run` starts it, or with `std` one that is that sure of where it is.
    """
    std = options.pop("std", None)
    e = KINDS[kind].make(LATE, **options)
    found, stated = [], []
    for seed in SEEDS:
        record = ambkit.simulate(LATE, Scenario(duration=FIRST * T, seed=seed)).record
        if std is None:
            estimate = e.run(record, covariance=True)
            mean, P = estimate.mean, estimate.covariance
        else:
            e.reset(e.equilibrium_state(0.0), [std * size for size in e.default_std()])
            out = e.core.run(record["y"], record["u"], covariance=True)
            mean, P = out["mean"], out["covariance"]
        at = [e.model.index(name) for name in JUDGED]
        truth = np.stack([record[name] for name in JUDGED], axis=1)
        found.append((mean[:, at] - truth)[:FIRST])
        stated.append(full(P[:FIRST])[:, at][:, :, at])
    return np.array(found), np.array(stated)


def squares(error, P):
    return np.einsum("ski,ski->sk", error, np.linalg.solve(P, error[..., None])[..., 0])


@kinds
def test_the_first_samples_of_a_hovering_rotor_are_as_good_as_stated(kind):
    """The start is unsure on purpose: errors may be less than stated, not more."""
    nees = squares(*errors(kind)).mean(0)
    assert (nees < chi2.ppf(1 - 1e-5, len(JUDGED) * len(SEEDS)) / len(SEEDS)).all()


@kinds
def test_a_filter_that_is_sure_of_the_start_is_right(kind):
    """What moves the rotor is only the amplifier's noise, which the filter knows."""
    error, P = errors(kind, std=1e-3, noise=FilterNoise(disturbance=1e-6))
    nees = squares(error[..., :2], P[..., :2, :2])
    assert (nees.mean(0) < chi2.ppf(1 - 1e-5, 2 * len(SEEDS)) / len(SEEDS)).all()
    # Once that noise has come through the delay and outgrown what is told of the start, which is
    # more than there is; samples that far apart tell almost anew.
    late = nees[:, [39, 49, 59]]
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 2 * len(SEEDS)) / len(SEEDS)
    assert (late.mean(0) > low).all()
    assert (late.mean(0) < high).all()


@pytest.mark.parametrize("gravity", ["known", "disturbance"])
def test_at_rest_the_currents_are_what_holds_the_rotor(gravity):
    e = ambkit.ExtendedKalmanFilter(LATE, gravity=gravity)
    law, travel = ClosedLaw(LATE), LATE.clearance
    e.reset()
    assert (e.mean == e.equilibrium_state(0.0)).all()
    for x in (0.0, 0.1 * travel, -0.2 * travel):
        rest = dict(zip((state.name for state in e.states), e.equilibrium_state(x), strict=True))
        assert rest["i"] == rest["u_1"] == rest["u_2"]
        left = evaluate_force(law, rest["i"], x).item() + law.bias_force + LATE.weight
        assert abs(left) < (1e-9 if x == 0 else 0.02) * abs(LATE.weight)
    assert e.levitation_current[0] == pytest.approx(LATE.levitation_current, rel=1e-9)


def test_an_axis_whose_current_follows_at_once_starts_as_ever():
    e = ambkit.KalmanFilter(BEARING)
    assert e.levitation_current == (0.0, 0.0)
    assert e.equilibrium_state(1e-4).tolist() == [1e-4, 0.0, 0.0, BEARING.sensor.gain * 1e-4]


def test_in_a_loop_it_knows_what_its_controller_demanded_before():
    """A rotor that hangs in the middle with no current falls: so does the estimate."""
    for start, current in (("released", 0.0), ("levitated", LATE.levitation_current)):
        e = ambkit.ExtendedKalmanFilter(LATE)
        ambkit.simulate(LATE, Scenario(duration=2 * T, start=start, noise=False), filter=e)
        assert e.mean[e.model.index("u_2")] == pytest.approx(current, abs=1e-9)
