"""Training of the expert system: what it reaches, and that it is right and repeatable."""

import numpy as np
import pytest
from force_table import force_table
from paper.printed import INITIAL_WIDTH

from ambkit.base.errors import AmbkitError
from ambkit.fuzzy.expert import Expert
from ambkit.fuzzy.training import LeastSquares, TrainingSet, _least_squares, train
from ambkit.machine.machine import Machine
from ambkit.machine.stiffness import stiffness_map

ZITTAU = Machine.preset("zittau_axial")
ONE_SIDED = ZITTAU.replace(magnet__type="one-sided")
MAP = stiffness_map(ZITTAU)


def worst_force_rms(expert, stiff):
    """The larger of the area's mean and that of a grid with the edges, where it is hardest."""
    iu, x = np.meshgrid(
        np.linspace(*expert.current_range, 101), np.linspace(*expert.displacement_range, 101)
    )
    error = expert.force(iu, x) - np.asarray(stiff.force(iu, x))
    return max(stiff.force_rms(expert.force), float(np.sqrt(np.mean(error**2))))


@pytest.mark.parametrize("scaling", ["grid", "unit"])
@pytest.mark.parametrize(("weights", "least"), [(False, 0.16), (True, 0.05)])
def test_what_is_trained_is_as_near_as_its_freedom_allows(weights, least, scaling):
    expert = train(MAP, weights=weights, scaling=scaling)
    assert worst_force_rms(expert, MAP) < least  # [N]
    assert expert.training.weights is weights
    if not weights:
        np.testing.assert_array_equal(expert.weights[0], MAP.k_i.ravel())
        np.testing.assert_array_equal(expert.weights[1], MAP.k_s.ravel())
        assert np.all((expert.widths > 0.05) & (expert.widths < 3))


@pytest.mark.parametrize("weights", [False, True])
def test_k_i_and_k_s_keep_their_meaning(weights):
    expert = train(MAP, weights=weights)
    iu, x = np.meshgrid(np.linspace(-1.5, 1.5, 61), np.linspace(-0.5e-3, 0.5e-3, 61))
    for found, lsm in zip(expert.stiffness(iu, x), MAP.stiffness_at(iu, x), strict=True):
        assert np.sqrt(np.mean((found - lsm) ** 2)) < 0.04 * np.sqrt(np.mean(lsm**2))
        assert np.min(found) > 0.8 * np.min(lsm)
        assert np.max(found) < 1.1 * np.max(lsm)


def test_steepest_gradient_of_the_paper_learns():
    options = {"method": "steepest-gradient", "scaling": "unit", "widths": INITIAL_WIDTH}
    plain = train(MAP, normalised=False, **options)
    normalised = train(MAP, **options)
    assert MAP.force_rms(plain.force) < 1.2  # the paper's own widths: 1.98
    assert MAP.force_rms(normalised.force) < 0.16
    for expert in (plain, normalised):
        assert len(expert.learning_curve) == 1001
        for curve in (expert.training.k_i_rms, expert.training.k_s_rms):
            assert np.all(np.diff(curve) <= 0)
            assert curve[-1] < 0.4 * curve[0]


def test_the_learning_curve_goes_from_the_untrained_to_the_trained_network():
    start, expert = Expert.from_map(MAP), train(MAP)
    for network, rms in ((start, expert.learning_curve[0]), (expert, expert.learning_curve[-1])):
        iu, x = np.meshgrid(np.linspace(-1.5, 1.5, 21), np.linspace(-0.5e-3, 0.5e-3, 21))
        error = network.force(iu, x) - np.asarray(MAP.force(iu, x))
        assert np.sqrt(np.mean(error**2)) == pytest.approx(rms, rel=1e-9)
    assert start.learning_curve.size == 0


@pytest.mark.parametrize("normalised", [False, True])
@pytest.mark.parametrize("weights", [False, True])
@pytest.mark.parametrize("bearing", [ZITTAU, ONE_SIDED])
def test_the_jacobian_is_that_of_differences(bearing, weights, normalised):
    stiff = stiffness_map(bearing)
    start = Expert.from_map(stiff, normalised=normalised)
    problem = LeastSquares(TrainingSet(stiff, start, samples=6), weights)
    at = 0.3 * np.random.default_rng(1).standard_normal(problem.start().size)
    h = 1e-5
    differences = np.column_stack(
        [
            (problem.residuals(at + h * e) - problem.residuals(at - h * e)) / (2 * h)
            for e in np.eye(at.size)
        ]
    )
    jacobian = problem.jacobian(at)
    np.testing.assert_allclose(jacobian, differences, atol=1e-8 * np.max(np.abs(jacobian)))


def test_a_symmetric_law_gives_symmetric_widths():
    widths = train(MAP).widths
    np.testing.assert_allclose(widths, widths[:, ::-1], rtol=1e-5)


def test_the_same_input_gives_the_same_network():
    assert train(MAP) == train(ZITTAU)


@pytest.mark.parametrize("weights", [False, True])
def test_neither_units_nor_size_matter(weights):
    """Powers of two cost no rounding: every digit has to agree."""
    metre, newton = 2.0**20, 2.0**-7
    other = stiffness_map(
        ZITTAU,
        displacements=metre * MAP.displacement,
        delta_displacement=metre * MAP.delta_displacement,
        force=lambda iu, x: newton * np.asarray(MAP.force(iu, x / metre)),
    )
    here, there = train(MAP, weights=weights), train(other, weights=weights)
    np.testing.assert_allclose(there.widths, here.widths, rtol=1e-12)
    units = np.array([[newton], [newton / metre]])
    np.testing.assert_allclose(there.weights, units * here.weights, rtol=1e-12)


@pytest.mark.parametrize("weights", [False, True])
def test_a_one_sided_magnet_is_learnt(weights):
    stiff = stiffness_map(ONE_SIDED)
    expert = train(stiff, weights=weights)
    assert worst_force_rms(expert, stiff) < (0.05 if weights else 0.1)
    assert expert.force_bias == stiff.force_bias


def test_a_force_table_is_learnt():
    def saturating(iu, x):
        """The law of the bearing, its iron saturating at some 15 N."""
        return 15 * np.tanh(np.asarray(MAP.force(iu, x)) / 15)

    current, displacement = np.linspace(-1.6, 1.6, 15), np.linspace(-0.6e-3, 0.6e-3, 15)
    table = force_table(current, displacement, saturating(*np.meshgrid(current, displacement)))
    stiff = stiffness_map(ZITTAU, force=table)
    untrained = Expert.from_map(stiff)
    expert = train(stiff, weights=True)
    assert worst_force_rms(expert, stiff) < 0.05
    assert stiff.force_rms(expert.force) < 0.3 * stiff.force_rms(untrained.force)


def test_other_numbers_of_nodes_are_learnt():
    stiff = stiffness_map(
        ZITTAU, currents=np.linspace(-1.5, 1.5, 7), displacements=[-0.5e-3, -1e-4, 1e-4, 0.5e-3]
    )
    expert = train(stiff, weights=True)
    assert len(expert.rules) == 28
    assert worst_force_rms(expert, stiff) < 0.1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, 'method must be "least-squares" or "steepest-gradient"'),
        ({"method": "steepest-gradient", "weights": True}, "weights = True needs the method"),
        ({"epochs": 0}, "epochs must be 1 or more, is 0"),
        ({"samples": 1}, "samples must be 2 or more, is 1"),
        ({"learning_rate": 0.0}, "learning_rate must be greater than 0"),
        ({"scaling": "metric"}, "scaling must be"),
    ],
)
def test_what_cannot_be_used_is_named(options, message):
    with pytest.raises(AmbkitError, match=message):
        train(MAP, **options)


def test_a_force_that_never_changes_cannot_be_learnt():
    stiff = stiffness_map(ZITTAU, force=lambda iu, x: 0 * iu + 5.0)
    with pytest.raises(AmbkitError, match="the force is the same all over the box"):
        train(stiff)


def test_a_training_that_was_done_before_is_kept():
    before, one = _least_squares.cache_info(), train(ZITTAU, samples=7)
    again, other = train(ZITTAU, samples=7), train(ZITTAU, samples=8)
    after = _least_squares.cache_info()
    assert (after.hits - before.hits, after.misses - before.misses) == (1, 2)
    assert np.array_equal(one.widths, again.widths)
    assert not np.array_equal(one.widths, other.widths)
