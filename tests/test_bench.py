"""The comparison: the same for all, tuned alike, consistent where the model is true."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import ambkit
from ambkit import AmbkitError, Machine
from ambkit.estimate.machine_model import View
from ambkit.judge.comparison import cases, criteria
from ambkit.judge.comparison.cases import CASES, Load, trials, walk_case
from ambkit.judge.comparison.comparison import Sweep, bench, sweep
from ambkit.judge.comparison.conditions import CERTAIN, Spread
from ambkit.judge.comparison.figures import _shades, cases_figure, matrix_figure, sweep_figure
from ambkit.judge.comparison.study import HEIGHTS, WRONG, learned, study
from ambkit.judge.comparison.tuning import candidates, errors, expand, tune
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.force_surface import ForceSurface
from ambkit.machine.magnets import own_time
from ambkit.simulation.external_inputs import ExternalInputs

BEARING = Machine.preset("zittau_axial")
VIEW = View(BEARING)
SHORT = replace(
    cases.step_case(0.5),
    scenario=lambda bearing, load: (
        cases.step_case(0.5).scenario(bearing, load).replace(duration=0.3)
    ),
)  # 0.3 s: the step, and the load at 0.25 s
FIELD = candidates(["linear", "closed-law"], BEARING)


# ---- what is uncertain ----


def test_points_stay_within_the_spread_and_fewer_are_the_first_of_more():
    spread = Spread(magnet_constant=0.2, mass=0.1)
    few, many = spread.factors(5, seed=3), spread.factors(12, seed=3)
    assert few == many[:5]
    assert few != spread.factors(5, seed=4)
    constants = np.array([f.magnet_constant for f in spread.factors(64, seed=1)])
    assert 0.8 <= constants.min() < 0.82
    assert 1.18 < constants.max() <= 1.2
    # Even cover is what Sobol points are for: each eighth of the range has an eighth of them.
    assert (np.histogram(constants, 8, (0.8, 1.2))[0] == 8).all()
    assert all(f.air_gap == f.noise == 1 for f in many)


def test_the_plant_takes_the_factors_and_nothing_else_changes():
    plant = Spread(1.1, 0.9, 1.05, 1.2, 0.8, 1.3).plant(BEARING)
    assert plant.magnet.magnet_constant == pytest.approx(1.1 * BEARING.magnet.magnet_constant)
    assert plant.rotor.mass == pytest.approx(0.9 * BEARING.rotor.mass)
    assert plant.magnet.air_gap == pytest.approx(1.05 * BEARING.magnet.air_gap)
    assert plant.sensor.noise_variance == pytest.approx(1.44 * BEARING.sensor.noise_variance)
    assert plant.sensor.lag == pytest.approx(0.8 * BEARING.sensor.lag)
    assert plant.amplifier == BEARING.amplifier
    assert Spread.all(1.0).plant(BEARING).to_toml() == BEARING.to_toml()


def test_imposed_series_are_added_and_replace():
    scenario = ambkit.Scenario(duration=0.05, disturbance=ambkit.Constant(value=1.0))
    n = 501
    load, noise = np.linspace(0, 1, n), np.full(n, 2e-6)
    record = ambkit.simulate(BEARING, scenario, external_inputs=ExternalInputs(load, noise)).record
    assert record["f_d"] == pytest.approx(1 + load)
    assert record["y"] - record["x_m"] == pytest.approx(noise)
    with pytest.raises(ValueError, match="external_inputs disturbance must have 501 values"):
        ambkit.simulate(BEARING, scenario, external_inputs=ExternalInputs(load[1:]))


@pytest.mark.parametrize("name", ["zittau_axial", "inteco_ml"])
def test_a_scaled_magnet_is_another_magnet_constant(name):
    bearing = Machine.preset(name)
    pid = ambkit.PID.for_bearing(bearing).model_copy(update={"feedback": "measurement"})
    scenario = ambkit.Scenario(duration=0.03, start="released", controller=pid)
    n = round(0.03 / bearing.sampling_time) + 1
    scaled = ambkit.simulate(
        bearing, scenario, external_inputs=ExternalInputs(magnet_scale=np.full(n, 1.2))
    ).record
    stronger = bearing.replace(magnet__magnet_constant=1.2 * bearing.magnet.magnet_constant)
    other = ambkit.simulate(stronger, scenario).record
    for signal in ("x", "v", "iu", "f_mag"):
        assert scaled[signal] == pytest.approx(other[signal], rel=1e-9, abs=1e-12)


def test_a_drifting_magnet_drifts():
    trial = trials(CASES["wrong-k"], BEARING, 1, 0)[0]
    law = ambkit.ClosedLaw(BEARING).force(trial.record["iu"], trial.record["x"])
    ratio = trial.record["f_mag"] / law
    assert ratio[[0, -1]] == pytest.approx([0.7, 0.77])
    assert (np.diff(ratio) > 0).all()


# ---- consistency where the model is true ----


@pytest.fixture(scope="module")
def true_model():
    """NEES of 200 runs, (runs, samples), of two filters; after the start, in steps of 5 ms."""
    made = [t for t in trials(walk_case(0.3), BEARING, 200, 3) if not t.lost]
    return {
        name: np.array(
            [
                criteria.normalised_errors(
                    each.build().run(t.record, covariance=True), t.record, VIEW
                )[500::50]
                for t in made
            ]
        )
        for name, each in FIELD.items()
    }  # fmt: skip


def test_nees_is_within_its_band_over_200_runs(true_model):
    """The mean of N values of three states is chi-square with 3 N degrees of freedom, over N."""
    nees = true_model["closed-law"]
    runs = len(nees)
    assert runs > 190
    low, high = chi2.ppf([0.025, 0.975], 3 * runs) / runs
    means = nees.mean(axis=0)
    assert np.mean((low < means) & (means < high)) >= 0.85  # 95 % of about 30 instants
    assert np.mean(nees <= chi2.ppf(0.95, 3)) == pytest.approx(0.95, abs=0.01)


def test_nees_finds_the_filter_that_is_too_sure(true_model):
    """At three tenths of the travel the constant stiffnesses are wrong; it states by how much."""
    bound = chi2.ppf(0.95, 3)
    assert 0.9 < np.mean(true_model["linear"] <= bound) < 0.985
    silent = FIELD["linear"].build()
    silent.law_error = np.zeros(0)
    unstated = [
        criteria.normalised_errors(silent.run(t.record, covariance=True), t.record, VIEW)[500::50]
        for t in trials(walk_case(0.3), BEARING, 20, 3)
    ]
    assert np.mean(np.array(unstated) <= bound) < 0.85


def test_nees_by_hand():
    t = np.array([0.0, 1.0])
    zero = np.zeros(2)
    truth = ambkit.Record(t, {"x": zero, "v": zero, "f_d": zero}, {})
    upper = np.tile([4.0, 1.0, 0, 0, 9.0, 0, 0, 25.0, 0, 1.0], (2, 1))
    mean = np.array([[2.0, 3.0, 5.0, 0.0], [0.0, 0.0, 10.0, 7.0]])
    estimate = ambkit.Estimate(
        t, mean, zero, zero, zero, zero, np.zeros(2, dtype=np.uint16), upper, "",
        ambkit.KalmanFilter(BEARING).states,
    )  # fmt: skip
    P = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, 25.0]])
    expected = [e @ np.linalg.inv(P) @ e for e in mean[:, :3]]
    assert criteria.normalised_errors(estimate, truth, VIEW) == pytest.approx(expected)
    # Other states beside change nothing: here one more, which goes with x.
    wide = np.tile([4.0, 1.0, 0, 0, 3.0, 9.0, 0, 0, 0, 25.0, 0, 0, 1.0, 0, 7.0], (2, 1))
    more = ambkit.KalmanFilter(BEARING.replace(amplifier__bandwidth="1 kHz")).states
    five = replace(estimate, states=more, mean=np.c_[mean, zero], covariance=wide)
    assert criteria.normalised_errors(five, truth, VIEW) == pytest.approx(expected)
    assert five.std("f_d") == pytest.approx([5.0, 5.0])
    # An estimator that knows no covariance writes zeros: then there is no NEES.
    blind = replace(estimate, covariance=0 * upper)
    assert np.isnan(criteria.normalised_errors(blind, truth, VIEW)).all()


# ---- single criteria ----


def once(t):
    return 3 + np.tanh((t - 1500) / 60) + 0.5 * np.sin(t / 150)


def again(t):
    """Of period 100: an estimate that is ahead by 3 samples is not 97 late."""
    return np.sin(2 * np.pi * t / 100)


def at_the_end(t):
    """So late that for most lags nothing moves in the stretch that is compared."""
    return np.tanh((t - 3950) / 8)


@pytest.mark.parametrize(("signal", "late"), [
    *((of, late) for of in (once, at_the_end) for late in (0, 7, 12.4)),
    *((again, late) for late in (-3.0, 0.0, 7.0, 40.0)),
])  # fmt: skip
def test_the_delay_is_what_the_signal_was_delayed_by(signal, late):
    t = np.arange(4000.0)
    noise = 0.02 * np.random.default_rng(0).normal(size=t.size)
    for unit in (1.0, 1e6):
        estimated, true = unit * (signal(t - late) + noise), Load(unit * signal(t))
        found = criteria.delay(estimated, true, 1e-4)
        assert found == pytest.approx(1e-4 * max(late, 0.0), abs=1e-4)
    assert np.isnan(criteria.delay(noise, Load(np.ones_like(t)), 1e-4))


def test_on_one_s_own_iron_what_learned_it_is_best():
    """A force map that bends away from the law: there the law is wrong, and the table right."""
    law = ambkit.magnet_of(BEARING)
    reach = 0.9 * BEARING.clearance
    current = np.linspace(BEARING.current_min, BEARING.current_max, 9)
    i, x = (a.ravel() for a in np.meshgrid(current, np.linspace(-reach, reach, 9)))
    force = law.force(i, x)
    plant = ForceSurface(BEARING, ForcePoints(i, x, force / np.sqrt(1 + (force / 12) ** 2)))
    names = ["closed-law", "table"]
    found = ambkit.compare(BEARING, names, plant=plant, seeds=4).best
    assert found["table"].mean("f_d") < 0.8 * found["closed-law"].mean("f_d")
    described = ambkit.compare(BEARING, names, seeds=4).best
    assert described["closed-law"].mean("f_d") < 1.1 * described["table"].mean("f_d")


# ---- tuning ----


def test_tuning_spends_its_budget_and_is_never_worse_than_the_defaults():
    training = trials(SHORT, BEARING, 2, 5)
    linear = FIELD["linear"]
    reference = errors(linear.build, training, 170).mean(axis=0)
    for budget in (1, 2, 9, 20):
        found = tune(linear, training, reference, budget, 170)
        assert found.evaluations == budget
        assert found.default == pytest.approx(1.0)
        assert found.objective <= found.default
    assert found.objective < 0.98
    again = errors(lambda: linear.build(**found.values), training, 170) / reference
    assert np.mean(again) == pytest.approx(found.objective, rel=1e-12)
    assert tune(linear, training, reference, 1, 170).values == linear.defaults


def test_what_is_lost_counts_as_much_as_it_may():
    class Lost:
        def step(self, _y, _u):
            return [np.nan, 0.0, 0.0, 0.0]

    training = trials(SHORT, BEARING, 1, 5)
    own = candidates([], BEARING, custom={"lost": Lost})["lost"]
    assert tune(own, training, np.ones(3), 4, 170).objective == 10.0


# ---- the whole ----


def test_no_figure_depends_on_the_threads():
    one, many = (
        bench(BEARING, replace(SHORT, spread=Spread.all(0.1)), FIELD, runs=3, budget=6, threads=n)
        for n in (1, 4)
    )
    for which in ("default", "tuned"):
        for name, standing in getattr(one, which).items():
            other = getattr(many, which)[name]
            assert standing.values == other.values
            for criterion, figures in standing.figures.items():
                if criterion != "cost":
                    np.testing.assert_array_equal(figures, other.figures[criterion], criterion)


def test_a_figure_is_that_of_the_single_run():
    found = bench(BEARING, SHORT, FIELD, runs=2, seed=4)
    trial = trials(SHORT, BEARING, 2, 4)[1]
    estimate = ambkit.KalmanFilter(BEARING).run(trial.record)
    first = round(2 * own_time(BEARING) / BEARING.sampling_time)
    error = (estimate.f_d - trial.record["f_d"])[first:]
    standing = found.default["linear"]
    assert standing.figures["f_d"][1] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert standing.mean("f_d") == pytest.approx(standing.figures["f_d"].mean())
    half = 12.706 * np.ptp(standing.figures["f_d"]) / 2  # Student's t of one degree of freedom
    assert standing.half_width("f_d") == pytest.approx(half, rel=1e-4)
    assert found.limit == {}


def test_where_iron_saturates_what_is_learned_is_better_than_the_law():
    names = ["linear", "adaptive", "closed-law"]
    case = CASES["saturating"]
    field = candidates(names, BEARING, learned(case, BEARING, names))
    found = bench(BEARING, case, field, runs=3).default
    assert found["adaptive"].mean("f_d") < 0.75 * found["linear"].mean("f_d")
    assert found["closed-law"].mean("f_d") > 1.2 * found["linear"].mean("f_d")


@pytest.mark.parametrize("drift", [0.0, 0.1])
def test_who_estimates_k_gets_back_what_a_wrong_one_costs(drift):
    """Steps have told the constant before the load comes; judged from the load on."""
    wrong = replace(CASES["wrong-k"], drift=drift)
    right = replace(wrong, magnet_constant=1.0, drift=0.0)
    field = candidates(["extended", "augmented", "multiple-model"], BEARING)
    load = round(42 * own_time(BEARING) / BEARING.sampling_time)

    def error(case, name):
        made = trials(case, BEARING, 3, 0)
        return float(errors(field[name].build, made, load)[:, 2].mean())

    blind, known = error(wrong, "extended"), error(right, "extended")
    for name in ("augmented", "multiple-model"):
        assert (blind - error(wrong, name)) / (blind - known) > 0.8
        assert error(right, name) < 1.05 * known


def test_lost_runs_are_counted_and_leave_the_means_alone():
    class Drifting:
        """Right in every other run."""

        runs = 0

        def __init__(self):
            Drifting.runs += 1
            self.wrong = Drifting.runs % 2

        def step(self, y, _u):
            return (1.0 if self.wrong else y, 0.0, 0.0, y)

    own = candidates([], BEARING, custom={"drifting": Drifting})
    standing = bench(BEARING, SHORT, own, runs=4, threads=1).default["drifting"]
    assert standing.mean("lost") == 0.5
    assert standing.mean("x") < 2e-5
    assert np.isnan(standing.mean("nees"))
    assert np.isnan(standing.mean("tracking"))


def test_a_sweep_and_the_limit_near_the_centre_and_far_out():
    found = sweep(BEARING, {0.02: walk_case(0.02), 0.5: walk_case(0.5)}, FIELD, runs=6)
    linear, law = found.errors["linear"]["f_d"], found.errors["closed-law"]["f_d"]
    assert linear[1] > 1.4 * law[1]
    assert law / found.limit["f_d"] == pytest.approx([1, 1], abs=0.12)


class OfMean:
    """What a picture asks of a score."""

    def __init__(self, mean):
        self.mean = lambda _name: mean


@pytest.mark.parametrize("ratio", [1.0, 1.3, 2.0, 2.9, 4.0])
def test_a_ratio_too_small_is_shaded_as_one_too_large(ratio):
    small, large, double = _shades([OfMean(1 / ratio), OfMean(ratio), OfMean(2 * ratio)], "nis")
    assert small == pytest.approx(large)
    assert small == pytest.approx(min(math.log(ratio) / math.log(3), 1))
    assert double >= large


def test_the_report_of_a_whole_study():
    steps = []
    found = study(
        BEARING, SHORT, ["linear"], custom={"mine": OwnLinear}, runs=2, budget=3, done=steps.append
    )
    # Each default, tuned and searched, then itself; the rows of cases around it, and the limit.
    assert len(steps) == 2 * 3 + 1 + 2 * len(HEIGHTS) + len(WRONG) + 2
    assert [part.title for part in found.chapters] == [
        "Comparison", "Dependence on conditions", "Cramér-Rao bound", "Method",
    ]  # fmt: skip
    assert {figure.id for part in found.chapters for figure in part.figures} == {
        "matrix", "cost", "run", "steps", "wrong_k", "limit_steps", "efficiency",
    }  # fmt: skip
    model = found.model
    # Own code that is the linear filter, to the last digit.
    assert model.efficiency("mine", "x") == pytest.approx(model.efficiency("linear", "x"))


def test_a_picture_that_stands_alone_says_what_it_shows():
    found = bench(BEARING, SHORT, FIELD, runs=2)
    matrix = matrix_figure(found).panels[0]
    assert matrix.title.startswith(f"zittau_axial, {SHORT.name}: {SHORT.title}; 2 runs, ")
    assert "darkest" in matrix.x.title
    cases = cases_figure({"here": found, "there": found}).panels[0]
    assert cases.title.startswith("zittau_axial: error of ")
    assert cases.title.endswith("over that of linear; 2 runs in each case, with their defaults")
    assert "blue" in cases.x.title


def test_a_sweep_shows_whole_intervals_and_one_lost_filter_hides_none():
    values = np.array([0.1, 0.2])
    means = {"linear": values, "extended": values, "low-pass": 100 * values}
    means = {name: {"x": each, "f_d": each} for name, each in means.items()}
    widths = {name: dict.fromkeys(("x", "f_d"), np.array([np.nan, 0.1])) for name in means}

    def top(*names):
        shown = Sweep(values, {n: means[n] for n in names}, {n: widths[n] for n in names}, {})
        panel = sweep_figure("steps", shown).panels[0]
        return panel.y.limits[1]

    assert 0.3 < top("linear") < 0.35
    assert 0.3 < top(*means) < 1.5


# ---- estimators of one's own ----


class OwnLinear:
    """The linear filter, behind the smallest interface."""

    def __init__(self, bearing):
        self.kalman = ambkit.KalmanFilter(bearing)
        self.started = False

    def reset(self, mean, std):
        self.kalman.reset(mean, std)
        self.started = False

    def step(self, y, u):
        if self.started:
            return self.kalman.step(y, u)
        self.started = True
        return self.kalman.update(y)


def test_own_code_from_a_file(tmp_path):
    file = tmp_path / "my.py"
    file.write_text(
        "class MyFilter:\n    def step(self, y, u):\n        return y, 0, 0, y\n"
        "class Short:\n    def step(self, y, u):\n        return y\n"
        "class NoStep:\n    pass\n"
    )
    assert expand(f"linear, {file}:MyFilter,linear") == ["linear", f"{file}:MyFilter"]
    found = candidates([f"{file}:MyFilter"], BEARING)
    assert list(found) == ["MyFilter"]
    assert not found["MyFilter"].in_loop
    record = trials(SHORT, BEARING, 1, 0)[0].record
    with pytest.raises(AmbkitError, match=r"Short: step\(y, u\) at sample 0"):
        candidates([f"{file}:Short"], BEARING)["Short"].build().run(record)
    for name, message in {
        "NoStep": "NoStep: it needs a method step",
        "Nobody": "there is no class or function Nobody; it has MyFilter, Short, NoStep",
    }.items():
        with pytest.raises(AmbkitError, match=message):
            candidates([f"{file}:{name}"], BEARING)
    file.write_text("1/0")
    with pytest.raises(AmbkitError, match="ZeroDivisionError"):
        candidates([f"{file}:MyFilter"], BEARING)
    with pytest.raises(AmbkitError, match="there is no such file"):
        candidates([f"{tmp_path}/other.py:MyFilter"], BEARING)


def test_names_that_nobody_has():
    with pytest.raises(AmbkitError, match='no filter "lineal"; known: low-pass'):
        expand("lineal")
    with pytest.raises(AmbkitError, match="no filter is named"):
        expand(" , ")
    assert "linear" in expand("all")


def test_a_spread_that_no_bearing_survives_is_reported():
    heavy = BEARING.replace(amplifier__current_limit=0.6)
    with pytest.raises(AmbkitError, match="current_limit"):
        trials(replace(SHORT, spread=Spread.all(0.5)), heavy, 16, 0)
    assert trials(replace(SHORT, spread=CERTAIN), heavy, 1, 0)
