"""The proof that an export ships: its script, what it records, and that it sees what is wrong."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from ambkit.export.c import CExport, proof
from ambkit.export.c.data import CPrecision
from firmware import proof as prover

Exported = Callable[..., CExport]
STORED = json.loads(proof.STORED.read_text(encoding="utf-8"))

needs_frama_c = pytest.mark.skipif(
    shutil.which("frama-c") is None, reason="Frama-C (frama-c-base) is not installed"
)


def test_what_is_shown_of_a_kind_is_recorded_in_both_precisions() -> None:
    shown = {name for name, left in STORED["filters"].items() if not any(left.values())}
    assert {"Kalman, Constant, float", "Kalman, Constant, double"} <= shown


@pytest.mark.parametrize("kind", ["linear", "adaptive"])
def test_the_readme_says_what_was_recorded_and_no_more(exported: Exported, kind: str) -> None:
    made = exported(kind)
    text = (made.folder / "proof" / "README.md").read_text(encoding="utf-8")
    magnet = "Constant" if kind == "linear" else "Fuzzy"
    recorded = STORED["filters"].get(f"Kalman, {magnet}, float")
    assert ("That was a whole proof." in text) == (
        recorded is not None and not any(recorded.values())
    )
    assert ("this kind of filter was not analysed" in text) == (recorded is None)
    if recorded is not None:
        assert STORED["tool"] in text
        assert f"| finite inputs | {recorded['finite']} | |" in text
        assert f"| any inputs | {recorded['any']} | {recorded['open']} |" in text


def test_every_output_is_asked_for(exported: Exported) -> None:
    made = exported("linear")
    header = (made.folder / f"{made.name}.h").read_text(encoding="utf-8")
    (body,) = re.findall(r"_estimates \{(.*?)\}", header, re.DOTALL)
    numbers = re.findall(r"^\s*amb_real (\w+);", body, re.MULTILINE)
    harness = (made.folder / "proof" / f"{made.name}_proof.c").read_text(encoding="utf-8")
    assert re.findall(r"is_finite\(now\.(\w+)\)", harness) == numbers
    assert len(numbers) == 8


@pytest.mark.long
@needs_frama_c
@pytest.mark.parametrize("precision", ["float", "double"])
def test_what_is_recorded_of_the_linear_filter_comes_out(
    precision: CPrecision, tmp_path: Path
) -> None:
    name, left, said = prover.prove("linear", precision, tmp_path / "out")
    assert left == STORED["filters"][name] == {"finite": 0, "any": 0, "open": 0}, said


@pytest.mark.long
@needs_frama_c
def test_the_proof_fails_where_the_supervisor_looks_away(
    exported: Exported, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    made = exported("linear")
    shutil.copytree(made.folder, folder)
    path = folder / "core" / "src" / "envelope.c"
    text = path.read_text(encoding="utf-8")
    checked = "if (!AMB_WITHIN(cov[i], kf->most[i])) {"
    assert checked in text
    path.write_text(text.replace(checked, "if (false) {"), encoding="utf-8")
    command = ["sh", str(folder / "proof" / "prove.sh")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    alarms = [int(n) for _, n, _ in prover.SAID.findall(done.stdout)]
    assert alarms[0] > 0
