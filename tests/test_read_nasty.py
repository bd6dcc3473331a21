"""Logs as a stranger's logger writes them: each is read right, or refused in one clear word."""

import re
from pathlib import Path

import numpy as np
import pytest

from ambkit.base.errors import RecordError
from ambkit.data.channel_map import ChannelMap
from ambkit.data.files.tables import read_log
from ambkit.data.reading import read
from ambkit.data.reading.propose import guess
from tests import logs

N, T = 400, 1e-3
RNG = np.random.default_rng(3)
TIME = T * np.arange(N)
WAVE = np.sin(2 * np.pi * 3 * TIME)
POS = np.round(0.1 * WAVE + 0.01 * RNG.normal(size=N), 6)
CURRENT = np.round(-0.3 * WAVE + 0.01 * RNG.normal(size=N), 6)
HEAD = "time [s],pos [mm],current [A]"
BARE = "time,pos,current"


def rows(separator=",", decimal=".", time=None):
    for k, values in enumerate(zip(TIME, POS, CURRENT, strict=True)):
        cells = [f"{value:.6f}".replace(".", decimal) for value in values]
        yield separator.join([time(k) if time else cells[0], *cells[1:]])


def text(*lines, end="\n"):
    return end.join(lines) + end


def mixed_ends():
    lines = [HEAD, *rows()]
    return "".join(line + ("\n", "\r\n", "\r")[k % 3] for k, line in enumerate(lines))


READ = {
    "a byte order mark": ("csv", text(HEAD, *rows()).encode("utf-8-sig")),
    "UTF-16": ("csv", text(HEAD, *rows()).encode("utf-16")),
    "UTF-16 without a mark": ("csv", text(HEAD, *rows()).encode("utf-16-le")),
    "the other UTF-16 without a mark": ("csv", text(HEAD, *rows()).encode("utf-16-be")),
    "decimal comma": ("csv", text(HEAD.replace(",", ";"), *rows(";", ","))),
    "quoted headers": ("csv", text('"time [s]","pos, seen [mm]","current [A]"', *rows())),
    "units in brackets": ("csv", text(BARE, "[s],[mm],[A]", *rows())),
    "units in round ones": ("csv", text(BARE, "(s),(mm),(A)", *rows())),
    "units that are dashes": ("csv", text(BARE, "-,-,-", *rows())),
    "comments of all kinds": (
        "csv", text("# rig 3", "# who: X", "% MATLAB", "// C", "! more", "", HEAD, *rows()),
    ),
    "tabs, one more at the end": (
        "txt", text("time\tpos\tcurrent\t", *(row + "\t" for row in rows("\t"))),
    ),
    "mixed line ends": ("csv", mixed_ends()),
    "no line end at the end": ("csv", text(HEAD, *rows()).removesuffix("\n")),
    "time in ns since 1970": (
        "csv", text(BARE, *rows(time=lambda k: str(1_714_737_600_000_000_123 + k * 10**6))),
    ),
    "time in ms": ("csv", text(BARE, *rows(time=str))),
    "time in ms since 1970": ("csv", text(BARE, *rows(time=lambda k: str(1_714_737_600_000 + k)))),
    "Excel's sep": (
        "csv", text("sep=;", BARE.replace(",", ";"), *rows(";", ","), end="\r\n").encode("cp1252"),
    ),
    "Excel's sep, a tab": (
        "csv", text("sep=\t", BARE.replace(",", "\t"), *rows("\t", ",")).encode("utf-16"),
    ),
    "a minus as in print": (
        "csv", text(HEAD, *(row.replace("-", "\N{MINUS SIGN}") for row in rows())),
    ),
    "NumPy's header": ("csv", text(f"# {BARE}", *rows())),
    "an index without a name": (
        "csv", text(f",{BARE}", *(f"{k},{row}" for k, row in enumerate(rows()))),
    ),
    "spaces": ("txt", text("  time   pos  current", *("  " + row for row in rows("   ")))),
    "date and time apart": (
        "csv", text("Date;Time;pos;current",
                    *(f"03.05.2024;{row}" for row in rows(";", time=lambda k: f"12:00:00.{k:03}"))),
    ),
    "the American way": (
        "csv", text(BARE, *rows(time=lambda k: f"05/03/2024 11:59:59.{k:03} PM")),
    ),
    "a first line of 200 kB": ("csv", "x" * 200_000 + "\n" + text(HEAD, *rows())),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_a_nasty_log_is_read_by_the_map_that_is_guessed(tmp_path, name):
    ending, content = READ[name]
    path = tmp_path / f"log.{ending}"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    reading = read(path, ChannelMap.from_toml(guess(path)))
    record = reading.record
    np.testing.assert_allclose(record.t - record.t[0], TIME, atol=1e-9)
    np.testing.assert_allclose(record["y"], POS * 1e-3, atol=1e-15)
    np.testing.assert_allclose(record["u"], CURRENT, atol=1e-12)
    assert any("last line has no end" in r for r in reading.remarks) == name.startswith("no line")


def _words(line):
    return line.split()


def test_nothing_is_written_in_many_ways(tmp_path):
    words = _words("NaN nan N/A #N/A NULL null - 1.#QNAN -nan(ind) #NV None -- ? NAN() NoData")
    endless = _words("Inf -inf Infinity +INF 1.#INF -1.#INF ∞")
    lines = [row.split(",") for row in rows()]
    for k, word in enumerate(["", *words, *endless]):
        lines[20 + 5 * k][1] = word
    path = tmp_path / "log.csv"
    path.write_text(text(HEAD, *map(",".join, lines)), encoding="utf-8")
    reading = read(path, ChannelMap.from_toml(guess(path)))
    kinds = [fault.kind for fault in reading.faults]
    assert (kinds.count("missing"), kinds.count("infinite")) == (len(words) + 1, len(endless))
    lost = np.flatnonzero(np.isnan(reading.record["y"]))
    np.testing.assert_array_equal(lost, 20 + 5 * np.arange(len(words) + 1 + len(endless)))


REFUSED = {
    "an empty file": ("", "has no header and no samples"),
    "blanks alone": ("\n\n  \n", "has no header and no samples"),
    "a header alone": (f"{HEAD}\n", "holds only 0 samples of time, pos, current"),
    "one row": (f"{HEAD}\n0,1,2\n", "holds only 1 sample of time, pos, current"),
    "a page of the net": ("<html><body>404</body></html>\n", "holds only 0 samples"),
    "cut short": (text(HEAD, *rows())[:-13], r"log.csv:401: has 2 cells instead of 3; is the file"),
    "the comma twice": (
        text(BARE, *rows(",", ",")), "has 3 cells instead of 6; is the comma the separator and the",
    ),
    "begun again": (
        text(HEAD, *rows(), HEAD, *rows()), r"log.csv:402: column time: 'time \[s\]' is not a num",
    ),
    "words at the end": (text(HEAD, *rows(), "End of file"), r"log.csv:402: has 1 cell instead of"),
    "an archive": (b"PK\x03\x04" + bytes(range(256)) * 10, "is not text"),
    "a zero among the numbers": (text(HEAD, *rows()).replace("9,", "9\0,"), "is not text"),
    "names over two lines": (
        text('"time\n[s]","pos\n[mm]","current\n[A]"', *rows()), "log.csv:1: has 1 cell instead of",
    ),
    "nothing but times": (
        text("time,a,b", *(f"{t},1,2" for t in TIME)), "refused: nothing in it is levitated",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_hopeless_log_is_one_clear_word(call, name):
    content, word = REFUSED[name]
    Path("log.csv").write_bytes(content.encode() if isinstance(content, str) else content)
    code, out, err = call("read", "guess", "log.csv")
    if code == 0:
        Path("map.toml").write_text(out)
        code, out, err = call("read", "log.csv", "--channels", "map.toml", "--out", "a.parquet")
        Path("map.toml").unlink()
    assert (code, out) == (2, "")
    assert err.startswith("ambkit: ")
    assert re.search(word, err)
    code, out, err = call("read", "log.csv", "--out", "a.csv")
    assert (code, out) == (2, "")
    assert err.startswith("ambkit: ")
    assert [path.name for path in Path().iterdir()] == ["log.csv"]


@pytest.mark.parametrize("cell", ["1,234,567.8", "1'234'567.8", "1 234,5"])
def test_thousands_set_apart_are_no_numbers_and_that_is_said(tmp_path, cell):
    path = tmp_path / "log.csv"
    decimal = "," if "," in cell[-3:] else "."
    lines = (
        f"{t:.3f};{c:.3f}".replace(".", decimal) + f";{cell}"
        for t, c in zip(TIME, CURRENT, strict=True)
    )
    path.write_text(text("time;current;pos", *lines))
    with pytest.raises(RecordError, match=re.escape(f"pos ({cell!r}: are thousands set apart")):
        guess(path)
    channel_map = '[signals.t]\ncolumn="time"\nunit="s"\n[signals.y]\ncolumn="pos"\nunit="mm"\n'
    with pytest.raises(Exception, match="is not a number: are thousands set apart") as failure:
        read(path, ChannelMap.from_toml(channel_map))
    assert len(failure.value.damaged) == N


def test_columns_of_one_name(call):
    cells = zip(TIME.tolist(), POS.tolist(), CURRENT.tolist(), strict=True)
    twice = (f"{t},{y},{y},{i}" for t, y, i in cells)
    Path("log.csv").write_text(text("time,pos,pos,current", *twice))
    code, out, _ = call("read", "guess", "log.csv")
    assert (code, "pos#1" in out) == (0, True)
    Path("map.toml").write_text(out.replace("pos#1", "pos"))
    code, _, err = call("read", "log.csv", "--channels", "map.toml")
    assert code == 2
    assert "has several columns pos: use pos#1 or pos#2" in err


def test_a_parquet_with_text(call):
    logs.parquet(Path("log.parquet"), {
        "time": TIME, "pos": np.array([str(value) for value in POS]), "current": CURRENT,
        "who": np.array(["x"] * N),
    })  # fmt: skip
    code, out, _ = call("read", "guess", "log.parquet")
    assert code == 0
    assert "who holds no numbers" in out
    Path("map.toml").write_text(out)
    record = read("log.parquet", "map.toml").record
    np.testing.assert_allclose(record["y"], POS * 1e-3)
    code, _, err = call("read", "log.parquet")
    assert (code, "column who holds string, not numbers" in err) == (2, True)


def test_structure_arrays_of_matlab_a_matrix_in_hdf5_and_rates_of_mdf(tmp_path):
    import h5py
    from scipy.io import savemat

    runs = np.zeros(2, dtype=[("t", "O"), ("y", "O")])
    for k in range(2):
        runs[k] = TIME + k, POS
    savemat(tmp_path / "a.mat", {"runs": runs, "label": "text", "empty": np.zeros((0, 3))})
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["log/data"] = np.column_stack([TIME, POS, CURRENT])
        file["log/names"] = np.array([b"t", b"y", b"u"])
        file["cube"], file["scalar"], file["empty"] = np.zeros((2, 3, 4)), 3.0, np.zeros(0)
    slow = slice(None, None, 4)
    logs.mdf4(tmp_path / "a.mf4", {"time": TIME, "pos": POS},
              {"time": TIME[slow] + 1e-4, "current": CURRENT[slow]},
              {"time": TIME[::50], "temperature": TIME[::50]})  # fmt: skip
    by_hand = 'array = "log/data"\n' + "".join(
        f'[signals.{name}]\ncolumn = {n}\nunit = "{unit}"\n'
        for n, (name, unit) in enumerate({"t": "s", "y": "mm", "u": "V"}.items())
    )
    with pytest.raises(RecordError, match="refused: nothing in it is levitated"):
        guess(tmp_path / "a.h5")  # its columns have no names, and no rotor moves like these waves
    for name in ("a.mat", "a.h5", "a.mf4"):
        text_of_map = by_hand if name == "a.h5" else guess(tmp_path / name)
        found = ChannelMap.from_toml(text_of_map)
        record = read(tmp_path / name, found, resample=name == "a.mf4").record
        np.testing.assert_allclose(record["y"], POS * 1e-3, atol=1e-15)
        np.testing.assert_allclose(record.t, TIME, atol=1e-12)
    assert sorted(read_log(tmp_path / "a.mat").arrays)[-4:] == [
        "runs[0].t", "runs[0].y", "runs[1].t", "runs[1].y",
    ]  # fmt: skip
