"""A machine lifts off its touch-down bearings, flies and lands; simulated, and the same as C."""

import subprocess
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from export_cases import COMPILER, command, compiled, printed_by
from exporting import export_c
from machine_cases import AND_LONG, PRESETS
from quick import quick

import ambkit
from ambkit import AmbkitError, KalmanFilter, Machine, Scenario, harmonics
from ambkit.control.control import Control, LiftOff, Mode
from ambkit.estimate.registry import KINDS
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import simulate_run
from ambkit.simulation.waveforms import Ramp

QUICK = LiftOff(start=0.005, stop=0.25, lift=0.1, land=0.1)


def lifted(machine, **of_flight):
    keys = {"duration": 0.42, "start": "landed", "sequence": QUICK, "seed": 3}
    flight = Scenario(**keys | of_flight)
    return simulate_run(machine, flight)


def share_of_travel(run, late):
    machine, record = run.machine, run.record
    return max(
        float(np.abs(record[f"s_{axis.name}"][late]).max()) / axis.bearing.clearance
        for axis in machine.axes
    )


@pytest.mark.parametrize("name", AND_LONG)
@pytest.mark.parametrize("feedback", quick(["measurement", "estimate"], ["estimate"]))
def test_each_preset_lifts_flies_and_lands(name, feedback):
    run = lifted(Machine.preset(name).replace(speed=0.0), controller={"feedback": feedback})
    record, mode = run.record, run.record["mode"]
    order = [Mode(int(m)) for m in mode[np.flatnonzero(np.diff(mode, prepend=-1))]]
    assert order == [Mode.OFF, Mode.WAITING, Mode.LIFTING, Mode.FLYING, Mode.LANDING, Mode.OFF]
    flying = np.flatnonzero(mode == Mode.FLYING)
    assert share_of_travel(run, slice(flying[len(flying) // 2], flying[-1])) < 0.2
    off = (mode == Mode.OFF) | (mode == Mode.WAITING)
    for axis in run.machine.axes:
        assert not record[f"f_mag_{axis.name}"][off].any()  # the bias is off too
        assert not record[f"u_{axis.name}"][off].any()
    down = slice(-20, None)  # it lies where it lay
    for axis in run.machine.axes:
        s = record[f"s_{axis.name}"]
        assert abs(s[down].mean() - s[0]) < 0.3 * axis.bearing.clearance


def test_lift_off_is_without_a_kick():
    """Integrals start at what holds a rotor where this one lies."""
    run = lifted(Machine.preset("tum_mlps").replace(speed=0.0))
    record = run.record
    up = np.flatnonzero(record["mode"] == Mode.LIFTING)
    limit = run.machine.bearings[0].amplifier.current_limit
    for axis in run.machine.axes:
        s = record[f"s_{axis.name}"][up]
        assert np.abs(record[f"iu_{axis.name}"][up]).max() < 0.9 * limit
        assert np.abs(s).max() < 1.15 * axis.bearing.clearance


def test_a_machine_without_its_readings_trips_and_lifts_again():
    machine = Machine.preset("tum_mlps").replace(speed=0.0)
    sequence = LiftOff(lift=0.05, land=0.05, lost=0.01)
    flight = Scenario(duration=0.4, start="landed", sequence=sequence, noise=False)
    n = round(0.4 / machine.sampling_time) + 1
    readings, fly = np.zeros((n, len(machine.readings))), np.ones(n)
    readings[2000:2400] = np.nan
    fly[2600:2650] = 0.0
    mode = simulate_run(
        machine, flight, external_inputs=ExternalInputs(readings=readings, fly=fly)
    ).record["mode"]
    assert mode[1999] == Mode.FLYING
    assert mode[2500] == Mode.TRIPPED
    assert mode[2625] == Mode.OFF
    assert mode[-1] == Mode.FLYING


def test_from_hovering_it_flies_at_once():
    flight = Scenario(duration=0.05, sequence=LiftOff(stop=0.04, land=0.2))
    run = simulate_run(Machine.preset("tum_mlps"), flight)
    assert run.record["mode"][0] == Mode.FLYING
    assert run.record["mode"][-1] == Mode.LANDING
    assert share_of_travel(run, slice(0, 390)) < 0.1


def test_a_sequence_changes_nothing_of_a_flight_that_does_not_need_it():
    """The same numbers with the estimator in the loop, from the same start."""
    machine = Machine.preset("hindawi_2011")
    plain = Scenario(duration=0.05, controller={"feedback": "estimate"})
    one, other = (
        simulate_run(machine, flight, estimator=KalmanFilter(machine))
        for flight in (plain, plain.replace(sequence=LiftOff()))
    )
    for axis in machine.axes:
        np.testing.assert_array_equal(one.record[f"u_{axis.name}"], other.record[f"u_{axis.name}"])


def test_the_flight_file_says_so(tmp_path):
    text = 'duration = "0.4 s"\nstart = "landed"\n[sequence]\nlift = "0.1 s"\nstop = "0.3 s"\n'
    (tmp_path / "scenario.toml").write_text(text)
    flight = Scenario.load(tmp_path / "scenario.toml")
    assert flight.sequence == LiftOff(lift=0.1, stop=0.3)
    assert Scenario.from_toml(flight.to_toml()) == flight
    (tmp_path / "scenario.toml").write_text(text.replace("0.3 s", "0 s"))
    with pytest.raises(AmbkitError, match=r"scenario.toml.*sequence.stop.*after start"):
        Scenario.load(tmp_path / "scenario.toml")


def test_what_lies_is_left_out_of_what_is_filtered():
    """Magnets are off there, which no filter is told: NIS would be several times too large."""
    machine = Machine.preset("tum_mlps").replace(speed=0.0)
    record = lifted(machine, controller={"feedback": "estimate"}).record
    found = ambkit.filter(record, "linear", machine=machine)
    on = np.isin(record["mode"], (Mode.LIFTING, Mode.FLYING, Mode.LANDING))
    assert len(found.record) == on.sum()
    assert found.to_dict()["estimators"]["linear"]["nis"] < 1.3
    assert float(np.mean(KalmanFilter(machine).run(record).nis[1:])) > 1.3


@pytest.mark.parametrize("stop", [0.25, None])
def test_a_summary_is_of_the_flight(stop):
    machine = Machine.preset("tum_mlps")
    flight = Scenario(
        duration=0.35, start="landed", sequence=LiftOff(stop=stop, lift=0.05, land=0.05),
        controller={"feedback": "estimate"}, speed=Ramp(slope=2000.0, start=0.1),
    )  # fmt: skip
    kalman = KalmanFilter(machine, synchronous=("unbalance",))
    run = simulate_run(machine, flight, estimator=kalman)
    found = replace(run, turning=harmonics(kalman, run.record)).to_dict()
    modes = [each["mode"] for each in found["modes"]]
    assert modes[:3] == ["waiting", "lifting", "flying"]
    assert found["rmse"]["x"] < 2e-6
    assert ("synchronous" in found) == (stop is None)  # a rotor that lies says nothing of it


def test_a_summary_ends_where_the_power_fails():
    machine = Machine.preset("tum_mlps").replace(speed=0.0)
    whole, failing = (Scenario(duration=0.2, off=off, seed=1) for off in (None, 0.1))
    rmse = [
        simulate_run(machine, flight, estimator=KalmanFilter(machine)).to_dict()
        for flight in (whole, failing)
    ]
    assert rmse[1]["samples_at_the_stop"] > 0
    for name, error in rmse[0]["rmse"].items():
        assert rmse[1]["rmse"][name] < 1.5 * error, name


# ---- As C ----


FLIGHTS = {
    "hovering at first": Scenario(sequence=LiftOff()),  # what is exported begins at power-on
    "lift-off": Scenario(start="landed", sequence=LiftOff()),
    "by the estimate": Scenario(start="landed", sequence=LiftOff()).fed("estimate"),
    "run-up": Scenario(speed=Ramp(slope=2000.0), controller={"feedback": "estimate"}),
    "all": Scenario(
        start="landed", sequence=LiftOff(), speed=Ramp(slope=2000.0, start=0.2),
        controller=Control(unbalance="force-free", cross_feedback=0.3),
    ).fed("estimate"),
    "lqg": Scenario(
        start="landed", sequence=LiftOff(), controller=Control(type="lqg"),
    ).fed("estimate"),
}  # fmt: skip


QUICKLY = [("all", "float"), ("hovering at first", "double")]
AND_OTHERS = quick(product(FLIGHTS, ("float", "double")), QUICKLY)


@compiled
@pytest.mark.parametrize(("run", "precision"), AND_OTHERS)
def test_what_flies_is_what_was_simulated(run, precision, tmp_path):
    """Lift-off, landing, trips, and a model that follows the speed: the self-test's own flights."""
    machine = Machine.preset("tum_mlps")
    export_c(
        machine, None, tmp_path / "c", precision=precision, scenario=FLIGHTS[run], prefix="f",
        synchronous=("unbalance",),
    )  # fmt: skip
    said = printed_by(tmp_path / "c")
    assert said.count("equal to the last bit") == 2, said


MAIN = """
#include "f_control.h"
#include <stdio.h>
#include <stdlib.h>
int main(void)
{
  static f_control_state state;
  static f_command now;
  double in[AMB_SENSORS + 3];
  f_control_init(&state);
  for (;;) {
    amb_real y[AMB_SENSORS], r[AMB_CONTROLS] = {0};
    if (fread(in, sizeof in[0], AMB_SENSORS + 2, stdin) != AMB_SENSORS + 2)
      return 0;
    for (int s = 0; s < AMB_SENSORS; s++)
      y[s] = (amb_real)in[s];
    (void)f_control_step(&state, y, r, (amb_real)in[AMB_SENSORS], in[AMB_SENSORS + 1] > 0, &now);
    const double mode = (double)now.mode;
    for (int f = 0; f < AMB_CONTROLS; f++) {
      const double u = (double)now.u[f];
      fwrite(&u, sizeof u, 1, stdout);
    }
    fwrite(&mode, sizeof mode, 1, stdout);
  }
}
"""


def signals_of_c(made, record, machine, flight):
    """What the exported controller gives for a record's readings: control signals, and the mode."""
    folder = made.folder
    (folder / "main.c").write_text(MAIN)
    words = [*command(str(COMPILER)), *made.sources, "main.c", "-o", "fly"]
    subprocess.run(words, cwd=folder, check=True, capture_output=True)
    given = [record[f"y_{r.name}"] for r in machine.readings]
    given += [record["speed"], flight.sequence.fly(record.t)]
    told = np.ascontiguousarray(np.column_stack(given), float).tobytes()
    out = subprocess.run([folder / "fly"], input=told, capture_output=True, check=True).stdout
    return np.frombuffer(out).reshape(len(record), -1)


@compiled
@pytest.mark.parametrize("name", quick(PRESETS, ["tum_mlps"]))
def test_a_whole_flight_from_lift_off_over_a_run_up_to_landing(name, tmp_path):
    """The exported controller, fed with the readings of a simulated flight: 0 samples differ."""
    machine = Machine.preset(name)
    flight = Scenario(
        duration=0.5, start="landed", controller={"feedback": "estimate"},
        speed=Ramp(slope=machine.speed / 0.2, start=0.12, end=0.3),
        sequence=LiftOff(start=0.003, stop=0.4, wait=0.005, lift=0.08, land=0.08),
    )  # fmt: skip
    kalman = KalmanFilter(machine, synchronous=("unbalance",), precision="float32")
    record = simulate_run(machine, flight, estimator=kalman).record
    assert Mode.FLYING in record["mode"]
    made = export_c(
        machine, None, tmp_path / "c", scenario=flight, prefix="f", synchronous=("unbalance",)
    )
    got = signals_of_c(made, record, machine, flight)
    run = [record[f"u_{axis.name}"] for axis in machine.axes]
    np.testing.assert_array_equal(got, np.column_stack([*run, record["mode"]]))


@pytest.mark.long
@compiled
@pytest.mark.parametrize("kind", ["linear-adaptive-noise", "extended", "ud", "multiple-model"])
def test_each_kind_follows_the_speed_with_the_same_bits(kind, tmp_path):
    machine, of = Machine.preset("tum_mlps"), KINDS[kind].magnet
    magnet = None if of is None else of(machine)
    flight = FLIGHTS["all"].replace(controller=Control())
    export_c(
        machine, magnet, tmp_path / "c", kind=kind, scenario=flight, prefix="f",
        synchronous=("unbalance",),
    )  # fmt: skip
    assert printed_by(tmp_path / "c").count("equal to the last bit") == 2
