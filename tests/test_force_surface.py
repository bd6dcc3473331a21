"""The force through measured points: the law where nothing is known, the points where they are."""

import fe_map
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import quick

from ambkit import AmbkitError, ClosedLaw, Machine, train
from ambkit.fuzzy.rule_selection import measured_map
from ambkit.machine.forces.fitted_law import fitted_law
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.force_surface import MOST, ForceSurface

BEARING = Machine.preset("zittau_axial")
LAW = ClosedLaw(BEARING).force
BOX = np.meshgrid(np.linspace(-1.5, 1.5, 41), np.linspace(-0.5e-3, 0.5e-3, 41))


def saturating(iu, x):
    """Iron that saturates: in the corners the law is wrong by 12 N."""
    return 16 * np.tanh(LAW(iu, x) / 16)


def grid(lines):
    iu, x = np.meshgrid(np.linspace(-1.5, 1.5, lines), np.linspace(-0.5e-3, 0.5e-3, lines))
    return iu.ravel(), x.ravel()


def scattered(n, seed=3):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.5, 1.5, n), rng.uniform(-0.5e-3, 0.5e-3, n)


def noisy(iu, x, noise, force=saturating, seed=1, known=True):
    values = force(iu, x) + noise * np.random.default_rng(seed).normal(size=iu.size)
    return ForcePoints(iu, x, values, np.full(iu.size, noise) if known else None)


def rms(values):
    return np.sqrt(np.mean(np.asarray(values) ** 2))


def test_surface_is_the_textbooks():
    """Rasmussen and Williams 2006, eq. 2.25-2.26, with the inverse written out."""
    points = noisy(*scattered(40), 0.3)
    surface = ForceSurface(BEARING, points)
    a, b = surface.reach

    def covariance(p, q):
        r = np.hypot((p[0] - q[0]) / a, (p[1] - q[1]) / b)
        matern = (1 + np.sqrt(5) * r + 5 * r**2 / 3) * np.exp(-np.sqrt(5) * r)
        return surface.law_error**2 * (matern + 1)

    at = list(zip(points.current, points.displacement, strict=True))
    K = np.array([[covariance(p, q) for q in at] for p in at])
    K += np.diag(points.standard_error**2 + (1e-3 * surface.law_error) ** 2)
    law = fitted_law(BEARING, points)[1].force if surface.refitted else LAW
    off = points.force - law(points.current, points.displacement)
    for place in [(0.0, 0.0), (1.5, 0.5e-3), (-1.1, 0.2e-3)]:
        k = np.array([covariance(place, p) for p in at])
        expected = law(*place) + k @ np.linalg.inv(K) @ off
        doubt = np.sqrt(covariance(place, place) - k @ np.linalg.inv(K) @ k)
        assert float(surface(*place)) == pytest.approx(float(expected), rel=1e-7)
        assert float(surface.standard_error(*place)) == pytest.approx(doubt, rel=1e-5)


@pytest.mark.parametrize("noise", quick([0.02, 0.3], [0.02]))
def test_an_unmeasured_corner_pulls_nothing(noise):
    """Values far from any physical force, hardly measured: today's spline followed them."""
    iu, x = grid(9)
    clean = noisy(iu, x, noise)
    corner = (iu > 0.3) & (x > 1e-4)
    wild = ForcePoints(
        iu, x, clean.force + 30 * corner, np.where(corner, 30.0, clean.standard_error)
    )
    expert = train(measured_map(BEARING, wild)).expert
    unmeasured = (BOX[0] > 0.3) & (BOX[1] > 1e-4)
    # Where nothing is known: between law and truth, and stiffnesses as a magnet has them.
    assert rms((expert.force(*BOX) - LAW(*BOX))[unmeasured]) < 4
    k_i, k_s = expert.stiffness(*BOX)
    law_i, law_s = train(BEARING).expert.stiffness(*BOX)
    assert 0.4 * law_i.min() < k_i.min() < k_i.max() < 1.2 * law_i.max()
    assert 0.4 * law_s.min() < k_s.min() < k_s.max() < 1.2 * law_s.max()
    # And where it was measured the corner does no harm.
    off = (expert.force(*BOX) - saturating(*BOX))[~unmeasured]
    assert rms(off) < {0.02: 0.05, 0.3: 0.15}[noise]


def test_without_a_corner_at_all_it_is_the_same():
    iu, x = grid(9)
    points = noisy(iu, x, 0.3)
    corner = (iu > 0.3) & (x > 1e-4)
    hardly = ForcePoints(iu, x, points.force, np.where(corner, 1e4, 0.3))
    here, there = (ForceSurface(BEARING, p, 4.0) for p in (hardly, points.where(~corner)))
    assert rms(here(*BOX) - there(*BOX)) < 0.02


def test_far_from_all_points_the_law_stays():
    iu, x = grid(9)
    few = (iu < -0.7) & (x < -2e-4)
    surface = ForceSurface(BEARING, noisy(iu, x, 0.05).where(few))
    k, doubt = 1.5, surface.standard_error(1.5, 0.5e-3)
    offset = surface.correction(10.0, 5e-3)  # what all forces have in common
    assert abs(surface.correction(k, 0.5e-3) - offset) < 0.3 * surface.law_error
    assert 0.9 * surface.law_error < doubt < 1.5 * surface.law_error


@pytest.mark.parametrize("lines", quick([9, 15], [9]))
def test_well_measured_points_are_learnt_as_well_as_a_table_was(lines):
    """The figures of the spline through the same points, before: 0.031 N and 0.030 N."""
    expert = train(measured_map(BEARING, noisy(*grid(lines), 0.02))).expert
    assert rms(expert.force(*BOX) - saturating(*BOX)) < 0.034


def test_noise_is_smoothed():
    """A spline through the points, and a network trained on it, had 0.21 N."""
    expert = train(measured_map(BEARING, noisy(*grid(9), 0.3))).expert
    assert rms(expert.force(*BOX) - saturating(*BOX)) < 0.15


def test_scattered_points_do_as_well_as_a_grid():
    surface = ForceSurface(BEARING, noisy(*scattered(150), 0.1))
    inside = 0.85 * BOX[0], 0.85 * BOX[1]  # hardly a point lies in a corner
    assert rms(surface(*inside) - saturating(*inside)) < 0.08


def test_standard_errors_are_right():
    """Over many places and seeds the error is as large as was said."""
    z = []
    for seed in range(8):
        surface = ForceSurface(BEARING, noisy(*scattered(100, seed), 0.3, seed=seed))
        z.append((surface(*BOX) - saturating(*BOX)) / surface.standard_error(*BOX))
    assert 0.6 < rms(z) < 1.3


@pytest.mark.parametrize("noise", [0.05, 0.5])
def test_scatter_is_found(noise):
    surface = ForceSurface(BEARING, noisy(*scattered(120), noise, known=False))
    assert surface.scatter == pytest.approx(noise, rel=0.25)
    told = ForceSurface(BEARING, noisy(*scattered(120), noise))
    assert told.scatter is None
    assert rms(surface(*BOX) - told(*BOX)) < 0.5 * noise


def test_a_law_that_is_right_is_left_alone():
    surface = ForceSurface(BEARING, noisy(*grid(7), 0.5, force=LAW))
    assert surface.law_error < 1.0
    assert rms(surface(*BOX) - LAW(*BOX)) < 0.2


def test_an_offset_is_no_stiffness():
    """A load cell's zero goes into the force at the origin, all of it."""
    iu, x = grid(7)
    moved = ForcePoints(iu, x, LAW(iu, x) + 3.0, np.full(iu.size, 0.05))
    stiff = measured_map(BEARING, moved)
    assert stiff.force_bias == pytest.approx(3.0, abs=0.1)
    np.testing.assert_allclose(stiff.k_i, measured_map(BEARING, noisy(iu, x, 0.05, LAW)).k_i,
                               rtol=0.05)  # fmt: skip


def test_many_points_are_averaged():
    iu, x = scattered(4 * MOST)
    some = BOX[0][::4, ::4], BOX[1][::4, ::4]
    for known in (True, False):
        surface = ForceSurface(BEARING, noisy(iu, x, 1.0, known=known))
        off = rms(surface(*some) - saturating(*some))
        assert off < 0.25  # a point by itself: 1
        assert rms(surface.standard_error(*some)) == pytest.approx(off, rel=0.5)


@settings(max_examples=8, deadline=None)
@given(st.randoms(use_true_random=False))
def test_order_of_the_points_does_not_matter(random):
    points = noisy(*scattered(40), 0.3)
    order = list(range(40))
    random.shuffle(order)
    here = ForceSurface(BEARING, points)
    there = ForceSurface(BEARING, points.where(np.array(order)))
    np.testing.assert_allclose(there(*BOX), here(*BOX), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (ForcePoints([0.1, 0.1, 0.1], [0, 1e-4, 2e-4], [1, 2, 3]), "must differ in current"),
        (ForcePoints([0.1, 0.2, 0.3], [0, 0, 0], [1, 2, 3]), "must differ in displacement"),
    ],
)
def test_points_on_a_line_are_refused(points, message):
    with pytest.raises(AmbkitError, match=message):
        ForceSurface(BEARING, points)


@pytest.mark.parametrize(
    ("given_points", "message"),
    [
        (([1, 2], [0], [1, 2]), r"displacement must be a list with a value for each point"),
        (([], [], []), "current must be a list"),
        (([1.0], [0], [np.inf]), "force must be finite, is inf at point 1"),
        (([1.0, 1], [0, 0], [1, 1], [1, 0]), "greater than 0 N, is 0.0 at point 2"),
    ],
)
def test_points_that_are_none_are_named(given_points, message):
    with pytest.raises(AmbkitError, match=message):
        ForcePoints(*given_points)


def test_a_law_error_is_positive():
    with pytest.raises(AmbkitError, match="law_error must be greater than 0 N, is 0"):
        ForceSurface(BEARING, noisy(*grid(4), 0.1), 0.0)


def test_points_beside_the_box_are_reported():
    iu, x = grid(5)
    with pytest.raises(AmbkitError, match="they must overlap with the bearing's range"):
        measured_map(BEARING, noisy(iu + 4, x, 0.1, force=lambda i, x: i))


def test_the_law_is_fitted_before_it_is_corrected(monkeypatch):
    """On finite elements' map, with a quarter of it left out, it goes on nearer to the truth."""
    iu, x = fe_map.grid()
    points = ForcePoints(iu, x, fe_map.fe_force(iu, x), None)
    corner = (iu > 1) & (x > 0.08e-3)

    def error():
        surface = ForceSurface(fe_map.BEARING, points.where(~corner))
        off = surface(iu[corner], x[corner]) - points.force[corner]
        return surface.refitted, float(np.sqrt(np.mean(off**2)))

    refitted, fitted = error()
    monkeypatch.setattr("ambkit.machine.forces.force_surface.FITTED", len(points) + 1)
    as_described, described = error()
    assert (refitted, as_described) == (True, False)
    assert fitted < 0.7 * described


def test_a_law_that_is_right_is_corrected_as_described():
    iu, x = grid(9)
    force = LAW(iu, x) + np.random.default_rng(2).normal(0, 0.05, iu.size)
    assert not ForceSurface(BEARING, ForcePoints(iu, x, force, np.full(iu.size, 0.05))).refitted
