"""Any file of ambkit, as the object that it describes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base import files
from ambkit.base.errors import AmbkitError, ConfigError, shortened

if TYPE_CHECKING:
    from ambkit.data.channel_map import ChannelMap

#: Short names of the TOML files that are no machines.
SHORT = {"map": "channel map", "force": "channels of a force map"}


def load(
    path: str | os.PathLike[str],
    channel_map: ChannelMap | str | os.PathLike[str] | None = None,
) -> Any:
    """Load a machine, a filter, an expert, a record, or any other file of ambkit.

    Parameters
    ----------
    path : path
        ``.toml`` is a machine, a filter, a scenario, a study or a channel map, by its keys;
        ``.json`` is an expert; everything else is a record whose clock is even. `read` also takes
        logs with faults.
    channel_map : ChannelMap or path, optional
        The meaning of the columns of a log: signal, unit, scale, sign and offset.

    Returns
    -------
    Machine, Estimator, Expert, Record, Scenario, Study or ChannelMap

    Raises
    ------
    ConfigError
        A TOML file is not valid; each problem names file and line.
    RecordError
        A log cannot be read, or its clock is not even.
    AmbkitError
        The kind of the file is unknown.
    """
    from ambkit.data.reading.reader import load as load_record
    from ambkit.fuzzy.expert import Expert

    match Path(path).suffix.lower():
        case ".toml":
            document = documents()[kind_of_toml(path)].load(path)
            return document.make() if hasattr(document, "make") else document
        case ".json":
            return Expert.load(path)
        case _:
            return load_record(path, channel_map)


def documents() -> dict[str, Any]:
    """Return the classes of the TOML files, by kind."""
    from ambkit.campaigns.study import Study
    from ambkit.data.channel_map import ChannelMap
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.machine.forces.force_points import ForceChannels
    from ambkit.machine.machine import Bearing, PlacedMachine
    from ambkit.simulation.scenario import Scenario

    return {
        "bearing": Bearing, "machine": PlacedMachine, "scenario": Scenario,
        "channel map": ChannelMap, "filter": FilterFile, SHORT["force"]: ForceChannels,
        "study": Study,
    }  # fmt: skip


def kind_of_toml(path: str | os.PathLike[str]) -> str:
    """Return the kind of description that shares most keys with a file."""
    from ambkit.base.config import toml_text
    from ambkit.base.config.document import TOLD

    text = files.read_text(path)
    toml = toml_text.parse(text)
    if toml.data is None:
        problems = [f"{path}:{line}: {what}" for line, what in toml.problems]
        raise ConfigError(shortened(problems, TOLD), str(path))
    signals = toml.data.get("signals")
    if isinstance(signals, dict) and "f_mag" in signals and "t" not in signals:
        return SHORT["force"]
    shared = {
        kind: len(set(toml.data) & set(model.model_fields)) for kind, model in documents().items()
    }
    best = max(shared, key=lambda kind: shared[kind])
    if shared[best] == 0:
        raise AmbkitError(
            f"{path}: is neither a bearing, nor a machine, nor a scenario, nor a study, nor a "
            f"channel map, nor a filter: none of its keys is known in those "
            f"({', '.join(toml.data) or 'it is empty'})"
        )
    return best
