"""A machine's filter as C: its self-test, compiled, gives Python's bits."""

from __future__ import annotations

import shutil
import subprocess
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from export_cases import program
from machine_cases import AND_LONG, machine
from quick import quick

from ambkit import AmbkitError, Machine, Scenario
from ambkit.estimate.registry import KINDS
from ambkit.export.c import export_c

COMPILER = shutil.which("gcc") or shutil.which("clang")
compiled = pytest.mark.skipif(COMPILER is None, reason="no C compiler (gcc or clang) here")
FLOWN = {
    "estimate": Scenario(feedback="estimate"),
    "measurement": Scenario(feedback="measurement"),
}
KINDS_OF_C = ("linear", "closed-law", "extended", "ud", "augmented", "multiple-model", "unscented")


def printed_by(folder: Path) -> str:
    done = program(str(COMPILER), folder, folder / "selftest.out")
    assert done.returncode == 0, done.stderr
    return subprocess.run([folder / "selftest.out"], capture_output=True, text=True).stdout


@compiled
@pytest.mark.parametrize("kind", KINDS_OF_C)
@pytest.mark.parametrize("loops", [None, False])
def test_each_kind_gives_the_same_bits(kind: str, loops: bool | None, tmp_path: Path) -> None:
    one = machine()
    magnet = None if kind == "linear" else KINDS[kind].magnet(one)  # type: ignore[misc]
    export_c(one, magnet, tmp_path / "c", kind=kind, prefix="f", loops=loops)
    assert "equal to the last bit" in printed_by(tmp_path / "c")


@compiled
@pytest.mark.parametrize("name", AND_LONG)
@pytest.mark.parametrize("precision", ["float", "double"])
def test_each_preset_gives_the_same_bits(name: str, precision: str, tmp_path: Path) -> None:
    made = export_c(Machine.preset(name), None, tmp_path / "c", precision=precision)  # type: ignore[arg-type]
    assert "equal to the last bit" in printed_by(tmp_path / "c")
    header = (tmp_path / "c" / f"{made.name}.h").read_text()
    assert "amb_real th_x;" in header
    assert "A1, A2, B1, B2" in header


FUSED = ("-O2", "-ffp-contract=fast", "-march=native")
"""What gcc and clang take by default for aarch64, or for this processor."""


def fuses(compiler: str) -> bool:
    words = [compiler, *FUSED, "-dM", "-E", "-x", "c", "/dev/null"]
    defined = subprocess.run(words, capture_output=True, text=True).stdout
    return "__FMA__" in defined or "__aarch64__" in defined


@pytest.mark.parametrize(
    ("name", "flight", "precision", "compiler"),
    quick(
        [
            *product(
                ("tum_mlps", "ufu_flexible", "compressor", "tum_mlps_flexible"), FLOWN,
                ("float", "double"), ("gcc", "clang"),
            ),
        ],
        [("tum_mlps", "measurement", "float", "clang"),
         ("ufu_flexible", "estimate", "double", "gcc")],
    ),
)  # fmt: skip
def test_contraction_is_let_pass(
    name: str, flight: str, precision: Any, compiler: str, tmp_path: Path
) -> None:
    """Where rounding is amplified, the self-test asks only those for bits that promise them."""
    if shutil.which(compiler) is None or not fuses(compiler):
        pytest.skip(f"{compiler} is not there, or this processor fuses nothing")
    machine = Machine.preset(name)
    export_c(machine, None, tmp_path / "c", precision=precision, scenario=FLOWN[flight], prefix="f")
    done = program(compiler, tmp_path / "c", tmp_path / "out", flags=FUSED)
    assert done.returncode == 0, done.stderr
    said = subprocess.run([tmp_path / "out"], capture_output=True, text=True)
    assert said.returncode == 0, said.stdout
    assert "let pass" in said.stdout  # bits differ, or it says nothing


def test_what_cannot_be_exported_says_so(tmp_path: Path) -> None:
    with pytest.raises(AmbkitError, match="one axis"):
        export_c(machine(), None, tmp_path / "c", kind="observer")


def test_the_configuration_changes_with_the_machine(tmp_path: Path) -> None:
    first = export_c(machine(), None, tmp_path / "a")
    again = export_c(machine(), None, tmp_path / "b")
    other = export_c(machine(speed=501.0), None, tmp_path / "c")
    assert first.configuration == again.configuration != other.configuration
