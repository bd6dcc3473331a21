"""Fault isolation: against a naive likelihood ratio, on healthy runs, and whom it names."""

import numpy as np
import pytest

import ambkit
from ambkit.base.errors import AmbkitError
from ambkit.estimate.registry import KINDS
from ambkit.judge.isolation.isolation import LIMIT, FaultIsolation, _error_model
from ambkit.simulation.external_inputs import ExternalInputs, Faults
from ambkit.simulation.run import simulate
from ambkit.simulation.waveforms import Ramp, Sine
from ambkit.workflow.diagnose import diagnosed

PAPER = ambkit.preset("zittau_axial")
N, ONSET = 6000, 3000


def flown(machine, faults=None, *, moving=False, seed=3, n=N, **given):
    """A record of n samples."""
    T = machine.sampling_time
    swing = {"reference": Sine(amplitude=1e-4, frequency=20.0)} if moving else {}
    scenario = ambkit.Scenario(duration=(n - 1) * T, seed=seed, **swing)
    return simulate(machine, scenario, external_inputs=ExternalInputs(faults=faults, **given))


def with_fault(name, value, n=N):
    faults = Faults.none(n)
    getattr(faults, name)[ONSET:] = value
    return faults


def still(name):
    return ambkit.preset(name).model_copy(update={"speed": 0.0})


def naive_information(isolation, along, onset_samples):
    """Sum of squared innovations by faults of size 1, each stepped forwards by itself."""
    kalman = isolation.kalman
    A, b, H, units, _ = _error_model(kalman)
    P = kalman.covariance / np.outer(units, units)
    R, S = np.atleast_1d(kalman.variances.measurement), np.atleast_1d(kalman.innovation_variance)
    K = np.zeros_like(H)
    for r in reversed(range(len(H))):
        K[r] = P @ H[r] / R[r]
        P = P + np.outer(K[r], K[r]) * S[r]
    d, total = np.zeros(len(A)), 0.0
    for _ in range(onset_samples):
        d = A @ d + (b[along[1]] if along[0] == "force" else 0.0)
        for r in range(len(H)):
            e = H[r] @ d + (1.0 if along == ("reading", r) else 0.0)
            d = d - K[r] * e
            total += e**2 / S[r]
    return total


@pytest.mark.parametrize("name", ["zittau_axial", "heart_pump"])
def test_the_information_of_a_fault_is_that_of_a_naive_recursion(name):
    machine = PAPER if name == "zittau_axial" else still(name)
    kalman = KINDS["extended"].make(machine)
    isolation = FaultIsolation(kalman)
    isolation.run(flown(machine, n=4 * isolation.window))
    M = isolation.information(isolation.window)
    names = [s.name for s in isolation.signatures]
    first = np.cumsum([0, *(len(s.columns) for s in isolation.signatures)])
    axis, reading = machine.axes[-1].name, machine.readings[0].name
    for fault, along in (
        (f"load_{axis}".rstrip("_"), ("force", len(machine.axes) - 1)),
        (f"sensor offset_{reading}".rstrip("_"), ("reading", 0)),
    ):
        at = first[names.index(fault)]
        assert M[at, at] == pytest.approx(naive_information(isolation, along, isolation.window),
                                          rel=2e-3)  # fmt: skip
    spread = np.sqrt(np.outer(np.diag(M), np.diag(M)))
    there = np.diag(M) > 0
    alike = (M / np.where(spread > 0, spread, 1.0))[np.ix_(there, there)]
    assert np.linalg.eigvalsh(alike).min() > -1e-6
    # Beside an error at the start less is known, never more.
    assert (
        np.diag(isolation.information(isolation.window, before=True)) <= np.diag(M) * (1 + 1e-9)
    ).all()


@pytest.mark.parametrize(("name", "filter"), [
    ("zittau_axial", "extended"), ("zittau_axial", "ud"), ("heart_pump", "extended+unbalance"),
])  # fmt: skip
def test_a_healthy_machine_has_no_fault(name, filter):
    result = diagnosed(flown(ambkit.preset(name)), filter, ambkit.preset(name), None, None)
    assert result.faults == []
    assert result.finding.endswith("no fault.")
    later = len(result.searches.t) // 4
    assert result.searches.likelihood[later:].max() < 32  # the limit is 40


CASES = {
    "an offset": (with_fault("y_plus", 4e-5), False, "sensor offset", 4e-5),
    "an offset that restarts the filter": (with_fault("y_plus", 3e-4), True, "sensor offset", 3e-4),
    "a gain": (with_fault("y_times", 1.3), True, "sensor gain", 0.3),
}


@pytest.mark.parametrize("case", CASES)
def test_a_fault_is_named_with_its_size_and_begin(case):
    faults, moving, name, true = CASES[case]
    record = flown(PAPER, faults, moving=moving)
    result = diagnosed(record, "extended", PAPER, None, None)
    assert result.faults == [name]
    k, j = result.decisive, [s.name for s in result.searches.signatures].index(name)
    size = result.searches.size[k, j, 0]
    assert size == pytest.approx(true, rel=0.05)
    begin = result.searches.t[k] - result.searches.since[k, j] * PAPER.sampling_time
    assert begin == pytest.approx(ONSET * PAPER.sampling_time, abs=2e-3)
    row = next(r for r in result.rows if r.of == name and r.key == "verdict")
    assert row.value == "named"


def test_a_weak_magnet_at_rest_is_listed_with_all_that_look_like_it():
    scale = np.where(np.arange(N) < ONSET, 1.0, 0.9)
    result = diagnosed(flown(PAPER, magnet_scale=scale), "extended", PAPER, None, None)
    assert not result.certain
    assert "a disturbance force explains it" in result.finding
    (group,) = result.searches.groups(result.decisive)
    assert {"load", "magnet"} <= set(group)
    assert " or ".join(group) in result.finding


def test_two_faults_at_once_are_named_with_their_sizes():
    faults = with_fault("y_plus", 4e-5)
    faults.late[ONSET:] = 6
    result = diagnosed(flown(PAPER, faults, moving=True), "extended", PAPER, None, None)
    late, offset = sorted(result.faults, key=len, reverse=True)
    assert offset == "sensor offset"
    assert set(late.split(" or ")) <= {"sensor lag", "dead time"}
    k, names = result.decisive, [s.name for s in result.searches.signatures]
    size = result.searches.size[k, names.index("sensor offset"), 0]
    assert size == pytest.approx(4e-5, rel=0.05)


def test_faults_that_look_alike_are_named_together():
    late = with_fault("late", 6)
    result = diagnosed(flown(PAPER, late, moving=True), "extended", PAPER, None, None)
    assert {"sensor lag", "dead time"} <= set(result.faults[0].split(" or "))


def test_two_faults_of_a_machine_are_named_with_their_places():
    machine = still("heart_pump")
    T, readings, axes = machine.sampling_time, len(machine.readings), len(machine.axes)
    faults = with_fault("y_plus", 2e-5).among(1, readings, 0, axes)
    hum = np.zeros((N, readings))
    hum[ONSET:, 3] = 5e-6 * np.sin(100 * np.pi * T * np.arange(N - ONSET))
    record = flown(machine, faults, readings=hum)
    result = diagnosed(record, "extended", machine, None, None)
    names = [reading.name for reading in machine.readings]
    assert sorted(result.faults) == [f"line noise_{names[3]}", f"sensor offset_{names[1]}"]


def test_a_run_up_is_no_fault_and_an_unbalance_that_jumps_in_it_is():
    machine = ambkit.preset("heart_pump")
    T, rise = machine.sampling_time, 1000.0
    angle = rise * (T * np.arange(N)) ** 2 / 2
    force = np.zeros((N, len(machine.axes)))
    for k, axis in enumerate(machine.axes):
        if axis.bearing is machine.axes[0].bearing:
            line = axis.line
            around = np.cos(angle) * line.cosine + np.sin(angle) * line.sine
            force[ONSET:, k] = 0.02 * around[ONSET:]
    scenario = ambkit.Scenario(duration=(N - 1) * T, speed=Ramp(slope=rise), seed=3)
    for inputs, expected in (({}, []), ({"disturbance": force}, ["unbalance_A"])):
        record = simulate(machine, scenario, external_inputs=ExternalInputs(**inputs))
        result = diagnosed(record, "extended+unbalance", machine, None, None)
        assert result.faults[:1] == expected
        assert not any("extended+unbalance" in note for note in result.notes)
    without = diagnosed(record, "extended", machine, None, None)
    assert any("extended+unbalance" in note for note in without.notes)


def test_a_rotor_on_its_stop_is_said_and_no_fault_is_named():
    machine = PAPER.replace(stop={"stiffness": 1e8, "damping": 0.3})
    load = np.zeros(N)
    load[ONSET : ONSET + 400] = 25.0  # beyond what the magnet bears
    result = diagnosed(flown(machine, disturbance=load), "extended", machine, None, None)
    assert result.faults == []
    assert "the rotor is on a stop at 0.3" in result.finding


def test_a_step_of_the_load_is_no_fault():
    step = np.where(np.arange(N) < ONSET, 0.0, 2.0)
    result = diagnosed(flown(PAPER, disturbance=step), "extended", PAPER, None, None)
    load = [s.name for s in result.searches.signatures].index("load")
    assert result.searches.likelihood[:, load].max() > 40
    assert result.faults == []


def test_a_load_rougher_than_the_filter_assumes_is_no_fault_and_is_said():
    n, true = 20_000, 1.0
    walk = np.random.default_rng(3).normal(size=n).cumsum() * np.sqrt(true * PAPER.sampling_time)
    filter = KINDS["extended"].make(PAPER, noise=ambkit.FilterNoise(disturbance=true / 10))
    result = diagnosed(flown(PAPER, n=n, disturbance=walk), filter, PAPER, None, None)
    assert result.faults == []
    assert any("as intense as the filter assumes" in note for note in result.notes)
    s = result.searches
    assert 4 < np.median(s.roughness[20:]) < 12
    # Without that scale it would raise alarms.
    assert (s.likelihood * s.roughness[:, None]).max() > 2 * LIMIT


def test_single_precision_says_the_same():
    record = flown(PAPER, with_fault("y_plus", 4e-5))
    found = {}
    for precision in ("float64", "float32"):
        s = FaultIsolation(KINDS["extended"].make(PAPER, precision=precision)).run(record)
        found[precision] = s
    one, other = found.values()
    assert (one.alarms == other.alarms).all()
    both = one.likelihood > 40
    assert other.likelihood[both] == pytest.approx(one.likelihood[both], rel=0.03)


def test_micrometres_for_metres_change_nothing():
    small = PAPER.replace(sensor__gain=PAPER.sensor.gain * 1e3,
                          sensor__noise_variance=PAPER.sensor.noise_variance * 1e6)  # fmt: skip
    record = flown(PAPER, with_fault("y_plus", 4e-5))
    scaled = ambkit.Record(record.t, {"y": record["y"] * 1e3, "u": record["u"]},
                           {"y": "m", "u": "V"})  # fmt: skip
    one = FaultIsolation(KINDS["extended"].make(PAPER)).run(record)
    other = FaultIsolation(KINDS["extended"].make(small)).run(scaled)
    assert other.likelihood == pytest.approx(one.likelihood, rel=1e-5, abs=1e-6)


def test_one_reading_of_several_is_named():
    machine = still("heart_pump")
    n, readings = N, len(machine.readings)
    faults = with_fault("y_plus", 2e-6).among(1, readings, 0, len(machine.axes))
    result = diagnosed(flown(machine, faults, n=n), "extended", machine, None, None)
    assert result.faults == [f"sensor offset_{machine.readings[1].name}"]


def test_limits_say_what_is_seen_and_what_is_alike():
    result = ambkit.diagnose_limits(PAPER)
    rest = {r.of: r.value for r in result.rows if r.section == ("at rest",) and r.key == "alike"}
    assert "load" in rest["magnet"]
    assert rest["sensor offset"] == "none"
    named = {r.of: r.value for r in result.rows if r.section == ("in steps",) and r.key == "named"}
    seen = {r.of: r.value for r in result.rows if r.section == ("in steps",) and r.key == "alarm"}
    assert all(named[of] is None or named[of] >= seen[of] for of in seen)
    resting = {r.of: r.value for r in result.rows if r.section == ("at rest",) and r.key == "alarm"}
    assert resting["sensor gain"] is None  # a rotor that moves shows it
    assert seen["sensor gain"] is not None


def test_a_filter_without_a_model_is_refused():
    with pytest.raises(AmbkitError, match="no model of the machine"):
        diagnosed(flown(PAPER), "low-pass", PAPER, None, None)


def test_the_command(call, tmp_path):
    flown(PAPER, with_fault("y_plus", 4e-5)).save(tmp_path / "run.csv")
    said = call("diagnose", tmp_path / "run.csv", "--machine", "zittau_axial",
                "--plot", tmp_path / "faults.png")  # fmt: skip
    assert "sensor offset, since 0.2999 s." in said.out.replace("\n", " ")
    assert (tmp_path / "faults.png").is_file()
