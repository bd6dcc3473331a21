"""Estimator and controllers in one step, as C: what the simulation flew, to the last bit."""

import subprocess
from itertools import product

import numpy as np
import pytest
from export_cases import BEARING, INCLUDES, SAME_BITS, STRICT, command, compiled
from exporting import export_c
from machine_cases import machine
from quick import quick

from ambkit import AmbkitError, KalmanFilter, Machine, Scenario, simulate
from ambkit.control.control import Control, LiftOff
from ambkit.control.controller_states import Controller
from ambkit.control.controllers import controllers_of
from ambkit.data.signals import signal
from ambkit.export.c.controller_test_cases import vectors
from ambkit.models.plant import Plant
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import simulate_run
from ambkit.simulation.waveforms import Constant, Ramp, Sum

CROSSED = Control(type="translation and tilt", cross_feedback=0.5)
UNBALANCE = {"synchronous": ("unbalance",)}
FORCE_FREE = Control(unbalance="force-free", unbalance_from=200.0)
FLIGHTS = {
    "readings": (Scenario(), {}),
    "cross feedback": (Scenario(controller=CROSSED).fed("estimate"), {}),
    "force-free": (
        Scenario(controller=Control(unbalance="force-free")).fed("estimate"), UNBALANCE,
    ),
    "force-free, from a speed": (Scenario(controller=FORCE_FREE).fed("estimate"), UNBALANCE),
    "lqg, still": (
        Scenario(controller=Control(type="lqg", unbalance="compensation")).fed("estimate"),
        UNBALANCE,
    ),
}  # fmt: skip


QUICKLY = [
    ("cross feedback", "float"), ("force-free, from a speed", "float"), ("lqg, still", "double"),
]  # fmt: skip


def run(folder, *defines):
    sources = [str(path.relative_to(folder)) for path in folder.rglob("*.c")]
    build = [*command("gcc"), *defines, *sources, "-o", "test.out"]
    subprocess.run(build, cwd=folder, check=True, timeout=120)
    return subprocess.run([folder / "test.out"], capture_output=True, text=True).stdout


@compiled
@pytest.mark.parametrize(
    ("name", "precision"), quick(product(FLIGHTS, ["float", "double"]), QUICKLY)
)
def test_currents_are_those_of_the_simulation(name, precision, tmp_path):
    flight, options = FLIGHTS[name]
    one = machine(speed=600.0)
    export_c(one, None, tmp_path / "c", prefix="f", precision=precision, scenario=flight, **options)
    told = run(tmp_path / "c")
    assert "pass: f with its controllers, 1020 samples: equal to the last bit" in told


@compiled
@pytest.mark.long
@pytest.mark.parametrize("name", ["ufu_flexible", "compressor", "tum_mlps_flexible", "heart_pump"])
@pytest.mark.parametrize("kind", ["decentralised", "translation and tilt", "lqg"])
def test_those_of_presets(name, kind, tmp_path):
    flight = Scenario(controller=Control(type=kind)).fed("estimate")
    export_c(Machine.preset(name), None, tmp_path / "c", prefix="f", scenario=flight)
    assert "samples: equal to the last bit" in run(tmp_path / "c")


@compiled
@pytest.mark.long
def test_a_rotor_that_bends_is_force_free_as_in_the_simulation(tmp_path):
    one = Machine.preset("ufu_flexible").replace(speed="9000 rpm")
    flight = Scenario(controller=Control(unbalance="force-free")).fed("estimate")
    export_c(one, None, tmp_path / "c", prefix="f", scenario=flight, **UNBALANCE)
    assert "samples: equal to the last bit" in run(tmp_path / "c")


def test_what_is_flown_visits_limits_and_losses():
    flight = FLIGHTS["cross feedback"][0].model_copy(update={"sequence": LiftOff()})
    one = machine(speed=600.0)
    kalman = KalmanFilter(one, precision="float32")
    controllers = controllers_of(Plant(one), flight.controller, kalman, fastest=one.speed)
    fed = Controller(Plant(one), kalman, controllers, LiftOff(), True)
    tested = vectors(fed, flight)
    assert tested.saturated > 20
    assert np.isnan(tested.y).any()
    assert (np.abs(np.diff(tested.r, axis=0)) > 0).any(axis=0).all()
    held = np.abs(tested.u[tested.starts[1] :]).max(axis=0)
    limit = [b.amplifier.current_limit for b in one.bearings for _ in "12"]
    assert (held > 0.85 * np.array(limit)).all()


FAULTS = {
    "f_control.c": [("= state->control_state.u[f]", "= state->control_state.u[0]")],
    "core/src/controllers.c": [
        ("sum += power *", "sum -= power *"), ("power *= speed", "power += speed"),
        ("+= c->spread[", "-= c->spread["),
        ("c->iu_min[f], c->iu_max[f]", "c->iu_min[0], 2 * c->iu_max[f]"),
        ("others[i] -= left", "others[i] += left"), ("iu[f] += left", "iu[f] -= left"),
    ],
    "core/src/controller.c": [
        ("pid->weight *", "AMB_C(1.0) *"), ("* error +", "* error -"), ("- pid->kd", "+ pid->kd"),
    ],
}  # fmt: skip


@compiled
@pytest.mark.long
def test_faults_are_noticed(tmp_path):
    """Planted one by one; the control signal that the filter is told is the one that acted."""
    one = machine(speed=600.0)
    control = Control(type="translation and tilt", unbalance="force-free", cross_feedback=0.5)
    for name, each in (("turning", control), ("c", CROSSED)):
        flight = Scenario(controller=each).fed("estimate")
        export_c(one, None, tmp_path / name, prefix="f", scenario=flight, **UNBALANCE)
    for file, faults in FAULTS.items():
        # A rotor that is let turn trips on its way up, where no PID is at its limit.
        folder = tmp_path / ("c" if file.endswith("controller.c") else "turning")
        right = (folder / file).read_text()
        for old, new in faults:
            assert old in right, old
            (folder / file).write_text(right.replace(old, new, 1))
            assert "FAIL: f with its controllers" in run(folder, "-Wno-error"), (file, old)
        (folder / file).write_text(right)
    constants = folder / "f_data.c"
    constants.write_text(constants.read_text().replace(".kp = ", ".kp = 1.1F * ", 1))
    assert "FAIL: f with its controllers" in run(folder, "-Wno-error")


USER = """#include "f_control.h"
#include <math.h>
#include <stdio.h>
int main()
{
  static f_control_state control;
  f_command now;
  amb_real y[AMB_SENSORS], r[AMB_CONTROLS] = {0, 0, 0, 0};
  int bad = 0;
  f_control_init(&control);
  f_control_transfer(&control, r, 600, r);
  for (int k = 0; k < 500; k++) {
    for (int s = 0; s < AMB_SENSORS; s++)
      y[s] = (amb_real)(k % 7 == 3 ? NAN : k % 11 == 5 ? INFINITY : 1e-5 * (s - 1));
    r[0] = k % 13 == 2 ? (amb_real)NAN : 0;
    f_control_step(&control, y, r, k % 17 == 4 ? (amb_real)NAN : 600, true, &now);
    for (int f = 0; f < AMB_CONTROLS; f++) {
      const bool within = now.iu[f] >= -2 && now.iu[f] <= 2;
      const amb_real bias = now.on ? 2 : 0;
      const bool coils = now.coil[f][0] == bias + now.iu[f] && now.coil[f][1] == bias - now.iu[f];
      bad += !within || !coils || now.u[f] != now.iu[f];
    }
  }
  printf("%d\\n", bad);
  return 0;
}
"""


@compiled
@pytest.mark.parametrize("name", quick(
    ["force-free", "force-free, from a speed", "lqg, still"], ["force-free, from a speed"]
))  # fmt: skip
def test_currents_stay_within_limits_whatever_is_given(name, tmp_path):
    """And C++ takes the headers."""
    flight, options = FLIGHTS[name]
    folder = tmp_path / "c"
    export_c(machine(speed=600.0), None, folder, prefix="f", scenario=flight, **options)
    main = tmp_path / "main.cpp"
    main.write_text(USER)
    sources = [str(p.relative_to(folder)) for p in folder.rglob("*.c") if "selftest" not in str(p)]
    build = ["gcc", "-std=c99", *STRICT, *SAME_BITS, *INCLUDES, "-c", *sources]
    subprocess.run(build, cwd=folder, check=True, timeout=120)
    objects = [path.name for path in folder.glob("*.o")]
    link = ["g++", "-std=c++17", *INCLUDES, str(main), *objects, "-o", "user.out"]
    subprocess.run(link, cwd=folder, check=True, timeout=120)
    assert subprocess.run([folder / "user.out"], capture_output=True, text=True).stdout == "0\n"


DRIVEN = """#include "f_control.h"
#include <stdio.h>
int main(void)
{
  static f_control_state control;
  f_command now;
  amb_real y[AMB_SENSORS + 1], r[AMB_CONTROLS] = {0, 0, 0, 0};
  f_control_init(&control);
  while (fread(y, sizeof y, 1, stdin) == 1) {
    f_control_step(&control, y, r, y[AMB_SENSORS], true, &now);
    fwrite(now.u, sizeof now.u, 1, stdout);
  }
  return 0;
}
"""


@compiled
def test_the_exported_step_hands_back_to_plain_control_where_the_unbalance_is_large(tmp_path):
    """Force-free with the unbalance that is described; with five times as much it is limited."""
    largest = 0.04 * 4.0 * 0.3e-3  # [kg m] a plane, by mass and clearance
    described = machine(speed=600.0).replace(
        unbalance=[{"place": place, "amount": largest} for place in (0.2, -0.3)]
    )
    slope = Ramp(slope=1500.0, start=0.25, end=0.6)
    run_up = Sum(parts=(Constant(value=75.0), slope))  # to 600 rad/s
    swings = {}  # of the synchronous control signal, over the unbalance
    for kind in ("off", "force-free"):
        flight = Scenario(
            duration=1.0, start="landed", sequence=LiftOff(), speed=run_up,
            controller=Control(unbalance=kind),
        ).fed("estimate")  # fmt: skip
        folder = tmp_path / kind
        export_c(described, None, folder, prefix="f", scenario=flight, **UNBALANCE)
        (folder / "main.c").write_text(DRIVEN)
        sources = [p for p in map(str, folder.rglob("*.c")) if "selftest" not in p]
        subprocess.run(
            [*command("gcc"), *sources, "-o", "driven.out"], cwd=folder, check=True, timeout=120
        )
        kalman = KalmanFilter(described, precision="float32", **UNBALANCE)
        law = controllers_of(Plant(described), flight.controller, kalman, fastest=described.speed)
        for factor in (1, 5):
            real = described.replace(
                unbalance=[{"place": z, "amount": factor * u} for z, u, _ in described.unbalances()]
            )
            flown = simulate_run(
                real, flight, estimator=kalman, controllers=law,
                external_inputs=ExternalInputs(exported={}),
            )  # fmt: skip
            assert flown.modes[-1]["mode"] == "flying"
            y, same = (
                np.column_stack([flown.record[key] for key in keys])
                for keys in (
                    [*(signal("y", each.name) for each in real.readings), "speed"],
                    [signal("u", each.name) for each in real.axes],
                )
            )
            told = subprocess.run(
                [folder / "driven.out"], input=y.astype(np.float32).tobytes(),
                capture_output=True, check=True,
            )  # fmt: skip
            u = np.frombuffer(told.stdout, np.float32).reshape(same.shape)
            np.testing.assert_array_equal(u, same)
            turn = np.exp(600j * described.sampling_time * np.arange(1047))  # in ten turns
            swings[kind, factor] = np.abs(turn @ u[-1047:]).max() / factor
    assert swings["force-free", 1] < 0.4 * swings["off", 1]
    assert swings["force-free", 5] == pytest.approx(swings["off", 5], rel=0.02)


def test_what_has_no_controllers_says_so(tmp_path):
    with pytest.raises(AmbkitError, match="cross_feedback: is of a rotor that is a body"):
        export_c(
            BEARING, None, tmp_path / "c", scenario=Scenario(controller=Control(cross_feedback=0.5))
        )
    flight = Scenario(controller=Control(unbalance="compensation")).fed("estimate")
    with pytest.raises(AmbkitError, match="synchronous"):
        export_c(machine(), None, tmp_path / "c", scenario=flight)
    assert not (tmp_path / "c").exists()


def test_readings_that_are_lost_are_flown():
    one = machine()
    lost = np.zeros((101, len(one.readings)))
    lost[50, 1] = np.nan
    flown = simulate(
        one, Scenario(duration=0.01), external_inputs=ExternalInputs(readings=lost)
    ).record
    assert np.isnan(flown["y_A2"]).sum() == 1
    assert np.isfinite(flown["u_A2"]).all()
    with pytest.raises(ValueError, match="external_inputs readings must have 101 values"):
        simulate(one, Scenario(duration=0.01), external_inputs=ExternalInputs(readings=lost[:50]))


def test_the_command_takes_a_flight(call, tmp_path):
    flight = tmp_path / "scenario.toml"
    flight.write_text(
        '[controller]\nfeedback = "estimate"\ntype = "lqg"\nunbalance = "compensation"\n'
    )
    words = ["tum_mlps", "--controller", str(flight), "--out", str(tmp_path / "c")]
    refused = call("export", "c", *words, "--filter", "linear")
    assert "synchronous" in refused.err  # what the controllers are to know
    made = call("export", "c", *words)
    assert made.code == 0, made.err
    assert "tum_mlps_control_step" in (tmp_path / "c" / "README.md").read_text()
