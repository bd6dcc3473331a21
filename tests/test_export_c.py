"""``ambkit export c``: what a user types, compiles and links, and what its numbers are."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from itertools import product
from pathlib import Path

import pytest
from export_cases import BEARING, KINDS, PRECISIONS, export, flight_files, magnet_of
from exporting import export_c
from quick import quick

import ambkit
from ambkit import ClosedLaw, FilterNoise
from ambkit.base.errors import AmbkitError
from ambkit.export.c import CExport

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
Exported = Callable[..., CExport]


def texts(folder):
    """Return the bytes of every file in a folder."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


# ---- What a user types ----


@pytest.fixture(scope="module")
def workflow(tmp_path_factory):
    """The README's lines from training to self-test, run by a shell; folder and output."""
    for tool in ("cmake", "make", "bash"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    (lines,) = [block for block in blocks if "ambkit export c" in block]
    folder = tmp_path_factory.mktemp("workflow")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", lines],
        cwd=folder, env=os.environ | {"PATH": path, "PYTHONHASHSEED": "1"},
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def test_the_workflow_of_the_readme_ends_with_pass(workflow):
    _, printed = workflow
    last = printed.splitlines()[-1]
    assert last == "pass: zittau_axial, 768 samples, two instances: equal to the last bit"
    assert last in README


def test_another_process_writes_the_same_bytes(workflow, tmp_path):
    folder, _ = workflow
    expert = ambkit.Expert.load(folder / "expert.json")
    export_c(BEARING, expert, tmp_path / "here")
    assert texts(tmp_path / "here") == texts(folder / "out")


@pytest.mark.parametrize("kind", ["linear", "closed-law", "tabulated", "observer"])
def test_the_command_takes_names_and_files(call, exported, kind):
    magnet_of("adaptive").save("expert.json")
    named = "expert.json --table-error auto" if kind == "tabulated" else kind
    done = call("export", "c", *f"zittau_axial --filter {named} --out out".split())
    assert done.code == 0
    assert f"zittau_axial as C: out, {len(texts(Path('out')))} files." in done.out
    assert texts(Path("out")) == texts(exported(kind).folder)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("zittau_axial", "required: --out"),
        ("zittau --out o", "did you mean zittau_axial?"),
        ("zittau_axial --filter closed --out o", "did you mean closed-law?"),
        ("zittau_axial --filter e.json --out o", "e.json: cannot be read"),
        ("zittau_axial --table-error auto --out o", "only an expert can be tabulated"),
        ("zittau_axial --prefix front-axis --out o", 'a letter first, is "front-axis"'),
        ("zittau_axial --precision half --out o", "invalid choice: 'half' (choose from"),
        ("zittau_axial --clock 80MHz --out o", "there is no option --clock"),
    ],
)
def test_what_the_user_did_wrong_is_one_message(call, tmp_path, words, said):
    done = call("export", "c", *words.split())
    assert done.code == 2
    assert said in done.err
    assert len(done.err.splitlines()) <= 2
    assert list(tmp_path.iterdir()) == []


# ---- The folder ----


@pytest.mark.parametrize(("kind", "precision"), quick(
    product(KINDS, PRECISIONS), [*product(KINDS, ("float",)), ("adaptive", "double")]
))  # fmt: skip
def test_no_dates_no_paths(exported, kind, precision):
    for name, content in texts(exported(kind, precision).folder).items():
        text = content.decode()
        assert not re.search(r"\b20\d\d-\d\d|__DATE__|__TIME__|__TIMESTAMP__|__FILE__", text), name
        for place in (ROOT, Path.home(), Path(os.sep, "tmp"), Path(sys.prefix)):
            assert f"{place}{os.sep}" not in text, name
        assert "\r" not in text
        assert not re.search(r"[ \t]$", text, re.MULTILINE), f"{name}: blanks at the end of a line"


def test_the_same_input_gives_the_same_bytes_into_any_folder(exported, tmp_path):
    for kind in ("linear", "tabulated"):
        again = export(kind, tmp_path / kind / "elsewhere")
        assert texts(again.folder) == texts(exported(kind).folder)
        assert again.configuration == exported(kind).configuration


def test_whatever_the_filter_is_made_from_changes_the_hash(exported, tmp_path):
    heavier = BEARING.replace(rotor__mass=BEARING.rotor.mass * (1 + 1e-6))
    made = {
        "as it is": exported("linear"),
        "double": exported("linear", "double"),
        "mass": export_c(heavier, None, tmp_path / "mass"),
        "noise": export("linear", tmp_path / "noise", noise=FilterNoise(measurement=1e-10)),
        "gravity": export("linear", tmp_path / "gravity", gravity="disturbance"),
        "frozen": export("linear", tmp_path / "frozen", frozen_limit=20),
        "source": exported("adaptive"),
        "kind": exported("extended"),
        "poles": export("observer", tmp_path / "poles", bandwidth=1000.0),
        "other poles": export("observer", tmp_path / "other poles", bandwidth=1001.0),
        "table": exported("tabulated"),
        "bound": export("tabulated", tmp_path / "bound", force_bound=0.5),
    }
    hashes = {name: one.configuration for name, one in made.items()}
    assert len(set(hashes.values())) == len(hashes), hashes
    for one in made.values():
        assert re.fullmatch(r"[0-9a-f]{16}", one.configuration)
        header = (one.folder / f"{one.name}.h").read_text()
        assert f'{one.name.upper()}_CONFIGURATION "{one.configuration}"' in header
        assert f'_VERSION "{ambkit.__version__}"' in header


def test_its_header_says_which_sampled_model_it_has(tmp_path):
    for as_printed, told in (
        (False, "force held, all else exact"),
        (True, "position held (eq. 19"),
    ):
        folder = tmp_path / str(as_printed)
        made = export_c(BEARING, ClosedLaw(BEARING), folder, as_printed=as_printed)
        data = (made.folder / f"{made.name}_data.c").read_text()
        assert (".c_sen = 0.0F," in data) == as_printed
        for name in (f"{made.name}.h", "README.md"):
            text = (made.folder / name).read_text()
            assert told in text
            assert ("ahead of the rotor" in text) == as_printed


@pytest.mark.parametrize("kind", KINDS)
def test_the_folder_holds_what_the_core_holds(exported, kind):
    """The library's own files byte for byte, save precision, and a model that is not built in."""
    made = exported(kind)
    core = [name for name in made.files if name.startswith("core/")]
    assert len(core) > 5
    for name in core:
        model = kind == "constant-velocity" and name.endswith("/model.h")
        if not (model or name.endswith("/precision.h")):
            assert (made.folder / name).read_bytes() == (ROOT / name).read_bytes()
    assert set(made.sources) == {name for name in flight_files(made) if name.endswith(".c")}


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="sha256sum is not installed")
def test_the_manifest_is_of_all_files(exported):
    made = exported("adaptive")
    command = ["sha256sum", "--check", "--strict", "ambkit.sha256"]
    done = subprocess.run(command, cwd=made.folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    checked = {line.removesuffix(": OK") for line in done.stdout.splitlines()}
    assert checked | {"ambkit.sha256"} == set(texts(made.folder))
    assert checked == set(made.files)


def test_an_export_is_not_poured_among_other_files(call):
    Path("bearing.toml").write_text("mine")
    done = call("export", "c", "zittau_axial", "--out", ".")
    assert done.code == 2
    assert done.err.startswith("ambkit: .: holds other files, and the ")
    assert done.err.endswith("; take a new folder or an empty one\n")
    assert texts(Path()) == {"bearing.toml": b"mine"}


def test_a_new_repository_is_empty(tmp_path):
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "HEAD").write_text("ref: refs/heads/main")
    made = export("linear", tmp_path)
    assert set(texts(tmp_path)) == {".git/HEAD", "ambkit.sha256", *made.files}


def test_what_lies_beside_an_older_export_is_not_touched(tmp_path):
    first = export("adaptive", tmp_path)
    assert (tmp_path / "core" / "src" / "fuzzy.c").exists()
    (tmp_path / "notes.txt").write_text("mine")
    second = export("linear", tmp_path)
    assert set(texts(tmp_path)) == {"notes.txt", "ambkit.sha256", *second.files}
    assert set(first.files) - set(second.files), "nothing was there to be taken away"


def test_a_file_of_the_same_name_is_not_overwritten(tmp_path):
    export("linear", tmp_path)
    (tmp_path / "core" / "src" / "fuzzy.c").write_text("mine")
    before = texts(tmp_path)
    with pytest.raises(AmbkitError, match=r"fuzzy\.c is there already, and not from an export"):
        export("adaptive", tmp_path)
    assert texts(tmp_path) == before


@pytest.mark.parametrize("name", ["../outside.txt", "{folder}/outside.txt", "a/../../outside.txt"])
def test_a_manifest_cannot_reach_outside(tmp_path, name):
    outside, folder = tmp_path / "outside.txt", tmp_path / "out"
    outside.write_text("mine")
    folder.mkdir()
    line = f"{'0' * 64}  {name.format(folder=tmp_path)}\n"
    (folder / "ambkit.sha256").write_text(line)
    export("linear", folder)
    assert outside.read_text() == "mine"


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "out").write_text("mine")
    with pytest.raises(AmbkitError, match="out"):
        export("linear", tmp_path / "out")
    assert (tmp_path / "out").read_text() == "mine"


def test_an_installed_package_brings_its_c(tmp_path, exported):
    """The Python files and what CMake installs side by side, as in a wheel, and no repository."""
    installed = Path(sys.prefix, "lib", f"python{sys.version_info[0]}.{sys.version_info[1]}",
                     "site-packages")  # fmt: skip
    if not (installed / "ambkit" / "core").is_dir():
        pytest.skip("ambkit was not installed by its own build")
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "src" / "ambkit", tmp_path / "ambkit", ignore=ignored)
    shutil.copytree(installed / "ambkit", tmp_path / "ambkit", ignore=ignored, dirs_exist_ok=True)
    # Without site.py, and so without the hook that leads an editable install to the repository.
    code = (
        f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(installed)!r}]\n"
        "import ambkit.cli.main; print(ambkit.__file__); ambkit.cli.main.main()"
    )
    words = ["export", "c", "zittau_axial", "--out", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-S", "-c", code, *words], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(tmp_path))
    assert texts(tmp_path / "out") == texts(exported("extended").folder)
