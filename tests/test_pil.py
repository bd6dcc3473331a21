"""Processor in the loop: an exported controller on a Cortex-M4F in qemu flies the plant."""

import shutil
import subprocess

import numpy as np
import pytest
from exporting import export_c, pil

import ambkit
from ambkit import ContactKalmanFilter, KalmanFilter, Machine, Record, Scenario, Step
from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control, LiftOff, Mode
from ambkit.data.input_scaling import Inputs, Scaling
from ambkit.estimate.filter_file import FilterFile, filter_file_for
from ambkit.export.pil import build
from ambkit.export.pil.loop import Processor
from ambkit.simulation.waveforms import Ramp
from benchmarks.contact import with_stop

BEARING = Machine.preset("zittau_axial")
TOOLS = (build.QEMU_BOARD.compiler, build.QEMU)
needs_tools = pytest.mark.skipif(
    not all(map(shutil.which, TOOLS)), reason=f"not there: one of {', '.join(TOOLS)}"
)
SEQUENCE = LiftOff(start=5e-3, stop=0.16, wait=5e-3, lift=0.04, land=0.03)
SCENARIO = Scenario(
    duration=0.2, start="landed", sequence=SEQUENCE, controller=Control(feed_forward=1.0),
    disturbance=Step(amplitude=2.0, time=0.1),
)  # fmt: skip


@pytest.mark.parametrize("tool", TOOLS)
def test_what_is_missing_is_reported_with_what_to_install(tool, monkeypatch, call):
    monkeypatch.setattr(build.shutil, "which", lambda name: None if name == tool else name)
    told = call("pil", "zittau_axial")
    assert told.code == 2
    assert f"needs {tool}, which is not there: apt-get install" in told.err
    assert told.err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["tum_mlps", "--filter", "steady-state"], "takes one axis"),
        (["tum_mlps", "--scenario", "axis.toml"], "feed_forward: is made of the estimate"),
        (["zittau_axial", "--board", "arduino"], "must be one of stm32f4, amdc, c2000"),
        (["zittau_axial", "--board", "c2000"], "TI's C2000 code generation tools"),
    ],
)
def test_what_cannot_be_flown_is_reported(words, said, call, tmp_path):
    (tmp_path / "axis.toml").write_text(SCENARIO.fed("measurement").to_toml())
    if "c2000" in words and shutil.which("cl2000"):
        pytest.skip("there is a compiler for it")
    told = call("pil", *words)
    assert (told.code, told.err.count("Traceback"), told.err.count("report it")) == (2, 0, 0)
    assert said in " ".join(told.err.split())


TURNED = Scenario(
    duration=0.06, controller={"feedback": "estimate"}, speed=Ramp(slope=2000.0, end=0.06),
    sequence=LiftOff(start=2e-3, stop=0.04, wait=3e-3, lift=0.02, land=0.01),
)  # fmt: skip
FLOWN = {
    "readings": (TURNED.fed("measurement").replace(speed=None), {}),
    "a run-up, let turn": (
        TURNED.replace(controller=Control(unbalance="force-free")), {"synchronous": ["unbalance"]},
    ),
    "pulses": (
        TURNED.replace(speed=None), {"synchronous": ["unbalance"]},
    ),
    "a power failure": (TURNED.replace(speed=None, off=0.03, on=0.032), {}),
}  # fmt: skip
OUTAGE = [
    "OFF", "WAITING", "LIFTING", "FLYING", "TRIPPED", "OFF", "WAITING", "LIFTING", "LANDING", "OFF",
]  # fmt: skip


@pytest.mark.long
@needs_tools
@pytest.mark.parametrize("name", FLOWN)
def test_a_whole_machine_is_flown_with_the_bits_of_the_simulation(name, tmp_path):
    flight, options = FLOWN[name]
    machine, of = Machine.preset("tum_mlps"), KalmanFilter
    if name == "pulses":
        machine = machine.replace(angle={"type": "pulses", "angle_noise": 0.03, "latency": 1e-4})
    if flight.off is not None:
        machine, of = with_stop(machine, 1e9), ContactKalmanFilter
    of(machine, **options).save(tmp_path / "filter.toml")
    file = filter_file_for(str(tmp_path / "filter.toml"), machine)
    found = pil(machine, scenario=flight, filter_file=file)
    assert (found.unequal, found.unequal_frames, found.selftest) == (0, 0, 0)
    assert [mode for _, mode in found.modes] == OUTAGE[:4] + OUTAGE[4 if flight.off else -2 :]
    assert found.stack_seen <= (found.built.stack or 0)


@pytest.mark.long
@needs_tools
def test_other_bits_of_a_machine_would_be_seen(monkeypatch):
    contract = tuple(f.replace("contract=off", "contract=fast") for f in build.FLAGS)
    monkeypatch.setattr(build, "FLAGS", contract)
    found = pil(Machine.preset("tum_mlps"), scenario=FLOWN["readings"][0])
    assert not found.passed
    assert min(found.unequal, found.selftest) > 100


def test_the_stack_seen_and_its_bound_are_of_one_build():
    """Where qemu can run it: a bound at -O2 holds for no build at -O3."""
    of = {name: build.in_qemu(board) for name, board in build.BOARDS.items()}
    assert of["stm32f4"] is build.BOARDS["stm32f4"]
    assert of["amdc"] is of["c2000"] is build.QEMU_BOARD


def test_the_deepest_call_is_found(tmp_path):
    """By names, by pointers; not where a function calls itself or a frame has no bound."""
    text = """node: { title: "a" label: "a\\n16 bytes (static)" }
node: { title: "b" label: "b\\n8 bytes (static)" }
node: { title: "x.c:p" label: "p\\n40 bytes (static)" }
node: { title: "x.c:q" label: "q\\n100 bytes (static)" }
edge: { sourcename: "a" targetname: "b" label: "" }
edge: { sourcename: "b" targetname: "__indirect_call" label: "" }
edge: { sourcename: "x.c:p" targetname: "__indirect_call" label: "" }
"""
    path = tmp_path / "x.ci"
    path.write_text(text)
    assert build.stack([path], "a", set()) == 24
    assert build.stack([path], "a", {"p"}) == 64
    assert build.stack([path], "a", {"p", "q"}) == 164
    path.write_text(text + 'edge: { sourcename: "x.c:p" targetname: "a" label: "" }\n')
    assert build.stack([path], "a", {"p"}) is None
    path.write_text(text.replace("8 bytes (static)", "8 bytes (dynamic)"))
    assert build.stack([path], "a", set()) is None


ALONG = """#include "rig.h"
#include <stdio.h>

int main(void)
{
  static rig_state state;
  rig_output out;
  float in[3];
  rig_init(&state);
  while (fread(in, sizeof in, 1, stdin) == 1) {
    const amb_status status = rig_step(&state, in[0], in[1], in[2] > 0.5F, &out);
    const float told[] = {out.coil[0], out.coil[1], out.iu, out.u, out.x, out.v, out.f_d, out.x_m,
                          (float)status, (float)out.mode};
    (void)fwrite(told, sizeof told, 1, stdout);
  }
  return 0;
}
"""


def along(record, folder):
    """What the exported C says of a record, compiled for this machine: (samples, numbers)."""
    export = export_c(BEARING, None, folder / "c", prefix="rig", scenario=SCENARIO).folder
    (folder / "along.c").write_text(ALONG)
    sources = [str(file) for file in (folder / "along.c", *build.sources(export))]
    includes = [f"-I{export / at}" for at in (".", "core/include", "core")]
    words = ["gcc", "-std=c99", "-O2", "-ffp-contract=off", *includes, *sources]
    subprocess.run([*words, "-o", str(folder / "along")], check=True)
    given = np.column_stack([record["y"], record["r"], SEQUENCE.fly(record.t)]).astype("<f4")
    words = [str(folder / "along")]
    done = subprocess.run(words, input=given.tobytes(), capture_output=True, check=True)
    return np.frombuffer(done.stdout, "<f4").reshape(len(record.t), -1)


@pytest.mark.long
@needs_tools
@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_a_record_has_the_same_bits_at_every_stage(tmp_path):
    """Flown there, written as a log, read, filtered, and through the exported C compiled here."""
    found = pil(BEARING, scenario=SCENARIO, board="stm32f4")
    assert (found.unequal, found.selftest) == (0, 0)
    assert (found.unequal_frames, found.frames.meta["missing"]) == (0, 0)
    assert [mode for _, mode in found.modes] == [
        "OFF", "WAITING", "LIFTING", "FLYING", "LANDING", "OFF",
    ]  # fmt: skip
    record = found.record
    logged = {"r": "m", "y": "m", "u": "V"}
    Record(record.t, {name: record[name] for name in logged}, logged).save(tmp_path / "log.csv")
    read = ambkit.read(tmp_path / "log.csv").record
    np.testing.assert_array_equal(read["y"], record["y"])
    means = found.answers["mean"]
    filtered = KalmanFilter(BEARING, precision="float32").run(read)
    assert filtered.mean.astype("<f4").tobytes() == np.ascontiguousarray(means).tobytes()
    told, answers = along(read, tmp_path), found.answers
    there = [answers["coil"][:, 0], answers["iu"], answers["u"], means, answers["status"]]
    there += [answers["mode"]]
    np.testing.assert_array_equal(told, np.column_stack(there).astype("<f4"))
    flying = record["mode"] == Mode.FLYING
    assert flying.sum() > 800
    assert found.worst < 0.2 * BEARING.clearance
    assert found.stack_seen <= (found.built.stack or 0) < 2000
    assert 500 < found.instructions <= found.most < 2000
    assert found.built.variables == 0


@pytest.mark.long
@needs_tools
def test_the_rigs_own_numbers_go_there(tmp_path):
    estimator = KalmanFilter(BEARING)
    estimator.inputs = Inputs(y=Scaling(unit="V", scale="0.2 mm/V", sign=-1, offset="0.1 mm"))
    estimator.save(tmp_path / "filter.toml")
    file = FilterFile.load(tmp_path / "filter.toml")
    found = pil(BEARING, scenario=SCENARIO, filter_file=file)
    assert (found.unequal, found.selftest) == (0, 0)
    assert "FLYING" in [mode for _, mode in found.modes]


@pytest.mark.long
@needs_tools
def test_the_command_says_it(tmp_path, call):
    path, out, page = tmp_path / "s.toml", tmp_path / "flight.csv", tmp_path / "pil.html"
    path.write_text(SCENARIO.to_toml())
    told = call(
        "pil", "zittau_axial", "--scenario", path, "--json", "--out", out, "--out", page
    ).json
    assert told["passed"] is True
    assert told["samples"] == 2001
    assert ambkit.Record.load(out).t.size == 2001
    text = page.read_text(encoding="utf-8")
    assert "all values equal those of Python" in text
    assert f"{told['instructions']}" in text
    assert f"{told['most']}" in text


@pytest.mark.long
@needs_tools
def test_other_bits_would_be_seen(monkeypatch):
    """The check must be able to fail: the firmware is told to contract."""
    monkeypatch.setattr(
        build, "FLAGS", tuple(f.replace("contract=off", "contract=fast") for f in build.FLAGS)
    )
    found = pil(BEARING, scenario=SCENARIO)
    assert not found.passed
    assert found.unequal > 100


@pytest.mark.long
@needs_tools
def test_a_firmware_that_does_not_answer_is_reported(monkeypatch):
    monkeypatch.setattr("ambkit.export.pil.loop.PATIENCE", 2.0)  # seconds

    def broken(image, folder, *sizes):
        image.write_bytes(b"nothing that runs")
        return Processor(image, folder, *sizes)

    monkeypatch.setattr("ambkit.export.pil.loop.Processor", broken)
    with pytest.raises(AmbkitError, match="does not answer"):
        pil(BEARING, scenario=SCENARIO)
