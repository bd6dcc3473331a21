"""C that tests compile again and again: the same text is compiled once, whoever compiles it.

`run` stands in for `subprocess.run` in all tests (conftest.py). The texts of a file and of all that
it includes name its object, together with the compiler and its options, much as in ccache. The
objects lie in pytest's cache: workers share them, and a second call of the tests has them too.
"""

import functools
import hashlib
import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / ".pytest_cache" / "objects"
WEEK = 7 * 24 * 3600.0  # after which an object that nothing asked for goes

COMPILER = re.compile(r"([\w-]+-)?(cc|gcc|g\+\+|c\+\+|clang|clang\+\+)(-\d+)?")
SOURCE = (".c", ".cpp")
# Options of linking alone, and what makes something else of a source than an object of its text.
LINKING = re.compile(r"-shared|-static|-s|-Wl,.*|-l.+|-L.+|-nostdlib|-r")
OTHER = re.compile(
    r"-E|-S|-M.*|-fsyntax-only|--coverage|-include|-x|-save-temps.*|-fstack-usage|-fcallgraph-info.*|@.*"
)

plain_run = subprocess.run

Done = subprocess.CompletedProcess[Any]


def run(command: Any, **options: Any) -> Done:
    """Run a command as `subprocess.run` does; a compiler takes the objects that were made before.

    What warns or fails is not kept, and compiled as it was asked for.
    """
    words = [str(word) for word in command] if isinstance(command, list | tuple) else []
    if not words or not COMPILER.fullmatch(Path(words[0]).name) or "env" in options:
        return plain_run(command, **options)
    sources = [word for word in words[1:] if word.endswith(SOURCE)]
    if not sources or any(OTHER.fullmatch(word) for word in words):
        return plain_run(command, **options)
    cwd = Path(options.get("cwd") or ".")
    out = words.index("-o") if "-o" in words else len(words)
    flags = [word for word in [*words[:out], *words[out + 2 :]] if word not in (*sources, "-c")]
    compiling = [word for word in flags if not LINKING.fullmatch(word) and not _input(word)]
    found = {}
    for source in sources:
        if (kept := _object(compiling, source, cwd)) is None:
            return plain_run(command, **options)
        found[source] = str(kept)
    if "-c" not in words:
        return plain_run([found.get(word, word) for word in words], **options)
    for source, kept in found.items():
        to = words[out + 1] if out < len(words) else f"{Path(source).stem}.o"
        shutil.copyfile(kept, cwd / to)
    text = options.get("text") or options.get("encoding")
    silence = ("" if text else b"") if options.get("capture_output") else None
    return Done(command, 0, silence, silence)


def _input(word: str) -> bool:
    return word.endswith((".o", ".a", ".so"))


def _object(command: Sequence[str], source: str, cwd: Path) -> Path | None:
    """Return the object of a source, or nothing where compiling fails or warns."""
    folders = [cwd / word.removeprefix("-I") for word in command if word.startswith("-I")]
    options = (word for word in command[1:] if not word.startswith("-I"))
    try:
        words = [_identity(command[0]), *options, *texts(cwd / source, folders)]
    except OSError:
        return None
    kept = (
        _folder()
        / f"{hashlib.sha256(chr(0).join(words).encode(errors='surrogateescape')).hexdigest()}.o"
    )
    if kept.exists():
        with suppress(OSError):
            os.utime(kept)
        return kept
    # Others may do the same now: each writes a file of its own, and the last puts it in place.
    temporary = kept.with_suffix(f".{os.getpid()}.o")
    compiling = [*command, "-c", source, "-o", str(temporary)]
    done = plain_run(compiling, cwd=cwd, capture_output=True, timeout=300)
    if done.returncode or done.stderr:
        temporary.unlink(missing_ok=True)
        return None
    temporary.replace(kept)
    return kept


def texts(file: Path, folders: Sequence[Path]) -> Iterator[str]:
    """Yield the text of a file, and of all of ours that it includes, each once.

    OSError where a macro names what is included: its text could not be told.
    """
    # Paths as strings: a command of forty sources looks at a thousand headers.
    around = [os.fspath(folder) for folder in folders]
    waiting, seen = [os.fspath(file)], {os.fspath(file)}
    while waiting:
        here = waiting.pop()
        with open(here, errors="surrogateescape") as opened:
            text = opened.read()
        yield text
        for name in _included(text):
            if not name:
                raise OSError(f"{here}: what it includes is named by a macro")
            places = (f"{folder}/{name}" for folder in (os.path.dirname(here), *around))
            found = next((place for place in places if os.path.exists(place)), None)
            if found is not None and found not in seen:
                seen.add(found)
                waiting.append(found)


@functools.lru_cache(4096)
def _included(text: str) -> list[str]:
    """Return the names that a text includes, an empty one for a macro."""
    return re.findall(r'^\s*#\s*include\s+(?:["<](.+?)[">]|\w)', text, re.MULTILINE)


@functools.cache
def _folder() -> Path:
    FOLDER.mkdir(parents=True, exist_ok=True)
    for kept in FOLDER.glob("*.o"):
        with suppress(OSError):  # another process was faster
            if time.time() - kept.stat().st_mtime > WEEK:
                kept.unlink()
    return FOLDER


def _identity(compiler: str) -> str:
    """Return the compiler's own path and date, whatever it is called by; OSError without one."""
    path = os.path.realpath(shutil.which(compiler) or compiler)
    return f"{path} {os.stat(path).st_mtime_ns}"
