"""Preset machines, as commented TOML to start from."""

import difflib
from importlib import resources
from pathlib import Path

from ambkit.base.errors import AmbkitError

_FOLDER = Path(str(resources.files(__name__)))


def names() -> tuple[str, ...]:
    """Return the names of all presets, sorted."""
    files = (item.name for item in _FOLDER.iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in files if name.endswith(".toml")))


def text(name: str) -> str:
    """Return the TOML of a preset, with comments."""
    return path(name).read_text(encoding="utf-8")


def path(name: str) -> Path:
    """Return the file of a preset."""
    known = names()
    if not isinstance(name, str):
        raise AmbkitError(f"a preset has a name, such as {known[-1]}; is {name!r:.60}")
    if name not in known:
        near = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean {near[0]}?" if near else f"there are: {', '.join(known)}"
        raise AmbkitError(f'there is no preset "{name}"; {hint}')
    return _FOLDER / f"{name}.toml"
