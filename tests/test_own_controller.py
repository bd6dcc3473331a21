"""A controller and a plant of the user's, in Python, in place of ours."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exporting import export_c
from quick import quick

import ambkit
from ambkit import AmbkitError, Control, Machine, Scenario
from ambkit.estimate.machine_model import View

AXIS, MACHINE = Machine.preset("zittau_axial"), Machine.preset("tum_mlps")
KP, KD = 1700.0, 11.0
PLAIN = {"kp": KP, "ki": 0.0, "kd": KD, "derivative_filter": 0.0, "setpoint_weight": 1.0}


class PD:
    """Proportional and derivative action on the estimate, about the levitation current."""

    def __init__(self, machine: Any) -> None:
        self.current = machine.levitation_current

    def step(self, y: float, r: float, estimate: Any) -> float:
        x, v = estimate[:2]
        return float(KP * (r - x) - KD * v + self.current)


class Measured(PD):
    """The same by the measurement, where there is no estimate."""

    def __init__(self, machine: Any) -> None:
        super().__init__(machine)
        self.T, self.last, self.v = machine.sampling_time, 0.0, 0.0

    def step(self, y: float, r: float, estimate: Any) -> float:
        y = y if np.isfinite(y) else self.last
        self.v += ((y - self.last) - self.T * self.v) / (0.3e-3 + self.T)
        self.last = y
        return super().step(y, r, (y, self.v))


class Nothing(PD):
    """No action but half a levitation current."""

    def step(self, y: float, r: float, estimate: Any) -> float:
        return 0.5 * float(self.current)


class OfAxes:
    """The same of each axis, which sees the readings and their differences."""

    def __init__(self, machine: Machine) -> None:
        self.T, self.last = machine.sampling_time, None
        self.along = View(machine).measured

    def step(self, y: Any, r: Any, estimate: Any) -> Any:
        assert estimate is None
        x = self.along @ y
        v = np.zeros_like(x) if self.last is None else (x - self.last) / self.T
        self.last = x
        return 20e3 * (r - x) - 30.0 * v


class LinearMagnet:
    """A mass on a magnet of constant stiffness, by many steps of Euler."""

    def __init__(self, machine: Any) -> None:
        k = ambkit.ConstantStiffness.of(machine)
        self.machine, self.k_i, self.k_s = machine, k.k_i, k.k_s
        self.x = self.v = self.x_m = 0.0

    def step(self, iu: float, f_d: float) -> tuple[float, float, float]:
        sensor, h = self.machine.sensor, self.machine.sampling_time / 10
        for _ in range(10):
            force = self.k_i * iu + self.k_s * self.x + self.machine.weight + f_d
            self.x_m += h / sensor.lag * (sensor.gain * self.x - self.x_m)
            self.x += h * self.v
            self.v += h * force / self.machine.rotor.mass
        return self.x, self.v, self.x_m


def test_a_controller_does_what_the_same_of_ours_does() -> None:
    assert issubclass(PD, ambkit.ControllerProtocol)
    own, ours = (
        ambkit.simulate(AXIS, Scenario(duration=0.1, controller=control), step="0.1 mm").record
        for control in (Control(custom=PD), Control(anti_windup=1e3, **PLAIN))
    )
    assert own["x"] == pytest.approx(ours["x"], rel=1e-9, abs=1e-12)
    assert own["u"] == pytest.approx(ours["u"], rel=1e-9, abs=1e-12)


def test_a_controller_of_several_axes_sees_all_readings() -> None:
    control = Control(custom=OfAxes, feedback="measurement")
    run = ambkit.simulate(MACHINE, Scenario(duration=0.05, controller=control, noise=False), "none")
    assert run.estimate is None
    y = np.column_stack([run.record[f"y_{reading.name}"] for reading in MACHINE.readings])
    x = y @ View(MACHINE).measured.T
    r, u = (np.column_stack([run.record[f"{of}_{a}"] for a in run.axes]) for of in "ru")
    gain = [axis.bearing.amplifier.gain for axis in MACHINE.axes]
    expected = 20e3 * (r[5] - x[5]) - 30.0 * (x[5] - x[4]) / MACHINE.sampling_time
    assert u[5] * gain == pytest.approx(expected)


def test_a_plant_flies_in_place_of_the_machine() -> None:
    assert issubclass(LinearMagnet, ambkit.PlantProtocol)
    scenario = Scenario(duration=0.4, noise=False)
    run = ambkit.simulate(AXIS, scenario, step="0.3 mm", plant=LinearMagnet)
    plant, record = LinearMagnet(AXIS), run.record
    seen = [plant.step(iu, f) for iu, f in zip(record["iu"][:-1], record["f_d"][:-1], strict=True)]
    assert record["x"][1:] == pytest.approx([x for x, _, _ in seen], rel=1e-12, abs=1e-15)
    assert record["x"][-1] == pytest.approx(0.3e-3, rel=0.05)
    assert np.isnan(record["f_mag"]).all()
    of_scenario = ambkit.simulate(AXIS, scenario.replace(plant=LinearMagnet), step="0.3 mm").record
    assert np.array_equal(record["x"], of_scenario["x"])
    nonlinear = ambkit.simulate(AXIS, scenario, step="0.3 mm").record
    assert np.abs(record["iu"] - nonlinear["iu"]).max() > 1e-3


FILE = """
class Low:
    def step(self, y, r, estimate):
        return 1700.0 * (r - estimate[0]) - 11.0 * estimate[1] + 0.5


class Late:
    n = 0

    def step(self, y, r, estimate):
        self.n += 1
        return 1.0 / (7 - self.n)


class Two:
    def step(self, y, r, estimate):
        return 1.0, 2.0


class Still:
    def step(self, iu, f_d):
        return 1e-5, 0.0, 1e-5
"""


def test_from_a_file_in_python_toml_and_on_the_command_line(tmp_path, call):
    file = tmp_path / "my.py"
    file.write_text(FILE)
    text = 'duration = "20 ms"\nplant = "my.py:Still"\n[controller]\ncustom = "my.py:Low"\n'
    (tmp_path / "s.toml").write_text(text)
    scenario = Scenario.load(tmp_path / "s.toml")
    assert Scenario.from_toml(scenario.to_toml()) == scenario
    record = ambkit.simulate(AXIS, scenario).record
    assert (record["x"][1:] == 1e-5).all()
    assert call("simulate", "zittau_axial", "--scenario", "s.toml", "--out", "run.csv").code == 0
    assert (ambkit.Record.load(tmp_path / "run.csv")["x"][1:] == 1e-5).all()
    for name, words in (
        ("Late", "Late: step(y, r, estimate) at sample 6: ZeroDivisionError"),
        ("Two", "Two: step(y, r, estimate) at sample 0: ValueError: it returned 2 numbers"),
        ("None", "there is no class or function None; it has Low, Late, Two, Still"),
    ):
        with pytest.raises(AmbkitError, match=words.replace("(", r"\(").replace(")", r"\)")):
            ambkit.simulate(AXIS, Scenario(controller=Control(custom=f"{file}:{name}")))
    with pytest.raises(AmbkitError, match=r'must be "file.py:Class"'):
        Scenario.from_toml('[controller]\ncustom = "Low"\n')


def test_it_takes_part_in_other_verbs(tmp_path: Path) -> None:
    scenario = Scenario(duration=0.05, controller=Control(custom=PD))
    result = ambkit.compare_steps(
        AXIS, ["linear", "extended"], scenario=scenario, steps=["0.1 mm"], seeds=1
    )
    assert set(next(iter(result.scores.values()))) == {"linear", "extended"}
    judged = ambkit.compare(AXIS, "linear", case="model", seeds=2, plant=LinearMagnet)
    described = ambkit.compare(AXIS, "linear", case="model", seeds=2)
    assert judged.to_dict() != described.to_dict()
    found = ambkit.inject_faults(
        AXIS, "linear", faults=["outage-1ms"], samples=0, controller=Measured, plant=LinearMagnet
    )
    assert found.outcomes
    with pytest.raises(AmbkitError, match='no margins follow; "ambkit assess sweep" measures'):
        ambkit.assess(AXIS, controller=PD)
    with pytest.raises(AmbkitError, match="PD is Python, and has no C"):
        export_c(AXIS, None, tmp_path / "c", kind="linear", scenario=scenario)


@pytest.mark.parametrize("machine", quick([AXIS, MACHINE], [AXIS]))
def test_a_sweep_measures_what_the_margins_of_the_same_controller_are(machine: Machine) -> None:
    gains = PLAIN | ({} if machine is AXIS else {"kp": 20e3, "kd": 30.0})
    gains |= {"derivative_filter": 0.3e-3} if machine is AXIS else {}
    own = Measured if machine is AXIS else OfAxes
    swept = ambkit.assess_sweep(machine, "none", own, amplitudes=["1 um"])
    assert swept.model is None
    assert len(swept.figure().panels) == 1
    loop = ambkit.assess(machine, "none", Control(**gains, feedback="measurement")).loops
    (at,) = swept.swept
    model = loop["measurement"].loop.of_axis(0, at.frequency)
    assert np.max(np.abs(at.sensitivity - model) / np.abs(model)) < 0.02


def test_a_controller_that_holds_nothing_is_not_swept() -> None:
    with pytest.raises(AmbkitError, match="without any signal the rotor comes to a stop"):
        ambkit.assess_sweep(AXIS, "none", Nothing)


def test_many_runs_have_one_each() -> None:
    scenario = Scenario(duration=0.02, controller=Control(custom=Measured))
    runs = [ambkit.Planned(AXIS, scenario, number=number) for number in (0, 1, 0)]
    many = ambkit.simulate_many(runs, threads=2).figures["displacement_peak"]
    for place, run in enumerate(runs):
        assert many[place] == np.abs(run.simulated().record["x"]).max()
    assert many[0] == many[2] != many[1]
