"""Copying and pickling of objects with a state in the C core."""

from functools import cache
from importlib.metadata import version
from typing import Any, Self


@cache
def own_version() -> str:
    """Return the version of ambkit, cached, because it is parsed from a file."""
    return version("ambkit")


class Copyable:
    """Copied and pickled with its state: the copy continues independently.

    The copy is constructed with the same arguments, then given the state. `copy.copy` shares
    constant objects such as machine and magnet with the original, but not the state.

    Raises
    ------
    ValueError
        Unpickled by another version of ambkit, in which states may differ.
    """

    core: Any
    _of_core: tuple[str, ...] = ("core",)  # attributes of the core's own object
    _made: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *args: Any, **options: Any) -> Self:
        """Store the arguments of the constructor."""
        self = super().__new__(cls)
        self._made = args, options
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        own = {name: value for name, value in vars(self).items() if name not in self._of_core}
        return _rebuild, (type(self), *self._made), (own_version(), self.core.state, own)

    def __setstate__(self, state: tuple[str, bytes, dict[str, Any]]) -> None:
        writer, live, own = state
        if writer != own_version():
            raise ValueError(
                f"{type(self).__name__}: was pickled by ambkit {writer}, this is "
                f"{own_version()}; make it anew"
            )
        vars(self).update(own)
        self.core.state = live


def _rebuild(of: type[Any], args: tuple[Any, ...], options: dict[str, Any]) -> Any:
    return of(*args, **options)
