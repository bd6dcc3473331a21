"""The proof that an export ships: its script, what it records, and that it sees what is wrong."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from export_cases import KINDS, command, export
from exporting import export_c
from quick import quick

from ambkit import Machine, Scenario
from ambkit.control.control import LiftOff
from ambkit.control.pid import PID
from ambkit.export.c import proof
from firmware import proof as prover

STORED = json.loads(proof.STORED.read_text(encoding="utf-8"))

LEFT = ("finite", "any", "open")
OF = {"linear": "Kalman, Constant", "multiple-model": "MultipleModel, 5 models, Law"}

needs_frama_c = pytest.mark.skipif(
    shutil.which("frama-c") is None, reason="Frama-C (frama-c-base) is not installed"
)


CASES = [
    (kind, law, precision) for precision in prover.PRECISIONS for kind in prover.NAMES
    for law in (None, *prover.controllers(kind))
]  # fmt: skip


def stored_of(kind, law, precision):
    of = STORED["filters" if law is None else "controllers"]
    return of[prover.stored_as(kind, precision, prover.CONTROLLERS.get(law))]


def test_of_every_kind_it_is_recorded_in_both_precisions_that_nothing_is_left():
    stored = STORED["filters"] | STORED["controllers"]
    assert len(stored) == len(CASES)
    left = {name: [found[key] for key in LEFT] for name, found in stored.items()}
    assert [name for name, found in left.items() if any(found)] == []


@pytest.mark.parametrize(
    ("kind", "law", "precision"), quick(CASES, [case for case in CASES if case[-1] == "float"])
)
def test_what_is_recorded_is_of_the_c_as_it_is_now(kind, law, precision, tmp_path):
    """Otherwise: python -m firmware.proof KIND."""
    made = prover.exported(kind, precision, tmp_path / "c", prover.CONTROLLERS.get(law))
    found = stored_of(kind, law, precision)
    assert prover.hashes(made).items() <= found.items()
    for other in prover.PRECISIONS:  # of the double one, the text is compared in the long tests
        assert stored_of(kind, law, other)["core"] == found["core"]


def test_a_hash_sees_all_but_comments_and_the_tag_of_the_core():
    text = "/*@ requires x; */\nint amb_f01234a_f(int x) /* why */\n{\n  return x;\n}\n"
    same = text.replace("/* why */", "").replace("f01234a", "d98765b").replace("\n", "\n\n")
    assert proof.hashed({"a.c": text}) == proof.hashed({"a.c": same, "selftest/b.c": "int b;"})
    for other in (
        {"a.c": text.replace("x; */", "y; */")}, {"a.c": text.replace("return x", "return 0")},
        {"b.c": text}, {"a.c": text, "proof/prove.sh": "frama-c"},
    ):  # fmt: skip
        assert proof.hashed(other) != proof.hashed({"a.c": text})


def test_of_other_c_than_the_proved_one_no_proof_is_stated(tmp_path):
    readme = (export("linear", tmp_path / "c", telemetry=True).folder / "README.md").read_text()
    assert "- Not proved: that no input leads to" in readme


def test_the_table_is_what_is_recorded():
    """Otherwise: python -m firmware.proof."""
    readme = Path(prover.__file__).with_name("README.md").read_text(encoding="utf-8")
    assert prover.table() in readme


@pytest.mark.parametrize("kind", ["linear", "multiple-model"])
def test_the_readme_says_what_was_recorded_and_no_more(exported, kind):
    text = (exported(kind).folder / "proof" / "README.md").read_text(encoding="utf-8")
    recorded = STORED["filters"][OF[kind] + ", float"]
    assert STORED["tool"] in text
    assert f"| finite inputs | {recorded['finite']} | |" in text
    assert f"| any inputs | {recorded['any']} | {recorded['open']} |" in text
    assert "That proof is complete." in text
    assert "was not analysed" not in text


def test_every_output_is_asked_for(exported):
    made = exported("linear")
    header = (made.folder / f"{made.name}.h").read_text(encoding="utf-8")
    (body,) = re.findall(r"_estimates \{(.*?)\}", header, re.DOTALL)
    numbers = re.findall(r"^\s*amb_real (\w+);", body, re.MULTILINE)
    harness = (made.folder / "proof" / f"{made.name}_proof.c").read_text(encoding="utf-8")
    assert re.findall(r"is_finite\(now\.(\w+)\)", harness) == numbers
    assert len(numbers) == 8


BUILTINS = """
int Frama_C_interval(int low, int high);
float Frama_C_float_interval(float low, float high);
double Frama_C_double_interval(double low, double high);
"""


def export_proved(what, out):
    """Each form that brings a proof, and what has none."""
    if what in ("machine", "machine and its controllers"):
        flight = Scenario(sequence=LiftOff()) if "controllers" in what else None
        return export_c(Machine.preset("tum_mlps"), None, out, prefix="f", scenario=flight)
    if what == "editable":
        return export("linear", out, prefix="f", editable=True)
    of = {} if what in KINDS else {"scenario": Scenario(controller=LAWS[what])}
    if what == "calibrated":
        of["calibrated"] = True
    return export(what if what in KINDS else "linear", out, prefix="f", **of)


MACHINES = ["machine", "machine and its controllers"]
WITH_PROOF = [*KINDS, "editable", *prover.CONTROLLERS, *MACHINES]
LAWS = prover.CONTROLLERS | {"calibrated": PID()}


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize("what", quick(WITH_PROOF, ["linear", *WITH_PROOF[len(KINDS) :]]))
def test_script_and_harness_parse(what, tmp_path):
    """As a shell has the one, and a compiler the other, with what Frama-C has built in."""
    folder = export_proved(what, tmp_path / "c").folder
    (tmp_path / "__fc_builtin.h").write_text(BUILTINS)
    script = folder / "proof" / "prove.sh"
    assert subprocess.run(["sh", "-n", str(script)]).returncode == 0
    said = script.read_text(encoding="utf-8")
    assert "proof/f_proof.c" in said
    texts = [file.read_text(encoding="utf-8") for file in (folder / "core" / "src").glob("*.c")]
    listed = re.search(r"-eva-slevel-function (\S+)", said)
    for named in listed[1].split(","):  # Frama-C aborts where there is no such function
        function = re.sub(r"^amb_f\w{6,}?_", "amb_", named.split(":")[0])
        assert any(f" {function}(" in text for text in texts), named
    for defines in ((), ("-DANY",)):
        words = [*command("gcc"), "-D__FRAMAC__", *defines, f"-I{tmp_path}", "-fsyntax-only"]
        words += ["-Wno-unknown-pragmas", "proof/f_proof.c"]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("what", ["editable", *MACHINES])
def test_a_script_that_was_not_run_is_called_no_proof(what, tmp_path):
    folder = export_proved(what, tmp_path / "c").folder
    text = (folder / "proof" / "README.md").read_text(encoding="utf-8")
    assert text.startswith("# Script for the analysis of f, for which no proof is recorded\n")
    assert "# Proof" not in text


def test_of_what_is_not_proved_nothing_is_reported(tmp_path):
    made = export_proved("calibrated", tmp_path / "c")
    assert not [file for file in made.files if file.startswith("proof/")]
    readme = (made.folder / "README.md").read_text(encoding="utf-8")
    assert "proof" not in readme
    assert "- Not proved: that no input leads to" in readme


def test_the_readme_of_a_controller_says_that_it_is_proved(tmp_path):
    readme = (export_proved("LQG", tmp_path / "c").folder / "README.md").read_text(encoding="utf-8")
    assert "- Proved for the constants of ambkit's test bearing: no input" in readme
    assert "not proved" not in readme


@pytest.mark.study
@needs_frama_c
@pytest.mark.parametrize(
    ("kind", "precision", "law"),
    [("linear", "double", None), ("unscented", "float", None),
     ("linear", "float", "PID of the reading"), ("linear", "float", "LQG")],
)  # fmt: skip
def test_what_is_recorded_comes_out(kind, precision, law, tmp_path):
    """Of the others: python -m firmware.proof all."""
    control = None if law is None else prover.CONTROLLERS[law]
    left, said = prover.prove(prover.exported(kind, precision, tmp_path / "out", control))
    assert left == stored_of(kind, law, precision), said
    assert [left[key] for key in LEFT] == [0, 0, 0], said


@pytest.mark.study
@needs_frama_c
def test_the_proof_fails_where_the_supervisor_looks_away(exported, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(exported("linear").folder, folder)
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
