"""Writing files so that nobody ever sees half of one."""

import os
import tempfile
from pathlib import Path

from ambkit.errors import AmbkitError


def replace_file(path: Path, content: bytes) -> Path:
    """Write a file beside its place, then put it there in one step.

    Parameters
    ----------
    path : Path
        The file; its folder is made if it is not there.
    content : bytes
        All of it.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    AmbkitError
        If the folder or the file cannot be written; whatever was there before stays.
    """
    temporary = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as problem:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise AmbkitError(f"cannot write {path}: {problem.strerror}") from problem
    return path


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
