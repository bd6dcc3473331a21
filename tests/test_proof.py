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

OF = {"linear": "Kalman, Constant", "multiple-model": "MultipleModel, 5 models, Law"}

needs_frama_c = pytest.mark.skipif(
    shutil.which("frama-c") is None, reason="Frama-C (frama-c-base) is not installed"
)


def test_of_every_kind_it_is_recorded_in_both_precisions_that_nothing_is_left() -> None:
    names = [prover.stored_as(kind, each) for kind in prover.NAMES for each in prover.PRECISIONS]
    assert set(STORED["filters"]) == set(names)
    left = [name for name, found in STORED["filters"].items() if any(found.values())]
    assert left == []


def test_the_table_is_what_is_recorded() -> None:
    """Otherwise: python -m firmware.proof."""
    readme = Path(prover.__file__).with_name("README.md").read_text(encoding="utf-8")
    assert prover.table() in readme


@pytest.mark.parametrize("kind", ["linear", "multiple-model"])
def test_the_readme_says_what_was_recorded_and_no_more(exported: Exported, kind: str) -> None:
    made = exported(kind)
    text = (made.folder / "proof" / "README.md").read_text(encoding="utf-8")
    recorded = STORED["filters"][OF[kind] + ", float"]
    assert STORED["tool"] in text
    assert f"| finite inputs | {recorded['finite']} | |" in text
    assert f"| any inputs | {recorded['any']} | {recorded['open']} |" in text
    assert "That was a whole proof." in text
    assert "was not analysed" not in text


def test_every_output_is_asked_for(exported: Exported) -> None:
    made = exported("linear")
    header = (made.folder / f"{made.name}.h").read_text(encoding="utf-8")
    (body,) = re.findall(r"_estimates \{(.*?)\}", header, re.DOTALL)
    numbers = re.findall(r"^\s*amb_real (\w+);", body, re.MULTILINE)
    harness = (made.folder / "proof" / f"{made.name}_proof.c").read_text(encoding="utf-8")
    assert re.findall(r"is_finite\(now\.(\w+)\)", harness) == numbers
    assert len(numbers) == 8


@pytest.mark.study
@needs_frama_c
@pytest.mark.parametrize(("kind", "precision"), [("linear", "double"), ("unscented", "float")])
def test_what_is_recorded_comes_out(kind: str, precision: CPrecision, tmp_path: Path) -> None:
    """Of the others: python -m firmware.proof all."""
    name, left, said = prover.prove(kind, precision, tmp_path / "out")
    assert left == STORED["filters"][name] == {"finite": 0, "any": 0, "open": 0}, said


@pytest.mark.study
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
