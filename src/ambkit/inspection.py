"""What a file is, and all that is wrong with it."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ambkit import files
from ambkit.errors import AmbkitError, ConfigError


@dataclass(frozen=True)
class Finding:
    """What a file turned out to be.

    Attributes
    ----------
    path : Path
        The file.
    kind : str
        ``"bearing"``, ``"scenario"``, ``"channel map"``, ``"expert"``, ``"record"``, ``"lift-off
        points"``, ``"force table"``; ``"file"`` where that cannot be told.
    about : str
        What it holds, in a few words; empty where it is not valid.
    problems : tuple of str
        All that is wrong, each with its place.
    """

    path: Path
    kind: str
    about: str
    problems: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems


def schema_of(kind: str) -> dict[str, Any]:
    """Return the JSON schema of a TOML file: of a ``bearing``, a ``scenario`` or a ``map``."""
    model = _documents()["channel map" if kind == "map" else kind]
    return dict(model.json_schema())


def inspect(
    path: str | os.PathLike[str], channel_map: str | os.PathLike[str] | None = None
) -> Finding:
    """Find out what a file is by what it holds, and check it.

    Parameters
    ----------
    path : path
        A ``.toml``, ``.json``, ``.csv``, ``.parquet`` or ``.mat``.
    channel_map : path, optional
        What is what in a log.

    Returns
    -------
    Finding
        With all problems; a file that cannot be read is a problem too.
    """
    path = Path(path)
    kind = "file"
    try:
        kind, describe = _recognise(path, channel_map)
        return Finding(path, kind, describe(path))
    except ConfigError as error:
        return Finding(path, kind, "", error.problems)
    except AmbkitError as error:
        return Finding(path, kind, "", (str(error),))


def _recognise(
    path: Path, channel_map: str | os.PathLike[str] | None
) -> tuple[str, Callable[[Path], str]]:
    match path.suffix.lower():
        case ".toml":
            kind = _kind_of_toml(path)
            return kind, lambda p: _describe_document(kind, p)
        case ".json":
            return "expert", _describe_expert
        case ".csv" | ".parquet" if channel_map is None:
            return _kind_of_table(path)
        case ".csv" | ".parquet" | ".mat":
            return "record", lambda p: _describe_record(p, channel_map)
        case _:
            return "file", _unknown


def _unknown(path: Path) -> str:
    raise AmbkitError(
        f"{path}: what is that? known are .toml, .json, .csv, .parquet and .mat files"
    )


def _documents() -> dict[str, Any]:
    from ambkit.bearing import Bearing
    from ambkit.channelmap import ChannelMap
    from ambkit.scenario import Scenario

    return {"bearing": Bearing, "scenario": Scenario, "channel map": ChannelMap}


def _kind_of_toml(path: Path) -> str:
    """Return the kind of description that shares most keys with the file."""
    from ambkit.config import toml_text

    text = files.read_text(path)
    toml = toml_text.parse(text)
    if toml.data is None:
        raise ConfigError([f"{path}:{line}: {what}" for line, what in toml.problems], str(path))
    documents = _documents()
    shared = {
        kind: len(set(toml.data) & set(model.model_fields)) for kind, model in documents.items()
    }
    best = max(shared, key=lambda kind: shared[kind])
    if shared[best] == 0:
        raise AmbkitError(
            f"{path}: is neither a bearing, nor a scenario, nor a channel map: none of its keys "
            f"is known in those ({', '.join(toml.data) or 'it is empty'})"
        )
    return best


def _describe_document(kind: str, path: Path) -> str:
    from ambkit.units import engineering

    found = _documents()[kind].load(path)
    if kind == "channel map":
        return f"signals {', '.join(found.signals)}"
    if kind == "scenario":
        return (
            f"{engineering(found.duration, 's')}, reference {found.reference.type}, "
            f"disturbance {found.disturbance.type}"
        )
    return f"{found.name}, {found.magnet.type}, {engineering(found.rotor.mass, 'kg')}"


def _describe_expert(path: Path) -> str:
    from ambkit.fuzzy import Expert

    expert = Expert.load(path)
    return f"{len(expert.rules)} rules for {expert.source}"


def _kind_of_table(path: Path) -> tuple[str, Callable[[Path], str]]:
    from ambkit.files.tables import read_table
    from ambkit.identification import force_file, lift_off

    columns = set(read_table(path).columns)
    if "t" not in columns and columns >= set(lift_off.COLUMNS):
        return "lift-off points", _describe_points
    if "t" not in columns and columns >= set(force_file.COLUMNS):
        return "force table", _describe_force
    return "record", lambda p: _describe_record(p, None)


def _describe_points(path: Path) -> str:
    from ambkit.identification.lift_off import load_points

    points = load_points(path)
    return f"{len(points)} runs, {sum(not p.problem for p in points)} of them usable"


def _describe_force(path: Path) -> str:
    from ambkit.identification.force_file import load_force_table

    table = load_force_table(path)
    return f"{table.displacement.size} displacements times {table.current.size} currents"


def _describe_record(path: Path, channel_map: str | os.PathLike[str] | None) -> str:
    import numpy as np

    from ambkit.record import Record
    from ambkit.units import engineering

    record = Record.load(path, channel_map)
    lacking = [name for name in ("y", "u") if name not in record]
    unfit = f"; without {' and '.join(lacking)}, so nothing to filter" if lacking else ""
    missing = sum(int(np.isnan(record[name]).sum()) for name in record)
    lost = f", {missing} samples missing" if missing else ""
    return (
        f"{len(record)} samples of {', '.join(record)} every "
        f"{engineering(record.sampling_time, 's')}{lost}{unfit}"
    )
