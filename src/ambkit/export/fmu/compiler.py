"""Binary of an FMU for this platform, by the system's C compiler."""

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
_FLAGS = ("-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-s")  # -s: no names of this machine
_STRICT = ("-Wl,-z,defs",)  # missing symbols are reported here, not when the FMU is loaded


class _Platform(NamedTuple):
    """FMI's name of a platform, and the suffix of its libraries."""

    fmi_2: str
    fmi_3: str
    ending: str


_PLATFORMS = {
    ("linux", "x86_64"): _Platform("linux64", "x86_64-linux", ".so"),
    ("linux", "aarch64"): _Platform("aarch64-linux", "aarch64-linux", ".so"),
    ("darwin", "x86_64"): _Platform("darwin64", "x86_64-darwin", ".dylib"),
    ("darwin", "arm64"): _Platform("aarch64-darwin", "aarch64-darwin", ".dylib"),
}


_CROSS = {
    "x86_64-linux-gnu-gcc": _PLATFORMS["linux", "x86_64"],
    "aarch64-linux-gnu-gcc": _PLATFORMS["linux", "aarch64"],
    "x86_64-w64-mingw32-gcc": _Platform("win64", "x86_64-windows", ".dll"),
}
"""Cross compilers by their names in distributions."""


def binaries(
    texts: Mapping[str, str], sources: Sequence[str], identifier: str, fmi: Fmi, *, everywhere: bool
) -> dict[str, bytes]:
    """Compile for this platform, or also for each with a cross compiler."""
    made = {place(identifier, fmi): compiled(texts, sources)}
    for name, target in _CROSS.items() if everywhere else ():
        there = _place(target, identifier, fmi)
        if there not in made and shutil.which(name):
            made[there] = compiled(texts, sources, cross=name)
    return made


def _place(target: _Platform, identifier: str, fmi: Fmi) -> str:
    return f"binaries/{target.fmi_2 if fmi == 2 else target.fmi_3}/{identifier}{target.ending}"


def place(identifier: str, fmi: Fmi) -> str:
    """Return the path of the binary in an FMU."""
    here = _PLATFORMS.get((sys.platform, platform.machine()))
    if here is None:
        raise AmbkitError(
            f"an FMU is compiled on Linux and macOS only, this is {sys.platform} on "
            f"{platform.machine()}"
        )
    return _place(here, identifier, fmi)


def compiled(
    texts: Mapping[str, str], sources: Sequence[str], *, cross: str | None = None
) -> bytes:
    """Compile a shared library, reproducibly."""
    compiler = _compiler() if cross is None else [cross]
    linux = sys.platform == "linux" if cross is None else "linux" in cross
    with TemporaryDirectory() as made:
        for name, text in texts.items():
            files.make_folder(Path(made, name).parent)
            files.write_text(Path(made, name), text)
        flags = [*COMPILER_OPTIONS.split(), *_FLAGS, *(_STRICT if linux else ())]
        # With an explicit suffix: gcc for Windows adds .exe to a name without one.
        command = [*compiler, *flags, "-I.", *sources, "-o", "binary.library"]
        done = subprocess.run(
            command, cwd=made, capture_output=True, text=True, errors="replace", check=False
        )
        if done.returncode != 0:
            raise AmbkitError(f"{shlex.join(compiler)} cannot compile the FMU:\n{done.stderr}")
        return Path(made, "binary.library").read_bytes()


def _compiler() -> list[str]:
    """Return the command in the variable CC, or else the first available compiler."""
    command = os.environ.get("CC", "")
    try:
        chosen = shlex.split(command)
    except ValueError as error:
        raise AmbkitError(
            f"the environment variable CC, {command}, is no command: {error}"
        ) from None
    names = [chosen[0]] if chosen else list(_NAMES)
    for name in names:
        if shutil.which(name):
            return chosen or [name]
    raise AmbkitError(
        f"there is no C compiler ({', '.join(names)}), which an FMU needs; install one, or name it "
        "in the environment variable CC"
    )
