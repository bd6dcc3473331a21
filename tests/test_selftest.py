"""The self-test of an export sees what is wrong: planted faults, and a score over mutants.

The whole score, over all operators: ``python tests/mutants.py``.
"""

import random
import re
import shutil
import subprocess
from itertools import cycle, product

import mutants
import pytest
import unseen
from export_cases import BEARING, SAME_BITS, magnet_of, program
from exporting import export_c
from quick import quick

from ambkit import Machine

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
LOOSE = ("-O1", "-ffp-contract=off")  # without the word that each bit must be the same

# Text in a file of the linear filter's export, and what is there instead: what a company would not
# have noticed with a step up and four states compared.
FAULTS = {
    "k_i negated": ("{}.c", "estimates->k_i = ", "estimates->k_i = -"),
    "k_s of the other sign": ("{}.c", "estimates->k_s = ", "estimates->k_s = -"),
    "innovation always 0": (
        "{}.c",
        "innovation = result->innovation[0]",
        "innovation = AMB_C(0.0)",
    ),
    "variance -1": ("{}.c", "variance = result->variance[0]", "variance = AMB_C(-1.0)"),
    "outliers never told": (
        "core/src/kalman_step.h",
        "return inconsistent | outlier;",
        "return inconsistent | (outlier & ~AMB_OUTLIER);",
    ),
    "outliers left out for ever": (
        "core/src/kalman_sensor.h",
        "if (sensor->outliers < kf->set.outlier_limit) {",
        "if (sensor->outliers < 65535U) {",
    ),
    "gate 100 times wider": (
        "core/src/kalman_sensor.h",
        "(e * e) > (kf->gate_squared * S)",
        "(e * e) > (AMB_C(10000.0) * kf->gate_squared * S)",
    ),
    "INCONSISTENT never told": (
        "core/src/kalman_sensor.h",
        "(share > AMB_INCONSISTENT_SHARE) ? AMB_INCONSISTENT : AMB_OK",
        "(share > AMB_INCONSISTENT_SHARE) ? AMB_OK : AMB_OK",
    ),
    "HELD never told": ("core/src/envelope.c", "sound ? AMB_HELD", "sound ? AMB_OK"),
    "outlier_limit 3,000": ("{}_data.c", ".outlier_limit = 3U", ".outlier_limit = 3000U"),
    "fed back at once": ("{}.c", "(state->doubted == 0U) && (", "("),
    "a saturated current is believed": (
        "core/src/kalman_prediction.h",
        "*status |= AMB_SATURATED;",
        "(void)status;",
    ),
    "the control signal of this sample, not of the last one": (
        "selftest/{}_selftest.c",
        "selftest_u[(k > 0) ? (k - 1) : 0]",
        "selftest_u[k]",
    ),
    "a trusted step without its force": (
        "{}.c",
        "amb_step_trusted(kf, &k, &state->filter, &y, &iu);",
        "(void)iu; const amb_real none = AMB_C(0.0); "
        "amb_step_trusted(kf, &k, &state->filter, &y, &none);",
    ),
}


def printed(folder, out, flags=SAME_BITS):
    done = program("gcc", folder, out, flags)
    assert done.returncode == 0, done.stderr
    return subprocess.run([out], capture_output=True, text=True, timeout=60).stdout


def planted(export, folder, file, old, new):
    """A copy of an export with a fault in a file."""
    shutil.copytree(export, folder)
    text = (folder / file).read_text()
    assert text.count(old) == 1, "the fault cannot be planted"
    (folder / file).write_text(text.replace(old, new))
    return folder


@pytest.mark.parametrize(("fault", "flags"), quick(
    product(FAULTS, [SAME_BITS, LOOSE]), zip(FAULTS, cycle([SAME_BITS, LOOSE]), strict=False)
))  # fmt: skip
def test_planted_faults_are_seen(exported, tmp_path, fault, flags):
    made = exported("linear")
    file, *change = FAULTS[fault]
    folder = planted(made.folder, tmp_path / "out", file.format(made.name), *change)
    assert printed(folder, tmp_path / "a.out", flags).startswith("FAIL"), fault


@pytest.fixture(scope="module", params=["linear", "tabulated"])
def bench(request, exported):
    made = exported(request.param)
    one = mutants.Bench(made.folder, made.name)
    yield one
    one.close()


@pytest.mark.parametrize("count", quick([10, 50], [10], []))
def test_a_tenth_of_any_constant_is_seen_in_both_modes(bench, count):
    file = f"{bench.name}_data.c"
    found = list(mutants.of_constants(file, bench.text(file)))
    assert len(found) > 50
    some = random.Random(0).sample(found, count)
    verdicts = [bench.judge(mutant) for mutant in some]
    alive = [str(m) for m, v in zip(some, verdicts, strict=True) if v.exact or v.loose]
    assert alive == []


@pytest.mark.parametrize("count", quick([10, 50], [10], []))
def test_a_tenth_of_a_node_is_seen_without_the_crc_too(bench, count):
    file = f"{bench.name}_data.c"
    text = bench.text(file)
    at = text.find("nodes[")
    if at < 0:
        pytest.skip("a filter without a table")
    nodes = [m for m in mutants.of_constants(file, text) if at < m.start < text.index("};", at)]
    some = random.Random(1).sample(nodes, count)
    alive = [str(m) for m in some if bench.judge(m).exact_without_crc]
    assert alive == []


@pytest.mark.parametrize("bench", ["linear"], indirect=True)  # the same text as beside a table
@pytest.mark.parametrize("count", quick([12, 40], [12], []))
def test_operators_that_became_others_are_seen(bench, count):
    """A sample of those whose mutants are not alive in the whole score."""
    steps = [f"core/src/kalman_{part}.h" for part in ("prediction", "sensor", "step")]
    files = ["core/generated/axial.h", *steps, f"{bench.name}.c"]
    found = [m for file in files for m in mutants.of_operators(file, bench.text(file))]
    some = random.Random(0).sample(found, count)
    alive = [m for m in some if bench.judge(m).exact]
    gain_of_one = ("K_sen", "k_ui")  # a product with 1 is the quotient
    known = [m for m in alive if any(word in m.text for word in gain_of_one)]
    left = [
        m
        for m in alive
        if m not in known and mutants.why(bench, m, unseen.lists(False, False, False)) is None
    ]
    assert [str(m) for m in left if not bench.is_the_same(m)] == []


@pytest.fixture(scope="module")
def tangent(tmp_path_factory):
    """A table whose force and tangent fly, edges included."""
    to = tmp_path_factory.mktemp("tangent") / "c"
    expert = magnet_of("adaptive")
    made = export_c(BEARING, expert, to, kind="extended", expert_form="tabulated", prefix="f")
    one = mutants.Bench(made.folder, "f")
    yield one
    one.close()


AT_THE_EDGES = r"p\.node = \(|p\.fraction = amb_clamp|p\.slope = \(\(|k_s\.value \+ k_i"


@pytest.mark.parametrize("lines", quick(["", AT_THE_EDGES], [AT_THE_EDGES]))
def test_no_operator_of_a_table_can_be_another(tangent, lines):
    file = "core/src/table.c"
    found = list(mutants.of_operators(file, tangent.text(file)))
    some = [mutant for mutant in found if re.search(lines, mutant.text)]
    assert len(some) > 8
    assert [str(mutant) for mutant in some if tangent.judge(mutant).exact] == []


@pytest.mark.parametrize("bench", ["linear"], indirect=True)
def test_a_restart_for_a_bad_variance_keeps_the_rest_of_the_status(bench):
    file = f"{bench.name}.c"
    found = mutants.of_operators(file, bench.text(file))
    some = [mutant for mutant in found if "flags |= AMB_RESTARTED" in mutant.text]
    assert len(some) == 2
    assert [str(mutant) for mutant in some if bench.judge(mutant).exact] == []


def test_what_is_explained_stands_in_the_sources(exported):
    folders = exported("linear").folder, exported("tabulated").folder
    texts = {path.name: path.read_text() for one in folders for path in one.rglob("*.[ch]")}
    gone = [
        each
        for each in unseen.FILTER
        if not any(each.text in text for name, text in texts.items() if name.endswith(each.file))
    ]
    assert gone == []


@pytest.mark.parametrize("bench", ["linear"], indirect=True)
def test_the_bench_can_fail(bench):
    """What changes nothing passes, and is known for the same program."""
    file = f"{bench.name}.c"
    at = bench.text(file).index("AMB_HELD")
    nothing = mutants.Mutant(file, 1, "AMB_HELD", "(AMB_HELD)", at, "")
    assert bench.judge(nothing) == (True, True, True, True)
    assert bench.is_the_same(nothing)


MACHINE_FAULTS = {
    "starts within, only": ("f.c", "((beyond <= AMB_C(0.0)) || near)", "near"),
    "starts far beyond a stop": ("f.c", "(AMB_C(16.0) * var_y)", "(AMB_C(25.0) * var_y)"),
    "HELD never told": ("core/src/envelope.c", "sound ? AMB_HELD", "sound ? AMB_OK"),
    "a demand whose product is none": (
        "core/src/kalman_prediction.h",
        "= amb_clamp(u, -AMB_REAL_ROOT, AMB_REAL_ROOT);",
        "= (u > AMB_REAL_ROOT) ? AMB_C(0.0) : amb_clamp(u, -AMB_REAL_ROOT, AMB_REAL_ROOT);",
    ),
    "too sure of a sensor after an outage": (
        "core/src/envelope.c",
        "variance * AMB_C(1.01)",
        "variance * AMB_C(1.0)",
    ),
}


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    to = tmp_path_factory.mktemp("machine") / "c"
    return export_c(Machine.preset("heart_pump"), None, to, prefix="f", loops=True).folder


@pytest.mark.parametrize("fault", MACHINE_FAULTS)
def test_planted_faults_of_a_machine_are_seen(fault, machine, tmp_path):
    folder = planted(machine, tmp_path / "out", *MACHINE_FAULTS[fault])
    assert printed(folder, tmp_path / "a.out").startswith("FAIL")


def test_fast_math_is_reported_in_a_sentence(exported, tmp_path):
    said = printed(exported("linear").folder, tmp_path / "a.out", ("-O2", "-ffast-math"))
    assert said.startswith("FAIL")
    assert "assumes that neither NaN nor infinity occurs (-ffast-math," in said


def test_edited_constants_are_named(exported, tmp_path):
    made = exported("linear")
    shutil.copytree(made.folder, tmp_path / "out")
    data = tmp_path / "out" / f"{made.name}_data.c"
    data.write_text(re.sub(r"(\.x_max = \{\s*)[\d.]+F", r"\g<1>0.0011F", data.read_text()))
    said = printed(tmp_path / "out", tmp_path / "a.out")
    assert f"The CRC of the constants in {made.name}_data.c differs" in said


@pytest.mark.parametrize("kind", ["linear", "tabulated", "multiple-model"])
def test_what_it_visits_ships_beside_it(exported, kind):
    text = (exported(kind).folder / "selftest" / "COVERAGE.md").read_text()
    for flag in ("MISSING", "FROZEN", "SATURATED", "BAD_CONTROL", "HELD", "OUTLIER", "INCONSISTENT",
                 "RESTARTED"):  # fmt: skip
        assert re.search(rf"\| `AMB_{flag}` \| [1-9]\d* samples \|", text), flag
    low, high = map(float, re.search(r"\| `x` \| (\S+) to (\S+) m", text).groups())
    travel = BEARING.clearance
    assert low < -0.9 * travel
    assert high > 0.9 * travel
