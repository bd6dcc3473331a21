"""Bearings and machines that come with ambkit, as commented TOML to start one's own from."""

import difflib
from collections.abc import Sequence
from importlib import resources
from importlib.resources.abc import Traversable

from ambkit.base.errors import AmbkitError

_SUFFIX = ".toml"


def names() -> tuple[str, ...]:
    """Return the names of all presets of bearings, sorted."""
    return _names(_bearings())


def machine_names() -> tuple[str, ...]:
    """Return the names of all presets of machines, sorted."""
    return _names(_machines())


def all_names() -> tuple[str, ...]:
    """Return the names of all presets, sorted."""
    return tuple(sorted((*names(), *machine_names())))


def text(name: str, known: Sequence[str] | None = None) -> str:
    """Return the TOML of a preset, of these or of all, as it stands in its file, with comments."""
    known = all_names() if known is None else known
    if not isinstance(name, str):
        raise AmbkitError(f"a preset has a name, such as {known[-1]}; is {name!r:.60}")
    if name not in known:
        near = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean {near[0]}?" if near else f"there are: {', '.join(known)}"
        raise AmbkitError(f'there is no preset "{name}"; {hint}')
    folder = _bearings() if name in names() else _machines()
    return folder.joinpath(name + _SUFFIX).read_text(encoding="utf-8")


def _bearings() -> Traversable:
    return resources.files(__name__)


def _machines() -> Traversable:
    return resources.files(__name__).joinpath("machines")


def _names(folder: Traversable) -> tuple[str, ...]:
    files = (item.name for item in folder.iterdir())
    return tuple(sorted(name.removesuffix(_SUFFIX) for name in files if name.endswith(_SUFFIX)))
