"""Reading and writing of files, atomically and with clear errors."""

import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType

from ambkit.base import memory_limit
from ambkit.base.errors import AmbkitError

DOCUMENT_SHARE = 100  #: Memory to read a document, over the size of the file: a pipe may never end.


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary file beside `path`, which replaces `path` at the end."""
    # If the body of the ``with`` fails, the temporary file is removed and `path` is unchanged.
    path, final = Path(path), Path(os.path.realpath(path))  # a link stays a link
    special = final.exists() and not (final.is_file() or final.is_dir())  # a pipe or a device
    folder = Path(tempfile.gettempdir()) if special else final.parent
    temporary = folder / f".{final.name}.{os.getpid()}.tmp"
    try:
        yield temporary
        if special:
            with temporary.open("rb") as source, final.open("wb") as target:
                shutil.copyfileobj(source, target)
        else:
            os.replace(temporary, final)
    except OSError as error:
        raise AmbkitError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):  # replaced above, or never made
            temporary.unlink()


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write UTF-8 text through a temporary file (see `replacing`)."""
    write_bytes(path, text.encode())


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file through a temporary file (see `replacing`)."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def sha256(path: str | os.PathLike[str]) -> str:
    """Return the hash of a file, in hexadecimal digits."""
    try:
        return hashlib.sha256(memory_limit.read_bytes(path)).hexdigest()
    except OSError as error:
        raise AmbkitError(f"{path}: cannot be read: {error.strerror or error}") from None


def make_folder(path: str | os.PathLike[str]) -> Path:
    """Create a folder with its parents, if it does not exist."""
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise AmbkitError(f"{path}: cannot be made: {error.strerror or error}") from error
    return Path(path)


@contextmanager
def replacing_in(path: str | os.PathLike[str], first: str = "") -> Iterator[Path]:
    """Yield a temporary folder, whose files are moved into `path` at the end."""
    # If the body of the ``with`` fails, as on a full disk, `path` is unchanged, or not created.
    path = Path(path)
    new = [entry for entry in (path, *path.parents) if not entry.exists()]
    temporary = path / f".{os.getpid()}.tmp"
    try:
        make_folder(path)
        temporary.mkdir()
        yield temporary
        made = sorted(entry for entry in temporary.rglob("*") if entry.is_file())
        for file in sorted(made, key=lambda element: element.name != first):
            place = path / file.relative_to(temporary)
            place.parent.mkdir(parents=True, exist_ok=True)
            with replacing(place) as beside:
                shutil.move(file, beside)
    except OSError as error:
        raise AmbkitError(f"{path}: cannot be written: {error.strerror or error}") from error
    except AmbkitError as error:  # of a file in it: reported at its destination
        raise AmbkitError(str(error).replace(str(temporary), str(path))) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        for item in new:
            with suppress(OSError):  # it contains what was written
                item.rmdir()


def read_text(path: str | os.PathLike[str]) -> str:
    """Read UTF-8 text."""
    try:
        text = memory_limit.read_bytes(path, DOCUMENT_SHARE).decode("utf-8-sig")
        return text.replace("\r\n", "\n").replace("\r", "\n")
    except OSError as error:
        raise AmbkitError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise AmbkitError(f"{path}: is not UTF-8 text (byte {error.start})") from error


_PACKAGE = Path(__file__).parents[1]


def installed_folder(name: str, source: str) -> Path:
    """Return a folder beside the package, or at its place in the repository."""
    for candidate in (_PACKAGE / name, _PACKAGE.parents[1] / source):
        if candidate.is_dir():
            return candidate
    raise AmbkitError(f"a folder that comes with ambkit is not there: {_PACKAGE / name}")


def module_beside(folder: str, name: str) -> ModuleType:
    """Import a module of a folder that comes with ambkit outside the package."""
    place = str(installed_folder(folder, folder))
    if place not in sys.path:
        sys.path.insert(0, place)
    return import_module(name)
