"""Types of the verbs' arguments: objects in Python, and texts such as ``"0.3 mm"`` everywhere.

The second part of each is its placeholder in the help of a command.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

if TYPE_CHECKING:
    from os import PathLike

    from numpy.typing import ArrayLike

    import ambkit
    from ambkit.data.channel_map import ChannelMap
    from ambkit.judge.comparison.cases import Case as ComparisonCase
    from ambkit.machine.magnets import MagnetModel
    from ambkit.simulation.external_inputs import ExternalInputs

Machine = Annotated["str | PathLike[str] | ambkit.Machine", "MACHINE"]
Source = Annotated["str | PathLike[str] | ambkit.Machine | ambkit.StiffnessMap", "MACHINE"]
Filter = Annotated["str | PathLike[str] | ambkit.Estimator", "FILTER"]
LoopFilter = Annotated[
    "str | PathLike[str] | ambkit.Estimator | type[ambkit.EstimatorProtocol]", "FILTER"
]
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
Drawing = Annotated["str | PathLike[str]", "FILE.toml"]
Folder = Annotated["str | PathLike[str]", "DIR"]
Axis = Annotated[str, "AXIS"]
Preset = Annotated[str, "NAME"]
Cluster = Annotated[str, "WHERE"]
TruePlant = Annotated[
    "str | PathLike[str] | MagnetModel | type[ambkit.PlantProtocol]", "FILE.csv|FILE.py:CLASS"
]
Signal = Annotated["str | PathLike[str]", "FILE"]
Signals = Signal | Sequence[Signal]
Inputs = Annotated["ExternalInputs", ""]  # of Python only: without a name there is no option
Files = File | Sequence[File]
Length = Annotated["float | str", "LENGTH"]
Force = Annotated["float | str | Mapping[str, float | str]", "FORCE"]
RandomWalk = Annotated["float | str", "FORCE"]
Orbit = Annotated["float | str", "own|LENGTH"]
Speed = Annotated["float | str", "SPEED"]
Time = Annotated["float | str", "TIME"]
Limit = Annotated[str, "LIMIT"]
Above = Annotated["float | str", "LIMIT"]
Case = Annotated["str | ComparisonCase", "NAME"]
Seeds = Annotated["int | range | str", "[FIRST:]N"]
Share = Annotated["float | str", "SHARE"]
Rules = Annotated["tuple[int, int] | str", "NxM"]
Constant = Annotated["float | str", "CONSTANT"]
KnownForce = Annotated["float | str | ArrayLike", "FORCE|SIGNAL"]
Gap = Annotated["tuple[float | str, float | str] | str", "FROM,TO"]
Rest = Annotated["str | PathLike[str] | ambkit.Record", "RECORD[@MAP]"]
Noise = Annotated["float | str", "NOISE"]
Frequency = Annotated["float | str", "FREQUENCY"]
TableError = Annotated["float | str", "auto|FORCE"]
Band = Annotated["tuple[float | str, float | str] | str", "FROM,TO"]
Window = Annotated["tuple[float | str | None, float | str | None] | str", "FROM,TO"]
