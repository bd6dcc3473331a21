"""C sources of the library, and the files that an export needs."""

import hashlib
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from ambkit.base.errors import AmbkitError

_PACKAGE = Path(__file__).parents[1]
_FOLDERS = (_PACKAGE / "core", _PACKAGE.parents[1] / "core")
_INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)

_EXTERNAL = re.compile(
    r"^(?!static|typedef|AMB_INLINE|return)(?:extern )?(?:const )?\w+ \*?(amb_\w+)(?=[;(\[])",
    re.MULTILINE,
)


def folder() -> Path:
    """Return the folder with the C sources of the core."""
    for candidate in _FOLDERS:
        if (candidate / "include" / "ambkit" / "real.h").is_file():
            return candidate
    raise AmbkitError(f"the C sources that come with ambkit are not there: {_FOLDERS[0]}")


@cache
def _texts(root: Path) -> dict[str, str]:
    """Return all sources by their names."""
    paths = sorted(root.rglob("*.[ch]"))
    return {path.relative_to(root).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def closure(
    sources: Iterable[str], *, instead: Mapping[str, str | None] | None = None
) -> dict[str, str]:
    """Return C sources and all headers that they include, directly or indirectly."""
    texts, overrides = _texts(folder()), instead or {}
    results: dict[str, str] = {}
    waiting = list(sources)
    while waiting:
        name = waiting.pop()
        if name in results:
            continue
        text = overrides[name] if name in overrides else texts[name]
        if text is None:
            continue
        results[name] = text
        waiting += [_place(texts, name, included) for included in _INCLUDE.findall(results[name])]
    return dict(sorted(results.items()))


def external_names() -> tuple[str, ...]:
    """Return the names of all functions and constants of the core that a linker sees."""
    headers = (
        text for name, text in _texts(folder()).items()
        if name.endswith(".h") and name.startswith(("include/", "src/"))
    )  # fmt: skip
    return tuple(sorted({name for text in headers for name in _EXTERNAL.findall(text)}))


def hashed(*parts: str) -> str:
    """Return six hexadecimal digits, a hash of the core's text and these."""
    digest = hashlib.sha256()
    for name, text in _texts(folder()).items():
        digest.update(f"{name}{text}".encode())
    for part in parts:
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()[:6]


def _place(texts: Mapping[str, str], including: str, included: str) -> str:
    """Return the path of an included file: beside the other, or in an include folder."""
    beside = (Path(including).parent / included).as_posix()
    for candidate in (beside, f"include/{included}", included):
        if candidate in texts:
            return candidate
    raise AmbkitError(f"{folder() / including}: includes {included}, which is not there")
