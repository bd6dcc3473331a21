"""What the commands refuse, or say, so that nobody loses a file or trusts a wrong number."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ambkit.base.errors import RecordError, shortened

LOG = "t,y,u\n" + "".join(
    f"{k * 1e-3:.4f},{1e-3 * np.sin(k / 50):.6f},{-np.sin(k / 50):.4f}\n"
    for k in range(600)
    if not 200 < k < 300
)


@pytest.fixture
def refused(call):
    """Call a command that must fail with exit code 2; return what it says."""

    def told(*arguments):
        done = call(*arguments)
        assert done.code == 2
        return done.err

    return told


@pytest.mark.parametrize("name", ["log.csv", "./log.csv", "link.csv"])
@pytest.mark.parametrize(
    "command",
    [
        ["read", "log.csv", "--channels", "map.toml"],
        ["filter", "log.csv", "--machine", "zittau_axial"],
        ["simulate", "zittau_axial", "--signal", "log.csv"],
        ["identify", "log.csv", "run.csv"],  # in the machine's place
    ],
)
def test_no_command_overwrites_what_it_reads(refused, tmp_path, command, name):
    (tmp_path / "log.csv").write_text(LOG)
    (tmp_path / "link.csv").symlink_to("log.csv")
    assert f"--out: {name.removeprefix('./')} is read" in refused(*command, "--out", name)
    assert (tmp_path / "log.csv").read_text() == LOG


def test_an_estimator_that_cannot_be_made_is_one_message(refused, tmp_path):
    source = "class Mine:\n    def __init__(self, bearing):\n        raise KeyError('mass')\n"
    (tmp_path / "est.py").write_text(source)
    told = refused("compare", "zittau_axial", "--filter", "est.py:Mine", "--seeds", "1")
    assert told.strip().endswith("Mine: it is made with the machine, and fails: KeyError: 'mass'")


def test_no_estimator_is_not_all_of_them(refused):
    assert "known: " in refused("compare", "zittau_axial", "--filter", "")


@pytest.mark.parametrize("clock", ["-5 Hz", "0 Hz"])
def test_a_clock_that_stands_is_refused(refused, clock):
    assert "greater than 0 Hz" in refused("export", "cost", "zittau_axial", "--clock", clock)


def test_a_mat_file_takes_an_expert(refused, tmp_path):
    (tmp_path / "my.toml").write_text("name = 1\n")
    start = ("export", "mat", "zittau_axial", "--out", "b.mat", "--filter")
    assert "kind: missing" in refused(*start, "my.toml")
    assert "adaptive can" in refused(*start, "extended")


def test_an_option_that_is_taken_once_is_given_once(refused):
    twice = ("simulate", "zittau_axial", "--step", "1 mm", "--step=2 mm")
    assert "--step is given more than once" in refused(*twice)


def test_a_loop_at_the_stop_is_reported(call):
    far = ("--steps", "0.1 mm", "--steps", "5 mm", "--seeds", "1")
    out = call("compare", "steps", "zittau_axial", *far).out
    assert "5 mm, linear: contact with the stop in 1 of 1 runs" in out
    assert "100 µm, linear: the rotor" not in out


def test_problems_are_counted_with_those_that_are_not_listed():
    told = str(RecordError(shortened([f"line {k}" for k in range(250)]), "log.csv"))
    assert told.startswith("250 problems in log.csv:")
    assert told.endswith("and 240 more")


def test_a_guess_invents_no_sampling_time(call, refused, tmp_path):
    lines = LOG.splitlines()
    rows = [f"run {k},{line[7:]}" for k, line in enumerate(lines[1:])]
    (tmp_path / "log.csv").write_text("\n".join(["when,y,u", *rows]) + "\n")
    proposed = call("read", "guess", "log.csv").out
    assert "columns without numbers are not read: when" in proposed.lower()
    (tmp_path / "map.toml").write_text(proposed)
    assert "give sampling_time" in refused("read", "log.csv", "--channels", "map.toml")


def test_samples_missing_in_a_gap_are_counted(tmp_path):
    from ambkit.data.reading.propose import guess
    from ambkit.data.reading.reader import read

    log, proposed = tmp_path / "log.csv", tmp_path / "map.toml"
    log.write_text(LOG)
    proposed.write_text(guess(log))
    reading = read(log, proposed)
    for channel in reading.channels:
        assert channel.missing == np.isnan(reading.record[channel.name]).sum() == 99
        assert channel.samples == len(reading.record)


def test_a_python_that_is_only_a_shim_is_quiet(tmp_path):
    (tmp_path / "python3.13").write_text("#!/bin/sh\necho 'pyenv: not found' >&2\nexit 127\n")
    (tmp_path / "python3.13").chmod(0o755)
    script = (
        (Path(__file__).parents[1] / "tools/setup.sh")
        .read_text()
        .partition('[ -n "${PYTHON:-}" ]')[0]
    )
    done = subprocess.run(
        [shutil.which("bash") or "bash", "-c", script],
        env={"PATH": f"{tmp_path}:/usr/bin:/bin"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stderr == ""
