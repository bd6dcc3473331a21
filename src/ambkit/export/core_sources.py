"""C sources of the library, and the files that an export needs."""

import hashlib
import re
from collections.abc import Iterable, Mapping
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


def closure(
    sources: Iterable[str], *, instead: Mapping[str, str | None] | None = None
) -> dict[str, str]:
    """Return C sources and all headers that they include, directly or indirectly."""
    root, overrides = folder(), instead or {}
    results: dict[str, str] = {}
    waiting = list(sources)
    while waiting:
        name = waiting.pop()
        if name in results:
            continue
        text = overrides[name] if name in overrides else (root / name).read_text(encoding="utf-8")
        if text is None:
            continue
        results[name] = text
        waiting += [_place(root, name, included) for included in _INCLUDE.findall(results[name])]
    return dict(sorted(results.items()))


def external_names() -> tuple[str, ...]:
    """Return the names of all functions and constants of the core that a linker sees."""
    headers = (folder() / "include" / "ambkit").glob("*.h"), (folder() / "src").glob("*.h")
    texts = (path.read_text(encoding="utf-8") for paths in headers for path in sorted(paths))
    return tuple(sorted({name for text in texts for name in _EXTERNAL.findall(text)}))


def hashed(*parts: str) -> str:
    """Return six hexadecimal digits, a hash of the core's text and these."""
    digest = hashlib.sha256()
    for path in sorted(folder().rglob("*.[ch]")):
        digest.update(path.relative_to(folder()).as_posix().encode() + path.read_bytes())
    for part in parts:
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()[:6]


def _place(root: Path, including: str, included: str) -> str:
    """Return the path of an included file: beside the other, or in an include folder."""
    beside = (Path(including).parent / included).as_posix()
    for candidate in (beside, f"include/{included}", included):
        if (root / candidate).is_file():
            return candidate
    raise AmbkitError(f"{root / including}: includes {included}, which is not there")
