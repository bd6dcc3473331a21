"""Exported filters on a Cortex-M4F in qemu: same bits, instructions, memory, what they call."""

from functools import cache

import numpy as np
import pytest
from exporting import export_c

from ambkit import KalmanFilter, Machine, Scenario
from ambkit.estimate.registry import KINDS
from ambkit.export.c import CYCLES_PER_INSTRUCTION, cost
from ambkit.export.c.model import states
from ambkit.export.pil import build
from firmware import harness, measure, path

MISSING = harness.missing_tools()
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        bool(MISSING), reason=f"not there: {', '.join(MISSING)}; see firmware/README.md"
    ),
]

# Instructions of a usual step that trusts its input, and of one that checks it; the latter also
# where the compiler may contract. See firmware/README.md.
TRUSTED = {"linear": 305, "closed-law": 420, "table": 390, "adaptive": 2990}
LIMITS = {"linear": 600, "closed-law": 710, "table": 685, "adaptive": 3305}
LIMITS_CONTRACTED = {"linear": 550, "closed-law": 640, "table": 620, "adaptive": 2920}
CONTRACTED = 1e-3  # of each state's standard deviation; as the exports' own self-test
HELPERS = {"memcpy", "memset"}  # what any C compiler may call of itself
# What is steady-state is an observer: the same C with other numbers.
NAMES = tuple(name for name in KINDS if name != measure.UNMEASURED)
MEASURED = tuple(name for name in NAMES if name != "steady-state")


@pytest.fixture(scope="module", params=MEASURED)
def kind(request):
    name = request.param
    return name


@pytest.fixture(scope="module")
def case(kind, tmp_path_factory):
    return measure.case(kind, measure.magnets()[kind], tmp_path_factory.mktemp(kind))


@pytest.fixture(scope="module")
def here(case):
    """What the float build on this machine gives."""
    return case.estimator.run(measure.record(), covariance=True)


def test_the_self_test_passes_to_the_last_bit(case):
    assert (case.there.unequal, case.there.wrong_status) == (0, 0)


def test_estimates_are_those_of_the_float_build_here_bit_for_bit(case, here):
    assert case.there.mean.shape == (measure.SAMPLES, 4)
    assert case.there.mean.tobytes() == here.mean.astype("<f4").tobytes()
    np.testing.assert_array_equal(case.there.status, here.status)
    for flag in (1, 2, 4):
        assert (case.there.status & flag).any(), "nothing happened in the record"


@pytest.mark.parametrize("kind", LIMITS, indirect=True)
def test_contraction_moves_the_estimates_within_the_bound(kind, case, here, tmp_path):
    record = measure.record()
    firmware = harness.build(case.export, tmp_path, "fast")
    there = harness.run(firmware, record["y"], record["u"])
    off = np.abs(there.mean - here.mean) / np.sqrt(here.covariance[:, [0, 4, 7, 9]])
    assert 0 < off.max() <= CONTRACTED
    np.testing.assert_array_equal(there.status, here.status)
    assert np.median(there.instructions) <= LIMITS_CONTRACTED[kind]


@pytest.mark.parametrize("kind", LIMITS, indirect=True)
def test_a_step_of_the_papers_filter_stays_within_its_limit(kind, case):
    assert 50 < np.median(case.there.instructions) <= LIMITS[kind]
    assert 50 < np.median(case.there.trusted) <= TRUSTED[kind]


@pytest.mark.parametrize("kind", ["linear", "unscented"], indirect=True)
def test_a_wrong_expectation_in_the_self_test_is_found(case, tmp_path):
    """The harness itself must be able to fail."""
    vectors = case.export / "selftest" / "filter_vectors.c"
    text = vectors.read_text()
    head, array, values = text.partition(
        "_expected[FILTER_SELFTEST_STEPS][FILTER_SELFTEST_COLUMNS] = {\n  {"
    )
    first, comma, rest = values.partition(",")
    try:
        vectors.write_text(f"{head}{array}{float(first.rstrip('F')) + 1e-6:.9g}F{comma}{rest}")
        firmware = harness.build(case.export, tmp_path)
    finally:
        vectors.write_text(text)
    assert harness.run(firmware, [0.0], [0.0]).unequal == 2  # of two instances


def test_no_double_no_heap_no_stdio_no_variables(case):
    assert harness.borrowed(case.firmware) <= HELPERS
    assert harness.size(case.firmware).variables == 0


def test_a_controller_has_a_bound_on_any_path(tmp_path):
    made = export_c(measure.BEARING, None, tmp_path / "c", prefix="rig", scenario=Scenario(),
                    telemetry=True).folder  # fmt: skip
    fields = [state.field for state in states(KalmanFilter(measure.BEARING).states)]
    image = build.firmware(made, fields, build.QEMU_BOARD, tmp_path / "qemu", False)
    # The state and the output; the first words of the state lead to what it works by.
    works_by = {(0, 4 * k): "rig_control" for k in range(3)}
    found = path.bound(image, "rig_step", objects=0b101, points=works_by)
    assert found.instructions is not None, found.why
    assert 1500 < found.instructions < 8000


def test_double_helpers_would_be_found(tmp_path):
    export = export_c(measure.BEARING, None, tmp_path / "export", precision="double").folder
    borrowed = harness.borrowed(harness.build(export, tmp_path / "build"))
    assert any(name.startswith("__aeabi_d") for name in borrowed)


def told_is_measured(case):
    """Otherwise: python -m firmware."""
    told = cost.of(case.estimator)
    figures = measure.figures(case)
    if figures["trusted"] is None:
        assert told.trusted is None
        del figures["trusted"]
    arrays = cost.bytes_of_arrays(case.estimator)
    figures["constants"] = figures.pop("constants_without_arrays") + arrays
    # How long the self-test's records are depends on the bearing: that figure is a rough one.
    assert told.selftest == pytest.approx(figures.pop("selftest"), rel=0.5)
    assert {name: getattr(told, name) for name in figures} == pytest.approx(figures, rel=0.05)
    assert told.compiler.split()[2:] == harness.compiler().split()[2:]  # the flags


def test_the_cost_told_is_what_is_measured(case):
    told_is_measured(case)


def test_the_cost_of_another_number_of_rules(tmp_path):
    told_is_measured(measure.case("adaptive", measure.fewer_rules(16), tmp_path))


@pytest.mark.parametrize("kind", ["closed-law", "multiple-model"])
def test_the_cost_for_another_bearing(kind, tmp_path):
    """One-sided, and sampled ten times as slowly."""
    told_is_measured(measure.case(kind, None, tmp_path, Machine.preset("inteco_ml")))


@cache
def stored(name):
    magnet = measure.magnets()[name]
    return cost.of(KINDS[name].make(measure.BEARING, magnet, precision="float32"))


@pytest.mark.parametrize("name", NAMES)
def test_every_name_has_a_cost(name):
    spent = stored(name)
    assert (spent.trusted is not None) == (name in LIMITS)


@pytest.mark.parametrize(
    "unmeasured",
    [("multiple-model", None, {"scales": (0.8, 1.2)}), ("extended", "table", {})],
    ids=["fewer models", "another magnet"],
)
def test_what_was_not_measured_has_no_cost(unmeasured, tmp_path):
    kind, of, options = unmeasured
    magnet = measure.magnets()[of] if of else None
    made = export_c(measure.BEARING, magnet, tmp_path, kind=kind, **options)
    assert made.cost is None
    assert "instructions a step" not in (made.folder / "README.md").read_text()


@pytest.mark.parametrize("kind", ["linear", "multiple-model"], indirect=True)
def test_the_readme_of_an_export_tells_its_cost(kind, case):
    rows = [row.split("|") for row in (case.export / "README.md").read_text().splitlines()]
    facts = {row[1].strip(): row[2].strip() for row in rows if len(row) == 4}
    spent = stored(kind)
    assert facts["instructions a step (Cortex-M4F, in qemu)"].startswith(f"{spent.instructions}, ")
    assert f"{spent.code} bytes of code, {spent.constants} bytes" in facts["flash"]
    assert ("without checks of the input" in facts) == (kind == "linear")


@pytest.mark.parametrize("name", ["linear", "unscented"])
def test_the_command_tells_the_cost(name, call):
    words = ("zittau_axial", "--filter", name, "--clock", "80 MHz", "--json")
    told = call("export", "cost", *words).json["cost"]
    cycles = 80e6 / told["highest_rate"]
    assert cycles == pytest.approx(told["most"] * CYCLES_PER_INSTRUCTION)
    assert (told["trusted"] is None) == (name == "unscented")


def test_faults_are_searched_with_the_same_bits_within_their_limits(tmp_path):
    there = measure.faults(tmp_path)  # its self-test must be equal, or it does not come to an end
    stored = cost.stored(cost.STORED)["faults"]
    for what, count in stored.items():
        assert 0.9 * count < there[what] <= 1.02 * count
