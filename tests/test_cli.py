"""The commands as a user meets them: what they print, write and refuse."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from glob import glob
from pathlib import Path

import numpy as np
import pytest
from conftest import Result
from scipy.io import savemat

import ambkit
from ambkit.data import recordings
from ambkit.data.reading.propose import guess
from ambkit.export.pil import build
from ambkit.fuzzy.training import train
from ambkit.identification.excitation.signals import sparse_multisine
from ambkit.identification.forces.lift_off import load_points
from ambkit.machine.parts import GRAVITY
from ambkit.machine.stiffness import stiffness_map
from tests.test_coil import stepped

COMMANDS = (
    "reproduce", "simulate", "excite", "read", "identify", "train", "filter", "compare",
    "assess", "faults", "diagnose", "pil", "presets", "check",
)  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Make a folder with what the examples in the help start from."""
    folder = tmp_path_factory.mktemp("made")
    bearing = ambkit.preset("zittau_axial")
    bearing.save(folder / "my.toml")
    scenario = ambkit.Scenario(duration=0.3, reference=ambkit.Step(amplitude=0.3e-3, time=0.03),
                               controller=ambkit.PID.textbook(bearing))  # fmt: skip
    scenario.save(folder / "scenario.toml")
    ambkit.simulate(bearing, scenario).record.save(folder / "run.csv")
    bearing.save(folder / "found.toml")
    ambkit.Scenario(duration=0.02).save(folder / "mlps.toml")
    ambkit.KalmanFilter(bearing).save(folder / "filter.toml", machine=folder / "my.toml")
    signal = np.tile(sparse_multisine(1000, 1e-4, (10.0, 900.0)).values, 5)
    injection = ambkit.Recorded(times=1e-4 * np.arange(5000), values=1e-5 * signal)
    injected = ambkit.Scenario(duration=0.4999, injection=injection)
    ambkit.simulate(bearing, injected).record.save(folder / "injected.csv")
    (folder / "force.csv").write_text(_force(bearing), encoding="utf-8")
    shutil.copy(recordings.folder() / "lift_off_points.csv", folder / "points.csv")
    shutil.copy(recordings.folder() / "sinus_kalman.csv", folder / "log.csv")
    (folder / "map.toml").write_text(guess(folder / "log.csv"), encoding="utf-8")
    _logs(folder, bearing)
    return folder


def _logs(folder, bearing):
    """Logs as a rig writes them, and steps of its coil, with their channel maps."""
    (folder / "logs").mkdir()
    (folder / "steps").mkdir()
    for k in range(2):
        run = ambkit.simulate(bearing, step="0.3 mm", duration=0.2, seed=k).record
        savemat(folder / f"logs/{k}.mat", {"a": np.array([run.t, run["y"], run["u"]])})
    rows = enumerate([("t", "s"), ("y", "m"), ("u", "V")])
    signals = [f'[signals.{name}]\nrow = {k}\nunit = "{unit}"\n' for k, (name, unit) in rows]
    (folder / "rig.toml").write_text("\n".join(['name = "rig"\narray = "a"\n', *signals]))
    shutil.copy(recordings.folder() / "coil.toml", folder)
    for k, z in enumerate((1e-3, 4e-3, 9e-3, 18e-3)):
        run, none = stepped(z, k), 0.0
        rows = np.broadcast_arrays(run.t, run["z"], none, run["i"], none, run["u"])
        savemat(folder / f"steps/{k}.mat", {"measurements": np.array(rows)})


def _force(bearing):
    """A few measured points, anywhere."""
    iu, x = np.random.default_rng(1).uniform(-1, 1, (2, 30))
    force = ambkit.ClosedLaw(bearing).force(1.5 * iu, 5e-4 * x)
    rows = [f"{1.5 * i},{0.5 * d},{f}" for i, d, f in zip(iu, x, force, strict=True)]
    return "\n".join(["iu [A],x [mm],f_mag [N]", *rows]) + "\n"


def real(*arguments, **options):
    """Call ambkit as a process of its own."""
    command = [sys.executable, "-m", "ambkit", *map(str, arguments)]
    options = {"capture_output": True, "text": True, "timeout": 120} | options
    done = subprocess.run(command, check=False, **options)
    return Result(done.returncode, done.stdout, done.stderr)


# Start-up and help


def test_the_front_imports_nothing_heavy():
    heavy = "numpy scipy pydantic pint pyarrow matplotlib plotly rich"
    code = f"import sys, ambkit.cli.main; print([m for m in {heavy.split()} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_plain_simulation_imports_no_large_part_of_scipy():
    large = "scipy.signal scipy.stats scipy.interpolate scipy.integrate scipy.optimize"
    code = (
        "import sys\nfrom ambkit.cli.main import main\n"
        "try: main(['simulate', 'zittau_axial', '--duration', '5 ms', '--json'])\n"
        "except SystemExit as left: code = left.code\n"
        f"print(code, [m for m in {large.split()} if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "0 []"


def test_help_lists_all_commands_and_is_what_one_gets_for_no_command(call):
    asked, bare = call("--help"), call()
    assert asked.code == bare.code == 0
    assert asked.out == bare.out
    for name in COMMANDS:
        assert re.search(rf"^  {name} +\S.*\.$", asked.out, re.MULTILINE), name


def test_version(call):
    assert call("--version").out == f"ambkit {ambkit.__version__}\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_each_help_has_an_example_and_json(call, name):
    found = call(name, "--help")
    assert found.code == 0
    assert f"For example:\n    ambkit {name}" in found.out
    assert "--json" in found.out


SLOW_EXAMPLES = {"assess", "compare", "excite", "identify", "pil", "train"}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.long if name in SLOW_EXAMPLES else ())
        for name in COMMANDS
        if name != "reproduce"
    ],
)
def test_the_examples_in_the_help_work(call, made, tmp_path, name):
    examples = re.findall(r"^    (ambkit .*)$", call(name, "--help").out, re.MULTILINE)
    tools = (build.QEMU_BOARD.compiler, build.QEMU) if name == "pil" else ()
    if missing := [tool for tool in tools if shutil.which(tool) is None]:
        pytest.skip(f"not here: {', '.join(missing)}")
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    for example in examples:
        arguments = shlex.split(example.partition(" > ")[0])[1:]
        arguments = [
            each for word in arguments
            for each in (sorted(glob(word)) if "*" in word else [word])
        ]  # fmt: skip
        if name == "compare":
            arguments = ["4" if word == "40" else word for word in arguments]
            arguments += ["--seeds", "2", *(["--budget", "4"] * ("--budget" not in arguments))]
        if name == "faults":
            arguments += ["--faults", "outage-10ms", "--faults", "stuck", "--samples", "20000"]
        found = call(*arguments)
        assert found.code == 0, found.err
        for option in ("--out", "--plot"):
            if option in arguments:
                asked = Path(arguments[arguments.index(option) + 1].rpartition("=")[2])
                files = [*asked.parent.glob(f"{asked.stem}*{asked.suffix}")]  # one for each axis
                files += [*asked.glob("*")]  # or what a folder holds
                written = [file for file in files if f"wrote {file}" in found.err]
                assert written
                assert all(file.stat().st_size > 0 for file in written)


# Results


def test_simulate_tunes_what_the_scenario_does_not_say_of_the_controller(call, made):
    tuned = ambkit.Control.for_bearing(ambkit.preset("inteco_ml")).fed_by("estimate")
    tuned = tuned.model_copy(update={"type": "decentralised"})

    def controller(text, *arguments):
        Path("s.toml").write_text(f'duration = "20 ms"\n{text}')
        found = call("simulate", "inteco_ml", "--scenario", "s.toml", "--out", "r.csv", *arguments)
        assert found.code == 0, found.err
        return ambkit.Control(**ambkit.Record.load("r.csv").meta["scenario"]["controller"])

    assert controller("") == tuned
    assert controller('[controller]\nkp = "400 A/m"\n').kp == 400
    assert controller('[controller]\nkp = "400 A/m"\n').kd == tuned.kd
    assert controller("", "--filter", "none").feedback == "measurement"


def test_simulate_says_when_the_rotor_touched_the_stop(call):
    quiet = call("simulate", "inteco_ml", "--duration", "0.1 s")
    assert "the rotor touched" not in quiet.out.lower()
    arguments = ("--duration", "0.3 s", "--disturbance", "-3 N", "--filter", "none", "--json")
    found = call("simulate", "inteco_ml", *arguments, "--out", "r.csv")
    record = ambkit.Record.load("r.csv")
    count = found.json["samples_at_the_stop"]
    assert 0 < count < len(record)
    first = record.t[np.abs(record["x"]) >= np.abs(record["x"]).max()][0]
    assert f"in {count} of {len(record)} samples, first at {first:.4g} s" in found.out


def test_identify_finds_the_magnet_constant(call, made):
    found = call("identify", "online", made / "my.toml", made / "run.csv", "--method", "adaline",
                 "--initial", "4 N mm^2/A^2", "--disturbance", "f_d", "--out", "b.toml",
                 "--json")  # fmt: skip
    assert found.json["magnet_constant"] == pytest.approx(6.7e-6, rel=0.05)
    assert ambkit.Machine.load("b.toml").magnet.magnet_constant == found.json["magnet_constant"]
    words = (made / "my.toml", made / "run.csv", "--method", "adaline", "--disturbance", "-3 N")
    assert call("identify", "online", *words).code == 0


def test_identify_says_where_the_constant_still_drifts(call, made):
    assert call("simulate", "zittau_axial", "--duration", "80 ms", "--out", "short.csv").code == 0
    words = ("identify", "online", "zittau_axial")
    start = ("--method", "adaline", "--initial", "3 N mm^2/A^2")
    assert "still drifts" in call(*words, "short.csv", *start).out
    assert "drifts" not in call(*words, made / "run.csv", *start).out


def test_identify_from_lift_off_points_gives_gap_and_bias(call, made):
    found = call("identify", "lift-off", "inteco_ml", made / "points.csv", "--gap", "4 mm,16 mm",
                 "--operating-point", "10 mm", "--out", "b.toml", "--json")  # fmt: skip
    bearing = ambkit.Machine.load("b.toml")
    assert bearing.magnet.air_gap == pytest.approx(10e-3 + found.json["gap_offset"])
    assert bearing.levitation_current == pytest.approx(0.0, abs=1e-9)  # the bias carries the ball
    points = load_points(made / "points.csv")
    assert found.json["points"] + len(found.json["left_out"]) == len(points)


def test_filter_says_when_the_expert_is_asked_outside_of_its_box(call, made):
    arguments = ("filter", made / "run.csv", "--machine", "zittau_axial", "--filter")
    assert "outside" not in call(*arguments, "adaptive").out
    bearing = ambkit.preset("zittau_axial")
    displacements = np.linspace(-0.2e-3, 0.2e-3, 5)  # the run goes to 0.3 mm after a tenth of it
    train(stiffness_map(bearing, displacements=displacements)).save("e.json")
    found = call(*arguments, "e.json")
    assert found.code == 0
    share = float(re.search(r"e.json: (\d+) % of the samples lie outside", found.out)[1])
    assert share == pytest.approx(88, abs=4)
    assert "displacement -0.2 mm to 0.2 mm" in found.out


def test_an_expert_of_another_bearing_is_noticed(call, made):
    ambkit.Expert.paper().save("paper.json")
    arguments = ("filter", made / "run.csv", "--machine", "zittau_axial", "--filter")
    found = call(*arguments, "paper.json")
    assert found.code == 0
    assert "paper.json: was trained for Tables 4, 5 and 6 of the paper, not for" in found.err


def test_filter_reads_part_of_a_real_rigs_log(call):
    log = recordings.folder() / "sinus_kalman.csv"
    found = call("filter", log, "--machine", "inteco_ml", "--filter", "linear", "--window",
                 "3 s,5 s", "--settling", "100 ms", "--disturbance-noise", "1e-4 N^2/s",
                 "--json")  # fmt: skip
    judged = found.json["estimators"]["linear"]
    assert judged["samples"] == 1900
    assert set(judged["logged"]) == {"x_logged held", "x_logged and v_logged"}
    assert judged["rmse"] == {}


def test_filter_tunes_itself_on_a_measured_record_and_says_where(call, made):
    log = recordings.folder() / "sinus_kalman.csv"
    found = call("filter", log, "--machine", "inteco_ml", "--filter", "linear", "--json")
    judged = found.json["estimators"]["linear"]
    assert "Tuned from 3 to 4 s, judged on the rest." in found.json["notes"]
    assert judged["samples"] == 2001  # the half that it was not tuned on
    assert judged["prediction"]["10"] < 0.8 * judged["held"]["10"]
    simulated = call("filter", made / "run.csv", "--machine", "zittau_axial", "--json")
    assert "Tuned" not in simulated.out


def test_filter_tunes_on_the_beginning_of_a_record(call):
    arguments = ("filter", recordings.folder() / "sinus_kalman.csv", "--machine", "inteco_ml",
                 "--filter", "linear", "--measurement-noise", "225 µm^2", "--json")  # fmt: skip
    given = call(*arguments, "--settling", "1 s", "--disturbance-noise", "1.4 N^2/s")
    plain = given.json["estimators"]["linear"]
    tuned = call(*arguments, "--disturbance-noise", "auto 1 s").json["estimators"]["linear"]
    assert plain["disturbance_noise"] == 1.4
    assert tuned["disturbance_noise"] > 0
    assert tuned["samples"] == plain["samples"]
    assert tuned["prediction"]["10"] < tuned["held"]["10"] < plain["prediction"]["10"]


def test_filter_does_not_keep_a_tuning_that_a_later_load_ruins(call):
    bearing = ambkit.preset("zittau_axial")
    late = ambkit.Scenario(duration=0.6, disturbance=ambkit.Step(amplitude=6.0, time=0.45))
    run = ambkit.simulate(bearing, late).record
    ambkit.Record(run.t, {n: run[n] for n in "yu"}, {"y": "m", "u": "V"}).save("late.csv")
    asked = ("filter", "late.csv", "--machine", "zittau_axial", "--filter", "linear", "--json")
    found = call(*asked)
    untuned = (2 * bearing.rotor.mass * GRAVITY) ** 2
    assert found.json["estimators"]["linear"]["disturbance_noise"] == pytest.approx(untuned)
    assert "fits the rest of the record worse than the untuned" in found.out
    kept = call(*asked, "--disturbance-noise", "auto 0.3 s")
    assert kept.json["estimators"]["linear"]["disturbance_noise"] < untuned
    assert "the tuning is doubtful; --disturbance-noise sets it" in kept.out


def test_filter_and_identify_refuse_a_record_in_the_wrong_unit(call, made):
    run = ambkit.Record.load(made / "run.csv")
    signals = {"y": 1e3 * (run["y"] + 2e-5), "u": run["u"]}
    ambkit.Record(run.t, signals, {"y": "m", "u": "V"}).save("wrong.csv")
    for words in (("filter", "wrong.csv", "--machine", "zittau_axial"),
                  ("identify", "zittau_axial", "wrong.csv"),
                  ("check", "wrong.csv", "--machine", "zittau_axial")):  # fmt: skip
        found = call(*words)
        assert found.code == 2
        assert "beyond the air gap of 2 mm: is a unit, scale or offset wrong?" in found.err


def test_train_says_where_a_sign_is_wrong(call):
    rows = [
        f"{i},{x},{6 * i - 3 * x if x < 0 else 6 * i + 20 * x}"  # N: k_s is turned around
        for x in (-0.6, -0.4, -0.2, 0, 0.2, 0.4, 0.6)
        for i in (-1.5, -0.75, 0, 0.75, 1.5)
    ]
    Path("f.csv").write_text("\n".join(["iu [A],x [mm],f_mag [N]", *rows]) + "\n")
    found = call("train", "map", "zittau_axial", "f.csv", "--rules", "4x4", "--json", "--out",
                 "e.json")  # fmt: skip
    wrong = found.json["wrong_sign"]["k_s"]
    assert wrong["displacement"] < 0 < wrong["law"]
    expert = ambkit.Expert.load("e.json")
    at = wrong["current"], wrong["displacement"]
    assert expert.stiffness(*at)[1] == pytest.approx(wrong["least"])
    assert wrong["least"] < 0
    assert "the trained k_s is not positive in " in found.out
    assert "k_i is not positive" not in found.out


@pytest.mark.parametrize("bearing", ["zittau_axial", "inteco_ml"])
def test_an_expert_of_the_law_has_the_right_signs(call, bearing):
    found = call("train", bearing, "--json")
    assert found.json["wrong_sign"] == {}
    assert "not positive" not in found.err


def test_train_says_where_hardly_anything_was_measured(call):
    rows = [
        f"{i},{x},{i + 9 * x},{100 if i > 0 and x > 0 else 0.1}"
        for x in (-0.6, -0.2, 0.2, 0.6)
        for i in (-1.5, -0.5, 0.5, 1.5)
    ]
    Path("f.csv").write_text("\n".join(["iu [A],x [mm],f_mag [N],f_std [N]", *rows]) + "\n")
    found = call("train", "map", "zittau_axial", "f.csv", "--rules", "4x4", "--law-error",
                 "4 N")  # fmt: skip
    assert "few points near" in found.out
    assert "1.5 A at 0.6 mm" in found.out
    assert "-1.5 A at -0.6 mm" not in found.out
    assert "deviation from points, the trained expert" in found.out
    assert "error of the law" in found.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("f.csv", "--law-error", "-2 N"), "must be greater than 0 N, is -2 N"),
        (("line.csv",), "line.csv: the points must differ in displacement"),
        (("few.csv", "--rules", "auto"), "few.csv: too few points to choose"),
        (("far.csv",), "force: x must stay within the air gap, 2 mm, reaches -6 m"),
    ],
)
def test_train_says_what_measured_points_lack(call, arguments, message):
    Path("line.csv").write_text("iu [A],x [mm],f_mag [N]\n1,0,9\n0,0,0\n")
    Path("few.csv").write_text("iu [A],x [mm],f_mag [N]\n1,0.1,9\n0,0,0\n")
    rows = [f"{i},{x},{i + x}" for x in (-600, -200, 200, 600) for i in (-1.5, -0.5, 0.5, 1.5)]
    Path("far.csv").write_text("\n".join(["iu [A],x [cm],f_mag [N]", *rows]) + "\n")
    found = call("train", "map", "zittau_axial", *arguments)
    assert found.code == 2
    assert message in " ".join(found.err.replace("│", " ").split())


def test_filter_smooths(call, made):
    asked = ("filter", made / "run.csv", "--machine", "zittau_axial", "--filter", "closed-law",
             "--smooth")  # fmt: skip
    found = call(*asked, "--out", "e.csv", "--plot", "e.png", "--json")
    judged = found.json["estimators"]["closed-law"]
    for name in ("v", "f_d"):
        assert judged["smoothed"]["rmse"][name] < 0.8 * judged["rmse"][name]
    assert "closed-law_smoothed_f_d [N]" in Path("e.csv").read_text()
    assert Path("e.png").is_file()
    assert "error of f_d, rms, smoothed" in call(*asked).out


def test_compare_over_seeds(call):
    found = call("compare", "steps", "zittau_axial", "--steps", "0.1 mm", "--steps", "0.5 mm",
                 "--disturbance", "3 N", "--seeds", "4:3", "--filter", "linear",
                 "--filter", "closed-law", "--out", "s.csv", "--plot", "s.svg",
                 "--json")  # fmt: skip
    far = found.json["cases"]["0.5 mm"]
    assert found.json["seeds"] == [4, 6]
    assert far["closed-law"]["f_d"] < 0.8 * far["linear"]["f_d"]
    table = Path("s.csv").read_text()
    assert "closed-law_f_d [N]" in table
    assert len([line for line in table.splitlines() if line[0].isdigit()]) == 2 * 3


def test_compare_in_a_case(call):
    Path("my.py").write_text("class Mine:\n    def step(self, y, u):\n        return y, 0, 0, y\n")
    found = call("compare", "zittau_axial", "--filter", "linear", "--filter", "closed-law",
                 "--filter", "my.py:Mine", "--case", "step", "--seeds", "2:3", "--budget", "2",
                 "--out", "c.csv", "--plot", "m.svg", "--robustness", "--out",
                 "r.html", "--json")  # fmt: skip
    assert found.json["files"] == ["c.csv", "r.html", "m.svg"]
    tuned, default = found.json["tuned"], found.json["default"]
    assert list(default) == ["linear", "closed-law", "Mine"]
    assert tuned["closed-law"]["f_d"] < 0.8 * tuned["linear"]["f_d"]
    assert found.json["tuning"]["linear"]["evaluations"] == 2
    assert default["Mine"]["nis"] is None
    table = Path("c.csv").read_text()
    assert "linear_tuned_f_d [N]" in table
    assert len([line for line in table.splitlines() if line[0].isdigit()]) == 3
    assert "Cramér-Rao bound" in Path("r.html").read_text()


def test_compare_in_all_cases(call):
    from ambkit.judge.comparison import cases

    named = f"{', '.join(cases.CASES)}, or all."
    assert named in " ".join(call("compare", "--help").out.split())
    found = call("compare", "zittau_axial", "--filter", "linear", "--filter", "observer", "--case",
                 "all", "--seeds", "1", "--out", "c.csv", "--plot", "m.svg", "--out", "r.html",
                 "--json")  # fmt: skip
    assert list(found.json["cases"]) == list(cases.CASES)
    table = Path("c.csv").read_text()
    assert len([line for line in table.splitlines() if line[0].isdigit()]) == len(cases.CASES)
    assert "matrix-unbalance" in Path("r.html").read_text()


def test_compare_tells_the_limit_where_it_is_known(call):
    found = call("compare", "zittau_axial", "--case", "model", "--filter", "closed-law", "--seeds",
                 "4")  # fmt: skip
    assert "Cramér-Rao bound on the errors" in found.out
    assert "x       3.4" in found.out


def test_assess(call, tmp_path):
    found = call("assess", "zittau_axial", "--filter", "linear", "--filter", "observer",
                 "--disturbance", "1 N")  # fmt: skip
    assert found.code == 0, found.err
    for said in (
        "zone of ISO 14839-3",
        "measurement",
        "observer",
        "delay margin",
        "gain margin, up",
        "no linear controller",
        "certification requires",
    ):
        assert said in found.out  # fmt: skip
    picture = tmp_path / "margins.png"
    told = call("assess", "zittau_axial", "--filter", "none", "--plot", str(picture), "--json")
    data = json.loads(told.out)
    assert list(data["loops"]) == ["measurement"]
    assert data["loops"]["measurement"]["zone"] == "A"
    assert data["loops"]["measurement"]["delay_margin"] > 1e-3
    assert picture.is_file()


def test_help_fits_80_columns_and_breaks_no_word_at_its_hyphen(call, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for command in ((), ("export",), ("export", "c"), ("pil",), ("schema",)):
        lines = call(*command, "--help").out.splitlines()
        assert [x for x in lines if len(x) > 80 and not x.startswith("    ambkit")] == []
        assert [x for x in lines if re.search(r"[a-z]-$", x)] == []


def test_assess_takes_filters_files(call, tmp_path):
    bearing = ambkit.preset("zittau_axial")
    quick = ambkit.FilterNoise(disturbance=1e4)
    ambkit.KalmanFilter(bearing, noise=quick).save(tmp_path / "mine.toml")
    expected = ambkit.assess(bearing, {"mine": ambkit.KalmanFilter(bearing, noise=quick)})
    for arguments in (["mine.toml"], ["zittau_axial", "--filter", "mine.toml"]):
        found = call("assess", *arguments, "--json")
        assert found.code == 0, found.err
        assert list(found.json["loops"]) == ["measurement", "mine.toml"]
        peak = found.json["loops"]["mine.toml"]["peak"]
        assert peak == pytest.approx(expected.loops["mine"].peak, rel=1e-9)
    both = call("assess", "mine.toml", "--filter", "linear")
    assert (both.code, both.err) == (
        2, "ambkit: mine.toml is a filter itself: omit the other one\n"
    )  # fmt: skip


def test_a_signal_is_designed_played_and_assessed(call, tmp_path):
    made = call("excite", "sensitivity", "zittau_axial", "--duration", "1.5 s",
                "--filter", "observer", "--out", "injection.csv", "--plot", "it.png")  # fmt: skip
    assert made.code == 0, made.err
    assert "expected peak of |S|" in made.out
    call("simulate", "zittau_axial", "--signal", "injection.csv", "--filter", "observer", "--seed",
         "3", "--out", "run.csv")  # fmt: skip
    found = call("assess", "log", "run.csv", "--machine", "zittau_axial", "--filter", "observer",
                 "--plot", "measured.png")  # fmt: skip
    assert found.code == 0, found.err
    for said in ("Measured sensitivity", "zone of ISO 14839-3", "share within the 95 % intervals"):
        assert said in found.out
    data = call(
        "assess", "log", "run.csv", "--machine", "zittau_axial", "--filter", "observer", "--json"
    )
    assert data.json["models"]["observer"]["within"] > 0.8
    low, high = data.json["peak_interval_95"]
    assert low < data.json["models"]["observer"]["peak"] < high
    assert Path("measured.png").is_file()


def test_tune_keeps_a_margin_and_shows_what_it_costs(call, tmp_path):
    often = ("--filter", "linear", "--budget", "8", "--seeds", "1")
    found = call("tune", "zittau_axial", *often, "--max-sensitivity", "2.2", "--out", "f.toml")
    assert found.code == 0, found.err
    assert re.search(r"zone A \(limit 2\.2\); untuned 1\.\d+\.", found.out)
    assert call("assess", "f.toml", "--json").json["loops"]["f.toml"]["peak"] < 2.2
    found = call("tune", "trade-off", "zittau_axial", *often, "--peaks", "1.1", "--peaks", "2.2",
                 "--plot", "it.png")  # fmt: skip
    assert found.code == 0, found.err
    assert "none below 1.1" in found.out
    assert (tmp_path / "it.png").is_file()


def test_assess_takes_all_kinds_that_settle_and_a_scenarios_controller(call, tmp_path):
    soft = tmp_path / "soft.toml"
    soft.write_text('[controller]\nkp = "1 A/m"\nki = "0 A/(m s)"\n')
    found = call("assess", "inteco_ml", "--filter", "all", "--controller", str(soft))
    assert found.code == 0, found.err
    assert "multiple-model is omitted" in found.err
    assert "unstable" in found.out
    assert "Bode's integral does not hold" in found.out


def test_faults(call):
    found = call("faults", "inteco_ml", "--filter", "linear", "--filter", "low-pass",
                 "--filter", "table", "--faults", "stuck", "--faults", "long-stuck",
                 "--faults", "nan-u", "--samples", "20000", "--precision", "both",
                 "--seeds", "2", "--out", "t.csv", "--plot", "t.svg", "--json")  # fmt: skip
    assert found.code == 0, found.err
    assert found.json["seeds"] == [0, 1]
    assert found.json["files"] == ["t.csv", "t.svg"]
    assert list(found.json["estimators"]) == ["linear", "low-pass", "table"]
    assert found.json["estimators"]["linear"]["recovered"]
    # Three faults, clean and mixed beside the loop; one of them not in it.
    flights = 2 * 2 * (3 * (5 + 4) + 4)
    assert len(found.json["flights"]) == flights
    table = Path("t.csv").read_text()
    assert "recovery [1]" in table
    assert "after_x [m]" in table
    assert len([line for line in table.splitlines() if line[0].isdigit()]) == flights
    told = call(
        "faults", "inteco_ml", "--filter", "linear", "--faults", "stuck", "--samples", "0",
        "--verbose",
    )  # fmt: skip
    assert told.err == ""
    assert "the sensor repeats its last value" in told.out
    assert "no levitation was lost, and all filters recovered." in told.out.splitlines()[0]


def test_presets_print_their_toml_as_it_is(call):
    from ambkit.machine import presets

    assert call("presets", "zittau_axial").out == presets.text("zittau_axial")
    assert [each["name"] for each in call("presets", "--json").json] == list(presets.names())
    assert call("presets", "zittau_axial", "--out", "my.toml").code == 0
    assert Path("my.toml").read_text() == presets.text("zittau_axial")
    assert call("presets", "inteco_ml", "--json").json["machine"]["rotor"]["mass"] == 0.06054


def test_check_tells_what_files_are(call, made):
    files = [made / name for name in ("my.toml", "scenario.toml", "run.csv", "points.csv")]
    found = call("check", *files, recordings.folder() / "closed_loop.toml", "--json")
    kinds = [each["kind"] for each in found.json]
    assert kinds == ["machine", "scenario", "record", "lift-off points", "channel map"]
    assert found.code == 0


def test_check_tells_all_that_is_wrong(call, made):
    text = (made / "my.toml").read_text().replace("mass", "mas").replace('"2 mm"', '"2 kg"')
    Path("bad.toml").write_text(text)
    found = call("check", "bad.toml", made / "run.csv")
    assert found.code == 2
    assert re.search(r"^bad.toml:\d+: rotor.mas: unknown key, did you mean mass", found.err, re.M)
    assert re.search(r"^bad.toml:\d+: magnet.air_gap: .*kg", found.err, re.M)
    assert "run.csv: ok, record" in found.out


@pytest.mark.parametrize("kind", ["scenario", "map"])
def test_check_prints_the_schema(call, kind):
    schema = call("schema", kind).json
    assert schema["$schema"].startswith("https://json-schema.org")
    assert schema["properties"]


def test_reproduce_hands_on_its_arguments_and_prints_the_verdicts(call, monkeypatch):
    from paper import reproduction
    from paper.verdicts import SummaryRow

    row = SummaryRow(id="a", what="k", paper=6.7, ours=6.69, unit="N", verdict="agrees")

    def stand_in(out, *, seed, progress):
        progress("chapter 1")
        assert seed == 3
        return reproduction.Judged(Path(out), [row])

    monkeypatch.setattr(reproduction, "reproduce", stand_in)
    found = call("reproduce", "--out", "there", "--seed", "3")
    assert "agrees" in found.out
    assert f"wrote {Path('there', 'report.html')}" in found.err
    assert call("reproduce", "--out", "there", "--seed", "3", "--json").json["summary"] == [row]


# What is refused


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("simulat zittau_axial", "did you mean simulate?"),
        ("simulate", "required: MACHINE"),
        ("simulate zitau_axial", 'no preset and no file "zitau_axial"; did you mean zittau_axial?'),
        ("simulate missing.toml", "missing.toml: cannot be read: No such file"),
        ("simulate zittau_axial --step 0.5", 'step must be in m: "0.5" has no unit'),
        ("simulate zittau_axial --step 5kg", "kg cannot be converted to m"),
        ("simulate zittau_axial --seed -1", "seed"),
        ("simulate zittau_axial --filter ukf", 'no filter "ukf"; known: low-pass'),
        ("simulate zittau_axial --out run.xlsx", "run.xlsx must end with .csv or .parquet"),
        ("simulate zittau_axial --out nowhere/run.csv", "there is no folder nowhere"),
        ("simulate zittau_axial --out run.csv --plot run.gif", "run.gif must end with .png"),
        ("simulate zittau_axial --scenario zittau.toml", "zittau.toml: cannot be read"),
        ("identify zittau_axial", "required: RECORD"),
        ("identify lift-off inteco_ml RUN --method rls", "there is no option --method"),
        ("identify corpus inteco_ml RUN", "a corpus has 3 logs or more, 1 are given"),
        (
            "identify online zittau_axial RUN --method adaline --disturbance g",
            "signal of the record: r, y, u",
        ),
        (
            "identify online zittau_axial RUN --method adaline --initial -1N*mm^2/A^2",
            "initial must be greater",
        ),
        ("identify zittau_axial RUN --gap 1mm,2mm", "there is no option --gap"),
        ("simulate zittau_axial --duration 1e9s", "duration must be at most"),
        ("identify lift-off zittau_axial RUN", "is two-sided"),
        ("identify lift-off inteco_ml RUN", "has no column run"),
        ("identify lift-off inteco_ml RUN --gap 4mm", "gap must be two lengths"),
        ("identify lift-off inteco_ml POINTS --out b.toml", "operating_point is missing"),
        ("train zittau_axial --method adam", "invalid choice: 'adam'"),
        ("train map zittau_axial missing.csv", "missing.csv: cannot be read"),
        ("filter RUN --machine inteco_ml", "sampled every 0.0001 s, but 'inteco_ml'"),
        ("filter RUN --machine zittau_axial --filter none", 'no filter "none"'),
        ("filter RUN --machine zittau_axial --measurement-noise 0m^2", "noise.measurement must be"),
        ("filter RUN --machine zittau_axial --settling 9s", "needed to predict 10 samples ahead"),
        ("filter RUN --machine zittau_axial --disturbance-noise 1kg", "must be in N^2/s"),
        (
            "filter RUN --machine zittau_axial --disturbance-noise 'auto 1 s'",
            "tune must be shorter than the record, 0.3 s",
        ),
        ("filter RUN --machine zittau_axial --window 1s,", "no samples from 1 s on: it goes from"),
        ("filter RUN --filter linear", "machine is missing"),
        ("filter missing.csv --machine zittau_axial", "missing.csv: cannot be read"),
        ("assess zittau_axial --filter ukv", 'no filter "ukv"; known: low-pass'),
        ("assess zittau_axial --filter multiple-model", "no steady-state gain"),
        ("assess sweep zittau_axial --filter ud --filter linear", "is given more than once"),
        ("assess log RUN --filter linear", "filter and controller need a machine"),
        ("assess log RUN --machine zittau_axial", "has no signal injected"),
        ("excite sensitivity zittau_axial --kind prbs", "there is no option --kind"),
        ("excite zittau_axial --filter linear", "there is no option --filter"),
        ("excite zittau_axial --limit 5kg", 'limit must be a current or a length such as "2 A"'),
        ("assess zittau_axial --disturbance 500N", "no control current from -1.5 to 1.5 A holds"),
        ("tune trade-off zittau_axial --peaks x", "invalid float value: 'x'"),
        ("tune zittau_axial --max-sensitivity 1", "max_sensitivity must be above 1.02"),
        ("faults zittau_axial --filter ukv", 'no filter "ukv"; known: low-pass'),
        ("faults zittau_axial --faults gremlin", 'no fault "gremlin"; known: lift-off'),
        ("faults zittau_axial --precision half", "invalid choice: 'half'"),
        (
            "faults zittau_axial --filter linear --samples 9",
            "samples = 9 is too short for a fault and its recovery",
        ),
        ("compare zittau_axial --seeds 0", "seeds must be a number N of them from 1 on"),
        ("compare zittau_axial --case papers", 'no case "papers"; known: paper, uncertain'),
        ("compare zittau_axial --filter ukv", 'no filter "ukv"; known: low-pass'),
        ("compare zittau_axial --spread 120%", "spread must be from 0 to below 100 %, is 120 %"),
        ("compare steps zittau_axial --disturbance 3N --budget 5", "there is no option --budget"),
        (
            "compare steps zittau_axial --steps 1mm --steps two",
            'steps must be in m: "two" is not a number',
        ),
        ("presets zittau", 'no preset "zittau"; did you mean zittau_axial?'),
        ("check", "required: FILE"),
        ("check missing.toml", "missing.toml: cannot be read"),
        ("check strange.xyz", 'there is no preset and no file "strange.xyz"'),
    ],
)
def test_what_the_user_did_wrong_is_one_message(call, made, tmp_path, arguments, message):
    files = {"RUN": made / "run.csv", "POINTS": made / "points.csv"}
    found = call(*(files.get(word, word) for word in shlex.split(arguments)))
    assert found.code == 2
    assert message in found.err
    assert found.out == ""
    assert len(found.err.splitlines()) <= 2
    assert list(tmp_path.iterdir()) == []


def damaged(record, **signals):
    return ambkit.Record(record.t, {**record.signals, **signals}, record.units, record.meta)


def test_missing_samples_are_counted_not_filtered(call, made):
    record = ambkit.Record.load(made / "run.csv")
    y, u = record["y"].copy(), record["u"].copy()
    y[100:103] = u[200:202] = np.nan
    damaged(record, y=y, u=u).save("gaps.csv")
    said = call("filter", "gaps.csv", "--machine", "zittau_axial", "--filter", "linear", "--out",
                "e.csv", "--json")  # fmt: skip
    found = said.json["estimators"]["linear"]
    assert found["status"] == {"missing": 3, "bad_control": 2}
    assert f"missing in 2 of {len(record)} samples, at most 2 in a row" in said.out
    assert found["used"] == found["samples"] - 3
    assert np.isfinite(ambkit.Record.load("e.csv")["x"]).all()


# As a process


def test_a_real_call_keeps_stdout_for_the_results(tmp_path):
    arguments = ("simulate", "zittau_axial", "--duration", "20 ms", "--out", "r.csv", "--json")
    found = real(*arguments, cwd=tmp_path)
    assert found.code == 0
    assert json.loads(found.out)["files"] == ["r.csv"]
    assert found.err == "wrote r.csv\n"
    assert [path.name for path in tmp_path.iterdir()] == ["r.csv"]


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder nobody can write to")
def test_a_folder_that_cannot_be_written(tmp_path):
    for command in (
        ("simulate", "zittau_axial", "--duration", "20 ms", "--out", "/proc/self/r.csv"),
        ("presets", "zittau_axial", "--out", "/proc/self/b.toml"),
        ("reproduce", "--out", "/proc/self/out"),
    ):
        found = real(*command)
        assert found.code == 2
        assert found.out == ""
        assert re.fullmatch(r"ambkit: .*/proc/self.*\n", found.err.replace("\ntry ", " "))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root writes anywhere")
def test_a_folder_without_permission(call, tmp_path):
    (tmp_path / "locked").mkdir(mode=0o500)
    found = call("simulate", "zittau_axial", "--out", "locked/r.csv")
    assert found.code == 2
    assert "the folder locked cannot be written" in found.err


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send")
def test_ctrl_c_leaves_the_old_file_and_says_so(tmp_path):
    old = tmp_path / "scores.csv"
    old.write_text("old")
    command = ["compare", "steps", "zittau_axial", "--filter", "linear", "--steps", "0.1 mm",
               "--seeds", "40000", "--out", "scores.csv"]  # fmt: skip
    # Until Python has started, Ctrl-C is the interpreter's alone: the command says when it is not.
    started = "from ambkit.cli.main import main; print('started', flush=True); main()"
    # A test that runs in the background inherits that SIGINT is ignored.
    with subprocess.Popen(
        [sys.executable, "-c", started, *command],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:  # fmt: skip
        assert process.stdout.readline() == "started\n"
        time.sleep(2)
        process.send_signal(signal.SIGINT)
        try:
            out, err = process.communicate(timeout=60)  # all 40,000 would take longer
        finally:
            process.kill()
    assert process.returncode == 130
    assert out == ""
    assert err == "\ninterrupted; nothing was written\n"
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


def test_filter_says_when_a_record_is_not_of_the_bearing(call, made):
    record = ambkit.Record.load(made / "run.csv")
    signals = {"y": 1.5 * record["y"], "u": -record["u"]}
    ambkit.Record(record.t, signals, {"y": "m", "u": "V"}).save("turned.csv")
    found = call("filter", "turned.csv", "--machine", "zittau_axial", "--filter", "linear",
                 "--disturbance-noise", "1e-3 N^2/s")  # fmt: skip
    assert found.code == 0
    assert "times what the filter expects" in found.out
    good = call("filter", made / "run.csv", "--machine", "zittau_axial")
    assert "times what" not in good.out


def test_identify_replaces_what_turns_and_area_gave(call, made):
    bearing = ambkit.preset("zittau_axial")
    turns = 100
    area = 4 * bearing.magnet.magnet_constant / (ambkit.machine.parts.MU_0 * turns**2)
    wound = bearing.to_toml().replace(
        next(line for line in bearing.to_toml().splitlines() if line.startswith("magnet_constant")),
        f'turns = {turns}\npole_area = "{area!r} m^2"',
    )
    Path("wound.toml").write_text(wound)
    names = ("magnet_constant", "air_gap", "position_offset", "current_offset", "measurement_noise")
    free = [word for name in names for word in ("--free", name)]
    found = call("identify", "wound.toml", made / "run.csv", *free, "--out", "found.toml",
                 "--json")  # fmt: skip
    assert found.code == 0, found.err
    k = found.json["parameters"]["magnet_constant"]
    low, high = k["interval_95"]  # offsets unknown: this run tells little of k
    assert low < bearing.magnet.magnet_constant < high
    written = ambkit.Machine.load("found.toml").magnet
    assert written.magnet_constant == pytest.approx(k["value"], rel=1e-6)
    assert (written.turns, written.pole_area) == (None, None)
    plain = call("identify", "zittau_axial", made / "run.csv", *free, "--json")
    assert plain.json["parameters"]["magnet_constant"]["value"] == pytest.approx(k["value"])
