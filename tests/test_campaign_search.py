"""What drives machines, how rarely they fail, and what is tuned over them."""

import json
from pathlib import Path

import numpy as np
import pytest
from limit_states import LIMIT_STATES

import ambkit
from ambkit.base.errors import AmbkitError
from ambkit.campaigns.distributions import Choice, Uniform
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.results import Machines
from ambkit.campaigns.sobol_indices import _of_choice, indices
from ambkit.campaigns.study import Study
from ambkit.campaigns.subset_simulation import rare_failure, subset
from ambkit.workflow import robust_task
from ambkit.workflow.robust_tuning import pareto

KEYS = ("rotor.mass", "magnet.air_gap", "sensor.lag")


class Known(Machines):
    """Machines whose figure is a known function of what varies."""

    def __init__(self, of, way, runs, *more):
        vary = (*(Uniform(what=key, tolerance="10 %") for key in KEYS), *more)
        made = Study(
            name="a", machine="zittau_axial", sampling=way, runs=runs, vary=vary, part=runs
        )
        super().__init__(Path(), Plan(made), (0,))
        self.of = of

    def column(self, name):
        x = self.plan.points(0, len(self))
        nominal = np.array([float(key.value or 0) for key in self.plan.keys[:3]])
        return self.of(np.pi * (x[:, :3] / nominal - 1) / 0.1, x)


def ishigami(z, _x):
    """The function of Ishigami and Homma (1990), whose indices are known."""
    return np.sin(z[:, 0]) + 7 * np.sin(z[:, 1]) ** 2 + 0.1 * z[:, 2] ** 4 * np.sin(z[:, 0])


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning")
def test_sobol_indices_of_a_known_function():
    pytest.importorskip("SALib")
    found = indices(Known(ishigami, "saltelli", 5 * 1024), "f_d_rms")
    np.testing.assert_allclose(found.first, [0.3139, 0.4424, 0.0], atol=0.05)
    np.testing.assert_allclose(found.total, [0.5576, 0.4424, 0.2437], atol=0.05)
    assert (found.first_confidence < 0.1).all()
    other = indices(Known(ishigami, "sobol", 4096), "f_d_rms")
    np.testing.assert_allclose(other.first, [0.3139, 0.4424, 0.0], atol=0.05)
    assert other.total is None
    assert list(other.order[:2]) == [1, 0]


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning")
def test_the_share_of_a_choice_is_that_of_its_means():
    """Two values 1 apart, beside a uniform spread of variance 1/3."""
    pytest.importorskip("SALib")
    who = Choice(what="estimator", values=("linear", "extended"))
    made = Known(lambda z, x: z[:, 0] / np.pi + x[:, 3], "random", 4000, who)
    found = indices(made, "f_d_rms")
    share = 0.25 / (0.25 + 1 / 3)
    assert found.first[3] == pytest.approx(share, abs=0.03)
    assert found.first[0] == pytest.approx(1 - share, abs=0.05)
    constant = Known(lambda z, x: np.ones(len(x)), "random", 100)
    with pytest.raises(AmbkitError, match="is the same for all machines"):
        indices(constant, "f_d_rms")


def test_a_share_is_without_what_chance_makes_of_it():
    """Two levels of two runs: 25 of 35 between them, of which 1 / 2 of the 10 within is chance."""
    share, _ = _of_choice(np.array([0.0, 0.0, 1.0, 1.0]), np.array([1.0, 3.0, 5.0, 9.0]), 0.95)
    assert share == pytest.approx(20 / 35)


def estimates(name, seeds, runs=1000):
    """Estimates of a limit state of a known probability, and its probability."""
    state = LIMIT_STATES[name]
    found = [
        subset(state.value, state.dimensions, 0.0, runs=runs, seed=seed) for seed in range(seeds)
    ]
    return found, state.probability


@pytest.mark.parametrize("name", ["plane, 10", "two sides"])
def test_rare_failures_of_a_known_probability(name):
    found, P = estimates(name, 40)
    assert np.median([each.probability for each in found]) == pytest.approx(P, rel=0.3)
    assert np.mean([each.low <= P <= each.high for each in found]) > 0.85
    warned = np.mean([each.several_modes for each in found])
    assert warned > 0.9 if LIMIT_STATES[name].several_modes else warned == 0
    assert found[0].runs < 20 / P


@pytest.mark.study
@pytest.mark.parametrize("name", LIMIT_STATES)
def test_intervals_of_published_limit_states_hold_the_truth(name):
    found, P = estimates(name, 100)
    assert sum(each.low <= P <= each.high for each in found) >= 92
    warned = sum(each.several_modes for each in found)
    assert warned >= 60 if LIMIT_STATES[name].several_modes else warned <= 5


def test_a_limit_state_of_ones_own_is_of_figures_and_what_varies(tmp_path):
    (tmp_path / "own.py").write_text(
        "def limit(columns):\n"
        "    return columns['peak_S'] * columns['rotor.mass'] / 0.518\n"
        "def short(columns):\n"
        "    return columns['peak_S'][:1]\n"
    )
    plan = Plan(Study.from_toml(STUDY))
    own = rare_failure(plan, f"{tmp_path / 'own.py'}:limit", 1.85, runs=100)
    assert 0 < own.low < own.probability < own.high
    with pytest.raises(AmbkitError, match="must return 20 numbers, returned shape \\(1,\\)"):
        rare_failure(plan, f"{tmp_path / 'own.py'}:short", 1.85, runs=100)


def test_a_figure_without_a_way_to_failure_is_refused():
    with pytest.raises(AmbkitError, match="does not measure the distance"):
        subset(lambda u: (u[:, 0] > 6).astype(float), 2, 1.0, runs=100)


STUDY = """
name = "tuned"
machine = "zittau_axial"
runs = 24
scenario.duration = "30 ms"
scenario.disturbance = { type = "step", amplitude = "3 N", time = "5 ms" }

[[vary]]
what = "magnet.magnet_constant"
type = "uniform"
tolerance = "10 %"

[[vary]]
what = "rotor.mass"
type = "normal"
std = "3 %"
"""


def test_rare_failures_of_machines():
    """The likelihood agrees with that of plain runs, where it is not small."""
    plan = Plan(Study.from_toml(STUDY))
    limit = 1.85
    found = rare_failure(plan, "peak_S", limit, runs=100)
    many = Plan(Study.from_toml(STUDY.replace("runs = 24", "runs = 400")))
    from ambkit.campaigns.worker import compute

    share = np.mean(compute(many, 0, 400).runs.column("peak_S").to_numpy() >= limit)
    assert 0.002 < share < 0.5
    assert found.low / 2 < share < 2 * found.high
    with pytest.raises(AmbkitError, match="there is no figure nothing"):
        rare_failure(plan, "nothing", 1.0)


def test_a_front_has_what_nothing_is_better_than():
    points = [(1.0, 5.0), (2.0, 3.0), (2.0, 4.0), (3.0, 3.0), (4.0, 1.0)]
    assert pareto(points).tolist() == [True, True, False, False, True]


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::UserWarning")
def test_tuned_over_the_machines_it_is_gone_on_with_and_written(tmp_path):
    pytest.importorskip("optuna")
    study = Study.from_toml(STUDY)
    kept = tmp_path / "search.log"
    first = ambkit.tune_robust(study, budget=3, storage=kept, max_sensitivity=4.0)
    assert len(first.candidates) == 3
    found = ambkit.tune_robust(study, budget=6, storage=kept, max_sensitivity=4.0)
    assert [each.error for each in found.candidates[:3]] == [
        each.error for each in first.candidates
    ]
    assert len(found.candidates) == 6
    before, after = found.candidates[0], found.candidates[found.taken]
    assert before.values["controller.kp"] == found.plan.scenario.controller.kp
    assert after.allowed
    assert after.error <= before.error
    untuned, tuned = found.validation
    assert (untuned.values, tuned.values) == (before.values, after.values)
    assert tuned.error != after.error
    assert "on validation machines, error of f_d" in found.finding
    json.dumps(found.to_dict())
    found.save(tmp_path / "filter.toml")
    again = ambkit.FilterFile.load(tmp_path / "filter.toml").make()
    assert again.variances == found.estimator.variances
    controller = ambkit.Scenario.load(tmp_path / "filter.scenario.toml").controller
    assert controller.kp == found.controller.kp
    assert "tuned" in found._repr_html_()
    with pytest.raises(AmbkitError, match="is of another search"):
        ambkit.tune_robust(study, budget=6, storage=kept, max_sensitivity=3.0)
    with pytest.raises(AmbkitError, match=r"none keeps 95 % of .* below a peak of 1\.01"):
        ambkit.tune_robust(study, budget=1, max_sensitivity=1.01)
    with pytest.raises(AmbkitError, match=r"there is no controller\.kx"):
        ambkit.tune_robust(study, free=["controller.kx"])


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::UserWarning")
def test_the_kind_of_filter_is_chosen_too_and_judged_on_other_machines(tmp_path):
    pytest.importorskip("optuna")
    study = Study.from_toml(STUDY).model_copy(update={"estimator": "constant-velocity", "runs": 8})
    found = ambkit.tune_robust(study, filter=["linear"], budget=5, max_sensitivity=4.0)
    assert [one.kind for one in found.candidates[:2]] == ["constant-velocity", "linear"]
    allowed = [one for one in found.candidates if one.allowed]
    assert found.candidates[found.taken] == min(allowed, key=lambda one: one.error)
    assert found.kind == "linear"
    assert [one.kind for one in found.validation] == ["constant-velocity", "linear"]
    assert "untuned (constant-velocity)" in found.finding
    found.save(tmp_path / "filter.toml")
    assert isinstance(ambkit.FilterFile.load(tmp_path / "filter.toml").make(), ambkit.KalmanFilter)
    with pytest.raises(AmbkitError, match=r"must be a kind, .*, is nothing"):
        ambkit.tune_robust(study, filter=["nothing"])


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::UserWarning")
def test_the_size_of_the_expert_is_searched_and_is_that_of_the_filter(tmp_path, monkeypatch):
    pytest.importorskip("optuna")
    monkeypatch.setattr(robust_task, "SIZES", (3, 5))
    study = Study.from_toml(STUDY).model_copy(update={"estimator": "adaptive", "runs": 4})
    found = ambkit.tune_robust(study, free=["expert.rules"], budget=4, max_sensitivity=4.0)
    tried = {each.values["expert.rules"]: each.error for each in found.candidates}
    assert set(tried) == {3.0, 5.0}
    assert len(set(tried.values())) == len(tried)  # another size is another filter
    rules = int(found.candidates[found.taken].values["expert.rules"])
    assert found.candidates[found.taken].error == min(tried.values())
    assert found.estimator.magnet.weights.shape[1] == rules**2
    found.save(tmp_path / "filter.toml")
    again = ambkit.FilterFile.load(tmp_path / "filter.toml").make()
    assert again.magnet.weights.shape[1] == rules**2
