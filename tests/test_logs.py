"""Logs of all formats: what their own libraries write comes back, and damage is one clear line."""

import sys

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

import ambkit
from ambkit.base.errors import AmbkitError, ExtraMissing, RecordError
from ambkit.data.channel_map import ChannelMap
from ambkit.data.files import csv_dialect, mat
from ambkit.data.files.log import Request
from ambkit.data.files.tables import read_log
from ambkit.data.record import Record
from tests import logs

MAP = ChannelMap.from_toml(logs.MAP)
VALUES = st.floats(-1e6, 1e6, allow_subnormal=False) | st.just(float("nan"))


@pytest.mark.parametrize("name", logs.WRITERS)
@settings(max_examples=12)
@given(samples=st.lists(st.tuples(VALUES, VALUES), min_size=2, max_size=12), step=st.integers(1, 9))
def test_each_format_gives_back_what_its_library_wrote(tmp_path_factory, name, samples, step):
    pos, current = np.array(samples).T
    time = 0.125 * step * np.arange(len(pos))
    path = tmp_path_factory.mktemp("round") / name
    logs.WRITERS[name](path, {"time": time, "pos": pos, "current": current})
    record = ambkit.load(path, MAP)
    np.testing.assert_array_equal(record.t, time)
    np.testing.assert_array_equal(record["y"], pos * 1e-3)
    np.testing.assert_array_equal(record["u"], current)


@pytest.mark.parametrize("name", [n for n in logs.WRITERS if n.endswith(("mat", "h5", "mf4"))])
def test_a_damaged_file_is_one_line(tmp_path, name):
    t = np.arange(500.0)
    path = tmp_path / name
    logs.WRITERS[name](path, {"time": t, "pos": np.sin(t), "current": t})
    whole = path.read_bytes()
    for part in (0.0, 0.02, 0.3, 0.6, 0.8):
        path.write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(AmbkitError, match=name) as failure:
            ambkit.load(path, MAP)
        assert "\n" not in str(failure.value)


@pytest.mark.parametrize(
    ("name", "module", "extra"),
    [
        ("a.h5", "h5py", "hdf5"),
        ("a.mat", "pymatreader", "mat"),
        ("a.mf4", "asammdf", "mdf"),
        ("a.xlsx", "openpyxl", "xlsx"),
    ],
)
def test_a_missing_library_is_named_with_the_command_that_brings_it(
    tmp_path, monkeypatch, name, module, extra
):
    path = tmp_path / name
    writer = {"a.h5": logs.hdf5, "a.mat": logs.mat73, "a.mf4": logs.mdf4,
              "a.xlsx": lambda at, _: at.write_bytes(b"PK")}[name]  # fmt: skip
    writer(path, {"time": np.arange(3.0), "pos": np.arange(3.0)})
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ExtraMissing, match=rf"a\..*pip install 'ambkit\[{extra}\]'"):
        read_log(path)


def test_structures_of_matlab_have_dotted_names(tmp_path):
    content = {"s": {"a": np.arange(4.0), "b": {"c": np.arange(3.0)}}, "note": "text"}
    logs.mat5(tmp_path / "5.mat", content)
    logs.mat73(tmp_path / "73.mat", content)
    for name in ("5.mat", "73.mat"):
        arrays = read_log(tmp_path / name).arrays
        assert sorted(arrays) == ["s.a", "s.b.c"]
        np.testing.assert_array_equal(arrays["s.b.c"].ravel(), np.arange(3.0))


def test_hdf5_gives_paths_units_and_fields(tmp_path):
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_group("rig").create_dataset("current", data=np.arange(5.0))
        data.attrs["unit"] = "A"
        file["log"] = np.array([(1.0, 2, b"x")], dtype=[("a", "f8"), ("b", "i4"), ("c", "S1")])
        file["cube"] = np.zeros((2, 2, 2))
    log = read_log(tmp_path / "a.h5")
    assert sorted(log.arrays) == ["log.a", "log.b", "rig/current"]
    assert log.units == {"rig/current": "A"}


def test_mdf_gives_groups_clocks_and_units(tmp_path):
    fast, slow = np.arange(20) * 1e-3, np.arange(5) * 4e-3
    path = tmp_path / "a.mf4"
    logs.mdf4(
        path,
        {"time": fast, "pos": fast, "i": fast},
        {"time": slow, "pos": slow, "temperature": slow},
        units={"i": "A"},
    )
    log = read_log(path)
    assert log.clocks == {
        "0/pos": "0/time", "i": "0/time", "1/pos": "1/time", "temperature": "1/time",
    }  # fmt: skip
    assert log.units["i"] == "A"
    np.testing.assert_array_equal(log.arrays["1/time"], slow)
    assert set(read_log(path, ["i"]).arrays) == {"0/time", "i"}


# CSV as it comes

PLAIN = [[0.0, 1.5, -2.5], [0.5, 2.5, 3.5], [1.0, np.nan, 4.25]]


def lines(separator, decimal, ending=""):
    return [
        separator.join("" if np.isnan(v) else str(v).replace(".", decimal) for v in row) + ending
        for row in PLAIN
    ]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", ","), ("|", ".")]
)
@pytest.mark.parametrize(
    "header",
    [
        ["t [s]|Weg [µm]|i [A]"],
        ["t|Weg|i", "s|µm|A"],
        ["t|Weg|i", "[s]|[µm]|[A]"],
        ["Prüfstand 3", "Rate|1000", "", "t|Weg|i", "(s)|(µm)|(A)"],
        ["# note: 5", "Kanal|1||", "t [s]|Weg [µm]|i [A]"],
    ],
)
def test_headers_separators_decimal_signs_and_encodings(
    tmp_path, header, separator, decimal, encoding, end
):
    text = end.join([*(h.replace("|", separator) for h in header), *lines(separator, decimal)])
    path = tmp_path / "log.csv"
    path.write_bytes((text + end).encode(encoding))
    log = read_log(path)
    assert log.units == {"t": "s", "Weg": "µm", "i": "A"}
    np.testing.assert_array_equal(np.column_stack(list(log.arrays.values())), PLAIN)
    sizes = {"\n": 1, "\r\n": 1, "\r": 1}
    assert log.line_of(0) == len(header) * sizes[end] + 1
    assert ("decimal comma" in " ".join(log.remarks)) == (decimal == ",")


def test_of_lines_of_words_the_last_two_are_names_and_units(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("rig 3,bearing A,by hand\nt,pos,i\ns,mm,A\n0.0,1.5,2.5\n0.5,2.5,3.5\n")
    log = read_log(path)
    assert log.units == {"t": "s", "pos": "mm", "i": "A"}
    np.testing.assert_array_equal(log.arrays["pos"], [1.5, 2.5])


def test_spaces_between_columns(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text("  t [s]   pos [mm]  i\n 0.0   1e-3 2\n 0.5  -2.0D+01    3\n")
    log = read_log(path)
    assert log.units == {"t": "s", "pos": "mm"}
    np.testing.assert_array_equal(log.arrays["pos"], [1e-3, -20.0])


def test_a_separator_at_the_end_of_each_line_and_no_header(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines(";", ",", ";")) + "\n")
    log = read_log(path)
    assert log.order == ("0", "1", "2")
    np.testing.assert_array_equal(log.arrays["2"], [-2.5, 3.5, 4.25])
    by_place = MAP.to_toml().replace('"time"', "0").replace('"pos"', "1").replace('"current"', "2")
    np.testing.assert_array_equal(
        ambkit.load(path, ChannelMap.from_toml(by_place))["u"], [-2.5, 3.5, 4.25]
    )
    with pytest.raises(RecordError, match=r"has no column 7, it has 3"):
        ambkit.load(path, ChannelMap.from_toml(by_place.replace("column = 2", "column = 7")))


def test_names_that_are_there_twice_are_reported_apart(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,pos,current,current\n0,1,2,3\n1,1,2,3\n")
    assert read_log(path).order == ("time", "pos", "current#2", "current#3")
    with pytest.raises(RecordError, match="several columns current: use current#2 or current#3"):
        ambkit.load(path, MAP)


def test_all_that_is_wrong_is_reported_at_once_with_its_line(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t [s],y [m]\n0,1\n1,bad\n2\n3,x\n4,1\n")
    with pytest.raises(RecordError) as failure:
        Record.load(path)
    assert failure.value.problems == (
        f"{path}:3: column y: 'bad' is not a number",
        f"{path}:4: has 1 cell instead of 2",
        f"{path}:5: column y: 'x' is not a number",
    )
    path.write_text("t [s],y [m]\n0,1\n1,1\n\n3,1\n4,1\n4,1\n5,1\n")
    with pytest.raises(RecordError) as failure:
        Record.load(path)
    assert [problem.partition(": ")[0] for problem in failure.value.problems] == [
        f"{path}:7", f"{path}:5",
    ]  # fmt: skip
    path.write_text("t [s],y [m]\n" + "".join(f"{k},a\n" for k in range(50)))
    with pytest.raises(RecordError) as failure:
        Record.load(path)
    assert len(failure.value.problems) == 11
    assert failure.value.problems[-1] == "and 40 more"


@given(
    rows=st.lists(
        st.tuples(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9), st.floats(-1e9, 1e9)),
        min_size=3,
        max_size=20,
    ),
    pair=st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")]),
)
def test_the_dialect_is_found_for_any_numbers(rows, pair):
    separator, decimal = pair
    text = [separator.join(repr(v).replace(".", decimal) for v in row) for row in rows]
    found = csv_dialect.find(["t" + separator + "a" + separator + "b", *text])
    assert (found.separator, found.decimal, found.width) == (separator, decimal, 3)
    assert found.names == ("t", "a", "b")


def test_a_file_that_is_no_text(tmp_path):
    (tmp_path / "log.csv").write_bytes(b"PK\x03\x04\0\0\0\0")
    with pytest.raises(RecordError, match="is not text"):
        read_log(tmp_path / "log.csv")


def test_dates_in_a_parquet_are_seconds_from_the_first(tmp_path):
    import pyarrow as pa
    from pyarrow import parquet

    stamps = pa.array([10_000_000, 10_000_500, 10_001_000], pa.timestamp("us"))
    table = pa.table(
        {"time": stamps, "pos": [1.0, 2.0, 3.0], "current": [1, 2, 3], "who": ["a"] * 3}
    )
    parquet.write_table(table, tmp_path / "a.parquet")
    record = ambkit.load(tmp_path / "a.parquet", MAP)
    np.testing.assert_allclose(record.t, [0, 5e-4, 1e-3])
    lenient = read_log(tmp_path / "a.parquet", lenient=True)
    assert "who" not in lenient.arrays
    assert "column who holds no numbers: not read" in lenient.remarks


def test_objects_that_only_matlab_opens_are_named(tmp_path, monkeypatch):
    """As SciPy gives a timeseries of Simulink: a name, a class, and numbers that mean nothing."""
    from scipy.io.matlab import MatlabOpaque

    parts = [(part, "O") for part in ("s0", "s1", "s2", "arr")]
    inside = np.zeros((6, 1), np.uint32)
    ball = MatlabOpaque(np.array([(b"ball", b"MCOS", b"timeseries", inside)], dtype=parts))
    numbers = {"t": np.arange(5.0)}
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, numbers)
    for beside in ({}, numbers):
        monkeypatch.setattr(mat, "content", lambda _, beside=beside: {"None": ball} | beside)
        if beside:
            log = mat.read(str(path), Request())
            assert list(log.arrays) == ["t"]
            said = " ".join(log.remarks)
        else:
            with pytest.raises(RecordError) as refused:
                mat.read(str(path), Request())
            said = str(refused.value)
        assert "ball is an object of the class timeseries, which only MATLAB opens" in said
        assert "ball.Data" in said


@pytest.mark.parametrize("mark", ["#", "%"])
def test_names_in_a_comment_above_the_numbers_are_names(tmp_path, mark):
    lines = ["# rig 3", f"{mark} run of monday", f"{mark} t [s], y [mm], u [V]"]
    (tmp_path / "log.csv").write_text("\n".join([*lines, "0,1,2", "0.001,2,3", "0.002,3,4"]) + "\n")
    log = read_log(tmp_path / "log.csv")
    assert {"t", "y", "u"} <= set(log.arrays)
    assert log.units["y"] == "mm"


def test_a_sheet_of_excel_is_read_as_the_text_that_it_is(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["notes of the rig"])
    sheet = book.create_sheet("run 7")
    sheet.append(["Zeit [s]", "Weg W13 [mm]", "Strom [A]"])
    rows = [(1e-3 * k, 0.1 + 0.2 * k, None if k == 3 else 1 / (k + 3)) for k in range(9)]
    for row in rows:
        sheet.append(row)
    book.save(tmp_path / "log.xlsx")
    log = read_log(tmp_path / "log.xlsx")
    assert log.order == ("Zeit", "Weg W13", "Strom")
    assert log.units == {"Zeit": "s", "Weg W13": "mm", "Strom": "A"}
    columns = np.transpose(list(log.arrays.values()))
    np.testing.assert_allclose(columns, np.array(rows, float), rtol=1e-15)  # Excel's 16 digits
    assert "sheet run 7" in log.remarks
    only_text = openpyxl.Workbook()
    only_text.active.append(["a"])
    only_text.save(tmp_path / "text.xlsx")
    with pytest.raises(RecordError, match=r"text\.xlsx: no sheet has numbers"):
        read_log(tmp_path / "text.xlsx")
    (tmp_path / "cut.xlsx").write_bytes((tmp_path / "log.xlsx").read_bytes()[:900])
    with pytest.raises(RecordError, match=r"cut\.xlsx: is damaged or cut short"):
        read_log(tmp_path / "cut.xlsx")
