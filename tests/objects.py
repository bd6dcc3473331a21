"""C that tests compile again and again: the same text is compiled once.

The texts of a file and of all that it includes name its object, together with the compiler and its
options, much as in ccache. The objects lie in pytest's cache, so that a second call of the tests
has them too.

As a script it is a compiler: ``python tests/objects.py cc -O2 -shared a.c b.c -o library``.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

FOLDER = Path(__file__).parents[1] / ".pytest_cache" / "objects"
WEEK = 7 * 24 * 3600.0  # after which an object that nothing asked for goes

LINKING = re.compile("-shared|-s|-Wl,.*|-l.+")  # options that compiling alone does not know

Done = subprocess.CompletedProcess[str]


def build(
    command: Sequence[str],
    files: Sequence[str | Path],
    out: Path,
    cwd: Path,
    link: Sequence[str] = ("-lm",),
) -> Done:
    """Compile C files and link them; return how it ended, at the first file that has a warning.

    Parameters
    ----------
    command : sequence of str
        Compiler and options, for compiling and for linking.
    files : sequence of path
        C files.
    out : path
        The program or library.
    cwd : path
        Where the paths are from.
    link : sequence of str
        What linking takes beside them.
    """
    made = []
    for file in files:
        compiled, done = object_of(command, file, cwd)
        if done.returncode or done.stderr:
            return done
        made.append(str(compiled))
    return _run([*command, *made, *link, "-o", str(out)], cwd)


def object_of(command: Sequence[str], file: str | Path, cwd: Path) -> tuple[Path, Done]:
    """Return the object of a C file, which is there unless compiling failed or warned."""
    folders = [cwd / word.removeprefix("-I") for word in command if word.startswith("-I")]
    options = (word for word in command if not word.startswith("-I"))
    words = [_version(command[0]), *options, *_texts(cwd / file, folders)]
    kept = _folder() / f"{hashlib.sha256(chr(0).join(words).encode()).hexdigest()}.o"
    if kept.exists():
        with suppress(OSError):
            os.utime(kept)
        return kept, Done([], 0, "", "")
    # Others may do the same now: each writes a file of its own, and the last puts it in place.
    temporary = kept.with_suffix(f".{os.getpid()}.o")
    done = _run([*command, "-c", str(file), "-o", str(temporary)], cwd)
    if done.returncode or done.stderr:
        temporary.unlink(missing_ok=True)
    else:
        temporary.replace(kept)
    return kept, done


def _texts(file: Path, folders: Sequence[Path]) -> Iterator[str]:
    """Yield the text of a file, and of all that it includes in quotes, each once."""
    waiting, seen = [file], {file}
    while waiting:
        here = waiting.pop()
        text = here.read_text()
        yield text
        for name in re.findall(r'^\s*#\s*include\s+"(.+?)"', text, re.MULTILINE):
            places = (folder / name for folder in (here.parent, *folders))
            found = next((place for place in places if place.exists()), None)
            if found is not None and found not in seen:
                seen.add(found)
                waiting.append(found)


@functools.cache
def _folder() -> Path:
    FOLDER.mkdir(parents=True, exist_ok=True)
    for kept in FOLDER.glob("*.o"):
        with suppress(OSError):  # another process was faster
            if time.time() - kept.stat().st_mtime > WEEK:
                kept.unlink()
    return FOLDER


@functools.cache
def _version(compiler: str) -> str:
    return _run([compiler, "--version"], Path.cwd()).stdout


def _run(command: Sequence[str], cwd: Path) -> Done:
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300)


def main(compiler: str, *words: str) -> int:
    """Compile as the compiler would with these words; return its exit code."""
    out = words.index("-o")
    rest = [*words[:out], *words[out + 2 :]]
    files = [word for word in rest if word.endswith(".c")]
    link = [word for word in rest if LINKING.fullmatch(word)]
    command = [compiler, *(word for word in rest if word not in {*files, *link})]
    done = build(command, files, Path(words[out + 1]), Path.cwd(), link)
    sys.stderr.write(done.stderr)
    return done.returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
