"""The C core with loops over any model: the names of ``ambkit._core``, and a model of its own."""

from typing import Any

from ambkit._core import *

MOST_STATES: int
MOST_FORCES: int
MOST_SENSORS: int

class Model:  # type: ignore[no-redef]
    """Any model (ambkit/loops.h)."""

    def __init__(self, arrays: dict[str, Any]) -> None: ...
