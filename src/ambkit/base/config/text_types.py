"""Pydantic types for names and descriptions: permitted characters and length."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainSerializer,
    SerializationInfo,
    ValidationInfo,
)
from pydantic_core import PydanticCustomError

from ambkit.base.escaping import one_line


def from_folder(value: Any, info: ValidationInfo) -> Any:
    """Resolve a relative name from the folder of the description."""
    folder = (info.context or {}).get("folder")
    if folder is not None and isinstance(value, str):
        return str(Path(folder, value).absolute())
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def to_folder(value: str, info: SerializationInfo) -> str:
    """Return the name relative to the description's destination, so that both can be moved."""
    folder = (info.context or {}).get("folder")
    if folder is None:
        return value
    try:
        return Path(os.path.relpath(value, folder)).as_posix()
    except ValueError:  # on Windows, another drive
        return str(Path(value).absolute())


FilePath = Annotated[str, BeforeValidator(from_folder), PlainSerializer(to_folder)]
"""Name of a file."""


#: Maximum length of a name: it appears in headings, legends and comments of one line.
LONGEST_NAME = 80
LONGEST_LINE = 1000
LONGEST_DESCRIPTION = 10_000

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")  # all but tab and line feed


def _refusing(wrong: Callable[[str], object], limit: str) -> AfterValidator:
    def checked(text: str) -> str:
        if wrong(text):
            excerpt = one_line(text)
            excerpt = excerpt if len(excerpt) <= 60 else f"{excerpt[:57]}..."
            problem = f'must be {limit}, is "{excerpt}"'
            raise PydanticCustomError("problem", "{text}", {"text": problem})
        return text

    return AfterValidator(checked)


_printable = _refusing(lambda text: one_line(text) != text, "one line of printable characters")
_readable = _refusing(_CONTROL.search, "text without control characters")
Line = Annotated[str, Field(max_length=LONGEST_LINE), _printable]
"""A text of one line, such as the name of an array in a file."""
Name = Annotated[str, Field(max_length=LONGEST_NAME), _printable]  #: A name.
Description = Annotated[str, Field(max_length=LONGEST_DESCRIPTION), _readable]
"""A text with several lines; it is escaped when it is printed."""
