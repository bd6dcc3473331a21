"""Pydantic types for names and descriptions: what may stand in them, and how long they may be."""

import re
from typing import Annotated

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from ambkit.base.escaping import one_line

LONGEST_NAME = 80
"""Characters of a name: it stands in headings, legends and comments of one line."""
LONGEST_LINE = 1000
LONGEST_DESCRIPTION = 10_000

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")  # all but tab and line feed


def _printable(text: str) -> str:
    if one_line(text) != text:
        raise _wrong("must be one line of printable characters", text)
    return text


def _readable(text: str) -> str:
    if _CONTROL.search(text):
        raise _wrong("must be text without control characters", text)
    return text


def _wrong(limit: str, text: str) -> PydanticCustomError:
    excerpt = one_line(text)
    excerpt = excerpt if len(excerpt) <= 60 else f"{excerpt[:57]}..."
    return PydanticCustomError("problem", "{text}", {"text": f'{limit}, is "{excerpt}"'})


Line = Annotated[str, Field(max_length=LONGEST_LINE), AfterValidator(_printable)]
"""A text of one line, such as the name of an array in somebody's file."""
Name = Annotated[str, Field(max_length=LONGEST_NAME), AfterValidator(_printable)]
"""A name."""
Description = Annotated[str, Field(max_length=LONGEST_DESCRIPTION), AfterValidator(_readable)]
"""A text for people, which may have several lines; who prints it escapes it."""
