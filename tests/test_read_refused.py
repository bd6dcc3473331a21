"""A refused log: its picture; times of faults behind a delay; several clocks that jump."""

from pathlib import Path

import numpy as np
import pytest

from ambkit.base.errors import RecordError
from ambkit.data.channel_map import ChannelMap
from ambkit.data.reading import RejectedLog, read
from ambkit.data.reading.reading_figure import reading_figure, refused_figure
from ambkit.result.report import Line, Rule, Span
from tests import logs

MAP, TWO = logs.MAP, logs.TWO_CLOCKS
T = 1e-3


def back(c):
    c["time"][600:] -= 0.5


def without_times(c):
    c["time"][[100, 700]] = np.nan


def jitter(c):
    c["time"] += 1e-4 * np.random.default_rng(0).normal(size=c["time"].size)


def broken_gap(c):
    c["time"][300:] += 2.4 * T


def coarse(c):
    c["time"] = np.round(c["time"], 2)


@pytest.mark.parametrize(
    ("spoil", "axis", "marked"),
    [
        (back, "sample", [600]),
        (without_times, "sample", [100, 700]),
        (jitter, "time", None),
        (broken_gap, "time", [0.302]),
        (coarse, "sample", None),
    ],
)
def test_the_picture_of_a_refused_log_shows_where(tmp_path, spoil, axis, marked):
    log = logs.sound(1000)
    spoil(log)
    logs.csv(tmp_path / "log.csv", log)
    with pytest.raises(RejectedLog) as failure:
        read(tmp_path / "log.csv", ChannelMap.from_toml(MAP))
    figure = refused_figure(failure.value)
    assert figure.title == "log.csv: refused"
    assert {panel.x.label for panel in figure.panels} == {axis}
    shown = [panel.y.label for panel in figure.panels]
    assert shown[-3:] == ["step of t", "position $y$", "control signal $u$"]
    assert (shown[0] == "t") == (axis == "sample")
    for panel in figure.panels:
        marks = [item.value for item in panel.items if isinstance(item, Rule)]
        if marked is None:
            assert not marks  # all of it is one mark
        else:
            np.testing.assert_allclose(marks, marked, rtol=5e-3)
    position = figure.panels[-2].items[0]
    assert isinstance(position, Line)
    np.testing.assert_allclose(position.y, log["pos"] * 1e-3)
    assert "refused for this" in [text for text, _ in figure.legend()]


def test_damaged_lines_are_shown_among_the_sound_ones(tmp_path):
    path = tmp_path / "log.csv"
    logs.csv(path, logs.sound(1000))
    lines = path.read_text().split("\n")
    lines[200], lines[500] = "x,1,2", "1,2"
    path.write_text("\n".join(lines))
    with pytest.raises(RejectedLog, match=r"log\.csv:201: column time: 'x'") as failure:
        read(path, ChannelMap.from_toml(MAP))
    assert failure.value.damaged == (199, 499)
    figure = refused_figure(failure.value)
    marks = [item.value for item in figure.panels[0].items if isinstance(item, Rule)]
    np.testing.assert_allclose(marks, [199, 499], atol=1)


def test_two_clocks_are_shown_each_with_its_channels(tmp_path):
    fast, slow = T * np.arange(2000), 0.4 * T + 4 * T * np.arange(480)
    path = tmp_path / "log.mf4"
    logs.mdf4(path, {"time": fast, "pos": fast}, {"time": slow, "current": slow})
    # They have two clocks; and, in the other map, the wrong one.
    for text in (TWO, MAP.replace('"time"', '"0/time"')):
        with pytest.raises(RejectedLog) as failure:
            read(path, ChannelMap.from_toml(text))
        figure = refused_figure(failure.value)
        lines = {panel.y.label: panel.items[0] for panel in figure.panels}
        np.testing.assert_array_equal(lines["position $y$"].x, fast)
        np.testing.assert_array_equal(lines["control signal $u$"].x, slow)


@pytest.mark.parametrize("ending", ["png", "html"])
def test_the_command_says_where_the_picture_of_a_refused_log_is(call, ending):
    log = logs.sound(1000)
    back(log)
    logs.csv(Path("log.csv"), log)
    Path("map.toml").write_text(MAP)
    plot = f"log.{ending}"
    code, out, err = call("read", "log.csv", "--channels", "map.toml", "--out", "a.csv", "--plot",
                          plot)  # fmt: skip
    assert (code, out) == (2, "")
    drawn = f"wrote {plot}: what could be read, and where the trouble is; no record is written\n"
    assert err.startswith(f"{drawn}ambkit: 2 problems in log.csv:\n  log.csv:602: t jumps from")
    assert sorted(path.name for path in Path().iterdir()) == ["log.csv", plot, "map.toml"]
    assert Path(plot).is_file()


def test_a_log_of_which_nothing_can_be_read_has_no_picture(call):
    Path("log.csv").write_text("time,pos,current\n0,1,2\n")
    Path("map.toml").write_text(MAP)
    Path("log.png").write_text("old")
    code, _, err = call("read", "log.csv", "--channels", "map.toml", "--plot", "log.png")
    assert code == 2
    assert "t must have at least 2 samples, has 1" in err
    assert "log.png is not written: there is nothing to be drawn" in err
    assert Path("log.png").read_text() == "old"


# Delays


@pytest.mark.parametrize("delay", [5, -5])
def test_faults_are_told_by_the_clock_that_the_record_has(tmp_path, delay):
    log = logs.sound(1000)
    log["pos"][400:450] = log["pos"][400]
    log["pos"][[2, 3]] = np.inf
    log["pos"][995:] = np.nan
    keep = np.ones(1000, dtype=bool)
    keep[700:720] = False
    logs.csv(tmp_path / "log.csv", {name: values[keep] for name, values in log.items()})
    text = MAP.replace('unit = "mm"', f'unit = "mm"\ndelay = "{delay} ms"')
    reading = read(tmp_path / "log.csv", ChannelMap.from_toml(text))
    record, found = reading.record, {fault.kind: fault for fault in reading.faults}
    frozen = found["frozen"]
    at = np.rint(np.array([frozen.start, frozen.stop]) / T).astype(int)
    assert np.ptp(record["y"][at[0] : at[1] + 1]) == 0
    assert at.tolist() == [400 - delay, 449 - delay]
    lost = np.flatnonzero(np.isnan(record["y"]))
    if delay > 0:  # the first samples went out of the record
        assert found["infinite"].action == "shifted out of the record"
        assert found["missing"].stop == pytest.approx(0.994)
    else:
        assert found["infinite"].start == pytest.approx(0.007)
        assert found["missing"].action == "shifted out of the record"
    assert set(range(700 - delay, 720 - delay)) <= set(lost.tolist())
    assert found["gap"].start == pytest.approx(0.699)  # of the clock, which is not shifted
    figure = reading_figure(reading)
    (gap,) = [i for i in figure.panels[0].items if isinstance(i, Span) and 0.6 < i.start < 0.8]
    assert (gap.start, gap.stop) == pytest.approx((0.699 - delay * T, 0.720 - delay * T))


# Several clocks that jump


def test_clocks_that_jump_together_are_read_in_parts(tmp_path):
    fast, slow = T * np.arange(2000), 4 * T * np.arange(500)
    path = tmp_path / "log.mf4"

    def write(fast_jump, slow_jump):
        f = fast + np.where(fast >= 1.0, fast_jump, 0)
        s = slow + np.where(slow >= 1.0, slow_jump, 0)
        logs.mdf4(path, {"time": f, "pos": fast}, {"time": s, "current": slow})

    write(-0.6, -0.6)
    with pytest.raises(RecordError, match=r"t and t_slow jump from 0.999 s to 0.4 s") as failure:
        read(path, ChannelMap.from_toml(TWO), resample=True)
    assert "1: 1000 samples from 0 s, 2: 1000 samples from 0.4 s" in str(failure.value)
    second = read(path, ChannelMap.from_toml(TWO), resample=True, segment=2)
    np.testing.assert_allclose(second.record["y"], 1e-3 * fast[1000:])
    np.testing.assert_allclose(second.record["u"][:8:4], [1.0, 1.004])
    assert "part 2 of 2 between jumps of t and t_slow is read" in second.remarks
    with pytest.raises(RecordError, match=r"2 clocks.*--resample"):
        read(path, ChannelMap.from_toml(TWO), segment=2)
    for jumps in ((-0.6, 0.0), (-0.6, -0.3)):
        write(*jumps)
        with pytest.raises(RecordError, match="which of their samples belong together"):
            read(path, ChannelMap.from_toml(TWO), resample=True, segment=2)
