"""Times as text: exact to the nanosecond, in any layout; what cannot be told is refused."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pyarrow as pa
import pytest
from effort import lines_run
from hypothesis import given
from hypothesis import strategies as st

from ambkit.base.errors import ConfigError, RecordError
from ambkit.data.channel_map import ChannelMap
from ambkit.data.files import timestamps
from ambkit.data.files.timestamps import layouts, pattern
from ambkit.data.reading import read
from ambkit.data.reading.propose import guess
from ambkit.data.record import Record
from tests import logs

MAP = """
[signals.t]
column = "time"
unit = "s"
[signals.y]
column = "y"
unit = "mm"
[signals.u]
column = "u"
unit = "V"
"""


def seconds(cells, layout="", **options):
    return timestamps.read(cells, layout, "time", "log:{}".format, **options)


def log(path, cells, separator=",", decimal="."):
    numbers = ((f"{0.1 * (k % 7):.1f}", f"{0.2 * (k % 5):.1f}") for k in range(len(cells)))
    rows = [
        (c, *(n.replace(".", decimal) for n in both))
        for c, both in zip(cells, numbers, strict=True)
    ]
    path.write_text("\n".join(map(separator.join, [("time", "y", "u"), *rows])) + "\n")
    return path


START = st.datetimes(datetime(1950, 1, 1), datetime(2100, 1, 1))
STEPS = st.lists(st.integers(0, 10**15), min_size=1, max_size=8)


@given(start=START, steps=STEPS, separator=st.sampled_from("T "))
def test_nanoseconds_are_those_of_numpy(start, steps, separator):
    ticks = np.datetime64(start, "ns") + np.cumsum([0, *steps])
    cells = [str(t).replace("T", separator) for t in ticks]
    expected = (ticks - ticks[0]).astype(np.int64) / 1e9
    np.testing.assert_array_equal(seconds(cells).seconds, expected)


@pytest.mark.parametrize(
    "layout",
    [
        "%d.%m.%Y %H:%M:%S,%f", "%m/%d/%Y %I:%M:%S.%f %p", "%d-%b-%Y %H:%M:%S.%f",
        "%y%m%d-%H%M%S.%f", "%Y-%j %H.%M.%S.%f", "%Y-%m-%dT%H:%M:%S.%f%z", "%H:%M:%S.%f %d/%m/%y",
    ],
)  # fmt: skip
@given(start=st.datetimes(datetime(1971, 1, 1), datetime(2065, 1, 1)), steps=STEPS)
def test_a_layout_is_read_as_python_reads_it(layout, start, steps):
    start = start.replace(tzinfo=UTC)
    moments = [start + timedelta(microseconds=int(s) // 1000) for s in np.cumsum([0, *steps])]
    expected = [(m - start) / timedelta(seconds=1) for m in moments]
    assert [datetime.strptime(m.strftime(layout), layout).replace(tzinfo=UTC) for m in moments] == (
        moments
    )
    found = seconds([m.strftime(layout) for m in moments], layout).seconds
    np.testing.assert_array_equal(found, expected)


@given(
    moments=st.lists(
        st.tuples(
            st.datetimes(datetime(1971, 1, 1), datetime(2065, 1, 1)),
            st.integers(-14 * 60, 14 * 60),
        ),
        min_size=1, max_size=6,
    ),
    separator=st.sampled_from("T "),
    colon=st.booleans(),
)  # fmt: skip
def test_a_zone_is_read_as_python_reads_it(moments, separator, colon):
    """West of Greenwich and with odd minutes, too; a clock that goes back is another matter."""
    zoned = [m.replace(tzinfo=timezone(timedelta(minutes=z))) for m, z in moments]
    zoned.sort()
    cells = [m.isoformat(separator, timespec="microseconds") for m in zoned]
    cells = cells if colon else [cell[:-3] + cell[-2:] for cell in cells]
    expected = [(datetime.fromisoformat(c) - zoned[0]) / timedelta(seconds=1) for c in cells]
    np.testing.assert_allclose(seconds(cells).seconds, expected, atol=1e-9, rtol=1e-15)


@pytest.mark.parametrize(
    "cells",
    [
        ["2024-05-03 12:00:00.123", "2024-05-03 12:00:00.624"],
        ["2024-05-03T12:00:00Z", "2024-05-03T12:00:00.501Z"],
        ["2024-05-03T12:00:00,5+02:00", "2024-05-03T10:00:01.001+00:00"],
        ["2024/5/3 9:59:59.999", "2024/5/3 10:00:00.5"],
        ["20240503T120000.000", "20240503T120000.501"],
        ["03-May-2024 12:00:00", "03-May-2024 12:00:00.501"],
        ["31.12.2023 23:59:59,999", "01.01.2024 00:00:00,500"],  # there is no month 31
        ["5/3/2024 11:59:59.999 AM", "5/3/2024 12:00:00.500 PM"],
        ["23:59:59.999", "0:00:00.500"],
    ],
)
def test_layouts_that_need_not_be_told(cells):
    found = seconds(cells)
    np.testing.assert_array_equal(found.seconds, [0, 0.501])
    assert found.certain


def test_which_is_the_day_must_be_told_where_it_matters(tmp_path):
    cells = [f"0{3 + (k > 4)}.05.2024 {'23:59:59' if k < 5 else '00:00:00'},{k % 5 * 2:03}"
             for k in range(10)]  # fmt: skip
    cells[:5] = [f"03.05.2024 23:59:59,{990 + 2 * k}" for k in range(5)]
    path = log(tmp_path / "log.csv", cells, ";", ",")
    with pytest.raises(RecordError, match=r"which is the day in 03\.05\.2024 .* format = \"%d\.%m"):
        read(path, ChannelMap.from_toml(MAP))
    told = MAP.replace('unit = "s"', 'unit = "s"\nformat = "%d.%m.%Y %H:%M:%S,%f"')
    record = read(path, ChannelMap.from_toml(told)).record
    np.testing.assert_allclose(record.t, 2e-3 * np.arange(10), atol=1e-12)
    text = guess(path)
    assert 'format = "%d.%m.%Y %H:%M:%S.%f"' in text
    assert "day and month are guessed" in text
    assert read(path, ChannelMap.from_toml(text)).record.t[-1] == pytest.approx(0.018)


def test_which_is_the_day_does_not_matter_within_one():
    found = seconds(["03.05.2024 12:00:00,1", "03.05.2024 12:00:00,2"])
    np.testing.assert_array_equal(found.seconds, [0, 0.1])


@pytest.mark.parametrize(
    ("day", "before", "after", "word"),
    [
        ("2024-10-27", "02:59:59.99", "02:00:00.00", "back by an hour, as summer time ends"),
        ("2024-03-31", "01:59:59.99", "03:00:00.00", "on, as summer time begins"),
    ],
)
def test_summer_time_is_taken_out_and_told(tmp_path, day, before, after, word):
    cells = [f"{day} {before}{k}" for k in range(10)] + [f"{day} {after}{k}" for k in range(10)]
    reading = read(log(tmp_path / "log.csv", cells), ChannelMap.from_toml(MAP))
    np.testing.assert_allclose(reading.record.t, 1e-3 * np.arange(20), atol=1e-12)
    (remark,) = [r for r in reading.remarks if "summer" in r]
    assert f"log.csv:12: time is put {word}: taken out" in remark
    # An hour on any other day is a jump, and is not mended.
    other = [cell.replace(day, "2024-05-03") for cell in cells]
    assert abs(seconds(other).seconds[-1]) > 3500
    # With its distance from UTC the time goes on by itself.
    zones = ["+02:00" if k < 10 else "+01:00" for k in range(20)]
    if "ends" in word:
        zoned = [cell + zone for cell, zone in zip(cells, zones, strict=True)]
        np.testing.assert_allclose(seconds(zoned).seconds, 1e-3 * np.arange(20), atol=1e-12)


def test_midnight_is_passed_and_told(tmp_path):
    ticks = np.datetime64("2024-05-03T23:59:59.990", "ms") + np.arange(40)
    cells = [str(t).partition("T")[2] for t in ticks]
    reading = read(log(tmp_path / "log.csv", cells), ChannelMap.from_toml(MAP))
    np.testing.assert_allclose(reading.record.t, 1e-3 * np.arange(40), atol=1e-12)
    assert "time goes past midnight: carried on" in reading.remarks
    # Where it goes back by less, it is a jump.
    cells = [f"{21 - k // 10}:00:00.{k % 10:03}" for k in range(20)]
    with pytest.raises(RecordError, match="t jumps from 9 ms to"):
        read(log(tmp_path / "log.csv", cells), ChannelMap.from_toml(MAP))


def test_what_is_no_time_is_reported_with_its_line(tmp_path):
    cells = [f"2024-05-03 12:00:00.{k:03}" for k in range(20)]
    cells[4], cells[7], cells[9] = "2024-02-30 12:00:00.004", "soon", "2024-05-03 24:01:00"
    with pytest.raises(RecordError) as failure:
        read(path := log(tmp_path / "log.csv", cells), ChannelMap.from_toml(MAP))
    assert [p.partition(": ")[0][-10:] for p in failure.value.problems] == [
        "/log.csv:6", "/log.csv:9", "log.csv:11",
    ]  # fmt: skip
    assert "'soon' is no time of the format" in failure.value.problems[1]
    with pytest.raises(RecordError, match="'soon' is no time of the format"):
        guess(path)
    with_another = path.read_text().splitlines()
    numbered = [f"{k * 0.001:.3f},{line}" for k, line in enumerate(with_another[1:])]
    path.write_text("\n".join([f"sec,{with_another[0]}", *numbered]) + "\n")
    text = guess(path)  # it has another time, and the damage is told
    assert ChannelMap.from_toml(text).signals["t"].column == "sec"
    assert "is no time of the format" in text
    cells[4] = cells[7] = cells[9] = ""
    with pytest.raises(RecordError, match=r"log.csv:6: t is nan at sample 4"):
        read(log(tmp_path / "log.csv", cells), ChannelMap.from_toml(MAP))


def test_a_clock_with_too_few_digits_is_reported():
    ticks = [f"12:00:0{k // 1000}" for k in range(4000)]
    assert np.unique(seconds(ticks).seconds).size == 4


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ("%Q", '"%Q" is none of %Y'), ("%H:%H:%S", "twice"), ("%Y-%m-%d", "no time of the day"),
        ("%Y %H:%M", "needs a month and a day"),
    ],
)  # fmt: skip
def test_a_format_that_means_nothing(layout, message):
    with pytest.raises(ConfigError, match=message):
        ChannelMap.from_toml(MAP.replace('unit = "s"', f'unit = "s"\nformat = "{layout}"'))
    with pytest.raises(ValueError, match=message):
        pattern(layout)


def test_times_as_text_are_seconds(tmp_path):
    path = log(tmp_path / "log.csv", [f"12:00:00.{k:03}" for k in range(20)])
    with pytest.raises(
        RecordError, match=r'time holds times as text, which are seconds: unit = "s"'
    ):
        read(path, ChannelMap.from_toml(MAP.replace('"s"', '"ms"')))
    with pytest.raises(ConfigError, match=r'format: is of times as text.*unit = "s"'):
        ChannelMap.from_toml(MAP.replace('"s"', '"ms"\nformat = "%H:%M:%S"'))


def test_a_format_that_is_not_known_by_itself_is_read_if_told(tmp_path):
    path = log(tmp_path / "log.csv", [f"day 12 at 12h00m0{k}" for k in range(9)])
    told = MAP.replace('unit = "s"', 'unit = "s"\nformat = "day %d at %Hh%Mm%S"')
    np.testing.assert_array_equal(read(path, ChannelMap.from_toml(told)).record.t, np.arange(9.0))
    with pytest.raises(RecordError, match="'day 12 at 12h00m00' is not a number"):
        read(path, ChannelMap.from_toml(MAP))


@pytest.mark.parametrize("kind", ["csv", "txt", "parquet", "h5", "mat", "cells.mat", "73.mat"])
def test_the_guess_and_the_reading_of_each_format(tmp_path, kind):
    rng = np.random.default_rng(1)
    n = 600
    cells = np.datetime_as_string(np.datetime64("2024-05-03T12:00:00", "us") + 500 * np.arange(n))
    wave = np.sin(np.arange(n) / 50)
    y, u = 0.1 * wave + 0.01 * rng.normal(size=n), -0.3 * wave + 0.01 * rng.normal(size=n)
    path = tmp_path / f"log.{kind}"
    if kind == "parquet":
        logs.parquet(path, {"time": cells, "y": y, "u": u})
    elif kind == "73.mat":
        logs.mat73(path, {"time": cells.astype(object), "y": y, "u": u})
    elif kind.endswith("mat"):
        logs.mat5(
            path, {"time": cells.astype(object) if "cells" in kind else cells, "y": y, "u": u}
        )
    elif kind == "h5":
        logs.hdf5(path, {"time": cells.astype("S"), "y": y, "u": u})
    else:
        separator = "," if kind == "csv" else "  "
        rows = (separator.join(map(str, row)) for row in zip(cells, y, u, strict=True))
        path.write_text("\n".join([separator.join(("time", "y", "u")), *rows]) + "\n")
    text = guess(path)
    record = read(path, ChannelMap.from_toml(text)).record
    np.testing.assert_allclose(record.t, 5e-4 * np.arange(n), atol=1e-12)
    assert "times as text" in text
    assert "2000 Hz" in text


@pytest.mark.parametrize("kind", ["h5", "mat"])
def test_a_format_is_reported_of_an_array_too(tmp_path, kind):
    cells = np.array([f"12h00m0{k}" for k in range(9)])
    path = tmp_path / f"log.{kind}"
    y = np.sin(np.arange(9.0))
    if kind == "h5":
        logs.hdf5(path, {"time": cells.astype("S"), "y": y, "u": y})
    else:
        logs.mat5(path, {"time": cells, "y": y, "u": y})
    told = MAP.replace("column", "array").replace('"s"', '"s"\nformat = "%Hh%Mm%S"')
    np.testing.assert_array_equal(read(path, ChannelMap.from_toml(told)).record.t, np.arange(9.0))
    with pytest.raises(RecordError, match="there is no time"):
        read(path, ChannelMap.from_toml(MAP.replace("column", "array")))


def test_without_a_map_a_column_t_may_be_text(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,y [mm],u [V]\n12:00:00.000,1,2\n12:00:00.001,1,3\n12:00:00.002,2,3\n")
    np.testing.assert_allclose(Record.load(path).t, [0, 1e-3, 2e-3])
    path.write_text(path.read_text().replace("t,", "when,", 1))
    with pytest.raises(RecordError, match="column when holds times as text: give a channel map"):
        Record.load(path)


def test_dates_and_times_of_a_parquet(tmp_path):
    from pyarrow import parquet

    y = np.sin(np.arange(4.0))
    ticks = np.array([86_399_999_000, 86_399_999_500, 0, 500])  # past midnight
    times = pa.array(ticks, pa.time64("us"))
    stamps = pa.array([5, 10, None, 20], pa.timestamp("ns"))
    parquet.write_table(pa.table({"time": times, "y": y, "u": y}), tmp_path / "a.parquet")
    found = read(tmp_path / "a.parquet", ChannelMap.from_toml(MAP))
    np.testing.assert_allclose(found.record.t, 5e-4 * np.array([0, 1, 2, 3]))
    assert any("midnight" in remark for remark in found.remarks)
    parquet.write_table(pa.table({"time": stamps, "y": y, "u": y}), tmp_path / "b.parquet")
    with pytest.raises(RecordError, match="t is nan at sample 2"):
        read(tmp_path / "b.parquet", ChannelMap.from_toml(MAP))


@pytest.mark.parametrize("kind", ["csv", "parquet", "h5", "mat"])
def test_nanoseconds_since_1970_lose_no_digit(tmp_path, kind):
    n = 500
    ticks = 1_714_737_600_123_456_789 + 10_000 * np.arange(n)  # 100 kHz: float64 has steps of 256
    columns = {"time": ticks, "y": np.sin(np.arange(n) / 9), "u": np.cos(np.arange(n) / 9)}
    path = tmp_path / f"log.{kind}"
    {"csv": logs.csv, "parquet": logs.parquet, "h5": logs.hdf5, "mat": logs.mat5}[kind](
        path, columns
    )
    ns = MAP.replace('"s"', '"ns"')
    channel_map = ChannelMap.from_toml(ns.replace("column", "array") if kind == "mat" else ns)
    reading = read(path, channel_map)
    np.testing.assert_allclose(reading.record.t, 1e-5 * np.arange(n), rtol=1e-12)
    assert reading.clocks["t"].jitter < 1e-12
    assert any("counts from its first value, 1714737600123456789" in r for r in reading.remarks)
    assert 'unit = "ns"' in guess(path)


def test_seconds_since_1970_lose_no_digit(tmp_path):
    path = tmp_path / "log.csv"
    rows = (f"{1714737600 + k // 50000}.{20 * (k % 50000):06},{k % 7},{k % 5}" for k in range(900))
    path.write_text("time,y,u\n" + "\n".join(rows) + "\n")
    np.testing.assert_allclose(
        read(path, ChannelMap.from_toml(MAP)).record.t, 2e-5 * np.arange(900), atol=1e-12
    )


def test_what_looks_like_a_time_and_is_none():
    for cell in (
        "12:00",
        "1.2.3",
        "2024-05-03",
        "1:2:3:4",
        "99",
        "a:b:c",
        "",
        "12:00:00.1234567890",
    ):
        assert layouts(cell) == ()


def test_no_loop_of_python_goes_over_the_rows():
    rows = np.datetime_as_string(np.datetime64("2024-05-03", "us") + np.arange(30_000))
    few, many = (lines_run(lambda n=n: timestamps.read(rows[:n].tolist(), "", "time", str))
                 for n in (2000, 30_000))  # fmt: skip
    # A loop would be 28,000 more; what Python collects meanwhile runs lines of its own.
    assert many < few + 15_000
    assert timestamps.read(rows.tolist(), "", "time", str).seconds[-1] == 0.029999
