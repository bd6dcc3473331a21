"""Whatever a user gives or does: an exit code and a message, never a traceback."""

import errno
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from quick import quick

import ambkit
from ambkit.base import files
from ambkit.base.config import toml_text

AMBKIT = f"{shlex.quote(sys.executable)} -m ambkit"
ROWS = "".join(f"{k * 1e-4},{k % 7}e-6,0.1\n" for k in range(300))
CSV = f"t [s],y [m],u [V]\n{ROWS}"


@pytest.fixture(scope="module")
def bearing():
    return ambkit.preset("zittau_axial").to_toml()


def shell(command, **variables):
    """Run a line of shell; return its exit code, stdout and stderr."""
    environment = {**os.environ, **variables}
    done = subprocess.run(command, shell=True, capture_output=True, timeout=60, env=environment,
                          executable="/bin/bash", check=False)  # fmt: skip
    return done.returncode, done.stdout.decode(), done.stderr.decode()


# The net


def test_what_is_not_foreseen_is_one_line_with_its_place(call, monkeypatch):
    def broken(*_arguments):
        raise KeyError("no such thing")

    monkeypatch.setattr("ambkit.machine.presets.names", broken)
    code, out, err = call("presets")
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    assert err.startswith("ambkit: KeyError: 'no such thing' in ambkit.workflow.check, line ")
    assert "please report it with the output of --debug" in err


@pytest.mark.parametrize("place", [0, 1])
def test_debug_shows_where_an_error_came_from(call, place):
    arguments = ["check", "--machine", "nobody", "x.csv"]
    code, _out, err = call(*arguments)
    assert code == 2
    assert "Traceback" not in err
    arguments.insert(place, "--debug")
    code, _out, err = call(*arguments)
    assert code == 2
    assert err.startswith("Traceback")
    assert err.splitlines()[-1].startswith('ambkit: there is no preset and no file "nobody"')


# Files


def note(text):
    return f"# note: {text}\n{CSV}"


NASTY = {
    "deep.toml": (lambda toml: f"x = {'[' * 5000}{']' * 5000}\n{toml}", ":1: is nested too deeply"),
    "inline.toml": (lambda toml: f"x = {'{a=' * 5000}1{'}' * 5000}\n{toml}", "nested too deeply"),
    "dotted.toml": (lambda toml: f"{'a.' * 20000}a = 1\n{toml}", ":1: a key of more than 64 names"),
    "digits.toml": (lambda toml: f"x = {'1' * 5000}\n{toml}", ":1: x: an integer has more than"),
    "gain.toml": (lambda toml: re.sub("gain = .*", f"gain = {'1' * 4000}", toml), "too large"),
    "exponent.toml": (
        lambda toml: re.sub("mass = .*", 'mass = "1e9999999 kg"', toml),
        '"1e9999999 kg" is too large or too small a number',
    ),
    "deep.json": (lambda _: "[" * 100_000, "is nested too deeply for an expert"),
    "digits.json": (lambda _: f'{{"rules": {"1" * 5000}}}', "an integer of more than 4300 digits"),
    "quoted.csv": (
        lambda _: CSV + f'0.03,0,"{"x" * 140_000}"\n',
        ":302: a cell in quotes has more than 131072 characters",
    ),
}


@pytest.mark.parametrize("name", NASTY)
def test_a_nasty_file_is_refused_with_its_place(call, bearing, name):
    content, message = NASTY[name]
    Path(name).write_text(content(bearing))
    code, _out, err = call("check", name)
    assert code == 2
    assert err.startswith(name)
    assert message in err


@pytest.mark.parametrize("text", ["[" * 100_000, "1" * 5000, "{", "\udcff"])
def test_a_note_that_is_no_json_is_its_text(call, text):
    Path("run.csv").write_bytes(note(text).encode(errors="surrogateescape"))
    assert call("check", "run.csv")[0] == 0


def written(names=("t", "y", "u"), units=(b"s", b"m", b"V"), notes=None):
    """Write a Parquet with metadata as they are."""
    columns = [pa.array(np.arange(300) * 1e-4)] * len(names)
    fields = [
        pa.field(name, pa.float64(), metadata={"unit": unit})
        for name, unit in zip(names, units, strict=True)
    ]
    table = pa.Table.from_arrays(columns, schema=pa.schema(fields, metadata=notes))
    parquet.write_table(table, "run.parquet")


@pytest.mark.parametrize("text", [b"no JSON", b"\xff\xfe", b"[" * 100_000, b"1" * 5000, b""])
def test_parquet_with_odd_notes_is_read(call, text):
    written(notes={b"ambkit.x": text})
    assert call("check", "run.parquet")[0] == 0


def test_parquet_with_a_unit_that_is_no_text_is_refused(call):
    written(units=(b"s", b"\xff", b"V"))
    code, _out, err = call("check", "run.parquet")
    assert code == 2
    assert "column y: " in err
    assert "is not a known unit" in err


def test_parquet_with_columns_of_one_name_needs_a_map(call):
    written(("t", "y", "y"))
    code, _out, err = call("check", "run.parquet")
    assert code == 2
    assert "columns share a name" in err
    assert "y#1, y#2" in err
    Path("map.toml").write_text(
        '[signals.t]\ncolumn = "t"\nunit = "s"\n[signals.y]\ncolumn = "y#2"\nunit = "mm"\n'
    )
    record = ambkit.load("run.parquet", "map.toml")
    assert np.allclose(record["y"], np.arange(300) * 1e-7)
    assert call("read", "guess", "run.parquet")[0] == 0


FAULTY = {
    "k{} = {} mm": "write it in quotes",
    "k{} = {}": "unknown key",
    'name = "{}{}"': "is written twice",
}


@pytest.mark.parametrize("line", FAULTY)
def test_thousands_of_faults_are_counted_in_no_time(call, bearing, line):
    lines = "\n".join(line.format(k, k) for k in range(3000))
    Path("my.toml").write_text(f"{lines}\n{bearing}")
    before = time.process_time()
    code, _out, err = call("check", "my.toml")
    assert time.process_time() - before < 2
    assert code == 2
    told = err.splitlines()
    assert FAULTY[line] in err
    assert len(told) == 11
    faults = 6000 if "mm" in line else 3000  # unknown, too
    assert told[-1] == f"and {faults - 10} more"


def test_faults_behind_one_another_are_all_found_at_their_lines():
    text = (
        "a = 2 mm\nb = 'x'\nb = 'y'\n[t]\nc = 3 N\nd = 4\nd = 5\nnote = '''\ne = 6 V\n'''\n"
        "[[s]]\nf = 1\n[[s]]\nf = 1\ng = true or so\n"
    )
    found = toml_text.parse(text)
    assert sorted(line for line, _ in found.problems) == [1, 3, 5, 7, 15]
    assert found.data["t"]["note"] == "e = 6 V\n"
    assert found.data["s"] == [{"f": 1}, {"f": 1, "g": "true or so"}]


@pytest.mark.parametrize("unit", quick([" [mm]", " [A]", ""], [], [" [A]"]))
def test_the_time_of_a_guess_grows_as_the_columns(call, unit):
    def spent(count):
        names = ",".join(["t [s]" if unit else "t", *(f"c{k}{unit}" for k in range(1, count))])
        rows = ["{},{}".format(i * 1e-4, ",".join(f"{k * i % 7}.5" for k in range(1, count)))
                for i in range(40)]  # fmt: skip
        Path("wide.csv").write_text("\n".join([names, *rows]) + "\n")
        before = time.process_time()
        # Nothing floats there; of lengths one is taken for the position.
        assert call("read", "guess", "wide.csv")[0] == (0 if unit == " [mm]" else 2)
        return time.process_time() - before

    spent(200)  # imports
    assert spent(20_000) < 30 * spent(2_000)


def test_a_run_longer_than_the_memory_is_refused(call):
    for duration in ("1e30 s", "1e308 s"):
        code, _out, err = call("simulate", "zittau_axial", "--duration", duration)
        assert code == 2
        assert "duration must be at most" in err
        assert "memory holds" in err


# Anything instead of a file

CONTENTS = {
    "empty": b"",
    "noise": np.random.default_rng(1).bytes(3000),
    "zeros": bytes(300),
    "text": b"hello\nworld\n",
    "bracket": b"[",
}
SERIES = {
    "huge": "{t},{s}1e308,{s}1e308\n",
    "tiny": "{t},{s}1e-310,{s}1e-310\n",
    "nan": "{t},nan,nan\n",
    "zero": "{t},0,0\n",
    "mixed": "{t},{s}1e{k},nan\n",
    "backwards": "-{t},{k},{k}\n",
}


TAKING_FILES = [
    "check FILE.toml",
    "check FILE.json",
    "check FILE.parquet",
    "check run.csv --channels FILE.toml",
    "check run.csv --machine FILE.toml",
    "read FILE.csv",
    "read guess FILE.csv",
    "read guess FILE.mat",
    "read guess FILE.h5",
    "read guess FILE.mf4",
    "filter FILE.csv --machine zittau_axial --filter linear",
    "filter run.csv --machine zittau_axial --filter adaptive@FILE.json",
    "identify zittau_axial FILE.csv",
    "identify lift-off zittau_axial FILE.csv",
    "train map zittau_axial FILE.csv",
    "simulate FILE.toml",
    "simulate zittau_axial --scenario FILE.toml",
    "simulate zittau_axial --signal FILE.csv",
    "export c zittau_axial --out out --filter FILE.json",
]


def odd(folder, kind):
    """Make files that are none of this kind; return their names."""
    for name, content in CONTENTS.items():
        (folder / f"{name}.{kind}").write_bytes(content)
    (folder / f"folder.{kind}").mkdir()
    (folder / f"null.{kind}").symlink_to("/dev/null")
    (folder / f"loop.{kind}").symlink_to(f"loop.{kind}")
    for name, row in SERIES.items() if kind == "csv" else ():
        rows = [row.format(t=k * 1e-4, s="-" * (k % 2), k=k) for k in range(300)]
        (folder / f"{name}.csv").write_text("t [s],y [m],u [V]\n" + "".join(rows))
    return [*sorted(path.name for path in folder.iterdir()), "", "missing", f"{'x' * 300}.{kind}"]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # as the command does by itself
@pytest.mark.parametrize("command", TAKING_FILES)
def test_anything_in_the_place_of_a_file_is_an_exit_code(call, tmp_path, command):
    kind = re.search(r"FILE\.(\w+)", command)[1]
    names = odd(tmp_path, kind)
    (tmp_path / "run.csv").write_text(CSV)
    for name in names:
        arguments = [name if word.startswith("FILE") else word for word in command.split()]
        code, _out, err = call(*arguments)
        assert code in (0, 2), (arguments, err)
        assert "Traceback" not in err


@pytest.mark.parametrize("name", ["zero", "tiny"])
def test_nothing_is_identified_from_a_rotor_that_stands_still(call, tmp_path, name):
    odd(tmp_path, "csv")
    code, _out, err = call("identify", "zittau_axial", f"{name}.csv")
    assert code == 2
    assert err.splitlines()[-1] == "ambkit: y stands still: nothing can be identified from it"


ABSURD = ("", "nan", "0", "-1", "1e9999999 mm", "1e300 s", "1e-300 s", "1e300 m", "1e300 N", "1,,2",
          "7" * 5000, "\U0001f642")  # fmt: skip
WITH_NUMBERS = {
    "simulate zittau_axial --duration 5ms": "duration step disturbance seed filter out plot",
    "excite zittau_axial --duration 0.3s": "duration wander",
    "read run.csv": "sampling-time segment missing",
    "filter run.csv --machine zittau_axial --filter linear": "disturbance-noise settling",
    "identify online zittau_axial run.csv": "initial disturbance",
    "compare steps zittau_axial --filter linear --seeds 1": "steps disturbance",
    "export c zittau_axial --filter linear --out out": "prefix precision table-error",
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    "command", quick(WITH_NUMBERS, {"read run.csv", "identify online zittau_axial run.csv"})
)
def test_any_quantity_is_an_exit_code(call, tmp_path, command):
    (tmp_path / "run.csv").write_text(CSV)
    for option in WITH_NUMBERS[command].split():
        for value in ABSURD:
            code, _out, err = call(*command.split(), f"--{option}", value)
            assert code in (0, 2), (option, value[:40], err)


# Streams


@pytest.mark.skipif(os.name == "nt", reason="needs a POSIX shell")
def test_letters_and_windows_that_a_terminal_lacks_do_not_matter(tmp_path):
    picture = tmp_path / "run.png"
    drawn = f"simulate zittau_axial --duration '20 ms' --plot {shlex.quote(str(picture))}"
    lacks = {"PYTHONIOENCODING": "ascii", "MPLBACKEND": "nonsense"}
    code, out, err = shell(f"{AMBKIT} {drawn}", **lacks)
    assert (code, err) == (0, f"wrote {picture}\n")
    assert picture.is_file()
    assert out.isascii()
    assert re.search(r"\d um", out)
    code, out, _err = shell(f"{AMBKIT} presets zittau_axial", PYTHONIOENCODING="ascii")
    assert code == 0
    assert ambkit.Machine.from_toml(out) == ambkit.preset("zittau_axial")
    listed = f"{AMBKIT} check $'\\xff.toml' --json"
    code, out, _err = shell(listed, LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert code == 2
    assert json.loads(out)[0]["ok"] is False


@pytest.mark.skipif(os.name == "nt", reason="needs a POSIX shell")
@pytest.mark.parametrize(
    ("command", "closed", "code"),
    [
        ("--help", ">&-", 0),
        ("--hepl", "2>&-", 2),
        ("presets zittau_axial --out bearing.toml", ">&- 2>&- <&-", 0),
    ],
)
def test_closed_streams_are_silent(tmp_path, command, closed, code):
    said = shell(f"cd {shlex.quote(str(tmp_path))}; {AMBKIT} {command} {closed}")
    assert said[0] == code
    assert "Traceback" not in said[2]
    if "--out" in command:
        assert ambkit.Machine.load(tmp_path / "bearing.toml") == ambkit.preset("zittau_axial")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_stdout_is_reported(unbuffered):
    code, _out, err = shell(f"{AMBKIT} --help > /dev/full", PYTHONUNBUFFERED=unbuffered)
    assert code == 2
    assert err == "ambkit: the output cannot be written: No space left on device\n"


@pytest.mark.skipif(os.name == "nt", reason="needs a POSIX shell")
@pytest.mark.parametrize(
    "command", quick(["--help", "simulate zittau_axial --duration 5ms"], ["--help"])
)
def test_a_reader_that_has_gone_is_no_error(command):
    code, out, err = shell(f"{AMBKIT} {command} | true; echo ${{PIPESTATUS[0]}}")
    assert (code, out, err) == (0, "0\n", "")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send")
@pytest.mark.parametrize("module", ["argparse", "ambkit.cli.from_verbs", "numpy", "json"])
def test_ctrl_c_while_it_starts_is_one_line(module):
    """Interrupted while it imports: by a finder that is asked for each module."""
    program = (
        "import os, signal, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, *rest):\n"
        f"        if name == {module!r}:\n"
        "            sys.meta_path.remove(self)\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "for name in list(sys.modules):\n"
        f"    if name.split('.')[0] == {module!r}: del sys.modules[name]\n"
        "sys.meta_path.insert(0, Finder())\n"
        "sys.argv = ['ambkit', 'simulate', 'zittau_axial']\n"
        "from ambkit.cli.main import main\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    assert done.returncode == 130
    assert done.stderr == "\ninterrupted; nothing was written\n"


# A full disk


@pytest.fixture
def full(monkeypatch):
    """Let a disk be full once so many bytes are on it."""

    def limit(most):
        left = [most]
        write = Path.write_bytes

        def limited(self, content):
            if len(content) > left[0]:
                write(self, content[: left[0]])  # as much as there is room for
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            left[0] -= len(content)
            return write(self, content)

        monkeypatch.setattr(Path, "write_bytes", limited)

    return limit


@pytest.mark.parametrize("room", [0, 30_000])
def test_a_full_disk_leaves_no_part_of_an_export(call, full, room):
    full(room)
    code, _out, err = call("export", "c", "zittau_axial", "--filter", "linear", "--out", "a/out")
    assert code == 2
    assert re.fullmatch(r"ambkit: a/out/\S+: cannot be written: No space left on device\n", err)
    assert list(Path().iterdir()) == []


def test_a_full_disk_leaves_an_older_export_whole(call, full):
    command = ("export", "c", "zittau_axial", "--out", "out", "--filter")
    assert call(*command, "linear")[0] == 0
    Path("out/mine.c").write_text("int mine;")
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    full(30_000)
    assert call(*command, "extended")[0] == 2
    assert before == {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}


@pytest.fixture
def limited(monkeypatch):
    """Let no file grow beyond 4 kB."""
    resource = pytest.importorskip("resource")
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.pictures
@pytest.mark.parametrize("command", quick(
    TOO_LARGE := [
        "export c zittau_axial --filter linear --out out", "export fmu zittau_axial --out x.fmu",
        "simulate zittau_axial --duration 1s --out run.parquet",
        "simulate zittau_axial --duration 1s --plot run.svg",
    ],
    [TOO_LARGE[0], TOO_LARGE[3]],  # pyarrow itself takes away what it has begun
))  # fmt: skip
def test_a_file_that_may_not_grow_is_not_left_in_part(call, limited, tmp_path, command):
    code, _out, err = call(*command.split())
    assert code == 2
    assert "cannot be written: " in err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_written_as_a_whole_or_not_at_all(tmp_path):
    folder = tmp_path / "new" / "deep"

    def fill(fails):
        with files.replacing_in(folder) as temporary:
            files.write_text(temporary / "a", "1")
            assert not (folder / "a").exists()
            if fails:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fill(fails=True)
    assert list(tmp_path.iterdir()) == []
    fill(fails=False)
    assert [path.name for path in folder.iterdir()] == ["a"]


def test_a_link_stays_a_link_and_a_pipe_a_pipe(tmp_path):
    (tmp_path / "link").symlink_to("file")
    with files.replacing_in(tmp_path) as temporary:
        files.write_text(temporary / "link", "0")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_text() == "0"
    files.write_text(tmp_path / "link", "1")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_text() == "1"
    os.mkfifo(tmp_path / "pipe")
    read = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    files.write_text(tmp_path / "pipe", "2")
    assert os.read(read, 9) == b"2"
    os.close(read)
    assert (tmp_path / "pipe").is_fifo()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "link", "pipe"]
