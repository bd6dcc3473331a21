"""Escaping of foreign text (names, descriptions, paths) for every output.

Templates use these functions as filters (`FILTERS`); Jinja escapes HTML, a library writes XML.
"""

import json
import re
import unicodedata
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import tomli_w

_TOUCHING = re.compile(r"(?<=/)(?=[*/])|(?<=\*)(?=/)|(?<=\?)(?=\?)")
_MARKDOWN = re.compile(r"[\\`*_{}\[\]<>&|~$#!:@]|^(?:[-+=]|\d+(?=[.)](?:\s|$)))")


def one_line(text: object) -> str:
    r"""Return what cannot be printed as an escape, ``\x1b``, and a line's end as ``\n``."""
    # These are control characters, which move a terminal's cursor and are invalid in XML; marks
    # that reverse the direction of writing; zero-width characters; and halves of surrogate pairs,
    # which no file accepts.
    return _escaped(str(text), lambda char: char.encode("unicode_escape").decode())


def lines(text: object) -> str:
    """Escape a text of several lines for a terminal."""
    return "\n".join(map(one_line, str(text).split("\n")))


def _escaped(text: str, escape: Callable[[str], str]) -> str:
    if text.isprintable():
        return text
    # Spaces (Zs) are not "printable", but harmless.
    return "".join(
        char if char.isprintable() or unicodedata.category(char) == "Zs" else escape(char)
        for char in text
    )


def c_comment(text: object) -> str:
    """Escape a text for a C comment (MISRA C:2012): it neither opens nor closes one."""
    # Trigraphs are separated too: one of them is a backslash, which would join two lines.
    return _TOUCHING.sub(" ", one_line(text))


def markdown(text: object) -> str:
    """Escape a text for a paragraph of Markdown: no link, picture, formula, HTML or emphasis."""
    return _MARKDOWN.sub(  # "1." begins a list, "1\." does not
        lambda match: f"{match[0]}\\" if match[0].isdigit() else f"\\{match[0]}",
        one_line(text).strip(),
    )


def label(text: object) -> str:
    """Write a text within a label of a figure, where dollar signs stand around formulas."""
    return one_line(text).replace("$", r"\$")


def json_text(data: Any, **options: Any) -> str:
    r"""Write JSON that a terminal shows and does nothing else: what is not printable is ``\u``."""
    written = json.dumps(data, ensure_ascii=False, **options)
    return "\n".join(
        _escaped(line, lambda char: json.dumps(char)[1:-1]) for line in written.split("\n")
    )


def toml_text(data: Mapping[str, Any]) -> str:
    r"""Write TOML that a terminal shows and does nothing else: what is not printable is ``\U``."""
    written = tomli_w.dumps(data).replace("\t", "\\t")  # TOML lets a tab stand as it is
    return "\n".join(_escaped(line, _in_toml) for line in written.split("\n"))


def toml_string(text: str) -> str:
    r"""Write a string of TOML in one printable line; its escapes are JSON's, and ``\U``."""
    return _escaped(json.dumps(text, ensure_ascii=False), _in_toml)


def _in_toml(char: str) -> str:
    return f"\\U{ord(char):08X}"


FILTERS = {"one_line": one_line, "c_comment": c_comment, "markdown": markdown}
"""For templates; ``one_line`` is all that a comment to the line's end needs, as in CMake."""


@cache
def templates(folder: Path, *, autoescape: bool = False) -> Any:
    """Return the Jinja templates of a folder; HTML escapes by itself, what else passes a filter."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(folder), undefined=StrictUndefined, autoescape=autoescape,
        keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= FILTERS
    return environment
