"""A bearing with keys that it may not have itself: of the amplifier, the sensor and the loop."""

from __future__ import annotations

from typing import Any

from ambkit import Bearing


class Having:
    """Something, and further attributes."""

    def __init__(self, of: Any, **keys: Any) -> None:
        self.__dict__.update(keys)
        self._of = of

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.__dict__["_of"], name)


def having(
    bearing: Bearing,
    *,
    amplifier: dict[str, Any] | None = None,
    sensor: dict[str, Any] | None = None,
    **keys: Any,
) -> Any:
    """Return a bearing with further parts, for all that only asks it."""
    parts = {
        "amplifier": Having(bearing.amplifier, **(amplifier or {})),
        "sensor": Having(bearing.sensor, **(sensor or {})),
    }
    return Having(bearing, **parts, **keys)
