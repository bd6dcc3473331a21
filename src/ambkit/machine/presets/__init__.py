"""Bearings that come with ambkit, as commented TOML to start one's own from."""

import difflib
from importlib import resources

from ambkit.base.errors import AmbkitError

_SUFFIX = ".toml"


def names() -> tuple[str, ...]:
    """Return the names of all presets, sorted."""
    files = (item.name for item in resources.files(__name__).iterdir())
    return tuple(sorted(name.removesuffix(_SUFFIX) for name in files if name.endswith(_SUFFIX)))


def text(name: str) -> str:
    """Return the TOML of a preset as it stands in its file, comments included.

    Raises
    ------
    AmbkitError
        There is no preset of that name.
    """
    if name not in names():
        near = difflib.get_close_matches(name, names(), 1)
        hint = f"did you mean {near[0]}?" if near else f"there are: {', '.join(names())}"
        raise AmbkitError(f'there is no preset "{name}"; {hint}')
    return resources.files(__name__).joinpath(name + _SUFFIX).read_text(encoding="utf-8")
