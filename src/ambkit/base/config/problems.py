"""Errors of a description, in the user's terms instead of pydantic's."""

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import InitErrorDetails, PydanticCustomError

from ambkit.base import units
from ambkit.base.config.quantities import Quantity
from ambkit.base.config.toml_text import Path
from ambkit.base.escaping import json_text, one_line

ONE_OR_MORE = ("[one]", "[list]")  #: Pydantic's tags of a table or a list of tables; not in files.


class Problem(NamedTuple):
    """One error in a description."""

    path: Path
    text: str
    value: Any = None
    missing: bool = False
    meant: Path | None = None  #: Probably intended key, if it is unknown.

    @classmethod
    def unpack(cls, error: ValidationError) -> "list[Problem]":
        """Extract the problems from pydantic's error."""
        return [cls.of(e) for e in error.errors(include_url=False)]

    @classmethod
    def of(cls, error: Mapping[str, Any]) -> "Problem":
        """Convert one of pydantic's errors."""
        own = {k: v for k, v in error.get("ctx", {}).items() if k in ("missing", "meant")}
        path = tuple(step for step in error["loc"] if step not in ONE_OR_MORE)
        return cls(path, error["msg"], error["input"], **own)

    def pack(self) -> InitErrorDetails:
        """Pack the problem so that pydantic carries it to the outermost model."""
        context = {"text": self.text, "missing": self.missing, "meant": self.meant}
        error = PydanticCustomError("problem", "{text}", context)
        return InitErrorDetails(type=error, loc=self.path, input=self.value)


@cache
def names_of(model: type[BaseModel]) -> dict[str, str]:
    """Return the names of a model's fields by their keys in files."""
    return {field.alias or name: name for name, field in model.model_fields.items()}


@cache
def fields_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a model by their keys in files."""
    return {key: model.model_fields[name] for key, name in names_of(model).items()}


def in_words(model: type[BaseModel], error: Mapping[str, Any]) -> Problem:
    """Return pydantic's error in `model` in words, with the model's description of its keys."""
    problem, context = Problem.of(error), error.get("ctx", {})
    path, value = problem.path, problem.value
    match error["type"]:
        case "problem":
            return _find_home(model, problem)
        case "extra_forbidden":
            return _unknown(model, problem)
        case "missing":
            purpose = _description(fields_of(model)[str(path[-1])])
            return problem._replace(text=f"missing{purpose}", missing=True)
        case "union_tag_not_found":
            text = f"missing: {_one_of(_kinds(fields_of(model)[str(path[0])].annotation))}"
            return problem._replace(path=(*path, "type"), text=text)
        case "union_tag_invalid":
            text = _choice(context["tag"], context["expected_tags"])
            return problem._replace(path=(*path, "type"), text=text)
        case "literal_error":
            return problem._replace(text=_choice(value, context["expected"]))
        case "model_type" | "model_attributes_type":
            return problem._replace(text=no_table(value))
        case "tuple_type" | "list_type" if isinstance(value, dict) or _of_tables(model, path):
            text = "must be a list of tables, each written in double brackets: [[...]]"
            return problem._replace(text=text)
    text = re.sub(r"^\w+ should", "must", problem.text)
    return problem._replace(text=f"{text}, is {_shown(value)}")


def _unknown(model: type[BaseModel], problem: Problem) -> Problem:
    """Return the table to which an unknown key belongs, or the nearest key of the same table."""
    *around, name = problem.path
    keys = list(fields_of(model))
    meant = (*around, nearest(str(name), keys) or "")
    return _find_home(model, problem._replace(text=unknown_key(str(name), keys), meant=meant))


def unknown_key(name: str, keys: Iterable[str]) -> str:
    """Return the message for an unknown key, with the nearest known one."""
    near = nearest(name, list(keys))
    return "unknown key, " + (
        f"did you mean {near}?" if near else f"known here: {', '.join(keys) or 'none'}"
    )


def _of_tables(model: type[BaseModel], path: Path) -> bool:
    """Return whether a key of `model` is a list of tables."""
    field = fields_of(model).get(str(path[-1]))
    inner = get_args(field.annotation)[:1] if field else ()
    return any(isinstance(item, type) and issubclass(item, BaseModel) for item in inner)


def nearest(name: str, keys: Sequence[str]) -> str | None:
    """Return the key with the most similar spelling, or the only one with a common word."""
    near = difflib.get_close_matches(name, keys, 1, cutoff=0.65)
    words = set(name.split("_"))
    akin = [key for key in keys if words & set(key.split("_"))]
    return near[0] if near else akin[0] if len(akin) == 1 else None


def _find_home(model: type[BaseModel], problem: Problem) -> Problem:
    """Return in which other table of `model` an unknown key is known."""
    if problem.meant is None or len(problem.path) > 2:
        return problem
    return with_home(problem, _tables(model))


def with_home(problem: Problem, tables: Iterable[tuple[str, Iterable[str]]]) -> Problem:
    """Name the table of a file with an unknown key; "" is the part above the first."""
    name = str(problem.path[-1])
    for table, keys in tables:
        if name in keys:
            home = f"to [{table}]" if table else "above the first [table]"
            meant = (table, name) if table else (name,)
            return problem._replace(text=f"unknown key here, it belongs {home}", meant=meant)
    return problem


def _tables(model: type[BaseModel]) -> Iterator[tuple[str, list[str]]]:
    yield "", list(fields_of(model))
    for name, field in fields_of(model).items():
        kinds = [(get_args(item) or (item,))[0] for item in get_args(field.annotation)]
        for kind in (field.annotation, *kinds):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield name, list(fields_of(kind))


def table_of(model: type[BaseModel]) -> str:
    """Return the keys of a table, required ones first."""
    fields = fields_of(model).items()
    required, optional = (
        ", ".join(name for name, field in fields if field.is_required() == requirement)
        for requirement in (True, False)
    )
    return "a table with " + "; optional ".join(filter(None, (required, optional)))


def _description(field: FieldInfo) -> str:
    """Return the purpose of a key, with an example."""
    if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
        return f": {table_of(field.annotation)}"
    about = " ".join((field.description or "").split()).rstrip(".")
    about = f": {about[:1].lower()}{about[1:]}" if about else ""
    quantity = expected_quantity(field)
    return f"{about}, such as {quantity.shown_example()}" if quantity else about


def expected_quantity(field: FieldInfo) -> Quantity | None:
    """Return the annotation of a key for a value with a unit, or a list of them."""
    return _find_quantity((field.annotation, *field.metadata))


_NAMES = ("name", "description", "source")  #: Fields with the name of a description.


def settings_of(part: Any, text: Callable[..., str] = units.figure) -> Iterator[str]:
    """Yield the values of a part that differ from the defaults."""
    for name, field in type(part).model_fields.items():
        value, quantity = getattr(part, name), expected_quantity(field)
        words = (field.alias or name).replace("_", " ")
        if value is None or (value == field.default and not field.is_required()):
            continue
        if quantity and isinstance(value, float):
            yield f"{words} {text(value, quantity.unit, 4)}"
        elif isinstance(value, tuple) and value:
            yield f"{len(value)} {words}{'s' * (len(value) > 1 and words[-1] != 's')}"
        elif isinstance(value, str) and value and name not in _NAMES:
            yield value if name == "type" else f"{words} {value}"


def _find_quantity(annotations: Iterable[Any]) -> Quantity | None:
    for annotation in annotations:
        if isinstance(annotation, Quantity):
            return annotation
        result = _find_quantity((*getattr(annotation, "__metadata__", ()), *get_args(annotation)))
        if result:
            return result
    return None


SAME = {"axial": "thrust", "thrust": "axial"}
"""A bearing along the shaft is a thrust bearing, a sensor along it is axial."""


def _choice(value: Any, allowed: str) -> str:
    """Return the allowed words; `allowed` is pydantic's list in single quotes."""
    words = re.findall("'([^']*)'", allowed)
    same = [SAME[value]] if value in SAME and SAME[value] in words else []
    near = same or difflib.get_close_matches(str(value), words, 1)
    text = f"must be {_one_of(words)}, is {_shown(value)}"
    return text + (f"; did you mean {_shown(near[0])}?" if near else "")


def _one_of(words: list[str]) -> str:
    labels = [_shown(word) for word in words]
    return " or ".join(labels) if len(labels) < 3 else f"one of {', '.join(labels)}"


def _kinds(annotation: Any) -> list[str]:
    """Return the names of all models in an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        own = annotation.model_fields.get("type")
        return [] if own is None else [own.default]
    return [kind for inner in get_args(annotation) for kind in _kinds(inner)]


def no_table(value: Any) -> str:
    """Return that a value is not a table."""
    return f"must be a table, is {_shown(value)}"


def _shown(value: Any) -> str:
    text = json_text(value, default=repr)
    return text if len(text) <= 60 else f"{text[:57]}..."


def located(error: ValidationError, data: Any) -> Iterator[tuple[Path, str]]:
    """Yield the place of each problem in `data`, and its text with the key."""
    for problem in Problem.unpack(error):
        path = without_tags(problem.path, data)
        yield path, f"{dotted(path)}: {problem.text}"


def without_tags(path: Path, data: Any) -> Path:
    """Return the path in `data`, without pydantic's type names of signals."""
    results: list[str | int] = []
    for place, step in enumerate(path):
        inside = isinstance(data, dict) and step in data
        inside = inside or (isinstance(data, list | tuple) and isinstance(step, int))
        if inside:
            data = data[step]
        elif place < len(path) - 1:
            continue
        results.append(step)
    return tuple(results)


def dotted(path: Path) -> str:
    """Format a path: ``rotor.mass``, ``reference.times[2]``."""
    text = "".join(
        f"[{step}]" if isinstance(step, int) else f".{one_line(step)}"
        for step in path
        if step != "[key]"  # pydantic's word for an error of the key itself
    )
    return text.removeprefix(".")
