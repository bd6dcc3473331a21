"""Long work in stages, each written down, so that nothing is made twice."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ambkit.base import escaping, files
from ambkit.base.errors import AmbkitError

STATE = "design.json"
"""What was made from what, in the folder of a design."""


class Stages:
    """What was made from what in a folder, so that nothing is made twice."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        path = folder / STATE
        self.known: dict[str, Any] = read_json(path) if path.exists() else {}

    def make(
        self, name: str, made_from: Sequence[Any], written: Sequence[str], make: Callable[[], None]
    ) -> None:
        """Run a stage, unless its files are there and are what they were made into."""
        text = escaping.json_text([version("ambkit"), *made_from])
        key = hashlib.sha256(text.encode()).hexdigest()
        before = self.known.get(name, {})
        if before.get("from") == key and all(
            (self.folder / file).exists() and files.sha256(self.folder / file) == hashed
            for file, hashed in before.get("files", {}).items()
        ):
            return
        make()
        made = {file: files.sha256(self.folder / file) for file in written}
        self.known[name] = {"from": key, "files": made}
        write_json(self.folder / STATE, self.known)


def write_json(path: Path, data: Any) -> None:
    """Write plain data as JSON, through a temporary file."""
    files.write_text(path, escaping.json_text(data, indent=1) + "\n")


def read_json(path: Path) -> Any:
    """Read what `write_json` wrote."""
    try:
        return json.loads(files.read_text(path))
    except json.JSONDecodeError as error:
        raise AmbkitError(f"{path}:{error.lineno}: is not what ambkit wrote; remove it") from None
