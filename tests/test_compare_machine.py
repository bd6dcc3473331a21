"""Estimators of machines compared in a case, beside the bound and the raw sensors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ambkit import AmbkitError, KalmanFilter, Machine, compare, compare_steps
from ambkit.control.stabilising_controller import holding
from ambkit.judge.comparison.bound import bearing_bound
from ambkit.judge.comparison.cases import CASES, trials
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import by_axis

MACHINE = Machine.preset("tum_mlps")


def test_a_machine_has_its_bound_and_its_raw_sensors_beside_the_filters():
    found = compare(MACHINE, ["linear", "extended"], case="model", seeds=4)
    for signal in ("x", "v", "f_d"):
        assert 0.95 < found.efficiency("extended", signal) < 1.05
    # It takes what the magnets' law bends for a force.
    assert found.efficiency("linear", "f_d") < 0.9
    assert found.best["extended"].mean("nees") == pytest.approx(0.95, abs=0.03)
    assert found.raw > 2 * found.limit["x"]
    # What feeds the controllers is in the loop; no reference steps here.
    assert found.best["linear"].mean("tracking") > 0
    assert np.isnan(found.best["linear"].mean("overshoot"))


def test_each_axis_gets_what_happens_to_it_alone():
    record = trials(CASES["unbalance"], MACHINE, 1, 0)[0].record
    for axis in MACHINE.axes:
        alone = CASES["unbalance"].scenario(MACHINE.isolated_axis(axis.name), 0.6)
        assert record[f"f_d_{axis.name}"] == pytest.approx(alone.disturbance.sample(record.t))
        assert record[f"r_{axis.name}"] == pytest.approx(alone.reference.sample(record.t))


def test_the_bound_of_the_position_is_that_of_its_column():
    bearing = Machine.preset("zittau_axial").replace(amplifier__bandwidth="1 kHz")
    records = [trial.record.between(None, 0.02) for trial in trials(CASES["model"], bearing, 2, 0)]
    of = KalmanFilter(bearing)
    of_all = bearing_bound(bearing, records, of.variances, of.default_std())
    position = np.eye(len(of.states))[:1]
    alone = bearing_bound(bearing, records, of.variances, of.default_std(), position)
    assert alone[:, 0] == pytest.approx(of_all[:, 0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--case", "saturating"), "can be simulated for a machine with one axis only"),
        (("--filter", "low-pass"), "takes one axis"),
        (("--plant", "map.csv"), "plant is the magnet of one axis, and tum_mlps has 4"),
    ],
)
def test_what_a_machine_cannot_be_compared_in_is_one_sentence(options, message, call):
    chosen = () if "--filter" in options else ("--filter", "linear")
    told = call("compare", "tum_mlps", "--seeds", "1", *chosen, *options)
    assert told.code == 2
    assert message in told.err


@pytest.mark.parametrize("name", ["uncertain", "wrong-k", "coloured-noise"])
def test_a_case_whose_plant_is_another_one_changes_all_axes(name):
    trial, other = trials(CASES[name], MACHINE, 2, 0)
    assert not trial.lost
    described = MACHINE.bearings[0].magnet.magnet_constant
    ratios = {bearing.magnet.magnet_constant / described for bearing in trial.plant.bearings}
    drawn = trial.plant.bearings[0] != other.plant.bearings[0]
    assert len(ratios) == 1  # bearings alike
    if name == "uncertain":
        assert drawn
        assert 0.8 < ratios.pop() < 1.2
    elif name == "wrong-k":
        assert ratios.pop() == pytest.approx(0.7)
        assert trial.external_inputs.magnet_scale[[0, -1]] == pytest.approx([1.0, 1.1])
    else:
        noise = trial.external_inputs.sensor_noise
        assert noise.shape == (len(trial.record), len(MACHINE.readings))
        assert noise.std() == pytest.approx(MACHINE.sensors[0].noise_variance ** 0.5, rel=0.1)
        assert np.corrcoef(noise[1:, 3], noise[:-1, 3])[0, 1] == pytest.approx(0.905, abs=0.03)


def test_each_closes_its_own_loop_on_a_machine(call):
    """A step and a load of the first axis, or a run of one's own; all axes are judged together."""
    found = compare_steps(MACHINE, ["linear"], steps=["20 um"], disturbance="2 N", duration="40 ms",
                          seeds=2)  # fmt: skip
    score = found.scores["20 µm"]["linear"]
    happening = found.loop_cases["20 µm"].scenario
    assert [axis for axis, _ in by_axis(happening, "disturbance", "A1")] == ["A1"]
    for seed, error in enumerate(score.figures["f_d"]):
        run = simulate_run(MACHINE, happening.replace(seed=seed), estimator=KalmanFilter(MACHINE))
        wrong = [run.estimate[f"f_d_{a}"] - run.record[f"f_d_{a}"] for a in run.axes]
        assert error == pytest.approx(np.sqrt(np.mean(np.square(wrong))))
    Path("run.toml").write_text(
        'duration = "30 ms"\n[[disturbance]]\naxis = "B2"\n[disturbance.force]\n'
        'type = "step"\namplitude = "2 N"\ntime = "15 ms"\n'
    )
    told = call("compare", "steps", "tum_mlps", "--filter", "linear", "--scenario", "run.toml",
                "--seeds", "1", "--plot", "bars.svg", "--json")  # fmt: skip
    assert "run.toml" in told.json["cases"]


def test_an_estimator_of_one_s_own_takes_all_readings(tmp_path):
    (tmp_path / "my.py").write_text(
        "from ambkit import KalmanFilter\n"
        "class Mine:\n"
        "    def __init__(self, machine):\n"
        "        self.kalman = KalmanFilter(machine)\n"
        "    def reset(self, mean, std):\n"
        "        self.kalman.reset(mean, std)\n"
        "        self.next = lambda y, u: self.kalman.update(y)\n"
        "    def step(self, y, u):\n"
        "        found, self.next = self.next(y, u), self.kalman.step\n"
        "        return found\n"
        "class Short:\n"
        "    def step(self, y, u):\n"
        "        return y\n"
    )
    found = compare(MACHINE, ["linear", f"{tmp_path}/my.py:Mine"], case="model", seeds=1).best
    for name in ("x", "v", "f_d", "delay"):
        assert found["Mine"].mean(name) == found["linear"].mean(name)
    with pytest.raises(AmbkitError, match="returned 8 numbers; it must return the 20 numbers x, y"):
        compare(MACHINE, [f"{tmp_path}/my.py:Short"], case="model", seeds=1)


def test_a_machine_with_other_magnets_keeps_its_controllers():
    """As the report's errors by a wrong magnet constant need it."""
    case = replace(CASES["step"], magnet_constant=1.2)
    (trial,) = trials(case, MACHINE, 1, 0)
    for own, nominal in zip(trial.plant.bearings, MACHINE.bearings, strict=True):
        assert own.magnet.magnet_constant == pytest.approx(1.2 * nominal.magnet.magnet_constant)
    pids = holding(MACHINE, "estimate").pids
    assert [pid.kp for pid in trial.scenario.controller.pid.values()] == [pid.kp for pid in pids]


@pytest.mark.long
def test_the_whole_comparison_of_a_machine_is_a_page(call):
    words = ("--filter", "linear", "--seeds", "1", "--robustness", "--out", "out.html")
    assert call("compare", "tum_mlps", *words).code == 0
    page = Path("out.html").read_text()
    assert "Cramér-Rao bound" in page
    assert "along A1" in page


def test_all_kinds_are_those_that_take_several_axes():
    from ambkit.estimate.registry import KINDS
    from ambkit.judge.comparison.tuning import suited

    kinds = suited(list(KINDS), MACHINE)
    assert {"linear+unbalance", "table+unbalance", "constant-velocity"} <= set(kinds)
    assert "low-pass" not in kinds
    assert suited(["low-pass"], MACHINE) == ["low-pass"]  # who names it is told why not
    with pytest.raises(AmbkitError, match="takes one axis"):
        compare(MACHINE, ["low-pass"], case="model", seeds=1)
