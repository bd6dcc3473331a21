"""Exports of axes with more parts than the paper's: their own model in C, as code or as arrays."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from export_cases import BEARING, program
from quick import quick

from ambkit.base.errors import AmbkitError
from ambkit.estimate.registry import KINDS
from ambkit.export.c import CExport, export_c
from ambkit.export.c.model import MOST_UNROLLED, states
from ambkit.models.model import Descriptor

COMPILER = shutil.which("gcc") or shutil.which("clang")
compiled = pytest.mark.skipif(COMPILER is None, reason="no C compiler (gcc or clang) here")

NOISE = {"variance": 1e-12, "bandwidth": 200.0}
LATE = 1.5 * BEARING.sampling_time


def hum(*frequencies: float) -> list[dict[str, float]]:
    return [{"frequency": f, "amplitude": 5e-6, "bandwidth": 0.5} for f in frequencies]


AXES = {
    "amplifier": BEARING.replace(amplifier__bandwidth=2000.0),
    "delay": BEARING.replace(delay=LATE),
    "noise": BEARING.replace(sensor__coloured_noise=NOISE),
    "hum": BEARING.replace(sensor__hum=hum(50.0)),
    "all": BEARING.replace(
        delay=LATE,
        amplifier__bandwidth=2000.0,
        sensor__coloured_noise=NOISE,
        sensor__hum=hum(50.0),
    ),
}
# One of each C file; those that have a constant gain or no model are further below.
ESTIMATORS = (
    "linear", "closed-law", "extended", "ud", "augmented", "multiple-model", "unscented",
    "observer", "steady-state", "extended-adaptive-noise", "linear-adaptive-noise",
)  # fmt: skip


def made(axis: Any, kind: str, out: Path, **options: Any) -> CExport:
    magnet = None if kind == "linear" else KINDS[kind].magnet(axis)  # type: ignore[misc]
    return export_c(axis, magnet, out, kind=kind, prefix="f", **options)


def printed_by(folder: Path) -> str:
    """What the self-test prints, compiled with all warnings and, since many are, in a hurry."""
    done = program(str(COMPILER), folder, folder / "selftest.out")
    assert done.returncode == 0, done.stderr
    return subprocess.run([folder / "selftest.out"], capture_output=True, text=True).stdout


@compiled
@pytest.mark.parametrize("kind", quick(ESTIMATORS, {"linear", "augmented", "observer"}))
def test_an_axis_of_all_parts_has_python_s_bits(kind: str, tmp_path: Path) -> None:
    for precision, loops in (("double", False), ("double", True), ("float", None)):
        out = tmp_path / f"{precision}{loops}"
        made(AXES["all"], kind, out, precision=precision, loops=loops)
        assert "equal to the last bit" in printed_by(out), (precision, loops)


@compiled
@pytest.mark.parametrize("axis", AXES)
def test_each_part_has_python_s_bits(axis: str, tmp_path: Path) -> None:
    for kind in ("linear", "extended"):
        for loops in (False, True):
            out = tmp_path / f"{kind}{loops}"
            made(AXES[axis], kind, out, precision="double", loops=loops)
            assert "equal to the last bit" in printed_by(out), (kind, loops)


@compiled
def test_a_large_model_is_computed_by_loops(tmp_path: Path) -> None:
    large = BEARING.replace(sensor__hum=hum(50.0, 100.0, 150.0, 300.0, 600.0))
    export = made(large, "extended", tmp_path)
    assert "core/src/loops.c" in export.files
    assert "core/generated/model.h" not in export.files
    (states,) = re.findall(
        r"#define AMB_STATES (\d+)", (tmp_path / "core/include/ambkit/precision.h").read_text()
    )
    assert int(states) == 4 + 2 * 5 > MOST_UNROLLED
    assert "equal to the last bit" in printed_by(tmp_path)


def test_its_header_names_its_states(tmp_path: Path) -> None:
    export = made(AXES["all"], "linear", tmp_path)
    header = (tmp_path / "f.h").read_text()
    (fields,) = re.findall(r"typedef struct f_estimates \{\n(.*?)\n\}", header, re.DOTALL)
    names = re.findall(r"amb_real (\w+);", fields)
    assert names[:4] == ["x", "v", "f_d", "x_m"]
    assert {"i", "u_1", "u_2", "hum_c", "hum_s"} < set(names)
    assert names[-4:] == ["k_i", "k_s", "innovation", "variance"]
    model = (tmp_path / "core" / "generated" / "model.h").read_text()
    assert f"#define AMB_STATES {len(names) - 4}\n" in model
    assert "core/include/ambkit/loops.h" not in export.files
    assert max(map(len, model.splitlines())) <= 100
    assert export.cost is None


def test_a_state_of_a_name_that_c_has_gets_another() -> None:
    described = [Descriptor(n, "m", 1.0, "noise") for n in ("x", "double", "k_i", "feed_back")]
    assert [s.field for s in states(described)] == ["x", "double_", "k_i_", "feed_back_"]


def test_the_paper_s_axis_has_no_loops(tmp_path: Path) -> None:
    with pytest.raises(AmbkitError, match="loops are for other models"):
        made(BEARING, "linear", tmp_path / "out", loops=True)
    assert not (tmp_path / "out").exists()
