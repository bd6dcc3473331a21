"""The paper's Tables 4 and 5 against the LSM machine, and the shipped copies of its tables."""

from pathlib import Path

import numpy as np
import pytest
from paper.printed import MISPRINTS

from ambkit.machine import paper
from ambkit.machine.machine import Machine
from ambkit.machine.stiffness import stiffness_map

REFERENCE = Path(__file__).parents[2] / "shared" / "reference"


@pytest.fixture(scope="module")
def ours():
    return stiffness_map(Machine.preset("zittau_axial"))


def test_our_nodes_are_those_of_tables_2_and_3(ours):
    np.testing.assert_array_equal(ours.current, paper.CURRENTS)
    np.testing.assert_allclose(ours.displacement, paper.DISPLACEMENTS, rtol=1e-15, atol=0)


@pytest.mark.parametrize("misprint", MISPRINTS)
def test_a_misprint_is_what_its_mirror_image_says(misprint, ours):
    table = {"table4": paper.table4()}[misprint.table]
    assert table[misprint.row, misprint.column] == misprint.printed
    mirrored = table[::-1, ::-1][misprint.row, misprint.column]
    assert mirrored == misprint.meant
    assert abs(ours.k_i[misprint.row, misprint.column] - misprint.meant) <= 0.01


def test_table_6_has_two_widths_a_rule_in_the_order_of_the_rules():
    widths = paper.table6()
    assert widths.shape == (2, 25)
    # sigma_16 is at (-1.5 A, 0.25 mm): the smallest for k_s.
    assert np.argmin(widths[1]) == 15
    assert widths[1, 15] == 1.28e-5
    assert widths[0, 0] == 0.2621


@pytest.mark.parametrize("name", ["table4_ki.csv", "table5_ks.csv", "table6_widths.csv"])
def test_the_shipped_tables_are_the_reference(name):
    if not REFERENCE.is_dir():
        pytest.skip("../shared/reference is not there")
    shipped = Path(paper.__file__).parent / name
    assert shipped.read_bytes() == (REFERENCE / name).read_bytes()
