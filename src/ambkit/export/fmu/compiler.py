"""The binary of an FMU for this platform, made with the system's C compiler."""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.export.fmu.xml import COMPILER_OPTIONS, Fmi

_NAMES = ("cc", "gcc", "clang")
_FLAGS = ("-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-s")  # -s: nothing of this machine
_STRICT = ("-Wl,-z,defs",)  # what is missing is told here, not where the FMU is loaded


class _Platform(NamedTuple):
    """How FMI calls a platform, and the ending of its libraries."""

    fmi_2: str
    fmi_3: str
    ending: str


_PLATFORMS = {
    ("linux", "x86_64"): _Platform("linux64", "x86_64-linux", ".so"),
    ("linux", "aarch64"): _Platform("aarch64-linux", "aarch64-linux", ".so"),
    ("darwin", "x86_64"): _Platform("darwin64", "x86_64-darwin", ".dylib"),
    ("darwin", "arm64"): _Platform("aarch64-darwin", "aarch64-darwin", ".dylib"),
}


def place(identifier: str, fmi: Fmi) -> str:
    """Return where the binary belongs in an FMU.

    Raises
    ------
    AmbkitError
        Not on this platform.
    """
    here = _PLATFORMS.get((sys.platform, platform.machine()))
    if here is None:
        raise AmbkitError(
            f"an FMU is compiled on Linux and macOS only, this is {sys.platform} on "
            f"{platform.machine()}"
        )
    return f"binaries/{here.fmi_2 if fmi == 2 else here.fmi_3}/{identifier}{here.ending}"


def compiled(texts: Mapping[str, str], sources: Sequence[str]) -> bytes:
    """Compile a shared library; the same compiler makes the same bytes.

    Parameters
    ----------
    texts : mapping
        All files by their names, relative to one folder, which is the include folder too.
    sources : sequence of str
        Those that are compiled.

    Raises
    ------
    AmbkitError
        There is no compiler, or it fails.
    """
    compiler = _compiler()
    with TemporaryDirectory() as made:
        for name, text in texts.items():
            files.make_folder(Path(made, name).parent)
            files.write_text(Path(made, name), text)
        flags = [*COMPILER_OPTIONS.split(), *_FLAGS, *(_STRICT if sys.platform == "linux" else ())]
        command = [*compiler, *flags, "-I.", *sources, "-o", "binary"]
        done = subprocess.run(
            command, cwd=made, capture_output=True, text=True, errors="replace", check=False
        )
        if done.returncode != 0:
            raise AmbkitError(f"{shlex.join(compiler)} cannot compile the FMU:\n{done.stderr}")
        return Path(made, "binary").read_bytes()


def _compiler() -> list[str]:
    """Return the command in the variable CC, or else the first compiler that is there."""
    given = os.environ.get("CC", "")
    try:
        chosen = shlex.split(given)
    except ValueError as error:
        raise AmbkitError(f"the environment variable CC, {given}, is no command: {error}") from None
    names = [chosen[0]] if chosen else list(_NAMES)
    for name in names:
        if shutil.which(name):
            return chosen or [name]
    raise AmbkitError(
        f"there is no C compiler ({', '.join(names)}), which an FMU needs; install one, or name it "
        "in the environment variable CC"
    )
