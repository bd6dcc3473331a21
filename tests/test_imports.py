"""Imports go down only and in no circle, those by a string included (README.md, the house)."""

import ast
import re
import tomllib
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[1]

SOURCE = ROOT / "src" / "ambkit"
NAME = re.compile(r"\.?[a-z_]\w*(?:\.\w+)*(?::\w+)?")
FLOORS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
FLOORS = next(contract["layers"] for contract in FLOORS if contract["type"] == "layers")


def named(text, modules):
    """Return the module that a source names by each of its strings, as far as there is one."""
    tree = ast.parse(text)
    parts = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)
             for part in node.values}  # fmt: skip
    prefixes = {"ambkit."} | {
        str(node.values[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.JoinedStr) and isinstance(node.values[0], ast.Constant)
    }
    prefixes = {each for each in prefixes if re.fullmatch(r"ambkit\.(\w+\.)*", each)}
    dynamic = "import_module" in text or "__import__" in text
    strings = {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts
    }
    found = set()
    for string in filter(NAME.fullmatch, strings):
        words = string.replace(":", ".").split(".")
        starts = [""] if words[0] == "ambkit" else prefixes if dynamic or ":" in string else set()
        for start in starts:
            for end in range(len(words), 0, -1):
                module = start + ".".join(words[:end])
                if module in modules and module.count(".") > 1:
                    found.add(module)
                    break
    return found


@pytest.fixture(scope="module")
def graph():
    """Return who imports whom; the package's own root, above all floors, left out."""
    made = grimp.build_graph("ambkit", cache_dir=None)
    modules = {each for each in made.modules if not made.is_module_squashed(each)}
    for path in sorted(SOURCE.rglob("*.py")):
        parts = ("ambkit", *path.relative_to(SOURCE).with_suffix("").parts)
        importer = ".".join(parts).removesuffix(".__init__")
        for module in named(path.read_text(), modules) - {importer}:
            made.add_import(importer=importer, imported=module)
    for module in made.find_modules_directly_imported_by("ambkit"):
        made.remove_import(importer="ambkit", imported=module)
    return made


def floor_of(module):
    """Return how far from the top the floor of a module is."""
    room = module.split(".")[1]
    return next(k for k, floor in enumerate(FLOORS) if room in floor.split(" | "))


def test_no_import_goes_up(graph):
    """Strings and `import_module` included."""
    inner = [each for each in graph.modules if each not in ("ambkit", "ambkit.__main__")]
    upward = [
        f"{importer} -> {imported}"
        for importer in inner
        for imported in graph.find_modules_directly_imported_by(importer)
        if imported.count(".") and importer.split(".")[1] != imported.split(".")[1]
        if not imported.split(".")[1].startswith("_") and floor_of(imported) <= floor_of(importer)
    ]
    assert "\n".join(sorted(upward)) == ""


def test_no_import_circle(graph):
    """Neither between the rooms within a room, nor between single modules."""
    circles = {
        each: found for each in graph.modules if (found := graph.nominate_cycle_breakers(each))
    }
    assert not circles
    left = set(graph.modules)
    while leaves := {m for m in left if not graph.find_modules_directly_imported_by(m) & left}:
        left -= leaves
    assert not sorted(left)


# A method of a class that the registry of kinds knows, behind which is the registry: users save an
# estimator by `kalman.save(path)`. No other binding may hide a circle or a way up.
CIRCLES_BOUND_LATE = {("ambkit.estimate.estimator", "ambkit.estimate.filter_saving")}


def test_late_bindings_hide_nothing(graph):
    """What the root binds behind a method counts as an import of the module that has the method."""
    bound = dict(
        re.findall(r'PLACES\["(\w+)"\] = "([\w.]+):', (SOURCE / "__init__.py").read_text())
    )
    calls = {
        ("ambkit." + ".".join(path.relative_to(SOURCE).with_suffix("").parts), name)
        for path in SOURCE.rglob("*.py")
        for name in re.findall(r'late_binding\.call\(\s*"(\w+)"', path.read_text())
    }
    assert {name for _, name in calls} == bound.keys()
    edges = {(importer, f"ambkit.{bound[name]}") for importer, name in calls}
    hidden = {
        (importer, imported)
        for importer, imported in edges
        if floor_of(imported) < floor_of(importer)
        or graph.find_shortest_chain(importer=imported, imported=importer)
    }
    assert hidden == CIRCLES_BOUND_LATE


@pytest.mark.parametrize(
    ("source", "module"),
    [
        ('x = import_module("ambkit.result.card")', "ambkit.result.card"),
        ('a = "result.card:image"', "ambkit.result.card"),
        ('import_module(f"ambkit.estimate.{m}"); a = "kalman.KalmanFilter"',
         "ambkit.estimate.kalman"),
    ],
)  # fmt: skip
def test_strings_are_seen(graph, source, module):
    """The check finds what hid from it."""
    assert named(source, set(graph.modules)) == {module}
