"""Today's core answers as the one that wrote tests/golden did, to the last bit."""

import numpy as np
import pytest
from golden.axes import TABLES, read_rows
from golden.runs import RUNS, filtered, read

HOW = "\nif the change is meant: python -m tests.golden, and look at the diff"


@pytest.mark.parametrize("name", RUNS)
def test_the_run_is_the_recorded_one(name):
    recorded, now = read(name), RUNS[name]()
    assert list(recorded) == list(now)
    for column, values in now.items():
        changed = np.flatnonzero(recorded[column].astype(values.dtype) != values)
        if changed.size:
            k = changed[0]
            pytest.fail(
                f"{name}.csv, column {column}: {changed.size} of {values.size} rows differ, first "
                f"line {k + 2}: recorded {recorded[column][k]:.17g}, now {values[k]:.17g}{HOW}"
            )


def test_as_printed_it_is_what_it_was_before_there_was_another_model():
    recorded, now = read("linear_as_printed"), filtered(None, "float64", as_printed=True)
    assert list(recorded) == list(now)
    assert (recorded["status"] == now["status"]).all()
    for column, values in now.items():
        scale = np.abs(recorded[column]).max()
        assert np.abs(values - recorded[column]).max() <= 1e-12 * scale, column


def test_the_recorded_runs_have_something_in_them():
    """A step, a load, a gap, a frozen spell, and a current beyond its limit."""
    flags = np.unique(read("linear")["status"]).tolist()
    assert {0.0, 1.0, 2.0, 4.0, 8.0} <= set(flags)
    assert np.ptp(read("closed_law")["k_s"]) > 1000


BY_LAPACK = ("observer", "steady-state")
"""Kinds whose gain is computed by LAPACK; its last bits are the processor's."""


def case(row):
    return ", ".join(row[name] for name in list(row)[: list(row).index("bits")])


@pytest.mark.parametrize("name", TABLES)
def test_every_kind_and_plant_answers_as_recorded(name):
    recorded, now = read_rows(name), list(TABLES[name]())
    assert [case(row) for row in recorded] == [case(row) for row in now]
    changed = []
    for was, row in zip(recorded, now, strict=True):
        figures = list(row)[list(row).index("bits") + 1 :]
        far = [c for c in figures if float(row[c]) != pytest.approx(float(was[c]), rel=1e-9, abs=0)]
        ours = row.get("kind") not in BY_LAPACK
        if far or (ours and row["bits"] != was["bits"]):
            changed.append(f"{case(row)}: {', '.join(far) or 'last bits'}")
    assert not changed, "\n".join(changed) + HOW
