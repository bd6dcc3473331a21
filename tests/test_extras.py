"""What is read, and what is said, where a library of an extra is not installed."""

import sys

import numpy as np
import pytest

import ambkit
from ambkit.base.errors import ExtraMissing
from ambkit.campaigns.store import Folder
from ambkit.data.files import csv_text
from ambkit.data.files.log import Request

LOGS = {
    "plain": "t,y,u\n" + "".join(f"{k * 1e-4:.4f},{np.sin(k):.17g},{k % 7}\n" for k in range(50)),
    "missing": "t;y;u\n" + "".join(f"0,{k:04};{k if k % 9 else ''};1,5\n" for k in range(50)),
    "stamps": "time,y\n" + "".join(f"2026-03-01 10:00:0{k}.500,{k}\n" for k in range(9)),
    "coarse": "t,y\n" + "".join(f"1700000000.{k:09},{k}\n" for k in range(50)),
    "wide": "t y\n" + "".join(f"{k}.5   {k}\n" for k in range(50)),
}


@pytest.fixture
def without_arrow(monkeypatch):
    """Have no pyarrow."""
    for name in [*filter(lambda name: name.partition(".")[0] == "pyarrow", sys.modules)]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pyarrow", None)


@pytest.mark.parametrize("name", LOGS)
def test_csv_is_the_same_without_arrow(name, tmp_path, request):
    path = tmp_path / "log.csv"
    path.write_text(LOGS[name])
    fast = csv_text.read(path, Request())
    request.getfixturevalue("without_arrow")
    slow = csv_text.read(path, Request())
    assert slow.arrays.keys() == fast.arrays.keys()
    for column, values in fast.arrays.items():
        np.testing.assert_array_equal(slow.arrays[column], values)
    assert (slow.texts, slow.remarks, slow.units) == (fast.texts, fast.remarks, fast.units)


@pytest.mark.usefixtures("without_arrow")
def test_an_error_names_the_extra(tmp_path):
    (tmp_path / "log.parquet").write_bytes(b"PAR1")
    with pytest.raises(ExtraMissing, match=r"needs pyarrow: pip install 'ambkit\[parquet\]'$"):
        ambkit.read(tmp_path / "log.parquet")
    record = ambkit.simulate(ambkit.preset("zittau_axial"), duration="10 ms")
    with pytest.raises(ExtraMissing, match=r"ambkit\[parquet\]"):
        record.save(tmp_path / "r.parquet")
    with pytest.raises(ExtraMissing, match=r"needs pyarrow: pip install 'ambkit\[campaign\]'$"):
        Folder(tmp_path, None)
