"""Results that are no table of rows: a text, or a sentence with its data."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ambkit.base import escaping, files
from ambkit.result.result import Result, plain


@dataclass(frozen=True)
class Document:
    """A text, and what it says as data."""

    text: str  #: What is printed and written.
    data: Any  #: The same for machines.
    notes: Sequence[str] = ()  #: What is wrong, or still to be done.
    exit_code: int = 0  #: Of a command.

    def __str__(self) -> str:
        return self.text

    def to_dict(self) -> Any:
        """Return it as plain data."""
        return self.data

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the text to a file."""
        files.write_text(path, self.text)


def json_document(data: Any) -> Document:
    """Return data as a document in JSON."""
    text = escaping.json_text(plain(data), indent=2, allow_nan=False)
    return Document(f"{text}\n", data)


@dataclass(frozen=True, repr=False)
class Statement(Result):
    """One sentence, and its data."""

    finding: str = ""  #: The sentence.
    data: Mapping[str, Any] = field(default_factory=dict)  #: In SI.

    rows = ()
    TITLE = "{0.finding}"

    @property
    def series(self) -> Mapping[str, Any]:
        return self.data
