"""What a user's editor and mypy --strict see of ambkit: py.typed, and types that say something."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import ambkit

SCRIPT = Path(__file__).parent / "user" / "script.py"
WRONG = """
import ambkit
bearing = ambkit.preset(3)
kalman = ambkit.KalmanFilter("bearing", noise=1e-3)
estimate = kalman.run([0.0, 1.0])
reveal_type(kalman.run)
reveal_type(ambkit.train)
ambkit.no_such_name
"""


def mypy(folder, *files):
    """What mypy says without any configuration, as strict as it can be."""
    options = ["--strict", "--config-file=", f"--cache-dir={folder}", "--no-error-summary"]
    command = [sys.executable, "-m", "mypy", *options, *map(str, files)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600).stdout


@pytest.mark.long
def test_strict_types_pass_and_wrong_ones_do_not(tmp_path):
    wrong = tmp_path / "wrong.py"
    wrong.write_text(WRONG)
    said = mypy(tmp_path, SCRIPT, wrong)
    assert "script.py" not in said
    found = {int(line) for line in re.findall(r"^wrong\.py:(\d+): error", said, re.M)}
    assert found == {3, 4, 5, 8}
    revealed = re.findall(r"Revealed type is .*", said)
    assert len(revealed) == 2
    assert all("Any" not in each.split("->")[-1] for each in revealed)
    assert "Estimate" in revealed[0]


def test_the_script_has_all_public_names():
    used = set(re.findall(r"(?<!from )\bambkit\.(\w+)", SCRIPT.read_text(encoding="utf-8")))
    assert used == set(ambkit.__all__)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_script_runs(capsys):
    pytest.importorskip("control")
    runpy.run_path(str(SCRIPT), run_name="__main__")
    assert ambkit.__version__ in capsys.readouterr().out
