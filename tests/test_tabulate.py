"""The expert as a table: its bound on the force error holds, and it is not larger than need be."""

import re
from itertools import product

import numpy as np
import pytest
from export_cases import BEARING, CORE_PRECISION, PRECISIONS, export, magnet_of
from quick import quick
from scipy.stats import qmc

import ambkit
from ambkit import Machine
from ambkit.base.errors import AmbkitError
from ambkit.export.stiffness_table import tabulate
from ambkit.machine.magnets import core_module, evaluate_force


def deviation(table, expert, bearing, precision, points):
    """Force of the table less that of the expert [N] at points of the unit square."""
    stop = bearing.clearance
    iu = bearing.current_min + points[:, 0] * (bearing.current_max - bearing.current_min)
    x = stop * (2 * points[:, 1] - 1)
    magnet = table.in_core(core_module(CORE_PRECISION[precision]))
    return np.abs(magnet.force(iu, x) - evaluate_force(expert, iu, x))


@pytest.mark.parametrize(("bound", "precision"), quick(
    product([None, 1.0, 0.02], PRECISIONS), [(None, "float"), (1.0, "double"), (0.02, "float")]
))  # fmt: skip
def test_a_table_keeps_its_bound_wherever_the_filter_can_ask(bound, precision):
    expert = magnet_of("adaptive")
    table = tabulate(expert, BEARING, bound=bound, precision=CORE_PRECISION[precision])
    iu, x = np.meshgrid(np.linspace(-1.5, 1.5, 51), np.linspace(-1e-3, 1e-3, 51))
    largest = np.abs(evaluate_force(expert, iu, x)).max()
    assert table.bound == (bound or pytest.approx(1e-3 * largest, rel=0.01))
    sobol = qmc.Sobol(2, seed=4).random_base2(15)
    off = deviation(table, expert, BEARING, precision, sobol)
    # From the worst of them, ever closer around.
    worst, reach = sobol[np.argsort(off)[-20:]], 0.01
    for _ in range(6):
        near = worst[:, None, :] + reach * (qmc.Sobol(2, seed=5).random_base2(8) - 0.5)
        near = np.clip(near.reshape(-1, 2), 0, 1)
        far = deviation(table, expert, BEARING, precision, near)
        worst, reach = near[np.argsort(far)[-20:]], reach / 3
        off = np.concatenate([off, far])
    assert off.max() <= table.bound
    assert off.max() <= 1.02 * table.error, "the error that is stated is not the largest"
    assert table.error > table.bound / 3, "a smaller table would do"


def test_a_table_is_bounded_for_another_bearing_as_well():
    bearing = Machine.preset("inteco_ml")
    expert = ambkit.Expert.from_map(ambkit.stiffness_map(bearing))
    table = tabulate(expert, bearing, precision="float32")
    off = deviation(table, expert, bearing, "float", qmc.Sobol(2, seed=6).random_base2(14))
    assert 0 < off.max() <= table.bound


def test_the_readme_states_the_bound(exported):
    made = exported("tabulated")
    readme = (made.folder / "README.md").read_text()
    rows, columns = made.table.k_i.shape
    assert f"{rows} x {columns} nodes" in readme
    stated = re.search(r"\| bound on its force error \| ([\d.]+) (m?)N \|", readme)
    assert stated
    scale = 1e-3 if stated[2] else 1.0
    assert scale * float(stated[1]) == pytest.approx(made.table.bound, rel=1e-5)


@pytest.mark.parametrize(
    ("bound", "message"), [(0.0, "greater than 0 N"), (1e-9, "needs a table larger than")]
)
def test_a_bound_that_cannot_be_kept_is_refused(tmp_path, bound, message):
    with pytest.raises(AmbkitError, match=message):
        export("tabulated", tmp_path / "out", force_bound=bound)
    assert not (tmp_path / "out").exists()
