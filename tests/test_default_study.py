"""The defaults of filters, judged by truth: the kind of a machine, and poles that follow noise."""

import numpy as np
import pytest

import ambkit
from ambkit import FilterNoise, Machine
from ambkit.estimate import DEFAULT
from ambkit.estimate.registry import KINDS, default_filter, default_name
from ambkit.judge.comparison.default_study import CONSISTENT, DefaultScore, score_defaults
from ambkit.machine.accessories import Runout
from benchmarks.defaults import TUNED, random_machine, scores
from benchmarks.sensors import drawn

BEARING = Machine.preset("zittau_axial")
SPUN = Machine.preset("hindawi_2011")
PULSED = SPUN.replace(
    sensor=[item.model_copy(update={"runout": (Runout(order=1, amplitude=2e-6),)})
            for item in SPUN.sensors],
    angle={"type": "pulses", "angle_noise": "2 deg", "latency": "0.1 ms"},
)  # fmt: skip


def test_the_default_and_a_linear_filter_are_consistent():
    """The linear filter's law is off by six standard deviations of its gain's covariance."""
    score = score_defaults(drawn(3), (DEFAULT, "linear", "observer"), seed=3)
    for kind in (DEFAULT, "linear"):
        assert CONSISTENT[0] <= score.nees[kind] <= CONSISTENT[1]
    assert score.tuned[DEFAULT] < score.naive
    assert score.errors["observer"] < score.raw
    assert f"NEES {100 * score.nees[DEFAULT]:.0f} %" in score.row()


@pytest.mark.parametrize(
    ("nees", "error", "tuned", "texts"),
    [
        (0.94, 0.9, 0.9, []),
        (0.895, 1.01, 1.01, []),  # within twice the standard error; equal but for rounding
        (0.0, 28.0, 0.9, ["too small: 0 ± 1 %", "28 of the sensor's; 'ambkit tune'"]),
        (1.0, 2.0, 1.5, ["too large", "tuning does not help", "worse than a constant-velocity"]),
        (0.94, np.inf, np.inf, ["worse than the raw sensor", "constant-velocity"]),
    ],
)
def test_a_default_that_fails_its_study_is_named(nees, error, tuned, texts):
    of = DefaultScore(1.0, 1.0, {"k": error}, {"k": tuned}, {"k": nees}, {"k": 0.005})
    objections = list(of.objections())
    assert len(objections) == len(texts)
    assert all(text in objection for text, objection in zip(texts, objections, strict=True))


def test_a_ball_that_may_fall_is_judged_by_the_runs_in_which_it_floats():
    score = score_defaults(Machine.preset("inteco_ml"), runs=2)  # a third of its runs meet a stop
    assert CONSISTENT[0] <= score.nees[DEFAULT] <= CONSISTENT[1]
    assert score.errors[DEFAULT] < score.raw


@pytest.mark.parametrize("kind", ["observer", "low-pass"])
def test_poles_follow_noise_and_disturbance(kind):
    """A noisier sensor has slower poles, a stronger disturbance faster ones."""

    def fastest(**noise):
        made = KINDS[kind].make(BEARING, noise=FilterNoise(**noise))
        return made.bandwidth if kind == "observer" else made.corners["force"]

    R, q = (getattr(KINDS["linear"].make(BEARING).variances, of)
            for of in ("measurement", "disturbance"))  # fmt: skip
    assert fastest(measurement=100 * R) < fastest() < fastest(disturbance=1e4 * q)


@pytest.mark.parametrize("seed", [3, 5, 44, 75, 146])
def test_the_poles_of_the_observer_have_nearly_the_least_error(seed):
    observer, least = (KINDS[kind].make(drawn(seed)) for kind in ("observer", "steady-state"))
    assert observer.core.covariance[0, 0] < 1.015**2 * least.core.covariance[0, 0]


def test_the_default_estimates_what_rotates_by_the_description():
    names = [default_name(of) for of in (SPUN.replace(speed=0.0), SPUN, PULSED)]
    assert names == ["extended", "extended+unbalance", "extended+unbalance+runout"]
    assert [state.role for state in default_filter(SPUN).states].count("unbalance") == 2


@pytest.mark.parametrize("machine", [
    SPUN, Machine.preset("compressor"),
    pytest.param(PULSED, marks=pytest.mark.long),
    BEARING.replace(speed=300.0, sensor__runout=(Runout(order=1, amplitude=20e-6),)),
])  # fmt: skip
def test_the_default_is_consistent_with_unbalance_or_runout(machine):
    """Without synchronous states it is so in 28, 0, 0 and 0 % of the samples."""
    score = score_defaults(machine, runs=1)
    kind = default_name(machine)
    assert CONSISTENT[0] <= score.nees[kind] <= CONSISTENT[1]
    assert score.errors[kind] < score.raw


def test_an_unbalance_that_the_filter_does_not_estimate_is_reported():
    """Without the unbalance the same filter is consistent."""
    (note,) = (of for of in ambkit.simulate(SPUN, filter="extended").notes if "unbalance" in of)
    assert "'+unbalance'" in note
    more = [at.model_copy(update={"amount": 5 * SPUN.unbalances()[0][1], "grade": None})
            for at in SPUN.unbalance]  # fmt: skip
    notes = ambkit.simulate(SPUN.replace(unbalance=more), filter=default_filter(SPUN)).notes
    assert any("unbalance U1 is 7" in text and "correct the amount" in text for text in notes)
    for machine, filter in ((SPUN, None), (SPUN.replace(unbalance=[]), "extended")):
        notes = ambkit.simulate(machine, filter=filter).notes
        assert not any("with the unbalance" in text for text in notes)


@pytest.mark.study
@pytest.mark.parametrize(("draw", "count"), [(drawn, 240), (random_machine, 60)])
def test_defaults_hold_on_random_machines(draw, count):
    results = [score for _, score in scores(count, draw, 0)]
    nees = np.array([score.nees[DEFAULT] for score in results])
    tuned = np.array([score.tuned[DEFAULT] / score.naive for score in results])
    assert DEFAULT in TUNED
    assert np.mean((CONSISTENT[0] <= nees) & (nees <= CONSISTENT[1])) >= 0.95
    assert tuned.max() < 1.02
    if draw is drawn:
        observer = [one.errors["observer"] / min(one.raw, one.naive) for one in results]
        assert max(observer) < 1.02
