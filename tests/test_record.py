"""The record and its files: exact both ways, and clear about every way a file can be wrong."""

import csv
import json
import os
import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ambkit import KalmanFilter, Machine, Scenario, simulate
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.data.record import Record
from ambkit.data.signals import SI_UNITS, si_unit

ENDINGS = (".csv", ".parquet")
VALUES = st.floats(allow_nan=True, allow_infinity=False, width=64)


def ramp(n=5, **signals):
    return Record(1e-3 * np.arange(n), signals or {"y": np.linspace(0.0, 1e-3, n)})


def same(first, second):
    assert list(first) == list(second)
    np.testing.assert_array_equal(first.t, second.t)
    for name in first:
        np.testing.assert_array_equal(first[name], second[name])
    assert first.units == second.units
    assert first.meta == second.meta


@pytest.fixture
def load(tmp_path):
    def from_text(text):
        path = tmp_path / "log.csv"
        path.write_text(text)
        return Record.load(path)

    return from_text


@pytest.mark.parametrize("ending", ENDINGS)
@given(
    samples=st.lists(st.tuples(VALUES, VALUES), min_size=2, max_size=20),
    text=st.text(max_size=20),
    seed=st.integers(),
)
@example(samples=[(0.0, 0.0), (0.0, 0.0), (-1.7e308, 1.7976931348623157e308)], text="", seed=0)
def test_files_give_back_every_bit(tmp_path_factory, ending, samples, text, seed):
    y, k = np.array(samples).T
    meta = {"bearing": text, "seed": seed, "scenario": {"duration": 0.1, "list": [1, None, True]}}
    record = Record(0.3 + 1e-4 * np.arange(len(y)), {"y": y, "k": k}, {"k": "N m^2/A^2"}, meta=meta)
    path = tmp_path_factory.mktemp("round") / f"record{ending}"
    record.save(path)
    same(Record.load(path), record)


def test_units_in_the_header_are_converted(load):
    record = load(
        "t [ms],y [mm],r (um),u [mV],duty [%],k [N mm^2/A^2]\n0,2,5,3,40,6.7\n1,,5,3,40,6.7\n"
    )
    assert record.units == {"y": "m", "r": "m", "u": "V", "duty": "1", "k": "N m^2/A^2"}
    assert record.t[1] == 1e-3
    np.testing.assert_array_equal(record["y"], [2e-3, np.nan])
    assert [record[name][0] for name in record] == pytest.approx([2e-3, 5e-6, 3e-3, 0.4, 6.7e-6])


@pytest.mark.parametrize("missing", ["", "nan", "NaN", " "])
def test_a_missing_sample_is_kept_as_nan(load, missing):
    record = load(f"t [s];y [m]\n0;1\n1;{missing}\n2;3\n")
    np.testing.assert_array_equal(record["y"], [1, np.nan, 3])


@pytest.mark.parametrize("separator", [",", ";", "\t", ", "])
def test_separators_and_foreign_comments(load, separator):
    rows = ["t [s]|y [m]", "0|1e-3", "1|2e-3"]
    text = "# scope: A 12\n# anything\n\n" + "\n".join(rows).replace("|", separator)
    record = load(text)
    np.testing.assert_array_equal(record["y"], [1e-3, 2e-3])
    assert record.meta == {"scope": "A 12"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no header"),
        ("# only a note\n", "no header"),
        ("0,1\n1,2\n", "log.csv:1: has numbers where the header"),
        ("t [s],y\n0,1\n1,2\n", r"log.csv:1: column y has no unit; write one, as in y \[m\]"),
        ("# a: 1\nt [s],y [V]\n0,1\n1,2\n", "log.csv:2: column y: V cannot be converted to m"),
        ("t [s],y [parsnip]\n0,1\n1,2\n", 'column y: "parsnip" is not a known unit'),
        ("t [s],k [mT/ms]\n0,1\n1,2\n", "column k: mT/ms measures nothing"),
        ("t [s],y [m],y [m]\n0,1,1\n1,2,2\n", "two columns have the same name"),
        ("x [m],y [m]\n0,1\n1,2\n", r"has no column t \[s\]; it has x, y"),
        ("t [s],y [m]\n0,1\n1,two\n2,3\n", "log.csv:3: column y: 'two' is not a number"),
        ("# a: 1\nt [s],y [m]\n0,1\n\n1,2;3\n", "log.csv:5: column y: '2;3' is not a number"),
        ("t [s],y [m]\n0,1\n1\n2,3\n", "log.csv:3: has 1 cell instead of 2$"),
        ("t [s],y [m]\n0,1\n1,2\n2", "log.csv:4: has 1 cell instead of 2; is the file cut short"),
        ("t [s],y [m]\n0,1\n", "at least 2 samples"),
        ("t [s],y [m]\n", "at least 2 samples"),
        ("t [s],y [m]\n0,1\n1,2\n1,3\n", "t must increase, but sample 2 has 1 s after 1 s"),
        ("t [s],y [m]\n0,1\n1,2\n2,3\n4,5\n", "from sample 2 to 3 .t = 4 s. it goes on by 2 s"),
        ("t [s],y [m]\n0,1\n,2\n2,3\n", "t is nan at sample 1"),
        ("t [s],y [m]\n0,1\ninf,2\n2,3\n", "t is inf at sample 1"),
        ("t [s],y [m]\n0,1\n1,-inf\n2,3\n", "signal y is -inf at sample 1 .t = 1 s."),
    ],
)
def test_what_is_wrong_with_a_csv(load, text, message):
    with pytest.raises(RecordError, match=message):
        load(text)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_file_cut_short_is_noticed_wherever_it_ends(tmp_path, ending):
    path = tmp_path / f"record{ending}"
    rng = np.random.default_rng(0)
    Record(np.arange(30.0), {"y": rng.normal(size=30)}, meta={"seed": 1}).save(path)
    whole = path.read_bytes()
    for length in range(0, len(whole), 7 if ending == ".csv" else 101):
        path.write_bytes(whole[:length])
        with pytest.raises(AmbkitError, match="record"):
            Record.load(path)
    path.write_bytes(whole[:-1])
    with pytest.raises(AmbkitError, match="record"):
        Record.load(path)


def test_a_parquet_without_units_or_numbers(tmp_path):
    import pyarrow as pa
    from pyarrow import parquet

    path = tmp_path / "log.parquet"
    parquet.write_table(pa.table({"t": [0.0, 1.0], "y": [1.0, 2.0]}), path)
    with pytest.raises(RecordError, match="column t has no unit"):
        Record.load(path)
    parquet.write_table(pa.table({"t": [0.0, 1.0], "y": ["a", "b"]}), path)
    with pytest.raises(RecordError, match="column y holds string, not numbers"):
        Record.load(path)


@pytest.mark.parametrize("ending", [*ENDINGS, ".mat"])
def test_no_such_file(tmp_path, ending):
    with pytest.raises(AmbkitError, match=r"nowhere.*No such file"):
        Record.load(tmp_path / f"nowhere{ending}")


@pytest.mark.parametrize("name", ["record.xls", "record"])
def test_other_endings(tmp_path, name):
    with pytest.raises(RecordError, match=r"cannot write .*use \.csv or \.parquet"):
        ramp().save(tmp_path / name)
    with pytest.raises(RecordError, match=r"cannot read"):
        Record.load(tmp_path / name)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_failed_save_leaves_the_old_file_whole(tmp_path, ending, monkeypatch):
    path = tmp_path / f"record{ending}"
    ramp().save(path)
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(AmbkitError, match="No space left"):
        ramp(9).save(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_folder_that_cannot_be_written(tmp_path, ending):
    with pytest.raises(AmbkitError, match="cannot be written"):
        ramp().save(tmp_path / "nowhere" / f"record{ending}")


def test_meta_that_json_cannot_hold(tmp_path):
    with pytest.raises(RecordError, match="meta cannot be written as JSON"):
        Record([0, 1], {"y": [0, 0]}, meta={"what": {1, 2}}).save(tmp_path / "record.csv")
    assert not list(tmp_path.iterdir())


def test_notes_are_json(tmp_path):
    path = tmp_path / "record.csv"
    Record([0, 1], {"y": [0, 0]}, meta={"bearing": 'name = "a"\nb'}).save(path)
    (*_, notes), *_ = csv.reader(path.read_text().splitlines())
    assert json.loads(notes.removeprefix("# ")) == {"bearing": 'name = "a"\nb', "rows": 2}


def test_pandas_reads_our_csv_without_options(tmp_path):
    pandas = pytest.importorskip("pandas")
    record = ramp(9, y=np.array([np.nan, *np.arange(8) / 3]))
    record.save(path := tmp_path / "record.csv")
    frame = pandas.read_csv(path)
    assert len(frame) == 9
    for name in record.signals:
        column = frame[f"{name} [{record.units[name]}]"].to_numpy()
        assert column.dtype == float
        np.testing.assert_array_equal(column, record[name])


def test_files_with_notes_before_the_header_are_read_as_before(tmp_path):
    path = tmp_path / "record.csv"
    path.write_text('# bearing: "a"\n# rows: 2\nt [s],y [mm]\n0.0,1.5\n0.001,\n')
    old = Record.load(path)
    assert old.meta == {"bearing": "a"}
    assert old["y"][0] == 1.5e-3
    path.write_text(path.read_text().replace("rows: 2", "rows: 3"))
    with pytest.raises(RecordError, match="has 2 rows, and says that it has 3"):
        Record.load(path)


def test_arrays_are_copies_that_cannot_be_written():
    mine = np.zeros(5)
    record = ramp(5, y=mine)
    mine[0] = 1.0
    assert record["y"][0] == 0.0
    for values in (record["y"], record.t, record.between(0.001)["y"]):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0, 1], {"y": [1, 2, 3]}), r"signal y has shape \(3,\)"),
        (([0, 1], {"y": ["a", "b"]}), "signal y must be numeric"),
        (([0, 1], {"t": [1, 2]}), "t is the time"),
        (([0, 1], {"k": [1, 2]}), "signal k has no unit"),
        (([0, 1], {"k": [1, 2]}, {"k": "mm"}), "signal k must be given in m, not in mm"),
        (([0, 1], {"y": [1, 2]}, {"y": "V"}), "signal y must be given in m, not in V"),
        (([0, 1], {"k": [1, 2]}, {"k": "parsnip"}), "not a known unit"),
        (([0], {"y": [1]}), "at least 2 samples"),
        (([[0, 1]], {"y": [1, 2]}), "at least 2 samples"),
    ],
)
def test_what_is_no_record(arguments, message):
    with pytest.raises(RecordError, match=message):
        Record(*arguments)


def test_times_that_a_log_printed_rounded():
    t = np.round(np.arange(1000) / 3000, 6)
    assert Record(t, {}).sampling_time == pytest.approx(1 / 3000, rel=1e-5)


def test_between():
    record = Record(0.1 * np.arange(11), {"y": np.arange(11.0)})
    part = record.between(0.3, 0.7)  # in floating point 3 * 0.1 is greater than 0.3
    np.testing.assert_array_equal(part["y"], [3, 4, 5, 6])
    np.testing.assert_array_equal(part.t, record.t[3:7])
    assert len(record.between(stop=0.5)) == 5
    assert len(record.between(0.5)) == 6
    with pytest.raises(RecordError, match=r"no samples from 2 to 3 s: it goes from 0 to 1 s"):
        record.between(2.0, 3.0)


def test_names():
    record = Record([0, 1], {"y": [0, 0], "u": [1, 1]})
    assert list(record) == ["y", "u"]
    assert "y" in record
    assert "t" in record
    assert "r" not in record
    assert list(record.select("u")) == ["u"]
    assert repr(record) == "<Record 0 to 1 s, 2 samples: y [m], u [V]>"
    np.testing.assert_array_equal(record["t"], [0, 1])
    with pytest.raises(RecordError, match="no signal r; it has y, u"):
        record["r"]


def test_only_a_simulation_knows_the_truth(tmp_path):
    signals = {"y": [0, 0], "x": [1, 1], "f_d": [2, 2]}
    simulated = Record([0, 1], signals, meta={"scenario": {"duration": 1.0}})
    assert list(simulated.truth) == ["x", "f_d"]
    assert simulated.has_truth
    simulated.save(tmp_path / "record.csv")
    assert Record.load(tmp_path / "record.csv").has_truth
    estimated = Record([0, 1], signals, meta={"estimator": "linear"})
    assert not estimated.has_truth
    assert estimated.truth == {}


def test_si_units():
    assert [si_unit(unit) for unit in SI_UNITS] == list(SI_UNITS)
    assert [si_unit(unit) for unit in ("um/ms", "g", "%", "-", "", "A V/A")] == [
        "m/s", "kg", "1", "1", "1", "V",
    ]  # fmt: skip


def amplifier_of_currents(of):
    """Return a machine whose control signals are currents."""
    return type(of).from_toml(re.sub(r'(gain = "[^"]*)A/V"', r'\1A/A"', of.to_toml()))


def test_the_control_signal_of_an_amplifier_of_currents_is_in_ampere(tmp_path):
    plain = Machine.preset("zittau_axial")
    bearing = amplifier_of_currents(plain)
    for same in (bearing, bearing.replace(rotor__mass=0.5), bearing.isolated_axis("")):
        assert 'gain = "1 A/A"' in same.to_toml()
    made = simulate(bearing, Scenario(duration=0.01)).record
    made.save(tmp_path / "a.csv")
    read = Record.load(tmp_path / "a.csv")
    assert made.units["u"] == read.units["u"] == "A"
    np.testing.assert_array_equal(read["u"], simulate(plain, Scenario(duration=0.01)).record["u"])
    KalmanFilter(bearing).run(read)
    with pytest.raises(AmbkitError, match="u of the record is in A, and the amplifier"):
        KalmanFilter(plain).run(read)
    machine = amplifier_of_currents(Machine.preset("tum_mlps"))
    units = simulate(machine, Scenario(duration=0.002)).record.units
    assert {units[name] for name in ("u_A1", "u_A2", "u_B1", "u_B2")} == {"A"}
