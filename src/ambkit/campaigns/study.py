"""STUDY.toml: machine, varied quantities, recorded data, number of runs, stopping criterion.

::

    name = "Zittau, tolerances of the drawing"
    bearing = "zittau_axial"           # a preset, or a file
    estimator = "extended"
    runs = 2000
    seed = 1

    [scenario]
    duration = "0.2 s"
    disturbance = { type = "step", amplitude = "3 N", time = "50 ms" }

    [[vary]]
    what = "magnet.air_gap"
    type = "normal"
    std = "2 %"                        # of the nominal value

    [passes]
    zone = "A"
    contact = false
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainSerializer, SerializationInfo, ValidationInfo

from ambkit.base.config import Document, Read
from ambkit.base.config.quantities import Description, Name, from_folder, to_folder
from ambkit.base.errors import AmbkitError
from ambkit.campaigns.distributions import Vary
from ambkit.campaigns.study_tables import Correlated, Criteria, Recorded, Stop
from ambkit.control.control import Control
from ambkit.machine import presets
from ambkit.simulation.scenario import Scenario

Way = Literal["sobol", "latin-hypercube", "random", "grid", "saltelli"]

MOST_RUNS = 10**9  #: Maximum number of runs: the length of a Sobol sequence of 30 bits.


def _is_filter_file(value: Any) -> bool:
    from ambkit.estimate.registry import FILTER_SUFFIX

    return isinstance(value, str) and value.endswith(FILTER_SUFFIX)


def _file_or_name(is_file: Callable[[Any], bool]) -> tuple[BeforeValidator, PlainSerializer]:
    """Return the type of a text that is a file beside the study, or a name."""

    def read(value: Any, info: ValidationInfo) -> Any:
        return from_folder(value, info) if is_file(value) else value

    def written(value: str, info: SerializationInfo) -> str:
        return to_folder(value, info) if is_file(value) else value

    return BeforeValidator(read), PlainSerializer(written)


MachineName = Annotated[str, *_file_or_name(lambda value: value not in presets.names())]
EstimatorName = Annotated[str, *_file_or_name(_is_filter_file)]


class Study(Document):
    """A study of many machines.

    Frozen, and checked as a whole: from TOML (`load`, `from_toml`) or from Python, in SI.
    """

    name: Annotated[Name, Field(min_length=1)]
    """Short name."""
    description: Description = ""
    """Purpose."""
    machine: MachineName
    """Nominal machine: a preset, or a file. Controllers and filters are designed for it."""
    estimator: EstimatorName | None = None
    """Filter in the loop, or beside it with the measurement as feedback: a kind, a filter file, or
    none. By default as for `ambkit simulate`.
    """
    runs: Annotated[int, Field(ge=1, le=MOST_RUNS, strict=True)] | None = None
    """Maximum number of runs; a grid has as many as it has points."""
    repeats: Annotated[int, Field(ge=1, strict=True)] = 1
    """Runs at each point of a grid, with independent noise."""
    seed: Annotated[int, Field(ge=0, lt=2**63, strict=True)] = 0
    """Random seed of points and noise."""
    sampling: Way = "sobol"
    """Sampling method; "saltelli" for Sobol indices."""
    confidence: Annotated[float, Field(gt=0, lt=1)] = 0.95
    """Confidence of the intervals."""
    part: Annotated[int, Field(ge=1, le=100_000, strict=True)] = 1000
    """Runs that are computed and written together."""
    scenario: Scenario = Scenario()
    """Scenario of a run."""
    controllers: dict[Name, Control] = Field(default_factory=dict)
    """Controllers to choose from, by name; omitted settings are tuned."""
    vary: tuple[Vary, ...] = ()
    """Quantities that vary from run to run."""
    correlation: tuple[Correlated, ...] = ()
    """Correlations between these."""
    record: Recorded = Recorded()
    """Data to store."""
    passes: Criteria = Criteria()
    """Criteria of a good machine."""
    stop: Stop | None = None
    """Criterion for an early end."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        from ambkit.campaigns import study_checks

        yield from study_checks.contradictions(read)


def load(study: Study | str | os.PathLike[str]) -> Study:
    """Return a study, or the one in a file."""
    if isinstance(study, Study):
        return study
    path = Path(study)
    if path.is_dir():
        raise AmbkitError(f"{path}: is a folder; a study is a TOML file")
    return Study.load(path)
