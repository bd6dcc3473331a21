"""Reading a rig's log: what its clock and channels are worth, and what is done about faults."""

import contextlib
import json
import os
import re
import threading
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import ambkit
from ambkit.base.errors import ConfigError, RecordError
from ambkit.data import recordings
from ambkit.data.channel_map import ChannelMap
from ambkit.data.reading import RejectedLog, faults, read
from ambkit.data.reading.clock import describe_shift, examine, insert_missing, shifted
from ambkit.data.reading.plausibility import suspects
from ambkit.data.reading.propose import guess
from ambkit.data.reading.reading_figure import reading_figure, refused_figure
from ambkit.data.record import Record
from ambkit.judge.plausibility import evaluate_record
from benchmarks import reading as reading_benchmark
from tests import disguises, logs

RIG = Path(__file__).parents[2] / "shared" / "data" / "inteco"
needs_rig = pytest.mark.skipif(
    not RIG.is_dir(), reason="the rig's logs are not here (../shared/data/inteco)"
)
MAP, TWO, sound = logs.MAP, logs.TWO_CLOCKS, logs.sound
T = 1e-3


@pytest.fixture
def read_columns(tmp_path):
    def of(columns, extra="", **options):
        logs.parquet(tmp_path / "log.parquet", columns)
        return read(tmp_path / "log.parquet", ChannelMap.from_toml(MAP + extra), **options)

    return of


def kinds(reading):
    return sorted({(fault.signal, fault.kind) for fault in reading.faults})


# The clock


def test_a_sound_log_has_no_faults_and_stays_as_it_is(read_columns):
    columns = sound()
    reading = read_columns(columns)
    assert reading.faults == ()
    np.testing.assert_array_equal(reading.record["y"], columns["pos"] * 1e-3)
    np.testing.assert_array_equal(reading.record.t, columns["time"])
    assert reading.clocks["t"].rate == pytest.approx(1000)
    y = reading.channels[0]
    assert y.noise == pytest.approx(10e-6, rel=0.1)
    assert y.resolution == 0.0


@given(
    n=st.integers(40, 80),
    lost=st.sets(st.integers(1, 18), max_size=8),
    step=st.floats(1e-5, 10),
    start=st.floats(-100, 100),
)
def test_lost_samples_get_their_places_and_no_other_moves(n, lost, step, start):
    times = start + step * np.arange(n)
    kept = np.array([k for k in range(n) if k not in lost])
    clock = examine("t", times[kept])
    assert clock.jumps.size == 0
    full, place = insert_missing(clock)
    np.testing.assert_array_equal(place, kept)
    np.testing.assert_array_equal(full[place], times[kept])
    np.testing.assert_allclose(np.diff(full), step, rtol=1e-2)


def test_a_gap_is_filled_and_told(read_columns):
    columns = sound()
    keep = np.ones(4000, dtype=bool)
    keep[100:107] = keep[2000] = False
    reading = read_columns({name: v[keep] for name, v in columns.items()})
    gaps = [fault for fault in reading.faults if fault.kind == "gap"]
    assert [(g.samples, g.action) for g in gaps] == [
        (7, "filled with missing samples"), (1, "filled with missing samples"),
    ]  # fmt: skip
    assert np.flatnonzero(np.isnan(reading.record["y"])).tolist() == [*range(100, 107), 2000]
    np.testing.assert_array_equal(reading.record["u"][keep], columns["current"][keep])
    assert any("2 stretches, 8 samples" in line for line in reading.record.meta["reading"])


@pytest.mark.parametrize("start", [0.0, 53.8, 1e5])
def test_the_ends_of_a_short_fault_are_told_apart(read_columns, start):
    columns = sound()
    columns["time"] = start + columns["time"]
    columns["pos"][1500:1502] = np.nan
    keep = np.arange(4000) != 2000
    reading = read_columns({name: v[keep] for name, v in columns.items()})
    said = "\n".join(reading.account())
    stamps = [f"{start + second:.10g}" for second in (1.999, 2.001, 1.5, 1.501)]
    assert f"from {stamps[0]} s to {stamps[1]} s: 1 sample missing" in said
    assert f"2 samples from {stamps[2]} s to {stamps[3]} s" in said


def test_jitter_is_refused_with_its_lines_and_resampled_on_request(tmp_path):
    columns = sound(600)
    columns["time"] = columns["time"] + 1e-4 * np.random.default_rng(0).normal(size=600)
    logs.csv(tmp_path / "log.csv", columns)
    with pytest.raises(RecordError) as failure:
        read(tmp_path / "log.csv", ChannelMap.from_toml(MAP))
    first = failure.value.problems[0]
    assert re.search(r"log\.csv:3: from sample 0 to 1 .* goes on by .* instead of", first)
    assert "give sampling_time in the map" in failure.value.problems[-1]
    reading = read(tmp_path / "log.csv", ChannelMap.from_toml(MAP), resample=True)
    assert kinds(reading) == [("t", "jitter")]
    assert reading.faults[0].action == "resampled"
    assert reading.clocks["t"].jitter == pytest.approx(1.4e-4, rel=0.1)
    true = 1e-4 * np.sin(2 * np.pi * 3 * reading.record.t)
    assert np.nanstd(reading.record["y"] - true) < 12e-6


def test_a_log_without_times_takes_them_from_the_map(tmp_path):
    columns = sound(100)
    logs.csv(tmp_path / "log.csv", columns)
    text = 'sampling_time = "2 ms"\n' + MAP.partition('unit = "s"')[2]
    record = ambkit.read(tmp_path / "log.csv", ChannelMap.from_toml(text)).record
    np.testing.assert_allclose(record.t, 2e-3 * np.arange(100))


@pytest.mark.parametrize("jump", [-0.5, 1e3])
def test_a_clock_that_jumps_is_refused_until_a_part_is_chosen(tmp_path, jump):
    columns = sound(1000)
    columns["time"] = columns["time"] + np.where(np.arange(1000) >= 600, jump, 0.0)
    logs.csv(tmp_path / "log.csv", columns)
    with pytest.raises(RecordError) as failure:
        read(tmp_path / "log.csv", ChannelMap.from_toml(MAP))
    assert "log.csv:602: t jumps from 0.599 s to" in failure.value.problems[0]
    assert "1: 600 samples from 0 s, 2: 400 samples from" in failure.value.problems[1]
    reading = read(tmp_path / "log.csv", ChannelMap.from_toml(MAP), segment=2)
    assert len(reading.record) == 400
    assert ("t", "jump") in kinds(reading)
    np.testing.assert_array_equal(reading.record["u"], columns["current"][600:])
    with pytest.raises(RecordError, match="choose a part"):
        read(tmp_path / "log.csv", ChannelMap.from_toml(MAP), segment=3)


def test_times_with_too_few_digits(read_columns):
    columns = sound(1000)
    columns["time"] = np.round(columns["time"], 2)
    with pytest.raises(RecordError, match=r"too few digits.*sampling_time in the map"):
        read_columns(columns)


def test_times_that_are_no_numbers_are_told_with_their_lines(tmp_path):
    columns = sound(50)
    columns["time"][[4, 9]] = np.nan
    logs.csv(tmp_path / "log.csv", columns)
    with pytest.raises(RecordError) as failure:
        read(tmp_path / "log.csv", ChannelMap.from_toml(MAP))
    assert [p.rpartition("log.csv")[2] for p in failure.value.problems] == [
        ":6: t is nan at sample 4", ":11: t is nan at sample 9",
    ]  # fmt: skip


# Two clocks


@pytest.fixture
def two_clocks(tmp_path):
    fast, slow = T * np.arange(2000), 0.4 * T + 4 * T * np.arange(480)
    path = tmp_path / "log.mf4"
    logs.mdf4(path, {"time": fast, "pos": fast}, {"time": slow, "current": np.arange(480.0)})
    return path


def test_two_clocks_are_refused_or_resampled_on_request(two_clocks):
    with pytest.raises(RecordError, match=r"2 clocks: t \(y: .*t_slow \(u: .*--resample"):
        read(two_clocks, ChannelMap.from_toml(TWO))
    with pytest.raises(RecordError, match="2 clocks"):
        ambkit.load(two_clocks, ChannelMap.from_toml(TWO))
    reading = read(two_clocks, ChannelMap.from_toml(TWO), resample=True)
    record = reading.record
    np.testing.assert_allclose(record.t, T * np.arange(2000))
    np.testing.assert_allclose(record["y"], 1e-3 * record.t)
    # u is held: from 0.4 ms on it is 0, from 4.4 ms on it is 1; before and behind it is missing.
    np.testing.assert_array_equal(record["u"][:7], [np.nan, 0, 0, 0, 0, 1, 1])
    assert np.isnan(record["u"][-70:]).all()
    assert any("a controller holds it" in remark for remark in reading.remarks)
    coarse = read(two_clocks, ChannelMap.from_toml(TWO), resample=True, sampling_time=2 * T)
    np.testing.assert_allclose(coarse.record.t, 2 * T * np.arange(1000))


def test_a_map_that_takes_the_wrong_clock_is_told_which_is_right(two_clocks):
    wrong = MAP.replace('"time"', '"0/time"')
    with pytest.raises(
        RecordError, match=r'signal u: has the clock "1/time" in the file, and t is'
    ):
        read(two_clocks, ChannelMap.from_toml(wrong))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('time = "t_slow"', 'time = "t_slaw"', "there is no other signal t_slaw in this map"),
        ('time = "t_slow"', 'time = "y"', "y is a quantity in m, not in s"),
        ('time = "t_slow"', 'delay = "3 mm"', "delay: .*mm cannot be converted to s"),
        ("[signals.t]", 'sampling_time = "1 ms"\n[signals.t]', "either sampling_time or signals.t"),
    ],
)
def test_what_is_wrong_with_the_clocks_of_a_map(old, new, message):
    with pytest.raises(ConfigError, match=message):
        ChannelMap.from_toml(TWO.replace(old, new))


# Channels


def test_faulty_stretches_are_found_where_they_are(read_columns):
    columns = sound()
    columns["pos"][1000:1100] = columns["pos"][1000]
    columns["pos"][2000:2020] = np.nan
    columns["pos"][[3000, 3001]] = np.inf
    columns["current"] = np.clip(columns["current"], -0.25, np.inf)
    reading = read_columns(columns)
    assert kinds(reading) == [
        ("u", "saturated"), ("y", "frozen"), ("y", "infinite"), ("y", "missing"),
    ]  # fmt: skip
    found = {fault.kind: fault for fault in reading.faults if fault.signal == "y"}
    assert found["frozen"].samples == 100
    assert (found["frozen"].start, found["frozen"].stop) == pytest.approx((1.0, 1.099))
    assert found["missing"].samples == 20
    assert found["infinite"].action == "taken as missing"
    assert np.isfinite(reading.record["y"][1000:1100]).all()
    clipped = [fault for fault in reading.faults if fault.kind == "saturated"]
    assert sum(fault.samples for fault in clipped) > 0.9 * (columns["current"] == -0.25).sum()


def test_faulty_stretches_become_missing_on_request(read_columns):
    columns = sound()
    columns["pos"][1000:1100] = columns["pos"][1000]
    reading = read_columns(columns, missing=["frozen"])
    assert np.flatnonzero(np.isnan(reading.record["y"])).tolist() == list(range(1000, 1100))
    assert reading.faults[0].action == "taken as missing"
    with pytest.raises(RecordError, match="only saturated, frozen and spike can"):
        read_columns(columns, missing=["quantised"])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("step", [0.0, 0.003, 0.01, 0.03])
def test_a_coarse_sensor_is_not_frozen(read_columns, step, seed):
    columns = sound(seed=seed)
    if step:
        columns["pos"] = np.round(columns["pos"] / step) * step
    reading = read_columns(columns)
    assert not {"frozen", "saturated"} & {fault.kind for fault in reading.faults}
    coarse = [fault for fault in reading.faults if fault.kind == "quantised"]
    assert bool(coarse) == (step == 0.03)
    assert reading.channels[0].resolution == pytest.approx(step * 1e-3, rel=1e-6)


def test_a_converter_with_uneven_steps_has_their_median_as_its_resolution():
    """A few hundred values that come again and again, though on no one ladder."""
    rng = np.random.default_rng(2)
    levels = 1e-6 * np.cumsum(rng.uniform(0.5, 1.5, 500))
    values = levels[rng.integers(0, levels.size, 8000)]
    assert faults.resolution(values) == pytest.approx(np.median(np.diff(levels)), rel=1e-9)


def test_a_stretch_that_is_coarser_than_the_rest_is_found(read_columns):
    columns = sound()
    columns["pos"][1000:2000] = np.round(columns["pos"][1000:2000] / 0.04) * 0.04
    (fault,) = read_columns(columns).faults
    assert (fault.kind, fault.signal, fault.samples) == ("quantised", "y", 1000)
    assert (fault.start, fault.stop) == pytest.approx((1.0, 1.999))
    assert fault.text.startswith("in steps of 40 µm")


def test_a_slow_signal_through_a_coarse_sensor_is_coarse_and_steps_of_a_reference_are_not():
    t = np.arange(20_000) * 1e-4
    wave = np.round(5 * np.sin(t * 4))
    found = list(faults.find("y", wave, t, "m"))
    assert [fault.kind for fault in found] == ["quantised"]
    steps = np.repeat([0.0, 2.0, 0.0, 1.0], 5000)
    assert list(faults.find("r", steps, t, "m")) == []


def test_a_constant_channel_is_told(read_columns):
    columns = sound()
    columns["pos"][:] = 0.02
    reading = read_columns(columns)
    (fault,) = reading.faults
    assert (fault.kind, fault.signal) == ("constant", "y")
    assert "the same in all 4000 samples: 20 µm" in fault.text


def test_a_channel_without_one_sample(read_columns):
    columns = sound()
    columns["pos"][:] = np.nan
    reading = read_columns(columns)
    assert kinds(reading) == [("y", "missing")]
    assert np.isnan(reading.channels[0].mean)
    json.dumps(reading.account())


# Delays


@given(whole=st.integers(-5, 5))
def test_a_delay_of_whole_samples_moves_them_untouched(whole):
    values = np.arange(30.0) ** 2
    found = shifted(values, whole, held=False)
    for k in range(30):
        if 0 <= k + whole < 30:
            assert found[k] == values[k + whole]
        else:
            assert np.isnan(found[k])


@given(delay=st.floats(-3, 3), c=st.tuples(*[st.floats(-1, 1)] * 4))
def test_between_samples_a_cubic_is_met_exactly(delay, c):
    assume(abs(delay - round(delay)) > 1e-5)  # nearer ones count as whole
    k = np.arange(40.0)
    found = shifted(np.polyval(c, k), delay, held=False)
    there = np.isfinite(found)
    assert there.sum() >= 33
    np.testing.assert_allclose(found[there], np.polyval(c, k + delay)[there], atol=2e-9, rtol=1e-9)


@given(delay=st.floats(0, 3))
def test_a_held_signal_is_averaged_over_the_sample(delay):
    values = np.random.default_rng(0).normal(size=20)
    whole, part = int(delay), delay - int(delay)
    found = shifted(values, delay, held=True)
    for k in range(15):
        expected = (1 - part) * values[k + whole] + part * values[k + whole + 1]
        assert found[k] == pytest.approx(expected, abs=1e-5)


def test_one_sample_is_one_sample():
    assert "shifted by 1 sample;" in describe_shift("y", 1e-3, 1e-3)
    assert "shifted by 2 samples;" in describe_shift("y", 2e-3, 1e-3)


def test_the_map_takes_a_delay_out_and_says_so(read_columns):
    columns = sound()
    late = 2.3 * T
    columns["pos"] = 0.1 * np.sin(2 * np.pi * 3 * (columns["time"] - late))
    logs_path = Path(read_columns(columns).source)
    text = MAP.replace('unit = "mm"', 'unit = "mm"\ndelay = "2.3 ms"')
    shifted = read(logs_path, ChannelMap.from_toml(text))
    true = 1e-4 * np.sin(2 * np.pi * 3 * shifted.record.t)
    there = np.isfinite(shifted.record["y"])
    np.testing.assert_allclose(shifted.record["y"][there], true[there], atol=1e-11)
    assert 1 <= (~there).sum() <= 5
    (remark,) = [r for r in shifted.remarks if "late" in r]
    assert "y was logged 2.3 ms late: shifted by 2 samples and 0.3 of one (a cubic" in remark
    same = ambkit.load(logs_path, ChannelMap.from_toml(text))
    np.testing.assert_array_equal(same["y"], shifted.record["y"])


# The map that is proposed


def proposed(path):
    text = guess(path)
    return text, ChannelMap.from_toml(text)


def rig_logs():
    return [pytest.param(path, id=path.stem) for path in sorted(RIG.glob("closed_loop/*.mat"))]


@needs_rig
@pytest.mark.parametrize("log", rig_logs())
def test_the_guess_tells_the_rows_of_the_rig_apart(log):
    _, channel_map = proposed(log)
    rows = {name: channel.row for name, channel in channel_map.signals.items()}
    assert {name: rows[name] for name in ("t", "y", "u", "r")} == {"t": 0, "y": 2, "u": 4, "r": 1}
    # Row 3 is the difference of row 2, row 9 the velocity of the rig's filter. Without a filter it
    # is row 3 again, and in two logs it goes too little with the position's rate.
    far = log.stem.endswith(("no_filter", "-EKF", "multisteps_stairs-PID_gain_scheduling-KF"))
    assert rows["v_logged"] == (3 if far else 9)
    assert channel_map.signals["y"].sign == -1
    ours, theirs = (
        read(log, channel_map).record,
        ambkit.load(log, recordings.folder() / "closed_loop.toml"),
    )
    assert np.ptp(ours["y"] - theirs["y"]) < 1e-12


@pytest.mark.parametrize("name", ["sinus_kalman", "sinus_no_filter"])
def test_the_guess_needs_neither_names_nor_a_velocity(tmp_path, name):
    shipped = recordings.folder() / f"{name}.csv"
    lines = shipped.read_text().splitlines()
    body = [line for line in lines if line[0] not in "#t"]
    (tmp_path / "nameless.csv").write_text("\n".join(body) + "\n")
    text, channel_map = proposed(tmp_path / "nameless.csv")
    places = {signal: channel.column for signal, channel in channel_map.signals.items()}
    expected = {"t": "0", "r": "1", "y": "2", "u": "3"}
    assert {signal: places[signal] for signal in expected} == expected
    record = read(tmp_path / "nameless.csv", channel_map).record
    np.testing.assert_array_equal(record["y"], Record.load(shipped)["y"])
    hints = "\n".join(line.removeprefix("# ") if "offset =" in line else line
                      for line in text.splitlines())  # fmt: skip
    assert ChannelMap.from_toml(hints)  # what it suggests in comments is valid too


@needs_rig
@pytest.mark.parametrize("folder", ["force", "inductance", "."])
def test_where_the_ball_does_not_fly_nothing_is_guessed(folder):
    for path in sorted((RIG / folder).glob("*.mat")):
        if path.stem == "sensor_data":
            continue
        with pytest.raises(RecordError, match="refused: nothing in it is levitated"):
            guess(path)


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("t [s],y [mm],u [V]", {"t": "t", "y": "y", "u": "u"}),
        ("Zeit_s;Weg_µm;Strom_A", {"t": "Zeit_s", "y": "Weg_µm", "u": "Strom_A"}),
        ("time_ms,pos_um,I1,ref_um", {"t": "time_ms", "y": "pos_um", "u": "I1", "r": "ref_um"}),
        ("Timestamp,x_ref,x_pos,i_coil,u_ctrl",
         {"t": "Timestamp", "r": "x_ref", "y": "x_pos", "current": "i_coil", "u": "u_ctrl"}),
        ("time,z,z_est,current", {"t": "time", "y": "z", "x_logged": "z_est", "u": "current"}),
    ],
)  # fmt: skip
def test_the_guess_reads_common_names(tmp_path, header, expected):
    separator = ";" if ";" in header else ","
    columns = sound(400)
    waves = [columns["time"], columns["pos"], columns["current"]]
    names = header.split(separator)
    # No two are the same: a control is no copy of the position.
    rows = zip(*[np.roll(waves[min(k, 2)], 7 * max(0, k - 2)) for k in range(len(names))],
               strict=True)  # fmt: skip
    path = tmp_path / "log.csv"
    lines = [header, *(separator.join(f"{v:.6f}" for v in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="latin-1")
    _, channel_map = proposed(path)
    found = {name: channel.column for name, channel in channel_map.signals.items()}
    assert found == {k: re.sub(r" \[.*", "", v) for k, v in expected.items()}
    assert len(ambkit.read(path, channel_map).record) == 400


def test_the_guess_gives_units_of_names_and_headers(tmp_path):
    path = tmp_path / "log.csv"
    logs.csv(path, {"time_ms": sound()["time"] * 1e3, "Weg/µm": sound()["pos"] * 1e3,
                    "I [mA]": sound()["current"] * 1e3})  # fmt: skip
    text, channel_map = proposed(path)
    assert [c.unit for c in channel_map.signals.values()] == ["ms", "µm", "mA"]
    record = ambkit.read(path, channel_map).record
    np.testing.assert_allclose(record["y"], sound()["pos"] * 1e-3, rtol=1e-12)
    assert tomllib.loads(text)


@pytest.mark.parametrize(
    ("y", "r", "signs", "word"),
    [
        (-1, -1, (-1, -1), "sign = -1  # as pos, of which it is the reference"),
        (-1, 1, (-1, 1), "# sign = 1, for it falls where pos grows, which is turned"),
        (1, -1, (1, -1), "sign = -1  # it falls where pos grows"),
        (1, 1, (1, 1), ""),
    ],
)
def test_the_sign_of_a_reference_is_its_own(tmp_path, y, r, signs, word):
    columns = sound()
    columns["ref"] = np.round(r * 0.1 * np.sin(2 * np.pi * 3 * columns["time"]), 4)
    columns["pos"] = y * columns["pos"]
    logs.csv(tmp_path / "log.csv", columns)
    text, channel_map = proposed(tmp_path / "log.csv")
    assert (channel_map.signals["y"].sign, channel_map.signals["r"].sign) == signs
    assert word in text.partition("[signals.r]")[2]


def test_the_guess_of_two_clocks_says_so_and_resamples(two_clocks):
    text, channel_map = proposed(two_clocks)
    assert "It has a clock of its own" in text
    assert channel_map.signals["u"].time == "t_u"
    assert len(read(two_clocks, channel_map, resample=True).record) == 2000


@pytest.mark.parametrize("name", [n for n in logs.WRITERS if not n.endswith("csv")])
def test_the_guess_of_each_format_reads_it(tmp_path, name):
    logs.WRITERS[name](tmp_path / name, sound(1000))
    _, channel_map = proposed(tmp_path / name)
    record = ambkit.read(tmp_path / name, channel_map).record
    np.testing.assert_allclose(record["y"], sound(1000)["pos"] * 1e-3, atol=1e-15)
    np.testing.assert_allclose(record.t, sound(1000)["time"], atol=1e-12)


def test_a_log_without_a_time_gets_a_line_to_fill_in(tmp_path):
    columns = sound(400)
    del columns["time"]
    logs.csv(tmp_path / "log.csv", columns)
    text = guess(tmp_path / "log.csv")
    assert "No channel looks like a time" in text
    line = '# sampling_time = "... ms"'
    assert line in text  # nothing is invented: it must be filled in
    filled = ChannelMap.from_toml(text.replace(line, 'sampling_time = "2 ms"'))
    assert filled.sampling_time == 2e-3


LINES = ["time;pos;cur", *(f"{k * T:.3f};{np.sin(k / 9):.4f};{k % 7 / 2}" for k in range(40))]

STAMPED = ["time,pos,cur", *(f"2024-05-03 12:00:00.{k:03},{np.sin(k / 9):.4f},{k % 7 / 2}"
                             for k in range(40))]  # fmt: skip


@settings(max_examples=60)
@given(
    lines=st.sampled_from([LINES, STAMPED]),
    edits=st.lists(
        st.tuples(
            st.integers(0, 700), st.integers(0, 9), st.sampled_from(" ;,\n\t\"'#-.e9naif[m]é")
        ),
        max_size=20,
    ),
)
def test_whatever_is_done_to_a_csv_there_is_a_record_or_a_clear_word(
    tmp_path_factory, lines, edits
):
    text = "\n".join(lines) + "\n"
    for place, length, character in edits:
        text = text[:place] + character + text[place + length :]
    path = tmp_path_factory.mktemp("edited") / "log.csv"
    path.write_text(text, encoding="utf-8")
    # Nothing else is raised: a proposed map is always valid, and what is refused can be drawn.
    with contextlib.suppress(RecordError):
        channel_map = ChannelMap.from_toml(guess(path))
        try:
            assert len(read(path, channel_map, resample=True).record) >= 2
        except RejectedLog as refused:
            figure = refused_figure(refused)
            assert figure is None or figure.panels


def test_the_guess_of_a_log_that_holds_nothing(tmp_path):
    columns = sound(100) | {"pos": np.full(100, np.nan), "current": np.full(100, np.inf)}
    logs.parquet(tmp_path / "log.parquet", columns)
    _, channel_map = proposed(tmp_path / "log.parquet")
    assert kinds(read(tmp_path / "log.parquet", channel_map)) == [
        ("u", "infinite"), ("y", "missing"),
    ]  # fmt: skip


# The command and its picture


def faulty(path="log.csv"):
    columns = sound(2000)
    columns["pos"][500:600] = columns["pos"][500]
    columns["current"] = np.clip(columns["current"], -0.2, 0.2)
    keep = np.ones(2000, dtype=bool)
    keep[1000:1010] = False
    logs.csv(Path(path), {name: v[keep] for name, v in columns.items()})


def test_the_command_from_guess_to_record(call):
    faulty()
    code, text, err = call("read", "guess", "log.csv")
    assert (code, err) == (0, "")
    Path("map.toml").write_text(text, encoding="utf-8")
    code, out, err = call("read", "log.csv", "--channels", "map.toml", "--out", "log.parquet",
                          "--plot", "log.png", "--missing", "frozen")  # fmt: skip
    assert code == 0, err
    assert err == "wrote log.parquet\nwrote log.png\n"
    for word in ("10 samples missing; filled", "stands still", "saturated", "1000 Hz, 1 gap"):
        assert word in out
    record = Record.load("log.parquet")
    assert np.isnan(record["y"]).sum() == 110
    assert any("stands still" in line for line in record.meta["reading"])
    code, out, _ = call("read", "log.csv", "--channels", "map.toml", "--json")
    found = json.loads(out)
    assert found["clocks"]["t"]["missing"] == 10
    assert found["channels"]["y"]["missing"] == 10
    assert sum(fault["samples"] for fault in found["faults"]) == 1160
    assert {fault["kind"] for fault in found["faults"]} == {"gap", "frozen", "saturated"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--sampling-time", "1 ms"), "the step of --resample"),
        (("--missing", "quantised"), "invalid choice: 'quantised'"),
        (("--segment", "0"), "segment must be 1 or more"),
        ((), "column time has no unit"),
    ],
)
def test_what_the_command_refuses(call, arguments, message):
    faulty()
    code, _, err = call("read", "log.csv", *arguments)
    assert code == 2
    assert message in err


def test_the_picture_marks_the_faults(tmp_path):
    faulty(tmp_path / "log.csv")
    reading = read(tmp_path / "log.csv", ChannelMap.from_toml(MAP))
    figure = reading_figure(reading)
    assert [text for text, _ in figure.legend()] == [
        "as read", "frozen", "missing", "saturated", "time between samples",
    ]  # fmt: skip
    frozen = next(i for p in figure.panels for i in p.items if getattr(i, "signal", "") == "frozen")
    assert np.isfinite(frozen.y).sum() == 100
    for ending in (".png", ".svg", ".html"):
        assert figure.save(tmp_path / f"log{ending}").is_file()


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs wait4 and a pseudo terminal")
def test_many_rows_take_few_seconds_and_show_progress_on_a_terminal(tmp_path):
    """A hundredth of benchmarks/reading.py; processor time, since machines are busy."""
    try:
        terminal, inside = os.openpty()
    except OSError as error:
        pytest.skip(f"there are no pseudo terminals here: {error}")
    shown = []

    def listen():
        with contextlib.suppress(OSError):  # Linux says EIO where the other end is closed
            while part := os.read(terminal, 4096):
                shown.append(part)

    listener = threading.Thread(target=listen)
    listener.start()
    cost = reading_benchmark.measure(100_000, tmp_path, stderr=inside)
    os.close(inside)
    listener.join(timeout=10)
    os.close(terminal)
    assert re.search(rb"reading|looking at", b"".join(shown))
    assert cost.cpu < 2.5
    assert cost.memory < 6e8


# What a log may be and should not


@pytest.fixture(scope="module")
def flown():
    return disguises.simulated("one magnet")


def told_of(y, u, t, r=None):
    signals = {"y": y, "u": u} | ({} if r is None else {"r": r})
    return " ".join(suspects(t, signals, {"y": "m", "u": "V", "r": "m"}))


def test_of_a_sound_log_nothing_is_suspected(flown):
    y, u = (np.round(flown[n] / step) * step for n, step in (("y", 5e-6), ("u", 2e-3)))
    assert told_of(y, u, flown["t"]) == ""


def test_a_rotor_that_lies_while_its_current_rises_is_told(flown):
    n = flown["t"].size
    rng = np.random.default_rng(5)
    y = np.where(np.arange(n) < 0.6 * n, -0.01, 0.01) + 1e-5 * rng.normal(size=n)
    u = np.linspace(0, 2.6, n) + 0.006 * rng.normal(size=n)
    told = told_of(y, u, flown["t"])
    assert "in 60 % of the samples, while u goes through" in told
    assert "is the rotor in contact" in told


def test_a_position_that_was_smoothed_is_told(flown):
    u = np.round(flown["u"] / 2e-3) * 2e-3
    assert "was y filtered before logging?" in told_of(flown["x_estimated"], u, flown["t"])


@pytest.mark.parametrize("steps", [False, True])
def test_a_reference_in_the_place_of_the_measurement_is_told(flown, steps):
    r = np.where(flown["t"] % 4 < 2, 1e-3, -1e-3) if steps else flown["r"]
    assert "is it the reference" in told_of(r, flown["u"], flown["t"])


def test_a_log_of_another_rig_is_told():
    bearing = ambkit.preset("inteco_ml")
    record = Record.load(recordings.folder() / "sinus_no_filter.csv")
    assert "another rig" not in " ".join(evaluate_record(record, bearing).remarks)
    slow = Record(30 * record.t, {n: record[n] for n in ("y", "u")}, {"y": "m", "u": "V"})
    other = bearing.replace(sampling_time=30 * bearing.sampling_time)
    told = " ".join(evaluate_record(slow, other).remarks)
    assert "the rotor falls with an unstable pole of" in told
    assert "is the record of another rig" in told


def test_a_forecast_beyond_the_gap_is_no_number(call, flown):
    n, rng = flown["t"].size, np.random.default_rng(6)
    y = np.where(np.arange(n) % 3000 < 1500, -0.0067, 0.009) + 1e-5 * rng.normal(size=n)
    u = 0.7 * np.sin(0.002 * np.arange(n)) + 0.006 * rng.normal(size=n)
    Record(flown["t"], {"y": y, "u": u}, {"y": "m", "u": "V"}).save("lies.csv")
    code, out, err = call("filter", "lies.csv", "--machine", "inteco_ml", "--filter", "linear",
                          "--filter", "extended")  # fmt: skip
    assert code == 0, err
    told = " ".join(out.split())
    assert told.count("beyond the air gap") > told.count("predicts beyond the air gap")
    assert "predicts beyond the air gap, 12.15 mm" in told
    assert not re.search(r"e\d+ (k|M)?m", out)
