"""Many closed loops are `simulate_run` one by one, to the last bit, judged by their truth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ambkit
from ambkit import KalmanFilter, Machine, Planned, Scenario, Status, Step, simulate, simulate_many
from ambkit.estimate.batch import instruction_sets
from ambkit.estimate.registry import KINDS
from ambkit.machine.accessories import Hum
from ambkit.simulation.external_inputs import ExternalInputs, Faults
from ambkit.simulation.plans import windows
from ambkit.simulation.recording import Stream
from ambkit.simulation.run_figures import FIGURES, FLAGS

BEARING = Machine.preset("zittau_axial")
PID = ambkit.PID.for_bearing(BEARING)
KALMAN = ambkit.KalmanFilter(BEARING)
SCENARIO = Scenario(
    duration=0.08,
    seed=3,
    reference=Step(amplitude=3e-4, time=0.01),
    disturbance=Step(amplitude=-3.0, time=0.05),
    controller=PID,
)
LOST = SCENARIO.replace(disturbance=Step(amplitude=-40.0, time=0.03))
MEASURED = SCENARIO.replace(controller=PID.model_copy(update={"feedback": "measurement"}))


def columns(runs, **options):
    return simulate_many(runs, **options).columns()


def assert_same(got, expected):
    assert got.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(got[name], values, err_msg=name)


def mixture():
    """Kinds with lanes and without, plants, feedbacks, stops, parts, faults; not in groups."""
    runs = []
    quantised = BEARING.replace(sensor__quantisation="1 um")
    for name in ("linear", "closed-law", "extended", "observer", "low-pass", "unscented"):
        kind = KINDS[name].make(BEARING)
        for k in range(5):
            plant = BEARING.replace(rotor__mass=BEARING.rotor.mass * (1 + 0.03 * k))
            runs.append(Planned(plant, (SCENARIO, LOST, MEASURED)[k % 3], kind, number=k))
    n = 801
    weaker = ExternalInputs(magnet_scale=np.linspace(1, 0.9, n))
    silent = ExternalInputs(sensor_noise=np.zeros(n))
    late = ExternalInputs(faults=Faults(**{**Faults.none(n).series, "late": np.ones(n)}))
    runs += [
        Planned(quantised, SCENARIO, KALMAN, number=7),
        Planned(BEARING, MEASURED),
        Planned(BEARING, SCENARIO, KALMAN, external_inputs=weaker),
        Planned(BEARING, SCENARIO, KALMAN, external_inputs=silent),
        Planned(
            BEARING, MEASURED, KALMAN,
            external_inputs=late,
        ),
        Planned(BEARING, SCENARIO, ambkit.KalmanFilter(BEARING, precision="float32"), number=2),
    ]  # fmt: skip
    return runs


MIXED = mixture()
ONE_BY_ONE = columns(MIXED, instructions="scalar", threads=1)


@pytest.mark.parametrize("instructions", instruction_sets())
@pytest.mark.parametrize("threads", [1, 3])
def test_neither_lanes_nor_threads_change_a_bit(instructions, threads):
    assert_same(columns(MIXED, instructions=instructions, threads=threads), ONE_BY_ONE)


@settings(max_examples=10, deadline=None)
@given(order=st.permutations(range(len(MIXED))), cut=st.integers(0, len(MIXED)))
def test_neither_order_nor_splitting_changes_a_bit(order, cut):
    halves = [columns([MIXED[i] for i in part]) for part in (order[:cut], order[cut:])]
    joined = {name: np.concatenate([half[name] for half in halves]) for name in ONE_BY_ONE}
    assert_same(joined, {name: values[order] for name, values in ONE_BY_ONE.items()})


def test_runs_of_several_chunks_are_in_their_order(monkeypatch):
    monkeypatch.setattr("ambkit.simulation.many.CHUNK", 7)
    monkeypatch.setattr("ambkit.simulation.plans.MOST_PLANS", 10)
    told = []
    many = simulate_many(iter(MIXED), done=told.append)
    assert_same(many.columns(), ONE_BY_ONE)
    assert (len(many), sum(told), max(told)) == (len(MIXED), len(MIXED), 7)


def by_hand(run, kalman=None):
    """The figures from the samples of a run, of the worst axis, by NumPy."""
    record, estimate, axes = run.record, run.estimate, run.machine.axes
    single, T = "x" in record.signals, run.machine.sampling_time
    ends = [""] if single else [f"_{name}" for name in run.axes]
    s, r, iu, u, f_d = (
        np.column_stack([record[f"{of}{end}"] for end in ends])
        for of in ("x" if single else "s", "r", "iu", "u", "f_d")
    )
    gains = np.array([axis.bearing.amplifier.gain for axis in axes])
    travel = np.array([axis.bearing.clearance for axis in axes])
    at, away = windows(r, f_d, 1), np.abs(r - s)
    orbits = [np.linalg.norm(s[1:, k : k + 2], axis=1).max() for k in range(0, len(ends), 2)]
    found = {
        "tracking_rms": max(map(rms, away[1:].T)), "tracking_peak": away[1:].max(),
        "effort": max(map(rms, (gains * np.diff(u[1:], axis=0)).T)),
        "displacement_peak": np.abs(s).max(), "current_peak": np.abs(iu).max(),
        "orbit_peak": max(orbits), "orbit_share": (orbits / travel[::2]).max(),
        "touched": record.meta["stop_touched"] if single else 0.0,
    }  # fmt: skip
    if not single:
        found |= {"load_kept": np.linalg.norm(f_d, axis=1).max(), "landed": 0.0}
    if at[0].load_from < len(record):
        late = np.flatnonzero((away > 0.05 * travel).any(axis=1)[at[0].load_from :])
        never = late.size and late[-1] == len(record) - at[0].load_from - 1
        found["recovery"] = np.inf if never else (late[-1] + 1) * T if late.size else 0.0
    start, stop = at[0].step_from, at[0].step_to
    if start < stop:
        way = (s[start:stop, 0] - r[start, 0]) / at[0].height
        last = np.flatnonzero(np.abs(way) > 0.05)[-1]
        found["overshoot"] = max(0.0, way.max())
        found["settling"] = np.inf if last == way.size - 1 else (last + 1) * T
    if estimate is None:
        return found
    if single:
        errors = {name: (estimate[name] - record[name])[:, None] for name in ("x", "v", "f_d")}
        nis = estimate.nis[1:][estimate.used[1:]]
    else:
        along = kalman.view.along_axes(estimate.states)
        q = np.column_stack([record[f"q_{state.name}"] for state in estimate.states[:8]])
        errors = {
            name: estimate.mean @ rows.T - q @ rows[:, :8].T
            for name, rows in zip("xv", along, strict=True)
        }
        errors["f_d"] = np.column_stack([estimate[f"f_d{end}"] for end in ends]) - f_d
        nis = estimate.nis[1:]
    for name, values in errors.items():
        error = np.abs(values)[1:]
        found[f"{name}_rms"], found[f"{name}_peak"] = max(map(rms, error.T)), error.max()
    found["nis"] = np.nanmean(nis) if np.isfinite(nis).any() else np.nan
    return found


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


def test_the_figures_are_those_of_the_samples():
    many = simulate_many(MIXED)
    for place, planned in enumerate(MIXED):
        run = planned.simulated()
        single = planned.estimator is not None and planned.estimator.precision != "float64"
        for name, expected in by_hand(run).items():
            got = many.figures[name][place]
            tolerance = 1e-5 if single else 1e-12
            assert got == pytest.approx(expected, rel=tolerance, nan_ok=True), (place, name)
        if run.estimate is not None:
            for name, count in many.status.items():
                flag = np.uint16(Status[name.upper()])
                assert count[place] == np.count_nonzero(run.estimate.status & flag)


def test_what_a_stop_does_to_the_figures():
    """The load of 3 N is borne; under 40 N the rotor lands, and no load was borne before."""
    runs = [Planned(BEARING, scenario, KALMAN) for scenario in (SCENARIO, LOST)]
    figures = simulate_many(runs).figures
    assert figures["load_kept"].tolist()[0] == 3.0
    assert figures["touched"][0] == 0 < figures["touched"][1]
    assert figures["landed"].tolist() == [0.0, 1.0]
    # The last step of the reference, and then a load: without one, neither can be seen.
    still = simulate_many([Planned(BEARING, Scenario(duration=0.02, controller=PID), KALMAN)])
    assert all(np.isnan(still.figures[name][0]) for name in ("overshoot", "settling", "recovery"))
    assert tuple(still.figures) == tuple(FIGURES)
    assert tuple(still.status) == FLAGS == tuple(flag.name.lower() for flag in Status)


def test_where_a_step_and_a_load_can_be_judged():
    n = np.arange(400)
    r, f_d = np.where(n >= 100, 2e-4, 0.0), np.where(n >= 300, 3.0, 0.0)
    none = (0, 0, 1.0)

    def of(r, f_d, first):
        (result,) = windows(r[:, None], f_d[:, None], first)
        return result

    assert of(r, f_d, 1) == (1, 100, 300, 2e-4, 300)
    assert of(r + 1e-4, f_d, 1).height == pytest.approx(2e-4)
    assert of(r, 0 * f_d, 7) == (7, 100, 400, 2e-4, 400)
    assert of(r, np.sin(n / 50), 1) == (1, *none, 400)  # a load that never rests
    assert of(np.sin(n / 50), f_d, 1) == (1, *none, 400)  # nor a reference
    assert of(r, np.where(n >= 380, 3.0, 0.0), 1) == (1, 100, 380, 2e-4, 400)
    # Of several axes what comes next may be on another one, and a load is everybody's.
    pair = np.column_stack([r, np.where(n >= 200, 1e-4, 0.0)])
    first, second = windows(pair, np.column_stack([f_d, 0 * f_d]), 1)
    assert first == (1, 100, 200, 2e-4, 300)
    assert second == (1, 200, 300, 1e-4, 300)


def test_a_number_stands_for_the_run_of_the_scenario():
    own = simulate_many([Planned(BEARING, SCENARIO.replace(run=9), KALMAN)])
    given = Planned(BEARING, SCENARIO, KALMAN, number=9)
    assert_same(simulate_many([given]).columns(), own.columns())
    record = ambkit.simulate(BEARING, SCENARIO.replace(run=9), filter=KALMAN).record
    assert (given.simulated().record["y"] == record["y"]).all()
    assert record.meta["run"] == 9


def test_what_cannot_be_done_is_reported():
    run = Planned(BEARING, SCENARIO, KALMAN)
    with pytest.raises(ValueError, match=r"settling must be less than the 0\.08 s of a run"):
        simulate_many([run], settling=1.0)
    with pytest.raises(ValueError, match="threads must be 1 or more, got 0"):
        simulate_many([run], threads=0)
    with pytest.raises(ValueError, match="no instructions called 'sse9'"):
        simulate_many([run], instructions="sse9")
    assert len(simulate_many([])) == 0


def rotor(**control):
    """A machine, and steps of a reference and then of a load, along two axes."""
    machine = Machine.preset("tum_mlps")
    step = {"type": "step", "amplitude": 2e-5, "time": 3e-3}
    return machine, Scenario(
        duration=0.08, seed=2, controller=control,
        reference=[{"axis": "A1", "position": step}],
        disturbance=[{"axis": "B2", "force": {"type": "step", "amplitude": 5.0, "time": 0.04}}],
    )  # fmt: skip


@pytest.mark.parametrize("feedback", ["estimate", "measurement"])
def test_runs_of_several_axes_are_judged_by_their_samples(feedback):
    machine, scenario = rotor(feedback=feedback)
    kalman = KalmanFilter(machine)
    hum = machine.sensors[0].model_copy(update={"hum": (Hum(frequency=50.0, amplitude=1e-6),)})
    humming = machine.replace(sensor=[hum, *machine.sensors[1:]])
    runs = [Planned(machine, scenario, kalman, number=number) for number in range(3)]
    runs += [Planned(humming, scenario, kalman, number=7), runs[0]]
    if feedback == "measurement":
        runs.append(Planned(machine, scenario))
    many = simulate_many(runs)
    for place, planned in enumerate(runs):
        run = planned.simulated()
        expected = by_hand(run, kalman)
        for name, value in expected.items():
            assert many.figures[name][place] == pytest.approx(value, rel=1e-11), (place, name)
        assert {name for name in FIGURES if not np.isnan(many.figures[name][place])} == {*expected}
    alone = simulate(machine, scenario.replace(run=2), filter=KalmanFilter(machine))
    again = runs[2].simulated().record
    assert all(np.array_equal(again[name], alone.record[name]) for name in ("y_La1", "iu_B2"))
    for name, values in simulate_many(runs[::-1], threads=3).columns().items():
        np.testing.assert_array_equal(values[::-1], many.columns()[name], err_msg=name)


def test_machines_and_axes_that_run_up_fly_in_one_batch():
    """Each as by itself, at whatever speed a filter went before."""
    machine, scenario = rotor(feedback="estimate")
    fast = machine.model_copy(update={"speed": 0.9 * machine.speed})
    rising = scenario.replace(speed={"type": "ramp", "slope": 500.0})
    kalman = KalmanFilter(machine)
    runs = [
        Planned(machine, rising, kalman, number=1), Planned(BEARING, SCENARIO, KALMAN, number=1),
        Planned(fast, scenario, kalman, number=2), Planned(machine, scenario, kalman, number=3),
        Planned(machine, rising, kalman, number=4),
    ]  # fmt: skip
    many = simulate_many(runs, threads=2).columns()
    for place, run in enumerate(runs):
        for name, values in simulate_many([run], threads=1).columns().items():
            np.testing.assert_array_equal(many[name][place], values[0], err_msg=name)
    record = runs[0].simulated().record
    farthest = max(np.abs(record[f"s_{axis.name}"]).max() for axis in machine.axes)
    assert many["displacement_peak"][0] == pytest.approx(farthest, rel=1e-12)


def test_the_noise_is_normal_and_its_streams_are_apart():
    """Kolmogorov-Smirnov on 10^6 numbers, tails by their count, and all correlations nil."""
    from scipy.stats import binom, kstest

    n = 1_000_000
    z = Stream(1).normal(1.0, n)
    assert kstest(z, "norm").pvalue > 1e-3
    beyond = int(np.count_nonzero(np.abs(z) > 4))
    assert 1e-4 < binom.cdf(beyond, n, 6.334e-5) < 1 - 1e-4
    others = [Stream(1, 1), Stream(1, 2**32), Stream(2), Stream(2**32), Stream(1, 0, 1)]
    for other in [stream.normal(1.0, n) for stream in others] + [np.roll(z, 1), np.roll(z, 2)]:
        assert abs(np.mean(z * other)) < 5e-3
    assert (Stream(1).normal(2.0, 100) == 2 * z[:100]).all()


def test_the_normal_numbers_are_the_inverse_of_the_distribution():
    from scipy.special import ndtri

    from ambkit.machine.magnets import core_module

    core = core_module()
    z = core.normal_noise(5, 6, 7, 2000)
    words = np.array([core.philox([k, 7, 6, 0], [5, 0]) for k in range(1000)], np.uint64)
    bits = np.stack([(words[:, 1] << 20) ^ (words[:, 0] >> 12),
                     (words[:, 3] << 20) ^ (words[:, 2] >> 12)], axis=1).ravel()  # fmt: skip
    np.testing.assert_allclose(z, ndtri((bits + 0.5) / 2.0**52), rtol=1e-13)


def test_a_record_is_filtered_to_the_same_bits_by_all_instructions():
    record = ambkit.simulate(BEARING, SCENARIO, filter=KALMAN).record
    y, u = record["y"].copy(), record["u"].copy()
    y[100:130], u[200:220] = np.nan, 50.0
    for precision in ("float64", "float32"):
        kalman = ambkit.KalmanFilter(BEARING, precision=precision)
        told = []
        for instructions in instruction_sets():
            kalman.reset()
            given = [each.astype(precision) for each in (y, u)]
            told.append(kalman.core.run(*given, covariance=True, instructions=instructions))
        for other in told[1:]:
            assert all((other[name] == values).all() for name, values in told[0].items())
