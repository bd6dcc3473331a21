"""What the commands decide, asked from Python."""

import numpy as np
import pytest

import ambkit
from ambkit.estimate.named import factories
from ambkit.identification.noise import standstill_noise
from ambkit.workflow.filter_record import tuning_window
from ambkit.workflow.identify import identify
from ambkit.workflow.simulate import experiment_duration, scenario_for
from ambkit.workflow.tuning import default_disturbance, tune_disturbance

BEARING = ambkit.preset("zittau_axial")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A simulated run, and the same as a rig would log it: without truth."""
    folder = tmp_path_factory.mktemp("made")
    scenario = scenario_for(BEARING, duration=0.3, step=0.3e-3, load=3.0)
    run = ambkit.simulate(BEARING, scenario).record
    run.save(folder / "run.csv")
    measured(run).save(folder / "log.csv")
    return folder


def measured(record):
    return ambkit.Record(record.t, {n: record[n] for n in ("y", "u")}, {"y": "m", "u": "V"})


# --- filter


def test_a_measured_record_is_tuned_on_its_second_quarter_and_judged_on_the_second_half(made):
    log = ambkit.load(made / "log.csv")
    span = log.t[-1] - log.t[0]
    found = ambkit.filter(log, "closed-law", machine=BEARING)
    stretch, one = found.stretch, found["closed-law"]
    assert (stretch.start, stretch.stop, stretch.by_itself) == (span / 4, span / 2, True)
    assert found.settling == span / 2
    build = factories(["closed-law"], BEARING)["closed-law"]
    quarter = log.between(log.t[0] + span / 4, log.t[0] + span / 2)
    likeliest = tune_disturbance(
        BEARING, quarter, lambda growth: build(ambkit.FilterNoise(disturbance=growth))
    )
    assert one.tuning.tuned.disturbance == likeliest.intensity
    assert one.tuning.untuned.disturbance == default_disturbance(BEARING)
    assert one.noise == (one.tuning.tuned if one.tuning.kept else one.tuning.untuned)


def test_nothing_is_tuned_where_the_truth_or_the_noise_is_known(made):
    assert tuning_window(ambkit.load(made / "run.csv")) is None
    log = ambkit.load(made / "log.csv")
    given = ambkit.filter(log, "linear", machine=BEARING, disturbance_noise=50.0)
    assert given.stretch is None
    assert given["linear"].tuning is None
    assert given["linear"].noise.disturbance == 50.0


def test_filter_refuses_a_time_or_a_name_that_there_is_not(made):
    log = ambkit.load(made / "log.csv")
    with pytest.raises(ambkit.AmbkitError, match="must be tuned on more than 0 s"):
        ambkit.filter(log, "linear", machine=BEARING, disturbance_noise="auto 0 s")
    with pytest.raises(ambkit.AmbkitError, match='no filter "kalman"; known: low-pass'):
        ambkit.filter(log, "kalman", machine=BEARING)


# --- identify


def test_noise_at_rest_is_where_the_search_starts(made):
    t = BEARING.sampling_time * np.arange(20_000)
    noise = np.random.default_rng(0).normal(size=20_000)
    rest = standstill_noise(ambkit.Record(t, {"y": 3e-6 * noise, "u": 0 * t}, {"y": "m", "u": "V"}))
    assert rest["y"].standard_deviation == pytest.approx(3e-6, rel=0.05)
    assert isinstance(rest["u"], str)  # why nothing can be said of it
    log = ambkit.load(made / "log.csv").between(0, 0.1)
    found = identify(BEARING, [log], rest=rest, free=["magnet_constant"])
    assert found.likelihood.start.isolated.sensor.noise_variance == rest["y"].variance


def test_a_record_is_not_both_identified_from_and_validated_on(made):
    log = ambkit.load(made / "log.csv")
    with pytest.raises(ambkit.AmbkitError, match="validate on another one"):
        identify(BEARING, [log], others=[log])


def test_an_experiment_lasts_forty_periods():
    k_s, mass = ambkit.ConstantStiffness.of(BEARING).k_s, BEARING.rotor.mass
    period = 2 * np.pi / (k_s / mass) ** 0.5
    assert experiment_duration(BEARING) == pytest.approx(40 * period, rel=0.05)


def test_the_part_of_a_run_that_is_evaluated_is_stated():
    """Before a power failure only, unless the filter models contact."""
    scenario = ambkit.Scenario(duration=0.1, off=0.06)
    run = ambkit.simulate("zittau_axial", scenario, filter="extended")
    assert "until the power failure" in run.finding
    assert "until the power failure" in [row.value for row in run.rows]
    contact = ambkit.simulate("zittau_axial", scenario, filter="contact")
    assert "until" not in contact.finding


def test_a_demanded_current_at_its_limit_counts_with_a_slow_amplifier():
    """The current itself approaches the limit without reaching it."""
    machine = ambkit.preset("zittau_axial").replace(amplifier__bandwidth="500 Hz")
    force = ambkit.Scenario(duration=0.05, disturbance=ambkit.Step(amplitude=60.0, time=0.0))
    run = ambkit.simulate(machine, force)
    counted = {row.key: row.value for row in run.rows}["samples_at_the_current_limit"]
    assert counted > 50
    assert (np.abs(run.record["iu"]) >= machine.current_max).sum() < 10
