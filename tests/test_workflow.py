"""What the commands decide, asked from Python: the same numbers as the commands write."""

import json

import numpy as np
import pytest

import ambkit
from ambkit.cli.main import main
from ambkit.estimate.named import USUAL, factories
from ambkit.estimate.registry import KINDS
from ambkit.fuzzy.training import train
from ambkit.identification.noise import standstill_noise
from ambkit.judge.comparison.study import study
from ambkit.machine.forces.force_points import load_force_points
from ambkit.result.plain import plain
from ambkit.workflow import compare_steps, training
from ambkit.workflow.filter import filter as filter_record
from ambkit.workflow.filter import stretch_to_tune_on
from ambkit.workflow.identify import identify
from ambkit.workflow.lift_off import identify_by_lift_off
from ambkit.workflow.simulate import experiment_duration, scenario_for
from ambkit.workflow.tuning import default_disturbance, tune_disturbance
from ambkit.workflow.warnings import missing_control

BEARING = ambkit.Bearing.preset("zittau_axial")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A simulated run, and the same as a rig would log it: without truth."""
    folder = tmp_path_factory.mktemp("made")
    scenario = scenario_for(BEARING, duration=0.3, step=0.3e-3, load=3.0)
    run = ambkit.simulate(BEARING, scenario).record
    run.save(folder / "run.csv")
    measured(run).save(folder / "log.csv")
    other = ambkit.simulate(BEARING, scenario.replace(seed=1)).record
    measured(other).save(folder / "other.csv")
    return folder


def measured(record):
    return ambkit.Record(record.t, {n: record[n] for n in ("y", "u")}, {"y": "m", "u": "V"})


@pytest.fixture
def command(capsys, tmp_path, monkeypatch):
    """Call ambkit in an empty folder; return what --json prints."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        with pytest.raises(SystemExit) as left:
            main([*(str(argument) for argument in arguments), "--json"])
        printed = capsys.readouterr()
        assert not left.value.code, printed.err
        return json.loads(printed.out)

    return run


def same(data):
    """As `data` comes back from JSON."""
    return json.loads(json.dumps(plain(data)))


def without(data, *keys):
    return {key: value for key, value in data.items() if key not in keys}


# --- filter


@pytest.mark.parametrize("name", ["run.csv", "log.csv"])
def test_filter_is_filter_record(command, made, name):
    told = command(
        "filter", made / name, "--machine", "zittau_axial", "--smooth", "--out", "out.csv",
        "--filter", "linear", "--filter", "closed-law",
    )  # fmt: skip
    found = filter_record(BEARING, ambkit.load(made / name), ["linear", "closed-law"], smooth=True)
    assert without(told, "record", "files", "adequacy", "notes") == same(
        without(found.to_dict(), "notes")
    )
    written, estimates = ambkit.Record.load("out.csv"), found.to_record()
    assert list(written) == list(estimates)
    for signal in written:
        np.testing.assert_array_equal(written[signal], estimates[signal])


def test_a_measured_record_is_tuned_on_its_second_quarter_and_judged_on_the_second_half(made):
    log = ambkit.load(made / "log.csv")
    span = log.t[-1] - log.t[0]
    found = filter_record(BEARING, log, ["closed-law"])
    stretch, one = found.stretch, found["closed-law"]
    assert (stretch.start, stretch.stop, stretch.by_itself) == (span / 4, span / 2, True)
    assert found.settling == span / 2
    build = factories(["closed-law"], BEARING)["closed-law"]
    quarter = log.between(log.t[0] + span / 4, log.t[0] + span / 2)
    likeliest = tune_disturbance(
        BEARING, quarter, lambda growth: build(ambkit.FilterNoise(disturbance=growth))
    )
    assert one.tuning.found.disturbance == likeliest.growth
    assert one.tuning.untuned.disturbance == default_disturbance(BEARING)
    assert one.noise == (one.tuning.found if one.tuning.kept else one.tuning.untuned)


def test_a_tuning_that_the_rest_contradicts_is_kept_only_if_it_was_asked_for(tmp_path):
    """A load that is still, then wanders: the quiet stretch says nothing of the rest."""
    n = 4000
    wandering = np.cumsum(np.random.default_rng(2).normal(0, 0.5, n // 2))
    force = np.concatenate([np.zeros(n // 2), wandering])
    force = ambkit.Record(BEARING.sampling_time * np.arange(n), {"f": force}, {"f": "N"})
    force.save(tmp_path / "force.csv")
    load = ambkit.Recorded(file=str(tmp_path / "force.csv"), signal="f")
    scenario = scenario_for(BEARING, duration=force.t[-1]).replace(disturbance=load)
    log = measured(ambkit.simulate(BEARING, scenario).record)
    half = (log.t[-1] - log.t[0]) / 2
    unasked = filter_record(BEARING, log, ["closed-law"])["closed-law"]
    asked = filter_record(BEARING, log, ["closed-law"], tune=half)["closed-law"]
    assert unasked.tuning.worse
    assert asked.tuning.worse
    assert (unasked.tuning.kept, asked.tuning.kept) == (False, True)
    assert unasked.noise == unasked.tuning.untuned
    assert asked.noise == asked.tuning.found


def test_nothing_is_tuned_where_the_truth_or_the_noise_is_known(made):
    assert stretch_to_tune_on(ambkit.load(made / "run.csv")) is None
    log = ambkit.load(made / "log.csv")
    given = filter_record(BEARING, log, ["linear"], noise=ambkit.FilterNoise(disturbance=50.0))
    assert given.stretch is None
    assert given["linear"].tuning is None
    assert given["linear"].noise.disturbance == 50.0


def test_filter_record_refuses_what_contradicts_itself(made):
    log = ambkit.load(made / "log.csv")
    with pytest.raises(ValueError, match=r"tune must be shorter than the record, 0\.3 s"):
        filter_record(BEARING, log, ["linear"], tune=5.0)
    with pytest.raises(ValueError, match="tune must be greater than 0 s"):
        filter_record(BEARING, log, ["linear"], tune=0.0)
    with pytest.raises(ValueError, match="use one of them"):
        filter_record(BEARING, log, ["linear"], tune=0.1, noise=ambkit.FilterNoise(disturbance=1.0))
    with pytest.raises(ambkit.AmbkitError, match='no estimator "kalman"; known: low-pass'):
        filter_record(BEARING, log, ["kalman"])
    with pytest.raises(ambkit.AmbkitError, match="a magnet is given for adaptive"):
        filter_record(BEARING, log, ["linear"], magnets={"adaptive": ambkit.ClosedLaw(BEARING)})


def test_lost_control_counts_stretches(made):
    log = ambkit.load(made / "log.csv")
    assert missing_control(log) == (0, 0)
    u = log["u"].copy()
    u[10:13] = u[50:57] = np.nan
    holes = ambkit.Record(log.t, {"y": log["y"], "u": u}, log.units)
    assert missing_control(holes) == (10, 7)


def test_an_expert_beyond_its_box_is_noticed():
    run = ambkit.simulate(BEARING, scenario_for(BEARING, duration=0.2, step=0.5e-3)).record
    narrow = training.stiffness_of_law(BEARING).displacement[[1, -2]]
    small = train(
        ambkit.stiffness_map(BEARING, currents=[-1.5, 0, 1.5], displacements=[*narrow / 4])
    )
    found = filter_record(BEARING, run, ["adaptive", "linear"], magnets={"adaptive": small})
    outside = found["adaptive"].outside[""]
    low, high = small.displacement_range
    x = found["adaptive"].evaluation.estimate.x
    beyond = np.mean((x < low) | (x > high))
    assert beyond > 0.5
    assert outside.displacement == (low, high, beyond)
    assert outside.share >= beyond
    assert not found["linear"].outside


# --- identify


def test_identify_is_identify_by_likelihood(command, made):
    told = command(
        "identify", "zittau_axial", made / "log.csv", "--validate", made / "other.csv", "--free",
        "magnet_constant", "--free", "measurement_noise", "--out", "found.toml", "--out",
        "force-map=map.csv", "--nodes", "6x4",
    )  # fmt: skip
    found = identify(
        BEARING,
        [ambkit.load(made / "log.csv")],
        others=[ambkit.load(made / "other.csv")],
        names=["other.csv"],
        free=["magnet_constant", "measurement_noise"],
        map_forces=True,
        nodes=(6, 4),
    )
    assert without(told, "files") == same(found.to_dict())
    written = ambkit.Bearing.load("found.toml").magnet.magnet_constant
    assert written == pytest.approx(found.bearing.magnet.magnet_constant, rel=1e-3)
    nodes = load_force_points("map.csv")
    assert len(nodes) == told["force_map"]["written"]


def test_noise_at_rest_is_where_the_search_starts(command, made):
    rng = np.random.default_rng(0)
    t = BEARING.sampling_time * np.arange(20_000)
    units = {"y": "m", "u": "V"}
    ambkit.Record(t, {"y": 3e-6 * rng.normal(size=20_000), "u": 0 * t}, units).save("rest.csv")
    told = command(
        "identify", "zittau_axial", made / "log.csv", "--rest", "rest.csv", "--free",
        "magnet_constant",
    )  # fmt: skip
    rest = standstill_noise(ambkit.load("rest.csv"))
    assert rest["y"].standard_deviation == pytest.approx(3e-6, rel=0.05)
    assert isinstance(rest["u"], str)  # why nothing can be said of it
    found = identify(
        BEARING, [ambkit.load(made / "log.csv")], names=["log.csv"], rest=rest,
        free=["magnet_constant"],
    )  # fmt: skip
    assert found.likelihood.start.bearing.sensor.noise_variance == rest["y"].variance
    assert without(told, "files") == same(found.to_dict())


def test_a_record_is_not_both_identified_from_and_validated_on(made):
    log = ambkit.load(made / "log.csv")
    with pytest.raises(ambkit.AmbkitError, match="that it has not seen"):
        identify(BEARING, [log], others=[log])


def test_lift_off_tells_nothing_of_a_two_sided_magnet():
    with pytest.raises(ambkit.AmbkitError, match="that of zittau_axial is two-sided"):
        identify_by_lift_off(BEARING, [])


# --- compare


def test_compare_in_a_case(command):
    told = command(
        "compare", "zittau_axial", "--case", "step", "--filter", "linear", "--filter", "extended",
        "--seeds", 3, "--spread", "5 %",
    )  # fmt: skip
    found = compare_steps.compare_in_case(
        BEARING, "step", ["linear", "extended"], runs=3, spread=0.05
    )
    other = same(found.bench.to_dict())
    for data in (told, other):
        for one in data["default"].values():
            del one["cost"], one["cost_half_width"]  # of the processor's time
    assert without(told, "files", "adequacy") == other
    plain_case = study(BEARING, "step", ["linear"], runs=3, whole=False).bench
    assert plain_case.default["linear"].mean("x") != found.bench.default["linear"].mean("x")


def test_compare_in_own_loops(command):
    told = command(
        "compare", "steps", "zittau_axial", "--filter", "linear", "--filter", "closed-law",
        "--seeds", "5:2", "--duration", "0.1 s", "--disturbance", "3 N",
    )  # fmt: skip
    what = compare_steps.loop_cases(BEARING, duration=0.1, load=3.0)
    found = compare_steps.compare_in_loops(
        BEARING, what, ["linear", "closed-law"], seeds=range(5, 7)
    )
    assert without(told, "files", "adequacy") == same(found.to_dict())
    travel = BEARING.rotor.clearance
    assert found.steps == [share * travel for share in compare_steps.HEIGHTS]


def test_cases_are_by_name():
    assert list(compare_steps.cases_called()) == ["paper"]
    assert len(compare_steps.cases_called("all", 0.1)) > 5
    with pytest.raises(ambkit.AmbkitError, match='no case "none"'):
        compare_steps.cases_called("none")
    with pytest.raises(ValueError, match="spread must be from 0 to below 100 %, is 120 %"):
        compare_steps.cases_called("paper", 1.2)


# --- simulate, excite, train


def test_simulate_starts_from_scenario_for(command):
    told = command(
        "simulate", "zittau_axial", "--step", "0.2 mm", "--disturbance", "3 N", "--seed", 4
    )
    scenario = scenario_for(BEARING, step=0.2e-3, load=3.0, seed=4)
    run = ambkit.simulate(BEARING, scenario, filter=ambkit.KalmanFilter(BEARING))
    assert without(told, "files") == same(run.to_dict())


def test_a_scenario_without_a_controller_is_tuned_to_the_bearing():
    other = ambkit.Bearing.preset("inteco_ml")
    said = ambkit.Scenario(controller=ambkit.Control(kp=5.0))
    controller = scenario_for(other, said, from_estimate=False).controller
    own = ambkit.PID.for_bearing(other)
    assert (controller.kp, controller.kd, controller.ki) == (5.0, own.kd, own.ki)
    assert controller.feedback == "measurement"
    with pytest.raises(ambkit.AmbkitError, match="give one of them"):
        scenario_for(other, step=1e-6, reference="r.csv")


def test_an_experiment_lasts_forty_periods():
    k_s, mass = ambkit.ConstantStiffness.of(BEARING).k_s, BEARING.rotor.mass
    period = 2 * np.pi / (k_s / mass) ** 0.5
    assert experiment_duration(BEARING) == pytest.approx(40 * period, rel=0.05)


def test_train_is_train_expert(command):
    told = command("train", "zittau_axial", "--rules", "4x3", "--out", "expert.json")
    found = training.train_expert(BEARING, (4, 3))
    assert without(told, "files") == same(found.to_dict())
    assert ambkit.Expert.load("expert.json").force(0.5, 1e-4) == found.expert.force(0.5, 1e-4)


def test_train_on_points(command):
    iu, x = np.random.default_rng(1).uniform(-1, 1, (2, 30))
    force = ambkit.ClosedLaw(BEARING).force(1.5 * iu, 5e-4 * x)
    rows = [f"{1.5 * i},{5e-4 * d},{f}" for i, d, f in zip(iu, x, force, strict=True)]
    with open("force.csv", "w", encoding="utf-8") as file:
        file.write("\n".join(["iu [A],x [m],f_mag [N]", *rows]) + "\n")
    told = command("train", "map", "zittau_axial", "force.csv", "--rules", "3x3")
    measured = training.measured_force(BEARING, load_force_points("force.csv"), (3, 3))
    found = training.train_expert(BEARING, measured=measured)
    assert without(told, "files") == same(found.to_dict())
    assert found.stiffness.k_i.shape == (3, 3)


def test_what_the_commands_offer_is_what_there_is():
    assert set(USUAL) <= set(KINDS)
