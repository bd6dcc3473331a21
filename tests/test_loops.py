"""The build that runs any model by loops, as the built-in axis; other models: test_models_emit."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
CORE = sorted((ROOT / "core" / "src").glob("*.c"))
FLAGS = [
    "-std=c99",
    "-O3",
    "-ffp-contract=off",
    "-fno-trapping-math",
    *(f"-I{ROOT / folder}" for folder in ("core/include", "core", "tests/c")),
]


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.long
@pytest.mark.parametrize("precision", ["-DAMB_DOUBLE", "-DAMB_FLOAT"])
def test_the_axis_by_loops_is_the_axis_built_in_to_the_last_bit(precision, tmp_path):
    """18,000 steps of every kind, with faults in between; a record, and the same smoothed."""
    here, axis = ROOT / "tests" / "c", tmp_path / "axis.o"
    words = ["gcc", *FLAGS, precision, "-c", here / "axis.c", "-o", axis]
    subprocess.run(words, check=True)
    printed = []
    for build in ([precision], [precision, "-DAMB_MODEL_LOOPS"]):
        program = tmp_path / f"print{len(build)}"
        words = ["gcc", *FLAGS, *build]
        words += [here / "print_steps.c", *CORE, axis, "-lm", "-o", program]
        subprocess.run(words, check=True)
        done = subprocess.run([program], capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        printed.append(done.stdout.splitlines())
    built_in, loops = printed
    differing = [pair for pair in zip(built_in, loops, strict=True) if pair[0] != pair[1]]
    assert differing == []
    last = [line.split() for line in built_in if line.startswith(" step 17999 ")]
    assert len(last) == 18  # nine kinds, each twice
    raised = 0
    for words in last:
        raised |= int(words[-1])
    # Missing, frozen, saturated, bad control, held, outlier, restarted: nothing was left out.
    assert raised & 0b1001_0010_1111 == 0b1001_0010_1111
    assert not any("nan" in line or "inf" in line for line in built_in)
