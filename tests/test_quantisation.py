"""Sensors with coarse steps: what filters make of them, and what counts as frozen."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from quick import quick

import ambkit
from ambkit.estimate.machine_model import View
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.observer import unstable_pole
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison import criteria
from ambkit.machine.magnets import core_module, own_time
from ambkit.simulation.external_inputs import ExternalInputs, Faults
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario

NOISE = 1e-7
PAPER = ambkit.preset("zittau_axial").replace(sensor__noise_variance=NOISE**2)
T = PAPER.sampling_time
N = 3001
WALK = 1e-4 * (2 * PAPER.weight) ** 2
OWN_TIME = np.sqrt(0.518 / 7537.5)


def flown(ratio, feedback="measurement", wander=None, stuck=None, seed=0, stated=True):
    """The record and the estimate of an extended filter, of a sensor with steps of `ratio` std."""
    bearing = PAPER.replace(sensor__quantisation=ratio * NOISE)
    known = bearing if stated else PAPER
    pid = ambkit.PID.for_bearing(bearing).model_copy(update={"feedback": feedback})
    scenario = ambkit.Scenario(duration=(N - 1) * T, seed=seed, controller=pid)
    kalman = ambkit.ExtendedKalmanFilter(known, noise=FilterNoise(disturbance=wander))
    load, faults = None, None
    if wander is not None:
        load = np.cumsum(np.random.default_rng(seed).normal(size=N)) * np.sqrt(wander * T)
    if stuck is not None:
        none = Faults.none(N)
        late = np.maximum(np.arange(N) - stuck + 1.0, 0.0)
        faults = Faults(late, none.y_times, none.y_plus, none.u_times, none.u_plus, none.current)
    external_inputs = ExternalInputs(disturbance=load, faults=faults)
    record = simulate_run(bearing, scenario, estimator=kalman, external_inputs=external_inputs)
    return record.record, record.estimate, kalman


def rms(error):
    return np.sqrt(np.mean(error[300:] ** 2))


@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
@pytest.mark.parametrize("ratio", [0.1, 1, 5, 10, 20, 50, 100])
def test_coarse_steps_are_no_frozen_sensor_and_no_worse_than_raw(ratio, feedback):
    runs = [flown(ratio, feedback, seed=seed)[:2] for seed in range(4)]
    assert not any((estimate.status & ambkit.Status.FROZEN).any() for _, estimate in runs)
    most = 0.9 if feedback == "measurement" else 0.97 if ratio <= 50 else 1.0
    ours = np.array([estimate["x"] - record["x"] for record, estimate in runs])
    raw = np.array([record["y"] - record["x"] for record, _ in runs])
    assert rms(ours.T) <= most * rms(raw.T)


@pytest.mark.parametrize("noise", [1e-7, 1e-8])
@pytest.mark.parametrize("kind", ["linear", "extended", "steady-state", "observer"])
def test_by_default_a_sensor_as_quiet_as_can_be_makes_no_estimate_worse_than_raw(kind, noise):
    """The process noise let filters undo the sensor's lag; observers were slower than the rotor."""
    for ball in (ambkit.preset("inteco_ml"), ambkit.preset("zittau_axial")):
        for ratio in (0, 5):
            steps = {"sensor__quantisation": ratio * noise} if ratio else {}
            rig = ball.replace(sensor__noise_variance=noise**2, **steps)
            scenario = Scenario(duration=2000 * rig.sampling_time, seed=1,
                                controller=ambkit.PID.for_bearing(rig))  # fmt: skip
            run = simulate_run(rig, scenario, estimator=KINDS[kind].make(rig))
            x = run.record["x"]
            assert rms(run.estimate["x"] - x) < rms(run.record["y"] / rig.sensor.gain - x)


@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
@pytest.mark.parametrize("ratio", [1, 3, 5, 10, 20, 50, 100])
def test_coarse_steps_that_are_not_stated_are_no_frozen_sensor(ratio, feedback):
    record, estimate, _ = flown(ratio, feedback, stated=False)
    assert not (estimate.status & ambkit.Status.FROZEN).any()
    # The filter takes the steps for noise that it is told too small: 2 where they are coarsest.
    most = 1.02 if ratio <= 10 else 2.0
    assert rms(estimate["x"] - record["x"]) <= most * rms(record["y"] - record["x"])
    assert np.ptp(record["x"][300:]) < 0.2 * (ratio + 20) * 1e-6


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("kind", ["low-pass", "observer", "steady-state", "linear-adaptive-noise"])
@pytest.mark.parametrize("stated", [True, False])
def test_kinds_of_other_covariances_flag_no_healthy_sensor(kind, precision, stated):
    for ratio in (1, 5, 10, 20, 100):
        bearing = PAPER.replace(sensor__quantisation=ratio * NOISE)
        kalman = KINDS[kind].make(bearing if stated else PAPER, precision=precision)
        scenario = ambkit.Scenario(duration=(N - 1) * T, controller=ambkit.PID.for_bearing(bearing))
        estimate = simulate_run(bearing, scenario, estimator=kalman).estimate
        assert not (estimate.status & ambkit.Status.FROZEN).any()


@pytest.mark.parametrize("kind", ["observer", "steady-state"])
@pytest.mark.parametrize("name", ["zittau_axial", "inteco_ml"])
@pytest.mark.parametrize("ratio", [12, 20, 50, 85, 100])
def test_a_constant_gain_in_the_loop_is_no_worse_than_raw(kind, name, ratio):
    quiet = ambkit.preset(name).replace(sensor__noise_variance=NOISE**2)
    bearing = quiet.replace(sensor__quantisation=ratio * NOISE)
    walk = np.sqrt(1e-4 * (2 * bearing.weight) ** 2 * bearing.sampling_time)
    pid = ambkit.PID.for_bearing(bearing).model_copy(update={"feedback": "estimate"})
    ours, raw = [], []
    for seed in range(4):
        load = np.cumsum(np.random.default_rng(seed).normal(size=N)) * walk
        made = Scenario(duration=(N - 1) * bearing.sampling_time, seed=seed, controller=pid)
        external_inputs = ExternalInputs(disturbance=load)
        run = simulate_run(
            bearing, made, estimator=KINDS[kind].make(bearing), external_inputs=external_inputs
        )
        assert not (run.estimate.status & ambkit.Status.FROZEN).any()
        ours.append(run.estimate["x"] - run.record["x"])
        raw.append(run.record["y"] - run.record["x"])
    assert rms(np.array(ours).T) <= 1.01 * rms(np.array(raw).T)


HEAVY = PAPER.replace(rotor__mass=0.99, sampling_time=101e-6, sensor__lag=294e-6, sensor__gain=0.83)


@pytest.mark.parametrize("ratio", [12, 20, 50, 100])
def test_a_loop_that_is_fed_by_a_constant_gain_swings_over_no_steps(ratio):
    """Its gain counted each repeat of a code for nothing: the rotor swung over a hundred steps."""
    runs = [of_kind("steady-state", ratio, "estimate", seed, bearing=HEAVY) for seed in range(2)]
    x = np.array([run.record["x"] for run in runs])
    ours = np.array([run.estimate["x"] for run in runs]) - x
    raw = np.array([run.record["y"] for run in runs]) / HEAVY.sensor.gain - x
    assert rms(ours.T) <= 1.02 * rms(raw.T)
    assert np.ptp(x[:, 300:]) < 20 * ratio * NOISE


@pytest.mark.parametrize("lag", [0.4, 0.8, 1.6])
def test_holding_to_coarse_steps_sets_off_no_transient_of_a_short_lag(lag):
    """Gains that slow a fast sensor's pole down made errors of a thousand steps."""
    run = of_kind("observer", 20, bearing=PAPER.replace(sensor__lag=lag * T))
    error, raw = (run.estimate["x"], run.record["y"]) - run.record["x"]
    assert rms(error) <= rms(raw)


@pytest.mark.parametrize("ratio", [20, 100])
def test_a_constant_gain_of_little_process_noise_is_no_worse_than_raw(ratio):
    """Its gain alone would be too slow in a loop that hunts between two codes."""
    runs = [of_kind("steady-state", ratio, "estimate", seed) for seed in range(4)]
    ours = np.array([run.estimate["x"] - run.record["x"] for run in runs])
    raw = np.array([run.record["y"] - run.record["x"] for run in runs])
    assert rms(ours.T) <= rms(raw.T)


@pytest.mark.parametrize("ratio", [5, 8, 10.9])
def test_a_rotor_that_stays_in_a_coarse_step_is_no_frozen_sensor(ratio):
    bearing = PAPER.replace(sensor__quantisation=ratio * NOISE)
    pid = ambkit.PID.for_bearing(bearing).model_copy(update={"feedback": "estimate"})
    kalman = KINDS["unscented"].make(bearing)
    for seed in range(12):
        scenario = ambkit.Scenario(duration=(N - 1) * T, seed=seed, controller=pid)
        estimate = simulate_run(bearing, scenario, estimator=kalman).estimate
        assert not (estimate.status & ambkit.Status.FROZEN).any()


def test_a_slowly_sampled_stuck_sensor_is_flagged_within_three_own_times():
    quiet = ambkit.preset("inteco_ml").replace(sensor__noise_variance=NOISE**2)
    bearing = quiet.replace(sensor__quantisation=5 * NOISE)
    none, since = Faults.none(N), np.maximum(np.arange(N) - 2000 + 1.0, 0.0)
    faults = Faults(since, none.y_times, none.y_plus, none.u_times, none.u_plus, none.current)
    made = Scenario(duration=(N - 1) * bearing.sampling_time)
    kalman = ambkit.ExtendedKalmanFilter(bearing)
    run = simulate_run(
        bearing, made, estimator=kalman, external_inputs=ExternalInputs(faults=faults)
    )
    flagged = np.flatnonzero(run.estimate.status & ambkit.Status.FROZEN)
    assert 0 <= (flagged[0] - 2000) * bearing.sampling_time <= 3 / unstable_pole(bearing)


def fast_rotor(name, ratio):
    """The first axis of a preset, which has 22 to 25 samples in its time constant."""
    machine = ambkit.Machine.preset(name)
    steps = {"sensor__noise_variance": NOISE**2, "sensor__quantisation": ratio * NOISE}
    return machine.isolated_axis(machine.axes[0].name).replace(**steps)


@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
@pytest.mark.parametrize(("ratio", "little"), [(1, True), (2, False), (2, True), (2.5, False)])
@pytest.mark.parametrize(("name", "kind"), quick(
    product(["tum_mlps", "compressor", "heart_pump", "hindawi_2011"], ["extended", "unscented"]),
    [("tum_mlps", "extended"), ("compressor", "unscented"), ("heart_pump", "extended")],
))  # fmt: skip
def test_a_stuck_sensor_of_a_fast_rotor_is_flagged_within_three_own_times(
    name, kind, ratio, little, feedback
):
    axis = fast_rotor(name, ratio)
    for seed in range(2):
        run = of_kind(kind, ratio, feedback, seed, stuck=2000, bearing=axis, little=little)
        frozen = (run.estimate.status & ambkit.Status.FROZEN) > 0
        assert not frozen[:2000].any()
        flagged = np.flatnonzero(frozen[2000:])[0]
        # With little process noise two standard deviations are the limit of what can be known.
        most = 3.1 if little and ratio == 2 else 3
        assert flagged * axis.sampling_time <= most * own_time(axis)


@pytest.mark.parametrize("ratio", [3, 4, 5])
def test_a_coarse_sensor_is_not_flagged_before_a_rotor_at_rest_would_be_suspect(ratio):
    """A filter that assumes twice the weight in a second believed no rotor to rest."""
    run = of_kind("extended", ratio, stuck=2000, little=False)
    flagged = np.flatnonzero(run.estimate.status[2000:] & ambkit.Status.FROZEN)[0]
    assert min(soonest(PAPER, ratio), 2.8 * OWN_TIME / T) - 40 <= flagged <= 3 * OWN_TIME / T


def test_a_quiet_sensor_that_has_shown_no_step_yet_is_not_frozen_at_once():
    filter_ = ambkit.ExtendedKalmanFilter(PAPER)
    record, _, _ = flown(1)
    y = np.full(N, 4e-6)
    still = ambkit.Record(record["t"], {"y": y, "u": record["u"]}, {"y": "m", "u": "V"})
    frozen = np.flatnonzero(filter_.run(still).status & ambkit.Status.FROZEN)
    assert 12 * OWN_TIME < frozen[0] * T < 16 * OWN_TIME


@pytest.mark.parametrize("ratio", [0.1, 2, 5])
def test_what_it_says_of_its_errors_holds(ratio):
    shares = []
    for seed in range(8):
        record, _, kalman = flown(ratio, wander=WALK, seed=seed)
        shares.append(criteria.nees(kalman.run(record, covariance=True), record, 300, kalman.view))
    assert 0.93 <= np.mean(shares) <= 0.97


@pytest.mark.parametrize(
    ("ratio", "stated"),
    [(0.1, True), (1, True), (3, True), (5, True), (0.1, False), (1, False), (2, False)],
)
def test_a_stuck_sensor_is_flagged_within_three_own_times(ratio, stated):
    _, estimate, _ = flown(ratio, stuck=2000, stated=stated)
    flagged = np.flatnonzero((estimate.status[2000:] & ambkit.Status.FROZEN) > 0)
    assert flagged.size
    assert flagged[0] * T <= 3 * OWN_TIME


def of_kind(kind, ratio, feedback="measurement", seed=0, stuck=None, bearing=PAPER, little=True):
    """A run under a random walk of the disturbance force, of an intensity that the filter has.

    Or, where it is not ``little``, at rest, with a filter that assumes much.
    """
    step_time, walk = bearing.sampling_time, 1e-4 * (2 * bearing.weight) ** 2
    coarse = bearing.replace(sensor__quantisation=ratio * NOISE)
    load = np.cumsum(np.random.default_rng(seed).normal(size=N)) * np.sqrt(walk * step_time)
    noise = FilterNoise(disturbance=walk) if little else FilterNoise()
    pid = ambkit.PID.for_bearing(coarse).model_copy(update={"feedback": feedback})
    faults = Faults.none(N)
    if stuck is not None:
        faults = replace(faults, late=np.maximum(np.arange(N) - stuck + 1.0, 0.0))
    return simulate_run(
        coarse,
        Scenario(duration=(N - 1) * step_time, seed=seed, controller=pid),
        estimator=KINDS[kind].make(coarse, noise=noise),
        external_inputs=ExternalInputs(disturbance=load if little else 0 * load, faults=faults),
    )


@pytest.mark.parametrize("ratio", [3, 4, 5])
@pytest.mark.parametrize("kind", ["observer", "steady-state"])
def test_what_a_constant_gain_says_of_its_errors_holds(kind, ratio):
    shares = []
    for seed in range(4):
        run = of_kind(kind, ratio, seed=seed)
        kalman = KINDS[kind].make(
            PAPER.replace(sensor__quantisation=ratio * NOISE), noise=FilterNoise(disturbance=WALK)
        )
        estimate = kalman.run(run.record, covariance=True)
        shares.append(criteria.nees(estimate, run.record, 300, kalman.view))
    assert 0.93 <= np.mean(shares) <= 0.97


IMPROBABLE = 1e-13


def soonest(bearing, ratio):
    """Samples after which it is improbable that a rotor at rest in the middle of a step repeats.

    It must have stayed, with 1 - 1/dwell a sample, and the noise must have left it in its step.
    """
    within = math.sqrt(-math.expm1(-(ratio**2) / (2 * math.pi)))
    return math.log(IMPROBABLE) / math.log(
        within * (1 - 1 / core_module().dwell(View(bearing).seen_by))
    )


@pytest.mark.parametrize(("ratio", "own_times"), [(2.5, 1.5), (3, 2.5), (4, 6)])
@pytest.mark.parametrize("kind", ["low-pass", "observer", "steady-state"])
def test_without_a_covariance_a_stuck_sensor_is_flagged_as_soon_as_can_be_known(
    kind, ratio, own_times
):
    run = of_kind(kind, ratio, stuck=2000)
    frozen = (run.estimate.status & ambkit.Status.FROZEN) > 0
    assert not frozen[:2000].any()
    flagged = np.flatnonzero(frozen[2000:])[0]
    # It may have repeated its measurement a few times before.
    assert soonest(PAPER, ratio) - 40 <= flagged <= soonest(PAPER, ratio) + 1
    assert flagged * T <= own_times * OWN_TIME


def flight(name, ratio, kind, feedback, precision="float64", seed=0):
    """Errors of an estimate and of the readings of a machine [m], and healthy samples flagged."""
    machine = ambkit.Machine.preset(name).model_copy(update={"unbalance": ()})
    steps = {"noise_variance": NOISE**2, "quantisation": ratio * NOISE}
    sensors = tuple(each.model_copy(update=steps) for each in machine.sensors)
    machine = machine.model_copy(update={"sensor": sensors})
    kalman = KINDS[kind].make(machine, precision=precision)
    made = Scenario(duration=0.2, seed=seed, controller={"feedback": feedback})
    run = simulate_run(machine, made, estimator=kalman)
    c, record, estimate = kalman.engine.model.c, run.record, run.estimate
    shown = [next((x for x in ("q_" + n, n) if x in record.signals), None) for n in estimate.names]
    truth = np.array([np.zeros(len(record["t"])) if n is None else record[n] for n in shown])
    y = np.array([record[n] for n in record.signals if n.startswith("y_")])
    frozen = np.count_nonzero(estimate.status & ambkit.Status.FROZEN)
    return rms((estimate.mean - truth.T) @ c.T), rms(y.T - truth.T @ c.T), frozen


def test_a_rotor_that_other_sensors_hold_within_a_step_is_no_frozen_sensor():
    ours, raw, frozen = flight("tum_mlps", 100, "linear", "measurement")
    assert frozen == 0
    assert ours < 0.5 * raw


def test_a_start_that_is_hardly_known_makes_no_frozen_sensor():
    """The rotor of the compressor is at rest in its middle, within a step, for 50 samples."""
    assert flight("compressor", 5, "extended", "estimate")[2] == 0


@pytest.mark.study
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
@pytest.mark.parametrize("kind", ["linear", "extended", "ud", "unscented"])
@pytest.mark.parametrize("name", ["tum_mlps", "compressor"])
def test_coarse_steps_of_machines(name, kind, feedback, precision):
    for ratio in (0.1, 1, 5, 10, 20, 50, 100):
        ours, raw, frozen = flight(name, ratio, kind, feedback, precision)
        assert frozen == 0
        assert ours <= raw
