"""The force on a grid from a record of the loop, and the expert trained by its uncertainty."""

from dataclasses import replace

import numpy as np
import pytest
from force_table import force_table
from scipy.interpolate import RegularGridInterpolator

from ambkit import (
    PID,
    AmbkitError,
    ClosedLaw,
    Machine,
    Scenario,
    Sine,
    simulate,
    stiffness_map,
    train,
)
from ambkit.fuzzy.rule_selection import measured_map
from ambkit.identification.forces.force_map import force_map, nodes_for
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.machine.forces.force_points import ForcePoints, load_force_points

BEARING = Machine.preset("zittau_axial")


def saturating(iu, x):
    """Iron that saturates: the law is wrong by newtons."""
    return 16 * np.tanh(ClosedLaw(BEARING).force(iu, x) / 16)


@pytest.fixture(scope="module")
def record():
    nodes = np.linspace(-1.5, 1.5, 25), np.linspace(-1e-3, 1e-3, 25)
    true = force_table(*nodes, saturating(*np.meshgrid(*nodes)))
    plant = stiffness_map(
        BEARING,
        currents=np.linspace(-1.49, 1.49, 31),
        displacements=np.linspace(-0.95e-3, 0.95e-3, 31),
        force=true,
    )
    scenario = Scenario(
        duration=2.0,
        reference=Sine(amplitude=0.3e-3, frequency=5) + Sine(amplitude=0.05e-3, frequency=31),
        disturbance=Sine(amplitude=2, frequency=2.3),
        controller=PID.textbook(BEARING),
    )
    run = simulate(BEARING, scenario, plant=plant).record
    assert run.meta["stop_touched"] == 0
    return run


@pytest.fixture(scope="module")
def found(record):
    model = LoopModel(BEARING, disturbance_noise=6.0, substeps=1)
    return force_map(model, record, settling=0.05)


def test_force_is_found_where_the_rotor_was(found):
    true = saturating(*np.meshgrid(found.current, found.displacement))
    seen = found.seen
    assert 0.4 < seen.mean() < 0.95
    weight = seen / found.standard_error**2
    off = found.force - true
    off = off - np.sum(weight * off) / weight.sum()  # a constant is a load
    of_law = found.law - true
    of_law = of_law - np.sum(weight * of_law) / weight.sum()
    assert np.sqrt(np.sum(weight * off**2)) < 0.4 * np.sqrt(np.sum(weight * of_law**2))
    # Between the nodes the correction is straight and the truth is not: not quite its errors.
    assert np.mean((np.abs(off) < 3 * found.standard_error + 0.05 * np.ptp(true))[seen]) > 0.85


def test_where_the_rotor_never_was_the_law_and_its_doubt_are_kept(found):
    corner = np.unravel_index(np.argmax(found.standard_error), found.standard_error.shape)
    assert found.standard_error[corner] > 0.7 * found.assumed
    assert not found.seen[corner]


def test_map_goes_through_a_file_into_the_training(found, tmp_path):
    found.save(tmp_path / "force.csv")
    points = load_force_points(tmp_path / "force.csv")
    told = found.observed
    assert 0.4 < told.mean() < 0.95  # what the records do not tell is no measurement of the law
    np.testing.assert_allclose(points.force, found.force[told], rtol=1e-12)
    np.testing.assert_allclose(points.standard_error, found.standard_error[told], rtol=1e-12)


def test_map_makes_an_expert_that_knows_the_force_where_the_rotor_was(found, record):
    """Better than the law along the record, and no wilder anywhere else."""
    expert = train(measured_map(BEARING, found.points())).expert
    iu, x = record["iu"][::50], record["x"][::50]
    off, of_law = expert.force(iu, x), ClosedLaw(BEARING).force(iu, x)
    assert np.std(off - saturating(iu, x)) < 0.35 * np.std(of_law - saturating(iu, x))
    box = np.meshgrid(np.linspace(-1.5, 1.5, 31), np.linspace(-1e-3, 1e-3, 31))
    k_i, k_s = expert.stiffness(*box)
    law_i, law_s = ClosedLaw(BEARING).stiffness(*box)
    assert 0.5 * law_i.min() < k_i.min() < k_i.max() < 1.2 * law_i.max()
    assert 0.5 * law_s.min() < k_s.min() < k_s.max() < 1.2 * law_s.max()


def test_more_nodes_tell_more(found, record):
    """Half the nodes each way, from the same record: straight between them they miss more."""
    model = LoopModel(BEARING, disturbance_noise=6.0, substeps=1)
    coarse = force_map(model, record, nodes=(5, 5), settling=0.05)
    at = np.stack([record["x"][::50], record["iu"][::50]], axis=-1)
    at = np.clip(at, *np.stack([(m[0], m[-1]) for m in (found.displacement, found.current)]).T)

    def off(mapped):
        between = RegularGridInterpolator((mapped.displacement, mapped.current), mapped.force)
        return np.std(between(at) - saturating(at[:, 1], at[:, 0]))

    assert found.force.shape == (9, 9)
    assert off(found) < 0.8 * off(coarse)


def test_a_law_that_is_right_is_found_right_near_rest():
    """Where the deviations of the innovations were not held, it was off by 4 standard errors."""
    model = LoopModel(BEARING, disturbance_noise=1e-3, substeps=1)
    scenario = Scenario(duration=1.0, reference=Sine(amplitude=0.02e-3, frequency=31))
    off = []
    for seed in range(3):
        mapped = force_map(model, simulate(BEARING, scenario.replace(seed=seed)).record,
                           nodes=(5, 5),
                           settling=0.05)  # fmt: skip
        off.append((mapped.force - mapped.law) / mapped.standard_error)
    assert 0.3 < np.sqrt(np.mean(np.square(off))) < 1.3


def test_records_decide_the_number_of_nodes():
    random = np.random.default_rng(3)
    assert nodes_for(*random.uniform(-1, 1, (2, 20_000))) == (9, 9)
    assert nodes_for(*random.uniform(-1, 1, (2, 300))) == (5, 5)
    assert nodes_for(*random.uniform(-1, 1, (2, 300_000))) == (7, 7)  # the derivatives' memory


def test_a_map_of_which_nothing_is_reported_is_refused(found):
    with pytest.raises(AmbkitError, match="do not determine the magnet force"):
        replace(found, assumed=1e-9).points()


def test_training_believes_what_is_known_better():
    """The same points with errors of 3 N on one half, told and not told."""
    iu, x = (
        side.ravel() for side in np.meshgrid(np.linspace(-1.5, 1.5, 9), np.linspace(-5e-4, 5e-4, 9))
    )
    wrong = iu > 0.6
    noise = 3.0 * np.random.default_rng(2).normal(size=iu.size) * wrong
    force = saturating(iu, x) + noise

    def trained(errors):
        return train(measured_map(BEARING, ForcePoints(iu, x, force, errors))).expert

    told, blind = trained(np.where(wrong, 3.0, 0.02)), trained(None)
    good = np.meshgrid(np.linspace(-1.4, 0.3, 15), np.linspace(-4e-4, 4e-4, 15))

    def off(expert):
        return np.sqrt(np.mean((expert.force(*good) - saturating(*good)) ** 2))

    assert off(told) < 0.1
    assert off(told) < 0.5 * off(blind)
