"""Names of files in descriptions, in TOML as seen from where the description lies."""

import os
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, PlainSerializer, SerializationInfo, ValidationInfo


def from_folder(value: Any, info: ValidationInfo) -> Any:
    """Take a relative name from where the description lies."""
    folder = (info.context or {}).get("folder")
    if folder is not None and isinstance(value, str):
        return str(Path(folder, value).absolute())
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def to_folder(value: str, info: SerializationInfo) -> str:
    """Write the name as seen from where the description will lie, so that both can move."""
    folder = (info.context or {}).get("folder")
    if folder is None:
        return value
    try:
        return Path(os.path.relpath(value, folder)).as_posix()
    except ValueError:  # on Windows, another drive
        return str(Path(value).absolute())


FilePath = Annotated[str, BeforeValidator(from_folder), PlainSerializer(to_folder)]
"""The name of a file."""
