"""The expert system: eq. 32-33, its box and its file."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from quick import quick

from ambkit.base.errors import AmbkitError
from ambkit.fuzzy.expert import Expert, Rule
from ambkit.fuzzy.training import train
from ambkit.machine import paper
from ambkit.machine.machine import Machine
from ambkit.machine.stiffness import stiffness_map

ZITTAU = Machine.preset("zittau_axial")
MAP = stiffness_map(ZITTAU)

currents = st.floats(-1.5, 1.5)
displacements = st.floats(-0.5e-3, 0.5e-3)
log_widths = st.lists(st.floats(math.log(0.1), math.log(3)), min_size=50, max_size=50)


def naive(expert, iu, x):
    """Eq. 32 and 33 word for word, a rule at a time."""
    outputs = []
    for name in ("k_i", "k_s"):
        total = weighted = 0.0
        for rule in expert.rules:
            distance = math.hypot(
                expert.per_ampere * (iu - rule.current), expert.per_metre * (x - rule.displacement)
            )
            u = math.exp(-(distance**2) / (2 * getattr(rule, f"width_{name}") ** 2))
            total += u
            weighted += getattr(rule, f"weight_{name}") * u
        outputs.append(weighted / total if expert.normalised else weighted)
    return outputs[0], outputs[1]


def random_expert(logs, **options):
    return Expert.from_map(MAP, widths=np.exp(np.reshape(logs, (2, 25))), **options)


@given(log_widths, currents, displacements, st.booleans(), st.sampled_from(["grid", "unit"]))
def test_evaluates_the_equations_of_the_paper(logs, iu, x, normalised, scaling):
    expert = random_expert(logs, normalised=normalised, scaling=scaling)
    # The narrowest rules do not reach everywhere: a sum of 1e-60 has its digits, too.
    np.testing.assert_allclose(expert.stiffness(iu, x), naive(expert, iu, x), rtol=1e-10)


def test_shapes_broadcast():
    expert = Expert.from_map(MAP)
    k_i, k_s = expert.stiffness(np.linspace(-1, 1, 4), np.zeros((3, 1)))
    assert k_i.shape == k_s.shape == (3, 4)
    assert expert.force(0.0, 0.0) == 0.0


def test_a_one_sided_network_adds_the_force_that_carries():
    stiff = stiffness_map(ZITTAU.replace(magnet__type="one-sided"))
    expert = Expert.from_map(stiff)
    assert expert.force(0.0, 0.0) == expert.force_bias == stiff.force_bias > 0


@pytest.mark.parametrize(("preset", "near"), quick(
    [("zittau_axial", 1e-6), ("inteco_ml", 1e-2)], [("zittau_axial", 1e-6)]
))  # fmt: skip
def test_another_magnet_constant_multiplies_what_the_rules_conclude(preset, near):
    """What training anew ends at, the bias force of a one-sided magnet included.

    The search of the second stops on a flat ground, not always at the same place.
    """
    bearing = Machine.preset(preset)
    other = bearing.replace(magnet__magnet_constant=0.8 * bearing.magnet.magnet_constant)
    trained, anew = (train(stiffness_map(b), weights=True) for b in (bearing, other))
    scaled = trained.scaled(0.8)
    iu, x = np.linspace(*trained.current_range, 9), np.linspace(*trained.displacement_range, 9)
    pairs = zip(
        (*scaled.stiffness(iu, x), scaled.force(iu, x)),
        (*anew.stiffness(iu, x), anew.force(iu, x)),
        strict=True,
    )
    for found, expected in pairs:
        assert np.abs(found - expected).max() <= near * np.abs(expected).max()
    np.testing.assert_allclose(scaled.learning_curve, 0.8 * trained.learning_curve)
    assert scaled.source_hash != trained.source_hash
    with pytest.raises(AmbkitError, match="factor must be greater than 0 and finite, is -1"):
        trained.scaled(-1.0)


def test_the_paper_s_network_is_tables_4_5_and_6():
    expert = Expert.paper()
    assert not expert.normalised
    np.testing.assert_array_equal(expert.widths, paper.table6())
    np.testing.assert_array_equal(expert.weights[0].reshape(5, 5), paper.table4())
    np.testing.assert_array_equal(expert.weights[1].reshape(5, 5), paper.table5())
    # sigma_4 is the rule at (0.75 A, -0.5 mm).
    rule = Rule(
        current=0.75,
        displacement=-0.5e-3,
        width_k_i=0.2881,
        width_k_s=0.3599,
        weight_k_i=9.35,
        weight_k_s=6530.0,
    )
    assert expert.rules[3] == rule


def test_the_paper_s_network_is_worse_than_constants_and_better_when_normalised():
    constant = MAP.force_rms(lambda iu, x: 10.05 * iu + 7537.5 * x)
    assert constant == pytest.approx(1.43, abs=0.005)
    assert MAP.force_rms(Expert.paper().force) == pytest.approx(1.98, abs=0.02)
    assert MAP.force_rms(Expert.paper(normalised=True).force) == pytest.approx(0.87, abs=0.01)


@given(logs=log_widths, normalised=st.booleans())
def test_a_file_gives_back_the_same_network(logs, normalised, tmp_path_factory):
    path = tmp_path_factory.mktemp("expert") / "expert.json"
    expert = random_expert(logs, normalised=normalised)
    expert.save(path)
    assert Expert.load(path) == expert
    first = path.read_bytes()
    Expert.load(path).save(path)
    assert path.read_bytes() == first


def edited(path, **changes):
    """Save a network with some keys changed, or left out where None."""
    Expert.from_map(MAP).save(path)
    data = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({k: v for k, v in data.items() if v is not None}))
    return path


RULE = Expert.from_map(MAP).rules[0].model_dump()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "ambkit record"}, 'e.json:1: format: must be "ambkit expert"'),
        ({"version": 2}, "e.json:1: version: must be 1, .* is 2"),
        ({"per_ampere": None}, "e.json:1: per_ampere: missing"),
        ({"per_metre": 0}, "e.json:1: per_metre: must be greater than 0"),
        ({"colour": "red"}, "e.json:1: colour: unknown key"),
        ({"rules": []}, "e.json:1: rules: must be one or more, is an empty list"),
        ({"rules": [RULE] * 65}, "e.json:1: rules: .* at most 64 items"),
        ({"rules": [RULE, RULE | {"width_k_i": -1}]}, r"e.json:1: rules\[1\].width_k_i: must be"),
        ({"rules": [RULE | {"weight_k_s": math.nan}]}, r"rules\[0\].weight_k_s: must be a finite"),
        ({"current_range": [1, 1]}, "e.json:1: current_range: must ascend, is 1 A to 1 A"),
    ],
)
def test_a_file_that_is_no_network_is_reported_apart(changes, message, tmp_path):
    with pytest.raises(AmbkitError, match=message):
        Expert.load(edited(tmp_path / "e.json", **changes))


def test_a_file_cut_short_says_in_which_line(tmp_path):
    path = edited(tmp_path / "e.json")
    path.write_text(path.read_text()[:500])
    with pytest.raises(AmbkitError, match=r"e\.json:1: not valid JSON"):
        Expert.load(path)


@pytest.mark.parametrize("text", ["[1, 2]", "null", "3"])
def test_a_file_with_something_else_is_refused(text, tmp_path):
    path = tmp_path / "e.json"
    path.write_text(text)
    with pytest.raises(AmbkitError, match=r"e\.json:1: must be a"):
        Expert.load(path)


def test_a_missing_file_and_an_unwritable_folder_are_named(tmp_path):
    with pytest.raises(AmbkitError, match=r"none\.json: cannot be read"):
        Expert.load(tmp_path / "none.json")
    with pytest.raises(AmbkitError, match="cannot be written"):
        Expert.from_map(MAP).save(tmp_path / "no folder" / "e.json")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"widths": 0.0}, "width_k_i: must be"),
        ({"widths": [1.0, 2.0, 3.0]}, r"widths must have shape \(2, 25\), .* has \(3,\)"),
        ({"weights": np.zeros(24)}, r"weights must have shape \(2, 25\)"),
        ({"scaling": "metric"}, 'scaling must be "grid", "unit" or two factors'),
        ({"scaling": (1.0, -1e3)}, "per_metre: must be greater than 0"),
    ],
)
def test_what_cannot_be_used_is_named(options, message):
    with pytest.raises(AmbkitError, match=message):
        Expert.from_map(MAP, **options)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_inputs_that_are_not_finite_are_refused(value):
    expert = Expert.from_map(MAP)
    with pytest.raises(AmbkitError, match="x must be finite"):
        expert.stiffness(0.0, [0.0, value])
    with pytest.raises(AmbkitError, match="iu must be finite"):
        expert.force(value, 0.0)


def test_too_many_nodes_are_refused():
    stiff = stiffness_map(ZITTAU, currents=np.linspace(-1.5, 1.5, 13))
    with pytest.raises(AmbkitError, match=r"rules: .* at most 64 items"):
        Expert.from_map(stiff)
