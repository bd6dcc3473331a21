"""Every public name is documented: parameters, shapes and units of arrays, errors, sources."""

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

import ambkit
from ambkit.cli import catalogue
from ambkit.machine.laws import LAWS

SECTIONS = ("Parameters", "Attributes")


def doc_of(thing: Any) -> str:
    """Return its docstring, of a method that has none the one of what it overrides."""
    within, _, own = thing.__qualname__.rpartition(".")
    of = vars(sys.modules[thing.__module__]).get(within)
    return inspect.getdoc(getattr(of, own, thing)) or ""


def sections(doc: str | None) -> dict[str, list[str]]:
    """Return the lines of a docstring by the heading that they stand below; "" is before all."""
    lines = inspect.cleandoc(doc or "").splitlines()
    heading, found = "", dict[str, list[str]]()
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        if below and set(below) == {"-"}:
            heading = line
        elif set(line) != {"-"}:
            found.setdefault(heading, []).append(line)
    return found


HEAD = re.compile(r"(\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: :|$)")
"""Of an entry: the names that it is of."""


def documented(thing: Any) -> set[str]:
    """Return the names in the sections on parameters and attributes of a docstring."""
    of = sections(doc_of(thing))
    heads = [HEAD.match(line) for name in SECTIONS for line in of.get(name, ())]
    return {name.lstrip("*") for head in heads if head for name in head[1].split(", ")}


def public() -> Iterator[tuple[str, Any]]:
    """Yield all public classes and functions, and the public methods of the classes."""
    for name in ambkit.__all__:
        thing = getattr(ambkit, name)
        if not callable(thing):
            continue
        yield name, thing
        for key in dir(thing) if inspect.isclass(thing) else ():
            method = inspect.getattr_static(thing, key)
            function = getattr(method, "__func__", method)
            ours = str(getattr(function, "__module__", "")).startswith("ambkit")
            if inspect.isfunction(function) and ours and not key.startswith("_"):
                yield f"{name}.{key}", function


def raised(function: Callable[..., Any]) -> set[type]:
    """Return the exceptions that a function itself raises, by the names in its text."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    found = set[type]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and node.exc is not None:
            name = ast.unparse(node.exc.func if isinstance(node.exc, ast.Call) else node.exc)
            known = vars(sys.modules[function.__module__]) | vars(sys.modules["builtins"])
            if isinstance(known.get(name), type):
                found.add(known[name])
    return found


def entry(doc: str | None, name: str) -> str:
    """Return what a docstring says of a parameter or attribute, first line and description."""
    lines = inspect.cleandoc(doc or "").splitlines()
    for place, line in enumerate(lines):
        if (head := HEAD.match(line)) and name in head[1].split(", "):
            below = [each.startswith(" ") or not each for each in lines[place + 1 :]] + [False]
            return " ".join(lines[place : place + 1 + below.index(False)])
    return ""


SHAPE = re.compile(r"\((?:n|\w+,[\w ,()/+-]*|[\w +-]+,)\)|shapes? that|broadcast shape")
UNIT = re.compile(r"\[[^\]]+\]|flags of|SI unit|scaled", re.IGNORECASE)
AN_ARRAY = re.compile(
    r"\b(?:Array|ArrayLike|NDArray)\b(?!\[np.bool_)|ndarray(?!\[[\w., ]*bool)|_SupportsArray"
)
"""Of annotations as they are written, and as they are evaluated (numpy.ndarray[...], ArrayLike)."""


def own_function(thing: Any) -> Callable[..., Any] | None:
    """Return what is called, if it is written down: no __init__ of a dataclass or of a parent."""
    function = vars(thing).get("__init__") if inspect.isclass(thing) else thing
    written = inspect.isfunction(function) and function.__code__.co_filename.endswith(".py")
    return function if written and function.__module__.startswith("ambkit") else None


def arrays() -> Iterator[tuple[str, str, str]]:
    """Yield each array of a public name: its name, the array's, and what is said of it."""
    for name, thing in public():
        function = own_function(thing)
        for key, annotation in (function.__annotations__ if function else {}).items():
            if AN_ARRAY.search(str(annotation)):
                of = sections(thing.__doc__)
                told = "\n".join(of.get("Returns") or of.get("", ()))
                yield name, key, told if key == "return" else entry(thing.__doc__, key)
        if not inspect.isclass(thing):
            continue
        if not issubclass(thing, BaseModel):
            for key, annotation in getattr(thing, "__dataclass_fields__", {}).items():
                if AN_ARRAY.search(str(annotation.type)) and "Mapping" not in str(annotation.type):
                    yield name, key, entry(thing.__doc__, key)
        for key, member in inspect.getmembers_static(thing):
            if isinstance(member, property) and not key.startswith("_"):
                annotation = str(inspect.signature(member.fget).return_annotation)
                if AN_ARRAY.search(annotation) and "dict" not in annotation:
                    yield name, key, member.__doc__ or ""


def is_protocol(thing: type) -> bool:
    return bool(getattr(thing, "_is_protocol", False))


def parameters(thing: Callable[..., Any]) -> set[str]:
    """Return the parameters that need words: not self, and no tag that can only be one thing."""
    if inspect.isclass(thing) and issubclass(thing, BaseModel):
        fields = thing.model_fields.items()
        return {
            name
            for name, field in fields
            if not field.description and len(get_args(field.annotation)) != 1
        }
    if inspect.isclass(thing) and ("__init__" not in vars(thing) or is_protocol(thing)):
        return set()  # an enumeration, a protocol, or an error that is only a name
    return set(inspect.signature(thing).parameters) - {"self", "cls"}


PUBLIC = dict(public())


@pytest.mark.parametrize("name", PUBLIC)
def test_every_parameter_is_documented(name):
    thing = PUBLIC[name]
    assert doc_of(thing), f"{name} has no docstring"
    assert parameters(thing) - documented(thing) == set()


ARRAYS = {f"{name}: {key}": told for name, key, told in arrays()}


@pytest.mark.parametrize("array", ARRAYS)
def test_every_array_has_shape_and_unit(array):
    told = ARRAYS[array]
    assert SHAPE.search(told), f"no shape in: {told}"
    assert UNIT.search(told), f"no unit in: {told}"


@pytest.mark.parametrize("name", PUBLIC)
def test_every_error_is_documented(name):
    thing = PUBLIC[name]
    function = own_function(thing)
    told = "\n".join(sections(doc_of(thing)).get("Raises", ()))
    for error in raised(function) if function else ():
        known = {each.__name__ for each in error.__mro__} - {"Exception", "BaseException", "object"}
        assert known & set(re.findall(r"^\w+", told, re.MULTILINE)), f"{error.__name__}: {told}"


@pytest.mark.parametrize("name", [n for n, t in PUBLIC.items() if hasattr(t, "run")])
def test_every_algorithm_has_its_source(name):
    """An equation of the paper, or author and year, in the class or at the head of its module."""
    thing = PUBLIC[name]
    told = f"{thing.__doc__} {sys.modules[thing.__module__].__doc__}"
    assert re.search(r"eq\. ?\d+|\b(?:19|20)\d\d\b", told)


def test_what_is_missing_is_noticed():
    def step(y: float, u: float) -> None:
        """Go on.

        Parameters
        ----------
        y : float
            Measured position [m].
        """

    assert parameters(step) - documented(step) == {"u"}
    assert documented(ambkit.AdaptiveKalmanFilter) == {"machine", "magnet", "options"}
    assert {"innovation", "innovation_variance"} <= documented(ambkit.Estimate)


def internal() -> Iterator[str]:
    """Yield each docstring of several lines of what nobody imports from ambkit, by its place."""
    ours = [thing for thing in map(PUBLIC.get, PUBLIC) if inspect.isclass(thing)]
    exported = {(each.__module__, each.__name__) for one in ours for each in one.__mro__}
    exported |= {(thing.__module__, thing.__qualname__) for thing in PUBLIC.values()}
    others = [*map(catalogue.verb_called, catalogue.VERBS), *LAWS]
    exported |= {(thing.__module__, thing.__qualname__) for thing in others}
    root = Path(ambkit.__file__).parent
    for path in root.rglob("*.py"):
        module = ".".join(["ambkit", *path.relative_to(root).with_suffix("").parts])
        module = module.removesuffix(".__init__")
        for name, node in definitions(ast.parse(path.read_text())):
            within, _, own = name.rpartition(".")
            known = (module, name) in exported or (
                (module, within) in exported and not own.startswith("_")
            )
            if "\n" in (ast.get_docstring(node) or "") and not known:
                yield f"{path.relative_to(root)}:{node.lineno} {name}"


def definitions(node: ast.AST, within: str = "") -> Iterator[tuple[str, Any]]:
    """Yield all classes and functions, by their qualified names."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.ClassDef, ast.FunctionDef)):
            yield within + child.name, child
            yield from definitions(child, f"{within}{child.name}.")
        else:
            yield from definitions(child, within)


def test_what_is_internal_has_one_line():
    assert list(internal()) == []


def undocumented() -> Iterator[str]:
    """Yield each public method without a docstring that overrides none which has one."""
    root, known = Path(ambkit.__file__).parent, dict[str, list[ast.ClassDef]]()
    places: dict[ast.ClassDef, Path] = {}
    for path in root.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                known.setdefault(node.name, []).append(node)
                places[node] = path

    def inherits(of: ast.ClassDef, name: str) -> bool:
        bases = [ast.unparse(base).rpartition(".")[2].partition("[")[0] for base in of.bases]
        parents = [node for base in bases for node in known.get(base, ()) if node is not of]
        return any(
            any(m.name == name and ast.get_docstring(m) for m in methods(node))
            or inherits(node, name)
            for node in parents
        )

    for node, path in places.items():
        for method in methods(node):
            own = method.name.startswith("_") or ast.get_docstring(method)
            if not own and not node.name.startswith("_") and not inherits(node, method.name):
                yield f"{path.relative_to(root)}:{method.lineno} {node.name}.{method.name}"


def methods(of: ast.ClassDef) -> list[ast.FunctionDef]:
    return [item for item in of.body if isinstance(item, ast.FunctionDef)]


def test_a_method_has_a_docstring_or_overrides_one_that_has():
    assert list(undocumented()) == []
