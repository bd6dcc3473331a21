"""Each script in examples/ runs, and finds what it says it shows."""

import re
import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest

import ambkit
from ambkit.judge.evaluation import evaluate

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run an example as a user would, in a folder of its own; return what it printed."""

    def run(name):
        monkeypatch.chdir(tmp_path)
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return run


def numbers(pattern, text):
    """Return the groups of the only match."""
    (match,) = re.finditer(pattern, text)
    return [float(number) for number in match.groups()]


def test_every_example_is_tested():
    here = Path(__file__).read_text(encoding="utf-8")
    scripts = {path.name for path in EXAMPLES.glob("*.py")}
    assert {name for name in scripts if f'run("{name}")' not in here} == {"thread.py"}  # a notebook


def test_own_bearing(run, tmp_path):
    printed = run("own_bearing.py")
    bearing = ambkit.Machine.load(EXAMPLES / "spindle.toml")
    position, force = numbers(
        r"position to ([\d.]+) µm rms, disturbance force to ([\d.]+) N", printed
    )
    assert position < 1e6 * np.sqrt(bearing.sensor.noise_variance)
    assert force < 10  # of a load of 40 N
    assert ambkit.Record.load(tmp_path / "spindle.csv").has_truth
    assert (tmp_path / "spindle.png").is_file()


def test_own_recording(run, tmp_path):
    printed = run("own_recording.py")
    for ahead in (1, 10):
        ours, held, logged = numbers(
            rf"\b{ahead} samples ahead: ([\d.]+) .*held ([\d.]+), .*filter ([\d.]+)", printed
        )
        assert ours < held < logged
    assert (tmp_path / "recording.png").is_file()


def test_a_log_means_the_same_around_another_point():
    """The channel map and the bearing shift together: the closed law predicts as before."""
    log = EXAMPLES / "recordings" / "sinus_kalman.csv"
    here = ambkit.preset("inteco_ml")
    there = here.replace(magnet__air_gap="11.149 mm", magnet__bias_current="0.8587 A")
    errors = []
    for bearing, channel_map in ((here, None), (there, EXAMPLES / "shifted_map.toml")):
        kalman = ambkit.AdaptiveKalmanFilter(
            bearing, ambkit.ClosedLaw(bearing), noise=ambkit.FilterNoise(disturbance=1e-4)
        )
        found = evaluate(kalman, ambkit.load(log, channel_map), settling=1.5)
        errors.append([found.prediction[1], found.prediction[10], found.nis])
    np.testing.assert_allclose(errors[0], errors[1], rtol=2e-3)


def test_force_table(run):
    printed = run("force_table.py")
    expert, law = numbers(r"expert ([\d.]+) N rms, closed law ([\d.]+) N rms", printed)
    assert expert < 0.1 < law
    error = {
        name: numbers(rf"{name}: error of the disturbance force ([\d.]+) ± [\d.]+ N", printed)[0]
        for name in ("linear", "closed law", "expert")
    }
    assert error["expert"] < 0.8 * error["linear"]
    assert error["expert"] < 0.8 * error["closed law"]
    readme = " ".join((EXAMPLES.parent / "README.md").read_text(encoding="utf-8").split())
    assert (
        f"{error['expert']:.2f} N with the expert, {error['linear']:.2f} N with the linear "
        f"filter, {error['closed law']:.2f} N with the closed law"
    ) in readme


def test_compare_filters(run, tmp_path):
    printed = run("compare_filters.py")
    found = re.findall(r"0\.5 mm +([\w, -]+): x ([\d.]+) µm, f_d ([\d.]+) ±", printed)
    position = {name.strip(): float(x) for name, x, _ in found}
    force = {name.strip(): float(f) for name, _, f in found}
    assert max(position.values()) < 1.05 * min(position.values())
    assert force["linear"] > force["adaptive"] > force["adaptive, wide"]
    assert force["adaptive, wide"] == pytest.approx(force["closed-law"], rel=0.05)
    assert (tmp_path / "comparison.png").is_file()


def test_rig_without_its_logs_says_so(run, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["rig.py", "nowhere"])
    with pytest.raises(SystemExit) as left:
        run("rig.py")
    assert not left.value.code
    assert "no logs in nowhere" in capsys.readouterr().out


def test_the_notebook_is_the_script():
    writer = runpy.run_path(str(EXAMPLES.parent / "docs" / "make_notebook.py"))
    script, made = (EXAMPLES / f"thread.{ending}" for ending in ("py", "ipynb"))
    assert made.read_text(encoding="utf-8") == writer["notebook"](script.read_text("utf-8"))


@pytest.mark.long
def test_the_notebook_runs(tmp_path):
    """The filter from the log is as good as one that was told everything, and C has its bits."""
    nbformat = pytest.importorskip("nbformat", reason="comes with the documentation's tools")
    nbclient = pytest.importorskip("nbclient", reason="comes with the documentation's tools")
    notebook = nbformat.read(EXAMPLES / "thread.ipynb", as_version=4)
    nbformat.validate(notebook)
    nbclient.NotebookClient(
        notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    printed = "".join(
        output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", [])
    )
    weaker, delay = numbers(r"([\d.]+) % weaker than drawn, the delay ([\d.]+) ms", printed)
    assert weaker == pytest.approx(6, abs=0.6)
    assert delay == pytest.approx(0.15, abs=0.006)
    assert "Use the " in printed
    if any(map(shutil.which, ("cc", "gcc", "clang"))):
        assert "12001 samples of the rig's numbers in C: 0 states differ from Python's." in printed
    for name in ("x", "v", "f_d"):
        *_, worst = numbers(
            rf"\b{name}: .* rms, (-?[\d.]+) ± ([\d.]+) % more than .*, (-?[\d.]+) % at worst",
            printed,
        )
        assert worst < 10
    assert (tmp_path / "thread" / "flying.png").is_file()
