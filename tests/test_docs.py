"""README and pages say what is so: the index of the paper, the commands, the snippet, the figures.

That every snippet on the pages runs, and every reference leads somewhere, is checked by their
build, which .ci/run does with warnings as errors.
"""

import ast
import json
import re
import subprocess
import tomllib
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image

import ambkit
from ambkit.cli import catalogue

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
INDEX = (DOCS / "paper" / "where.md").read_text(encoding="utf-8")
CORE = (DOCS / "explanation" / "core.md").read_text(encoding="utf-8")

ROLE = re.compile(r"\{py:\w+\}`(?:~|[^`<]*<)?([\w.]+)>?`")


def rows(text):
    """Return the cells of all Markdown tables, without their heads."""
    lines = [
        [cell.strip() for cell in line.strip()[1:-1].split("|")]
        for line in text.splitlines()
        if line.startswith("|")
    ]
    heads = {n + k for n, cells in enumerate(lines) if set(cells[0]) == {"-"} for k in (-1, 0)}
    return [cells for n, cells in enumerate(lines) if n not in heads]


def resolve(name):
    """Import what a dotted name names: a module, then attributes."""
    parts = name.split(".")
    found = None
    for count in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            fields = getattr(found, "__dataclass_fields__", {}) | getattr(found, "model_fields", {})
            found = fields[part] if part in fields else getattr(found, part)
        break
    return found


# --- the index from the paper to what implements it


@pytest.mark.parametrize(("kind", "last"), [("Eq.", 33), ("Table", 6), ("Fig.", 16)])
def test_the_index_has_the_whole_paper(kind, last):
    listed = [cells[0] for cells in rows(INDEX) if cells[0].startswith(kind)]
    assert listed == [f"{kind} {n}" for n in range(1, last + 1)]


@pytest.mark.parametrize("cells", rows(INDEX), ids=lambda cells: cells[0])
def test_what_the_index_names_exists(cells):
    names = ROLE.findall(cells[2])
    assert names, f"{cells[0]} names nothing"
    assert len(names) == cells[2].count("{py:")
    for name in names:
        found = resolve(name)
        assert found is not None
        assert not isinstance(found, ModuleType)
    if cells[0].startswith("Eq."):
        symbols, headers = re.findall(r"`(amb_\w+)`", cells[3]), re.findall(r"\(#(.*?)\)", cells[3])
        assert bool(symbols) == bool(headers)
        text = "".join(header(anchor) for anchor in headers)
        assert [symbol for symbol in symbols if not re.search(rf"\b{symbol}\b", text)] == []


def header(anchor):
    """Return the C header that is shown at a place of the page on the core: ambkit-kalman-h."""
    (folders,) = re.findall(r"\{headers\} (.*)", CORE)
    shown = {
        f"{p.parent.name}-{p.stem}-h": p for f in folders.split() for p in ROOT.glob(f"{f}/*.h")
    }
    return shown[anchor].read_text(encoding="utf-8")


def test_resolve_notices_what_does_not_exist():
    assert resolve("ambkit.KalmanFilter.predict")
    assert resolve("ambkit.machine.parts.Sensor.lag")
    with pytest.raises(AttributeError):
        resolve("ambkit.KalmanFilter.foresee")
    assert resolve("nowhere.at.all") is None


# --- names of the package on pages, in examples, benchmarks and long tests

DOTTED = re.compile(r"(?<![\w/.-])ambkit(?:\.[A-Za-z_]\w*)+")
NO_NAMES = {"ambkit.sha256", "ambkit.toml"}  # files


def python_names(source):
    """Return what Python takes from the package: what it imports, and attributes of that."""
    if source.lstrip().startswith("%%"):  # another language
        return set()
    nodes = list(ast.walk(ast.parse(re.sub(r"(?m)^ *[%!].*", "", source))))
    imported = {}
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "ambkit":
            imported |= {a.asname or a.name: f"{node.module}.{a.name}" for a in node.names}
        elif isinstance(node, ast.Import):
            names = [a for a in node.names if a.name.split(".")[0] == "ambkit"]
            imported |= {a.asname or a.name: a.name for a in names}
    found = set(imported.values())
    bound = {n.id for n in nodes if isinstance(n, ast.Name) and not isinstance(n.ctx, ast.Load)}
    bound |= {node.arg for node in nodes if isinstance(node, ast.arg)}
    for node in nodes:
        dotted = ast.unparse(node) if isinstance(node, ast.Attribute) else ""
        first, _, rest = dotted.partition(".")
        if first in imported and first not in bound and re.fullmatch(r"[\w.]+", rest):
            found.add(f"{imported[first]}.{rest}")
    return found


def directive_names(text):
    """Return what the directives of a page of the reference document."""
    module, found = "", set()
    for directive, name in re.findall(r"^ *\.\. (\w+):: (\S+)$", text, re.MULTILINE):
        if directive in ("currentmodule", "automodule"):
            module = name
            found.add(name)
        elif directive.startswith("auto"):
            found.add(name if name.startswith("ambkit.") else f"{module}.{name}")
    return found


def package_names(path):
    """Return the names of the package that a page, a notebook or a file of Python uses."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return python_names(text)
    if path.suffix == ".ipynb":
        cells = [
            "".join(cell["source"])
            for cell in json.loads(text)["cells"]
            if cell["cell_type"] == "code"
        ]
        return set().union(*map(python_names, cells))
    if path.name == "changes.md":  # what it was called before is gone
        text = re.sub(r"(?m)^\| .*? \|", "", text)
    names = set(DOTTED.findall(text)) | directive_names(text)
    snippets = re.findall(
        r"^```+(?:python|\{code-cell\})[^\n]*\n(.*?)^```", text, re.DOTALL | re.MULTILINE
    )
    options = re.compile(r"\A(?:---\n(?:.*\n)*?---\n|(?::.*\n)*)")
    return names.union(*(python_names(options.sub("", snippet)) for snippet in snippets))


def missing(names):
    """Return which of some names lead nowhere."""

    def leads_nowhere(name):
        try:
            return resolve(name) is None
        except AttributeError:
            return True

    return sorted(name for name in names - NO_NAMES if leads_nowhere(name))


LISTED = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
USERS = [
    name
    for name in LISTED.stdout.split()
    if name.endswith((".md", ".rst", ".py", ".ipynb"))
    and not name.startswith(("src/", "tests/user/"))
    and name not in ("CONTRIBUTING.md", "tests/test_contributing.py")  # their modules are to come
]


def test_names_on_pages_and_in_examples_exist():
    used = {name: package_names(ROOT / name) for name in USERS}
    assert len(used["docs/how-to/tune.md"]) > 2
    assert len(used["examples/thread.ipynb"]) > 2
    assert {name: gone for name, names in used.items() if (gone := missing(names))} == {}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.md", "Call {py:func}`ambkit.identify_all`."),
        ("a.md", "```{code-cell}\n:tags: [a]\n\nfrom ambkit.base import nowhere\n```"),
        ("a.rst", ".. currentmodule:: ambkit.export.c\n\n.. autofunction:: export_d"),
        ("a.rst", ".. automodule:: ambkit.exports"),
        ("a.py", "from ambkit.machine import parts as p\n\nprint(p.Sensor.lags)"),
        ("a.py", "import ambkit\n\nambkit.export.d()"),
        (
            "a.ipynb",
            json.dumps({"cells": [{"cell_type": "code", "source": ["import ambkit.bases"]}]}),
        ),
    ],
)
def test_a_name_that_moved_is_noticed(tmp_path, name, text):
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    assert len(missing(package_names(file))) == 1


# --- the floors of the house


def test_contributing_shows_the_floors_that_are_checked():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    floors = next(c["layers"] for c in contracts["contracts"] if c["type"] == "layers")
    optional = re.compile(r"\(\w+\)")  # a room that is still to come
    checked = [re.findall(r"\w+", optional.sub("", floor)) for floor in floors]
    shown = []
    for floor, room, *_ in rows(CONTRIBUTING.partition("## The house")[2].partition("\n## ")[0]):
        shown += [[]] if floor else []
        shown[-1].append(room.strip("`"))
    assert shown == checked
    assert len(shown) <= 15  # the rooms of the design, no two of them on the same task
    package = ROOT / "src/ambkit"
    rooms = {path.parent.name for path in package.glob("*/__init__.py")}
    rooms |= {path.stem for path in package.glob("[!_]*.py")}
    assert rooms == {room for floor in shown for room in floor}


# --- the pages


def test_every_public_name_is_in_the_reference():
    pages = (DOCS / "reference" / "api").glob("*.rst")
    documented = set().union(*(directive_names(page.read_text()) for page in pages))
    public = {f"ambkit.{name}" for name in ambkit.__all__ if not name.startswith("_")}
    assert public - documented == set()


def test_no_python_on_the_pages_goes_unrun():
    pages = {path: path.read_text(encoding="utf-8") for path in DOCS.glob("**/[!_]*.md")}
    assert any("{code-cell}" in text for text in pages.values())
    assert [
        path.name for path, text in pages.items() if re.search("^```+ *python", text, re.M)
    ] == []


def test_the_pages_have_every_command():
    page = (DOCS / "reference" / "commands.md").read_text(encoding="utf-8")
    assert re.findall(r"^## ambkit (\w+)$", page, re.MULTILINE) == list(commands())
    assert [name for name in commands() if f"{{manual}} {name}\n" not in page] == []


def commands():
    """Return the commands with the first line of their help."""
    first = dict.fromkeys(name.partition(" ")[0] for name in catalogue.VERBS)
    return {name: catalogue.summary(name) for name in first}


# --- README, CHANGELOG, CITATION.cff


def test_the_snippet_runs_in_ten_lines(tmp_path, monkeypatch, capsys):
    (snippet,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len([line for line in snippet.splitlines() if line.strip()]) <= 10
    monkeypatch.chdir(tmp_path)
    exec(compile(snippet, "README.md", "exec"), {})
    printed = re.fullmatch(
        r"position ([\d.]+) mm, disturbance force ([\d.]+) N\n", capsys.readouterr().out
    )
    assert float(printed[1]) == pytest.approx(0.5, abs=0.05)
    assert float(printed[2]) == pytest.approx(3.0, abs=0.5)


def test_the_readme_names_every_command():
    table = README.partition("## Commands")[2].partition("## ")[0]
    named = set(re.findall(r"`(\w+)`", table))
    assert named == set(commands())


def test_the_readme_is_a_screen_and_a_half():
    assert len(README.splitlines()) <= 100


@pytest.mark.parametrize("target", re.findall(r"\]\((?!http)([^)#]+)\)", README))
def test_what_the_readme_links_to_exists(target):
    assert (ROOT / target).exists()


def test_the_picture_is_small_and_has_something_on_it():
    file = DOCS / "images" / "step.png"
    assert file.stat().st_size < 200_000
    with Image.open(file) as picture:
        ink = np.asarray(picture.convert("L")) < 200
    rows, columns = ink.any(axis=1), ink.any(axis=0)
    assert rows.mean() > 0.5
    assert columns.mean() > 0.8


def test_changelog_and_citation_are_of_this_version():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (\S+),", changelog, re.MULTILINE)[0] == version("ambkit")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {version('ambkit')}\n" in citation
    paper = "Adaptive Kalman filter for active magnetic bearings using softcomputing"
    for text in (citation, " ".join(README.split())):
        assert paper in text
        assert "Kästner" in text
