"""Forms that MATLAB, Simulink and loggers give a log: guessed, read, and checked by the guess."""

import disguises
import numpy as np
import pytest
from scipy.io import savemat

from ambkit import read
from ambkit.base.errors import RecordError
from ambkit.data.channel_map import ChannelMap
from ambkit.data.reading.propose import guess


@pytest.fixture(scope="module")
def run():
    return disguises.simulated("one magnet")


def column(values):
    return np.asarray(values)[:, None]


def structure(t, values, label=""):
    """Write what To Workspace of Simulink writes as a structure with time."""
    signals = {"values": values, "dimensions": 1.0, "label": label}
    return {"time": column(t), "signals": signals, "blockName": "rig/To Workspace"}


def vectors_and_a_stale_matrix(t, y, u):
    old = np.random.default_rng(4).normal(size=(2, t.size + 777))
    return {"old": old, "sim_time": t, "sim_cur": u, "sim_gap": y, "spare": np.zeros(9)}


def vectors_beside_a_stale_longer_one(t, y, u):
    stale = np.r_[y, y[:500]] + 1e-3
    return {"sim_time": column(t), "sim_cur": column(u), "sim_gap": column(y), "pos_old": stale}


def structure_with_time(t, y, u):
    return {"out": structure(t, np.column_stack([y, u]))}


def structure_of_signals(t, y, u):
    fields = [("values", "O"), ("dimensions", "O"), ("label", "O")]
    both = np.array([(column(y), 1.0, "gap [m]"), (u[None, None], 1.0, "coil current")], fields)
    return {"out": {"time": column(t), "signals": both, "blockName": "rig/To Workspace"}}


def array_of_columns(t, y, u):
    return {"simout": np.column_stack([t, y, u])}


def timeseries_as_structures(t, y, u):
    return {"gap": {"Time": t, "Data": y, "Name": "gap"},
            "coil_current": {"Time": t, "Data": u, "Name": "coil current"}}  # fmt: skip


def rows_of_to_file(t, y, u):
    return {"ans": np.vstack([t, y, u])}


def cells(t, y, u):
    return {"log": {"time": t, "gap": y, "current": u}, "note": "run 7", "gain": 3.0}


FORMS = [
    vectors_and_a_stale_matrix, vectors_beside_a_stale_longer_one, structure_with_time,
    structure_of_signals, array_of_columns, timeseries_as_structures, rows_of_to_file, cells,
]  # fmt: skip


def in_turn(call, log):
    """Guess a map by the command, read and check by it; return the map and what check says."""
    code, text, err = call("read", "guess", str(log))
    assert code == 0, err
    log.with_suffix(".toml").write_text(text)
    by_map = (str(log), "--channels", str(log.with_suffix(".toml")))
    code, out, err = call("read", *by_map, "--out", str(log.with_suffix(".parquet")))
    assert code == 0, err
    assert "no faults found" in out
    code, out, err = call("check", *by_map)
    assert code == 0, err
    assert "note" not in err
    return text, out


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.__name__)
def test_a_log_of_matlab_is_guessed_read_and_checked(call, tmp_path, run, form):
    t, y, u = (run[name] for name in ("t", "y", "u"))
    savemat(tmp_path / "log.mat", form(t, y, u))
    text, out = in_turn(call, tmp_path / "log.mat")
    assert "12001 samples of" in out
    record = read(tmp_path / "log.mat", ChannelMap.from_toml(text)).record
    np.testing.assert_allclose(record.t, t, atol=1e-12)
    for name, true in (("y", y), ("u", u)):
        slope, offset = np.polyfit(true, record[name], 1)
        np.testing.assert_allclose(record[name], slope * true + offset, atol=1e-9 * np.ptp(true))
        assert abs(slope) in (pytest.approx(1.0), pytest.approx(1e-3)), name


@pytest.mark.parametrize("header", [
    "# rig of the second floor\n% 2024-05-03, run 7\ntime,coil,gap\n",
    "# time,coil,gap\n",
    "% rig: 3; k = 100\n% time [s],coil [A],gap [m]\n",
])  # fmt: skip
def test_a_csv_below_comments_is_guessed_read_and_checked(call, tmp_path, run, header):
    lines = [f"{t!r},{u!r},{y!r}\n" for t, u, y in
             zip(*(run[name].tolist() for name in ("t", "u", "y")), strict=True)]  # fmt: skip
    (tmp_path / "log.csv").write_text(header + "".join(lines))
    text, _ = in_turn(call, tmp_path / "log.csv")
    record = read(tmp_path / "log.csv", ChannelMap.from_toml(text)).record
    np.testing.assert_allclose(record["y"], run["y"], atol=1e-12)


@pytest.mark.parametrize("which", ["u slower", "y slower", "u late"])
def test_two_structures_with_their_own_clocks(call, tmp_path, run, which):
    """Position and current are found, each with its structure's time; one grid is asked for."""
    t, y, u = (run[name] for name in ("t", "y", "u"))
    of_y, of_u = (2 if which == "y slower" else 1), (2 if which == "u slower" else 1)
    late = 3e-4 if which == "u late" else 0.0
    savemat(tmp_path / "log.mat", {
        "pos": structure(t[::of_y], column(y[::of_y]), "gap [m]"),
        "cur": structure(t[::of_u] + late, column(u[::of_u]), "coil current"),
    })  # fmt: skip
    text = guess(tmp_path / "log.mat")
    assert "It has a clock of its own: 'ambkit read --resample' puts all on one grid." in text
    (tmp_path / "map.toml").write_text(text)
    arguments = ("read", str(tmp_path / "log.mat"), "--channels", str(tmp_path / "map.toml"))
    code, _, err = call(*arguments)
    assert code == 2
    assert "the signals have 2 clocks" in err
    code, _, err = call(*arguments, "--resample", "--out", str(tmp_path / "r.csv"))
    assert code == 0, err
    reading = read(tmp_path / "log.mat", ChannelMap.from_toml(text), resample=True)
    assert not any("has no noise" in text for text in reading.account())
    inner = slice(10, -10)
    close = np.interp(reading.record.t, t, y)
    assert np.abs(reading.record["y"] - close)[inner].max() < 2e-4
    assert (
        np.corrcoef(reading.record["u"][inner], np.interp(reading.record.t, t, u)[inner])[0, 1]
        > 0.5
    )


def test_what_only_rises_is_no_position(tmp_path, call):
    """A sensor's calibration has neither a time nor a rotor."""
    place = np.arange(36) * 0.7
    savemat(tmp_path / "calibration.mat", {
        "SensorData": {"Distance_mm": column(place), "Sensor_V": column(9.5 - 0.4 * place)}
    })  # fmt: skip
    with pytest.raises(RecordError, match=r"no channel is its time, and SensorData\.Distance_mm"):
        guess(tmp_path / "calibration.mat")
    rng = np.random.default_rng(1)
    savemat(tmp_path / "log.mat", {"gap_mm": rng.normal(size=400), "u": rng.normal(size=400)})
    code, text, err = call("read", "guess", str(tmp_path / "log.mat"))
    assert code == 0
    assert '# sampling_time = "... ms"' in text
    assert "the map has no time: fill in its sampling_time before a log is read by it" in err
