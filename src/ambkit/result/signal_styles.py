"""Common axes of figures, and styles of filters."""

from collections.abc import Iterable, Iterator
from itertools import cycle

from ambkit.base.escaping import label
from ambkit.result.report import Axis

TIME = Axis("time", "s")
POSITION = Axis("position", "mm", 1e3)
VELOCITY = Axis("velocity", "mm/s", 1e3)
CURRENT = Axis("current", "A")
NOISE = Axis("sensor noise", "µm", 1e6)
DISTURBANCE = Axis("disturbance force", "N")

_SIGNALS = {
    "linear": "estimate linear",
    "adaptive": "estimate adaptive",
    "closed-law": "estimate closed law",
}
_OTHERS = ("another", "another 2", "another 3", "another 4")


def looks(names: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Return style and label of each filter's lines; one without a style takes an unused one."""
    others = cycle(_OTHERS)
    for name in names:
        yield _SIGNALS.get(name) or next(others), label(name)
