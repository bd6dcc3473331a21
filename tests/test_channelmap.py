"""The channel map: it gives the channels of a log their meaning, and says where it is wrong."""

import numpy as np
import pytest
from scipy.io import savemat

import ambkit
from ambkit.base.errors import ConfigError, RecordError
from ambkit.data import recordings
from ambkit.data.channel_map import ChannelMap, inputs_of
from ambkit.data.record import Record

MAP = """\
name = "a rig"
array = "log"

[signals.t]
row = 0
unit = "ms"

[signals.y]
row = 2
unit = "mm"
sign = -1
offset = "10 mm"

[signals.u]
row = 1
unit = "A"
scale = "2 V/A"
offset = "-1 V"
"""
T = np.arange(4.0)
CURRENT = np.array([0.5, 1.0, 1.5, 2.0])
Z = np.array([10.0, 9.0, 8.0, np.nan])


@pytest.fixture
def mat(tmp_path):
    path = tmp_path / "log.mat"
    savemat(
        path,
        {"log": np.array([T, CURRENT, Z]), "time": T, "note": "text", "turned": np.array([T, Z]).T},
    )
    return path


def check(record):
    np.testing.assert_allclose(record.t, T * 1e-3)
    np.testing.assert_allclose(record["y"], [0, 1e-3, 2e-3, np.nan], atol=1e-18)
    np.testing.assert_allclose(record["u"], [0, 1, 2, 3])
    assert record.units == {"y": "m", "u": "V"}


def test_value_is_sign_scale_number_unit_plus_offset(mat):
    record = ambkit.load(mat, ChannelMap.from_toml(MAP))
    check(record)
    assert record.meta == {"log": "a rig", "source": "log.mat"}


def test_the_map_may_be_a_file(mat, tmp_path):
    path = tmp_path / "map.toml"
    path.write_text(MAP)
    check(ambkit.load(mat, path))
    ChannelMap.load(path).save(tmp_path / "again.toml")
    assert ChannelMap.load(tmp_path / "again.toml") == ChannelMap.load(path)


def test_samples_as_rows_and_arrays_by_name(mat):
    text = """
        [signals.t]
        array = "time"
        unit = "ms"
        [signals.y]
        array = "turned"
        column = 1
        unit = "mm"
        scale = -1
    """
    record = ambkit.load(mat, ChannelMap.from_toml(text))
    np.testing.assert_allclose(record["y"], -1e-3 * Z)


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_columns_by_name(tmp_path, ending):
    path = tmp_path / f"log{ending}"
    if ending == ".csv":
        path.write_text("Zeit;Strom [V];Text;Weg\n0;0.5;a;10\n1;1.0;b;9\n2;1.5;;8\n3;2;d;\n")
    else:
        import pyarrow as pa
        from pyarrow import parquet

        table = pa.table({"Zeit": T, "Strom": CURRENT, "Text": list("abcd"), "Weg": Z})
        parquet.write_table(table, path)
    text = MAP.replace("row = 0", 'column = "Zeit"').replace("row = 1", 'column = "Strom"')
    channel_map = ChannelMap.from_toml(text.replace("row = 2", 'column = "Weg"'))
    check(ambkit.load(path, channel_map))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("row = 2", "row = 20", r"signal y: log has no row 20, its shape is \(3, 4\)"),
        ("row = 2", "column = 4", r"signal y: log has no column 4, its shape is \(3, 4\)"),
        ("row = 2", "", r"signal y: log has shape \(3, 4\): which row or column"),
        ("row = 2", "column = 2", "signal y has shape"),
        ("row = 2", 'column = "z"', "signal y: there is no z; there is log, time, turned"),
        ('"log"', '"lag"', "signal t: there is no lag; there is log, time, turned"),
        ('array = "log"', "", "signal t: the channel map does not say which array"),
    ],
)
def test_a_log_that_lacks_what_the_map_says(mat, old, new, message):
    with pytest.raises(RecordError, match=message) as failure:
        ambkit.load(mat, ChannelMap.from_toml(MAP.replace(old, new)))
    assert "log.mat" in str(failure.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"mm"', '"V"', '12: signals.y.offset: "10 mm": mm cannot be converted to V'),
        ('"mm"\nsign = -1\noffset = "10 mm"', '"V"', "10: signals.y.unit: makes y a quantity in V"),
        ('"mm"', '"parsnip"', '10: signals.y.unit: "parsnip" is not a known unit'),
        ('"2 V/A"', '"2 parsnip"', "17: signals.u.scale: .* is not a known unit"),
        ('"2 V/A"', '"0.5 A/V"', '17: signals.u.scale: .* A times A/V .* upside down: "2 V/A"'),
        ('"2 V/A"', '"V/A"', '17: signals.u.scale: "V/A" is not a number with a unit'),
        ('"2 V/A"', "0", "17: signals.u.scale: must not be 0"),
        ('"-1 V"', '"-1 A"', '18: signals.u.offset: "-1 A": A cannot be converted to V'),
        ('"-1 V"', '"-1"', '18: signals.u.offset: "-1" has no unit'),
        ("sign = -1", "sign = -2", "11: signals.y.sign: must be 1 or -1, is -2"),
        ("row = 2", "row = -2", "9: signals.y.row: must be greater than or equal to 0, is -2"),
        ("row = 2", "row = 2\ncolumn = 1", "10: signals.y.column: give either row or column"),
        ("row = 2", "rew = 2", "9: signals.y.rew: unknown key, did you mean row?"),
        ("[signals.t]", "[signals.time]", "signals: t, the time, is missing"),
    ],
)
def test_what_is_wrong_with_a_map(old, new, message):
    text = MAP.replace(old, new)
    with pytest.raises(ConfigError, match=message):
        ChannelMap.from_toml(text, "map.toml")


def test_all_mistakes_at_once():
    text = (
        MAP.replace('"mm"', '"parsnip"').replace('"-1 V"', '"-1 A"').replace("row = 0", "row = 0.5")
    )
    with pytest.raises(ConfigError) as failure:
        ChannelMap.from_toml(text)
    assert len(failure.value.problems) == 3


def test_a_mat_without_a_map_says_what_it_holds(mat):
    with pytest.raises(RecordError, match=r"needs a channel map .* log \(3, 4\), time \(1, 4\)"):
        Record.load(mat)


def test_a_mat_cut_short(mat):
    whole = mat.read_bytes()
    channel_map = ChannelMap.from_toml(MAP)
    for length in (0, 50, 128, 200, len(whole) // 2):
        mat.write_bytes(whole[:length])
        with pytest.raises(RecordError, match=r"log\.mat"):
            ambkit.load(mat, channel_map)


def test_the_maps_of_the_shipped_recordings_are_whole():
    for path in sorted(recordings.folder().glob("*.toml")):
        assert "t" in ChannelMap.load(path).signals


def test_what_is_read_off_the_scale_of_y_moves_with_it():
    """A filter that found the sensor off its zero sees the reference off as much."""
    text = "".join(
        f'[signals.{name}]\ncolumn = "{name}"\nunit = "{unit}"\n{more}'
        for name, unit, more in (
            ("t", "s", ""), ("y", "mm", 'sign = -1\noffset = "10 mm"\n'),
            ("r", "µm", 'offset = "1 µm"\n'), ("u", "V", ""), ("v_logged", "m/s", ""),
        )
    )  # fmt: skip
    channels = ChannelMap.from_toml(text)
    own = inputs_of(channels)
    found = own.model_copy(update={"y": own.y.shifted(-25e-6)})
    moved = channels.with_inputs(found).signals
    assert moved["y"].zero == pytest.approx(9.975e-3, rel=1e-12)
    assert moved["r"].zero == pytest.approx(-24e-6, rel=1e-9)
    assert moved["v_logged"] == channels.signals["v_logged"]
    assert channels.with_inputs(own) == channels


def test_a_current_whose_control_is_there_is_measured(mat):
    driven = MAP + '\n[signals.control]\nrow = 1\nunit = "1"\n'
    read = [ambkit.load(mat, ChannelMap.from_toml(text)) for text in (MAP, driven)]
    assert ["measured" in record.meta for record in read] == [False, True]
