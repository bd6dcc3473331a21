"""Exported filters on a Cortex-M4F in qemu: same bits, instructions, memory, what they call."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from ambkit import KalmanFilter
from ambkit.cli import main
from ambkit.estimate import Estimate
from ambkit.export.c import CYCLES_PER_INSTRUCTION, cost, export_c
from firmware import harness, measure

MISSING = harness.missing_tools()
pytestmark = pytest.mark.skipif(
    bool(MISSING), reason=f"not there: {', '.join(MISSING)}; see firmware/README.md"
)

KINDS = ("Constant", "Law", "Table", "Fuzzy")
CONTRACTED = 1e-3  # of each state's standard deviation; as the exports' own self-test
# Instructions of a usual step that trusts its input, and of one that checks it; the latter also
# where the compiler may contract. See firmware/README.md.
TRUSTED = {"Constant": 170, "Law": 275, "Table": 300, "Fuzzy": 3000}
LIMITS = {"Constant": 275, "Law": 370, "Table": 360, "Fuzzy": 3000}
LIMITS_CONTRACTED = {"Constant": 240, "Law": 325, "Table": 320, "Fuzzy": 2700}
HELPERS = {"memcpy", "memset"}  # what any C compiler may call of itself


class Case(NamedTuple):
    """One filter: what the float build on this machine gives, and the processor."""

    kind: str
    export: Path
    here: Estimate
    std: np.ndarray
    firmware: harness.Firmware
    there: harness.Run


@pytest.fixture(scope="module", params=KINDS)
def case(request, tmp_path_factory) -> Case:
    folder = tmp_path_factory.mktemp(request.param)
    source = measure.sources()[request.param]
    export = export_c(measure.BEARING, source, folder / "export", prefix="filter").folder
    record = measure.record()
    here = KalmanFilter(measure.BEARING, source, precision="float32").run(record, covariance=True)
    firmware = harness.build(export, folder / "build")
    std = np.sqrt(here.covariance[:, [0, 4, 7, 9]])
    there = harness.run(firmware, record["y"], record["u"])
    return Case(request.param, export, here, std, firmware, there)


def test_the_self_test_passes_to_the_last_bit(case: Case) -> None:
    assert (case.there.unequal, case.there.wrong_status) == (0, 0)


def test_estimates_are_those_of_the_float_build_here_bit_for_bit(case: Case) -> None:
    assert case.there.mean.shape == (measure.SAMPLES, 4)
    assert case.there.mean.tobytes() == case.here.mean.astype("<f4").tobytes()
    np.testing.assert_array_equal(case.there.status, case.here.status)
    assert {1, 2, 4} <= set(case.there.status.tolist()), "nothing happened in the record"


def test_contraction_moves_the_estimates_within_the_bound(case: Case, tmp_path: Path) -> None:
    record = measure.record()
    firmware = harness.build(case.export, tmp_path, "fast")
    there = harness.run(firmware, record["y"], record["u"])
    off = np.abs(there.mean - case.here.mean) / case.std
    assert 0 < off.max() <= CONTRACTED
    np.testing.assert_array_equal(there.status, case.here.status)
    assert np.median(there.instructions) <= LIMITS_CONTRACTED[case.kind]


def test_a_step_stays_within_its_limit(case: Case) -> None:
    usual = np.median(case.there.instructions)
    assert 50 < usual <= LIMITS[case.kind]
    assert 50 < np.median(case.there.trusted) <= TRUSTED[case.kind]


def test_a_wrong_expectation_in_the_self_test_is_found(case: Case, tmp_path: Path) -> None:
    """The harness itself must be able to fail."""
    vectors = case.export / "selftest" / "filter_vectors.c"
    text = vectors.read_text()
    head, array, values = text.partition("_mean[FILTER_SELFTEST_STEPS][AMB_AXIAL_STATES] = {\n  {")
    first, comma, rest = values.partition(",")
    try:
        vectors.write_text(f"{head}{array}{float(first.rstrip('F')) + 1e-6:.9g}F{comma}{rest}")
        firmware = harness.build(case.export, tmp_path)
    finally:
        vectors.write_text(text)
    assert harness.run(firmware, [0.0], [0.0]).unequal == 2  # of two instances


def test_no_double_no_heap_no_stdio_no_variables(case: Case) -> None:
    assert harness.borrowed(case.firmware) <= HELPERS
    assert harness.size(case.firmware).variables == 0


def test_double_helpers_would_be_found(tmp_path: Path) -> None:
    export = export_c(measure.BEARING, None, tmp_path / "export", precision="double").folder
    borrowed = harness.borrowed(harness.build(export, tmp_path / "build"))
    assert any(name.startswith("__aeabi_d") for name in borrowed)


def test_stored_costs_are_those_of_today(tmp_path: Path) -> None:
    """Otherwise: python -m firmware."""
    stored = json.loads(cost.STORED.read_text())
    now = measure.measure(tmp_path)
    assert stored["compiler"].split()[2:] == now["compiler"].split()[2:]  # the flags
    for name, figures in now["magnets"].items():
        assert stored["magnets"][name] == pytest.approx(figures, rel=0.05), name


def test_cost_of_an_export_is_what_is_measured(case: Case) -> None:
    readme = (case.export / "README.md").read_text()
    size = harness.size(case.firmware)
    usual = np.median(case.there.instructions)
    line = next(row for row in readme.splitlines() if row.startswith("| instructions a step"))
    assert int(line.split("|")[2].split(",")[0]) == pytest.approx(usual, rel=0.05)
    line = next(row for row in readme.splitlines() if row.startswith("| flash"))
    code, constants = (int(word) for word in line.split() if word.isdigit())
    assert (code, constants) == pytest.approx((size.code, size.constants), rel=0.05)


def test_the_command_tells_the_cost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["export", "c", "zittau_axial", "--out", str(tmp_path), "--clock", "80 MHz", "--json"]
    with pytest.raises(SystemExit) as left:
        main(words)
    assert not left.value.code
    told = json.loads(capsys.readouterr().out)["cost"]
    cycles = 80e6 / told["highest_rate"]
    assert cycles == pytest.approx(told["most"] * CYCLES_PER_INSTRUCTION)


def test_double_has_no_cost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["export", "c", "zittau_axial", "--out", str(tmp_path / "out"), "--cost"]
    with pytest.raises(SystemExit) as left:
        main([*words, "--precision", "double"])
    assert left.value.code == 2
    assert "no double" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
