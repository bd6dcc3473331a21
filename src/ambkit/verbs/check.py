"""Checks of input files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from ambkit.verbs.words import Files, Machine, MapFile

if TYPE_CHECKING:
    from ambkit.result.result import Document


def check(
    files: Files, *, machine: Machine | None = None, channels: MapFile | None = None
) -> Document:
    """Check input files and report every fault.

    Each fault is reported with file and line; the exit code is then 2. Anomalies of a record that
    may be legitimate are reported as notes. The line of a machine ends with the performance of its
    default filter in simulation: consistency, and position error compared with the raw sensor and a
    constant-velocity filter.

    Parameters
    ----------
    files : str, path or sequence of them
        Machines, scenarios, studies, channel maps, filters, experts, records, force maps; or names
        of presets.
    machine : Machine, str or path, optional
        Compare records with this machine (rate, range, noise, signs), and evaluate filters on it.
    channels : str or path, optional
        Channel map of the logs (`ambkit read guess` proposes one).

    Returns
    -------
    Document
        One line per valid file; the faults are its notes.

    Raises
    ------
    AmbkitError
        The machine cannot be read.

    Examples
    --------
    $ ambkit check my.toml scenario.toml run.csv --machine my.toml
    """
    from ambkit.arguments import machine_argument
    from ambkit.base.quantity_arguments import names_in
    from ambkit.workflow.check import checked

    known = None if machine is None else machine_argument(machine)
    return checked(names_in(files=files), channels, known)


def schema(
    kind: Literal["machine", "scenario", "study", "map", "filter", "force", "drawing"],
) -> Document:
    """Print the JSON schema of a TOML file.

    Parameters
    ----------
    kind : {"machine", "scenario", "study", "map", "filter", "force", "drawing"}
        machine, scenario, study, map (channel map), filter, force (channel map of a force map), or
        drawing (of a magnet).

    Returns
    -------
    Document
        The schema.

    Examples
    --------
    $ ambkit schema machine > machine.schema.json
    """
    from ambkit.result.result import json_document
    from ambkit.workflow.check import schema_of

    return json_document(schema_of(kind))
