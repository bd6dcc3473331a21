"""TOML as text: its values, and the line of each key."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tree_sitter import Node

Path = tuple[str | int, ...]

_PLACE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")
_BARE_VALUE = re.compile(
    r"""(?P<start> \s* [\w.-]+ \s* = \s*)
        (?P<value> [^"'\#\[\]{}=]* [^"'\#\[\]{}=\s])""",
    re.VERBOSE,
)
_SHOWN = 120  # characters of a line in a message
_DEEPEST = 64  # maximum number of names in a key
_DEEP_KEY = re.compile(
    rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_DEEPEST}}}[\w"'-]"""
)
_TABLE = re.compile(r"\s*\[+\s*([^\]#]*?)\s*\]")


@dataclass
class TomlText:
    """Content of a TOML text."""

    data: dict[str, Any] | None = None  #: The values; None if the syntax leaves the meaning open.
    lines: dict[Path, int] = field(default_factory=dict)  #: Line, from 1, of each key.
    problems: list[tuple[int, str]] = field(default_factory=list)  #: Line and error.

    def line(self, path: Path) -> int:
        """Return the line of `path`, or of the nearest table around it that is in the file."""
        while path:
            for written in (path, (*path, 0)):  # an array of tables begins with its first
                if written in self.lines:
                    return self.lines[written]
            path = path[:-1]
        return 1


def parse(text: str) -> TomlText:
    """Parse TOML, and continue after each error whose correction is clear."""
    # Such as a value without quotes (``air_gap = 2 mm``), or a duplicate key: all errors are
    # reported at once.
    result = TomlText()
    lines = text.split("\n")
    if deep := _DEEP_KEY.search(text):
        at = text.count("\n", 0, deep.start()) + 1
        result.problems.append((at, f"a key of more than {_DEEPEST} names; is it text?"))
        return result
    try:
        _read(lines, result)
        if result.data is not None:
            result.lines.update(_key_lines("\n".join(lines)))
    except RecursionError:
        result.data = None
        brackets = [line.count("[") + line.count("{") for line in lines]
        result.problems.append((brackets.index(max(brackets)) + 1, "is nested too deeply"))
    return result


def _read(lines: list[str], result: TomlText) -> None:
    """Parse the values, with each error recorded and corrected in `lines`."""
    # After a corrected line, only the following lines are parsed, until they are valid: thousands
    # of errors take linear time. Errors of the complete text, such as duplicate keys, are reported
    # last.
    done = 0  # lines that need not be parsed again
    while result.data is None:
        try:
            data = _loads("\n".join(lines[done:]))
        except tomllib.TOMLDecodeError as error:
            place, message = _PLACE.search(str(error)), _PLACE.sub("", str(error))
            at = done + int(place[1]) if place and place[1] else len(lines)
            mended, advice = _repaired(lines[at - 1], message)
            if mended:
                result.problems.append((at, advice))
                lines[at - 1], done = mended, at
            elif done:  # the error may begin above
                done = 0
            elif mended is not None:
                result.problems += _drop_duplicates(lines) or [(at, advice)]
                lines[at - 1] = mended
            else:
                result.problems.append((at, advice))
                return
        else:
            if done == 0:
                result.data = data
            done = 0


def _loads(text: str) -> dict[str, Any]:
    """Parse TOML; an integer with too many digits for Python is an ordinary error."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:
        digits = sys.get_int_max_str_digits()
        runs = re.finditer(r"[\d_]+", text)
        long = (run.start() for run in runs if len(run[0].replace("_", "")) > digits)
        at = text.count("\n", 0, next(long, 0)) + 1
        raise tomllib.TOMLDecodeError(
            f"an integer has more than {digits} digits (at line {at}, column 1)"
        ) from None


def _drop_duplicates(lines: list[str]) -> list[tuple[int, str]]:
    """Remove each line whose key is a duplicate in its table, and report it."""
    problems: list[tuple[int, str]] = []
    seen: set[Path] = set()
    for path, at in list(_key_lines("\n".join(lines))):
        if path in seen and not _TABLE.match(lines[at - 1]) and _is_complete(lines[at - 1]):
            key = lines[at - 1].partition("=")[0].strip()
            problems.append((at, f"{key}: is written twice in this table"))
            lines[at - 1] = ""
        seen.add(path)
    return problems


def _repaired(line: str, message: str) -> tuple[str | None, str]:
    """Return the line as probably intended, or None if unclear; and the message."""
    key = line.partition("=")[0].strip()
    if message.startswith("an integer"):
        return None, f"{key:.{_SHOWN}}: {message}"
    bare = _BARE_VALUE.match(line)
    if bare and not _is_complete(line):
        value = bare["value"]
        meant = value.lower() if value.lower() in ("true", "false") else f'"{value}"'
        mended = f"{bare['start']}{meant}{line[bare.end() :]}"
        if _is_complete(mended):
            quotes = "" if meant == value.lower() else " in quotes"
            return mended, f"{key}: write it{quotes}: {key} = {meant}"
    table = _TABLE.match(line)
    if table and message.startswith("Cannot"):
        return None, f"[{table[1]}] is written twice, or is also a key"
    if message == "Cannot overwrite a value":
        return ("" if _is_complete(line) else None), f"{key}: is written twice in this table"
    excerpt = line.strip() if len(line.strip()) <= _SHOWN else f"{line.strip():.{_SHOWN}}..."
    return None, f"not valid TOML: {message[:1].lower()}{message[1:]}: {excerpt}"


def _is_complete(line: str) -> bool:
    """Return whether the line is valid TOML by itself, so that a change does not affect others."""
    try:
        return bool(_loads(line))
    except tomllib.TOMLDecodeError:
        return False


def _key_lines(text: str) -> Iterator[tuple[Path, int]]:
    import tree_sitter_toml
    from tree_sitter import Language, Parser

    tree = Parser(Language(tree_sitter_toml.language())).parse(text.encode())
    elements: dict[Path, int] = {}  # index of the last element of each array of tables
    for node in tree.root_node.named_children:
        path: Path = ()
        if node.type in ("table", "table_array_element"):
            for name in _key(node.named_children[0]):
                path += (elements[path], name) if path in elements else (name,)
            if node.type == "table_array_element":
                elements[path] = elements.get(path, -1) + 1
                path += (elements[path],)
            elif path in elements:
                path += (elements[path],)
            yield path, node.start_point.row + 1
        yield from _pairs(node, path)


def _pairs(node: Node, path: Path) -> Iterator[tuple[Path, int]]:
    """Yield the paths and lines of all keys and elements in a table, pair, or value."""
    if node.type == "pair":
        key, value = node.named_children[0], node.named_children[-1]
        path += _key(key)
        yield path, key.start_point.row + 1
        yield from _pairs(value, path)
    elif node.type == "array":
        for index, element in enumerate(n for n in node.named_children if n.type != "comment"):
            yield (*path, index), element.start_point.row + 1
            yield from _pairs(element, (*path, index))
    else:
        for child in node.named_children:
            if child.type == "pair":
                yield from _pairs(child, path)


def _key(node: Node) -> tuple[str, ...]:
    """Return the names in a bare, quoted or dotted key."""
    names: list[str] = []
    level: Any = tomllib.loads(f"{(node.text or b'').decode()} = 0")
    while isinstance(level, dict):
        name, level = next(iter(level.items()))
        names.append(name)
    return tuple(names)


_SPACE = re.compile(r"[ \t\n\r,:]*")


def line_of(text: str, path: Sequence[str | int]) -> int:
    """Return the line, from 1, of a value; if it is missing, of its parent."""
    decode = json.JSONDecoder().raw_decode
    at = _next(text, 0)
    for step in path:
        is_object = text[at] == "{"
        if not is_object and text[at] != "[":
            break
        place, here = _next(text, at + 1), 0
        while text[place] not in "}]":
            key: str | int = here
            if is_object:
                key, place = decode(text, place)
                place = _next(text, place)
            if key == step:
                at = place
                break
            _, place = decode(text, place)
            place, here = _next(text, place), here + 1
        else:
            break
    return text.count("\n", 0, at) + 1


def _next(text: str, place: int) -> int:
    """Return where the next value begins, or its container ends."""
    match = _SPACE.match(text, place)
    return match.end() if match else place


def flattened(tree: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return nested tables as one, by dotted keys."""
    result: dict[str, Any] = {}
    for key, value in tree.items():
        name = f"{before}{key}"
        result |= flattened(value, f"{name}.") if isinstance(value, Mapping) else {name: value}
    return result


def nested(pairs: Iterable[tuple[Sequence[str], Any]]) -> dict[str, Any]:
    """Return values by the steps of their keys as nested tables."""
    result: dict[str, Any] = {}
    for (*tables, name), value in pairs:
        at = result
        for table in tables:
            at = at.setdefault(table, {})
        at[name] = value
    return result
