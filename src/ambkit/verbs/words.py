"""Types of what verbs take: objects in Python, and everywhere texts such as ``"0.3 mm"``.

The second part of each is how the help of a command writes its value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

if TYPE_CHECKING:
    from os import PathLike

    import ambkit
    from ambkit.data.channel_map import ChannelMap

Machine = Annotated["str | PathLike[str] | ambkit.Machine", "MACHINE"]
Filter = Annotated["str | PathLike[str] | ambkit.Estimator", "FILTER"]
Filters = Filter | Sequence[Filter] | Mapping[str, Filter]
Controller = Annotated[
    "str | PathLike[str] | ambkit.PID | type[ambkit.ControllerProtocol]", "CONTROLLER"
]
Plant = Annotated["str | type[ambkit.PlantProtocol]", "FILE.py:CLASS"]
Record = Annotated["str | PathLike[str] | ambkit.Record", "RECORD"]
Records = Record | Sequence[Record]
Channels = Annotated["str | PathLike[str] | ChannelMap", "FILE.toml"]
Scenario = Annotated["str | PathLike[str] | ambkit.Scenario", "FILE.toml"]
Study = Annotated["str | PathLike[str] | ambkit.Study", "STUDY.toml"]
File = Annotated["str | PathLike[str]", "FILE"]
MapFile = Annotated["str | PathLike[str]", "FILE.toml"]
Log = Annotated["str | PathLike[str]", "RECORD"]
Storage = Annotated["str | PathLike[str]", "FILE"]
Folder = Annotated["str | PathLike[str]", "DIR"]
Axis = Annotated[str, "AXIS"]
Length = Annotated["float | str", "LENGTH"]
Force = Annotated["float | str | Mapping[str, float | str]", "FORCE"]
Wander = Annotated["float | str", "FORCE"]
Orbit = Annotated["float | str", "own|LENGTH"]
Speed = Annotated["float | str", "SPEED"]
Time = Annotated["float | str", "TIME"]
Limit = Annotated["str", "LIMIT"]
Band = Annotated["tuple[float | str, float | str] | str", "FROM,TO"]
Window = Annotated["tuple[float | str | None, float | str | None] | str", "FROM,TO"]
