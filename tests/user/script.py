"""A user's script with each public name of ambkit, for mypy --strict; it also runs."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, assert_type

import numpy as np
from numpy.typing import NDArray

import ambkit
from ambkit.judge.comparison.score import ComparisonSet

Array = NDArray[np.float64]
IRON = """
name = "iron"
sampling_time = "0.1 ms"
magnet.type = "two-sided"
magnet.turns = 208
magnet.pole_area = "290 mm^2"
magnet.air_gap = "0.78 mm"
magnet.bias_current = "2.5 A"
magnet.iron_length = "0.2 m"
magnet.relative_permeability = 2000
magnet.saturation = "1.6 T"
rotor = {mass = "5 kg", gravity = "-x", clearance = "0.25 mm"}
amplifier = {gain = "1 A/V", current_limit = "2.5 A", noise_variance = "1e-4 V^2"}
sensor = {gain = 1, lag = "0.05 ms", noise_variance = "1 µm^2"}
"""


def bearings() -> ambkit.Machine:
    """A bearing as described, and one that is changed."""
    bearing = ambkit.preset("zittau_axial")
    assert_type(bearing.sampling_time, float)
    assert_type(bearing.rotor.mass, float)
    heavier = bearing.replace(rotor__mass="0.6 kg")
    assert_type(heavier, ambkit.Machine)
    try:
        ambkit.preset("none")
    except ambkit.AmbkitError as error:
        print(error)
    return bearing


def magnets(bearing: ambkit.Machine) -> ambkit.Expert:
    """What estimators may know of a magnet."""
    points = ambkit.stiffness_map(bearing, displacements=[-5e-4, 0.0, 5e-4])
    assert_type(points, ambkit.StiffnessMap)
    assert_type(points.k_i, Array)
    expert = ambkit.train(points).expert
    assert_type(expert, ambkit.Expert)
    stiffness = ambkit.ConstantStiffness(10.0, 7500.0)
    for magnet in (stiffness, ambkit.ClosedLaw(bearing), ambkit.magnet_of(bearing)):
        ambkit.ExtendedKalmanFilter(bearing, magnet)
    assert_type(ambkit.SaturatingLaw(ambkit.Machine.from_toml(IRON)), ambkit.SaturatingLaw)
    return expert


def scenarios(bearing: ambkit.Machine) -> ambkit.Scenario:
    """All waveforms."""
    waves = ambkit.Scenario(
        duration=0.2,
        reference=ambkit.Step(amplitude=1e-4, time=0.05),
        disturbance=ambkit.Sine(amplitude=1.0, frequency=20.0),
        controller=ambkit.Control.for_bearing(bearing),
    )
    for load in (
        ambkit.Constant(value=1.0),
        ambkit.Impulse(area=0.01, time=0.05, duration=1e-3),
        ambkit.Ramp(slope=10.0, start=0.05),
        ambkit.HalfSine(amplitude=1.0, duration=0.01),
        ambkit.Sequence(times=(0.0, 0.1), values=(0.0, 1.0)),
        ambkit.Recorded(times=(0.0, 0.1), values=(0.0, 1.0)),
    ):
        ambkit.simulate(bearing, waves.model_copy(update={"disturbance": load}))
    return ambkit.scenario_for(bearing, waves, seed=1)


def records(bearing: ambkit.Machine, scenario: ambkit.Scenario) -> ambkit.Record:
    """A run, written and read again."""
    run = ambkit.simulate(bearing, scenario)
    assert_type(run.record, ambkit.Record)
    record = ambkit.simulate(bearing, scenario).record
    assert_type(record, ambkit.Record)
    assert_type(record["y"], Array)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        record.save(path)
        assert_type(ambkit.Record.load(path), ambkit.Record)
        loaded: ambkit.Record = ambkit.load(path)
        assert loaded
        try:
            ambkit.read(path, path)
            assert_type(ambkit.read_telemetry(b"AMBF", path), ambkit.Record)
        except (ambkit.ConfigError, ambkit.RecordError) as error:
            print(error)
    return record


def estimates(bearing: ambkit.Machine, expert: ambkit.Expert, record: ambkit.Record) -> None:
    """All estimators, along a record and sample by sample."""
    noise = ambkit.FilterNoise(disturbance=10.0)
    filters = [
        ambkit.LowPass(bearing),
        ambkit.ExtendedStateObserver(bearing),
        ambkit.KalmanFilter(bearing, noise=noise),
        ambkit.SteadyStateKalmanFilter(bearing),
        ambkit.AdaptiveKalmanFilter(bearing, expert),
        ambkit.ExtendedKalmanFilter(bearing),
        ambkit.ContactKalmanFilter(bearing),
        ambkit.UDKalmanFilter(bearing),
        ambkit.UnscentedKalmanFilter(bearing),
        ambkit.AugmentedKalmanFilter(bearing),
        ambkit.MultipleModelFilter(bearing),
        ambkit.AdaptiveNoise(ambkit.KalmanFilter(bearing)),
    ]
    for kalman in filters:
        estimate = kalman.run(record)
        assert_type(estimate, ambkit.Estimate)
        assert_type(estimate.x, Array)
        kalman.reset([0.0, 0.0, 0.0, 0.0])
        assert_type(kalman.step(1e-5, 0.1), Array)
        assert_type(kalman.status, ambkit.Status)
    many = ambkit.run_many(filters[2], record["y"], record["u"])
    assert_type(many.mean, NDArray[Any] | None)  # in float32 as well
    along = ambkit.filter(record, ["linear"], machine=bearing, disturbance_noise=10.0)
    print(along["linear"].evaluation)
    with TemporaryDirectory() as folder:
        file = Path(folder, "filter.toml")
        filters[2].save(file)
        assert_type(ambkit.Estimator.load(file), ambkit.Estimator)
        assert_type(ambkit.FilterFile.load(file).kind, str)
    tuned = ambkit.tune(bearing, filter="linear", budget=1, seeds=1)
    assert_type(tuned.estimator, ambkit.Estimator)


def judged(bearing: ambkit.Machine, scenario: ambkit.Scenario, record: ambkit.Record) -> None:
    """What compares and what identifies."""
    filters = {"linear": ambkit.KalmanFilter(bearing)}
    kalman = [ambkit.KalmanFilter(bearing) for _ in range(3)]
    runs = [ambkit.Planned(bearing, scenario, kalman[k], number=k) for k in range(3)]
    assert_type(ambkit.simulate_many(runs).figures["f_d_rms"], Array)
    loops = ambkit.compare_steps(bearing, filters, scenario=scenario, seeds=2)
    assert_type(loops.scores["scenario"]["linear"].mean("f_d"), float)
    case = ambkit.compare(bearing, ["linear"], case="model", seeds=2)
    assert not isinstance(case, ComparisonSet)
    assert_type(case.efficiency("linear", "x"), float)
    whole = ambkit.compare(bearing, ["low-pass"], case="all", seeds=1)
    assert isinstance(whole, ComparisonSet)
    assert_type(whole["paper"].default["low-pass"].mean("x"), float)
    recovery = ambkit.inject_faults(bearing, ["linear"], faults=["knock"], samples=0)
    assert_type(recovery.to_dict(), dict[str, Any])
    online = ambkit.identify_online(bearing, record)
    assert_type(online.results["adaline"].magnet_constant, float)
    found = ambkit.identify(bearing, record, free=["magnet_constant"])
    assert_type(found.machine, ambkit.Machine)
    print(ambkit.PID.for_bearing(bearing))
    for method in (ambkit.Adaline(bearing), ambkit.RecursiveLeastSquares(bearing)):
        print(method)
    print(ambkit.to_control(bearing))
    assert_type(ambkit.assess(bearing, "linear").loops["linear"].peak, float)
    traded = ambkit.tune_trade_off(bearing, peaks=[2.5], filter="linear", budget=2, seeds=1)
    assert_type(traded.points[0].peak, float)
    assert_type(ambkit.assess_sweep(bearing, "none", amplitudes=["1 um"]).swept[0].deviation, float)
    injection = ambkit.excite_sensitivity(bearing, duration=1.0)
    assert_type(ambkit.assess_log(injection.record, bearing, "none").zone, str)


def with_tools(bearing: ambkit.Machine) -> None:
    """What needs a cross compiler and qemu, logs, or half a minute: for its types only."""
    assert_type(ambkit.pil(bearing, "linear").passed, bool)
    ambkit.excite(bearing, free=["magnet_constant"], duration="1 s").save("excite.csv")
    ambkit.excite_sensitivity(bearing, "none", duration="1 s").save("injection.csv")
    assert_type(ambkit.export_cost(bearing, "linear", clock="80 MHz").clock, float)
    assert_type(ambkit.export_fmu(bearing, out="plant.fmu", kind="plant").finding, str)
    assert_type(ambkit.export_ssp(bearing, out="loop.ssp").finding, str)
    assert_type(ambkit.export_a2l("c", elf="firmware.elf", out="c.a2l").finding, str)
    assert_type(ambkit.identify_corpus(bearing, ["a.csv", "b.csv"]).filter, ambkit.Estimator)
    assert_type(ambkit.identify_lift_off(bearing, "points.csv").machine, ambkit.Machine)
    assert_type(ambkit.identify_coil(bearing, "log.csv").known, ambkit.Machine | None)
    assert_type(ambkit.train_map(bearing, "force.csv").expert, ambkit.Expert)
    assert_type(ambkit.guess_channels("log.csv").text, str)
    assert_type(ambkit.reproduce("out").folder, Path)


def written(bearing: ambkit.Machine) -> None:
    """C, a MAT-file, and what says how files must be."""
    with TemporaryDirectory() as folder:
        assert_type(ambkit.export_c(bearing, "linear", out=Path(folder, "c")).folder, Path)
        assert_type(ambkit.export_mat(bearing, out=Path(folder, "f.mat")).finding, str)
        file = Path(folder, "bearing.toml")
        file.write_text(ambkit.presets(bearing.name).text, encoding="utf-8")
        assert_type(ambkit.check(file).exit_code, int)
    assert_type(ambkit.schema("scenario").text, str)
    assert_type(ambkit.preset("tum_mlps"), ambkit.Machine)


class Raw:
    """An estimator of one's own."""

    def step(self, y: float, u: float) -> tuple[float, ...]:
        """Return what the sensor says."""
        return y, 0.0, 0.0, y


class Gain:
    """A controller of one's own."""

    def step(self, y: float, r: float, estimate: Array | None) -> float:
        """Return a current."""
        return 2e4 * (r - y)


class Still:
    """A plant of one's own."""

    def step(self, iu: float, f_d: float) -> tuple[float, ...]:
        """Return what does not move."""
        return 0.0, 0.0, 0.0


def of_ones_own(bearing: ambkit.Machine) -> None:
    """What has a step, and what a verb returns."""
    own: ambkit.EstimatorProtocol = Raw()
    controller: ambkit.ControllerProtocol = Gain()
    plant: ambkit.PlantProtocol = Still()
    print(controller, plant)
    assert_type(ambkit.simulate(bearing, filter=type(own)).samples_at_the_stop, int)
    found: ambkit.Result = ambkit.assess(bearing, {"naive": ambkit.ConstantVelocity(bearing)})
    assert found is not None


def whole_machine() -> None:
    """Four axes of a rotor."""
    assert_type(ambkit.workbench("zittau_axial").finding, str)
    assert ambkit.magnet.__doc__  # solving takes half a minute
    assert ambkit.diagnose.__doc__  # it wants a log without its fault first
    limits: ambkit.Result = ambkit.diagnose_limits("zittau_axial")
    assert limits.finding
    machine = ambkit.Machine.preset("hindawi_2011")
    filter_ = ambkit.KalmanFilter(machine)
    run = ambkit.simulate(machine, ambkit.Scenario(duration=0.02), filter=filter_)
    assert_type(run.samples_at_the_stop, int)
    assert_type([each.std for each in ambkit.harmonics(filter_, run.record)], list[float])
    assert_type(ambkit.campbell(machine, count=3).critical, list[float])
    over = ambkit.assess_speed(machine, "none", fastest="3000 rpm", count=2)
    assert_type(over.farthest, tuple[float, float])
    assert_type(ambkit.waterfall(run.record, "s_A1", window=0.01).amplitude, Array)
    assert_type(ambkit.unbalance_response(machine, 500.0, count=3).amplitude, Array)
    measured = machine.replace(angle={"type": "speed"})
    angle = ambkit.estimate_angle(measured, run.record)
    assert isinstance(angle, ambkit.AngleEstimate)
    assert_type(angle.speed, Array)
    assert not any(angle.status & ambkit.AngleStatus.RESTARTED)
    bending = ambkit.mode_shapes(ambkit.Machine.preset("ufu_flexible"))
    assert_type(bending.to_dict(), dict[str, Any])


def designed(bearing: ambkit.Machine, record: ambkit.Record) -> None:
    """From a log to C."""
    with TemporaryDirectory() as folder:
        log = Path(folder, "log.csv")
        record.save(log)
        found = ambkit.design(
            bearing, [log], out=Path(folder, "out"), filter="linear", free=["magnet_constant"]
        )
        assert_type(found.finding, str)


def designed_whole(machine: ambkit.Machine) -> None:
    """A whole machine's controllers and filter."""
    with TemporaryDirectory() as folder:
        found = ambkit.design(machine, out=folder, filter="linear")
        assert_type(found.loop.peak, float)
        assert_type(found.finding, str)


def many_machines() -> None:
    """Out of tolerances."""
    study = ambkit.Study.from_toml(
        'name = "a"\nmachine = "zittau_axial"\nruns = 8\nscenario.duration = "10 ms"\n'
        '[[vary]]\nwhat = "rotor.mass"\ntype = "uniform"\ntolerance = "2 %"\n'
    )
    with TemporaryDirectory() as folder:
        found = ambkit.campaign(study, Path(folder, "out"))
        assert isinstance(found, ambkit.Campaign)
        assert_type(found.good.value, float)
        assert_type(ambkit.campaign_report(found.folder), ambkit.Campaign)
        assert_type(ambkit.campaign_status(found.folder).finding, str)
        assert_type(ambkit.campaign_replay(found.folder, 1).run.record, ambkit.Record)
        rare = ambkit.campaign_rare(found.folder, figure="x_peak", above="1 um", budget=20)
        assert_type(rare.finding, str)
    print(ambkit.campaign_problem(study))
    assert_type(ambkit.tune_robust(study, budget=1).taken, int)


if __name__ == "__main__":
    print(ambkit.__version__)
    plant = bearings()
    network = magnets(plant)
    happening = scenarios(plant)
    log = records(plant, happening)
    estimates(plant, network, log)
    judged(plant, happening, log)
    designed(plant, log)
    of_ones_own(plant)
    written(plant)
    whole_machine()
    many_machines()
