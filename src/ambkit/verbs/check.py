"""Whether files are what ambkit can use."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from ambkit.verbs.words import Files, Machine, MapFile

if TYPE_CHECKING:
    from ambkit.result.document import Document


def check(
    files: Files, *, machine: Machine | None = None, channels: MapFile | None = None
) -> Document:
    """Check files and report every fault.

    Each problem is reported with its file and line; the exit code is 2 if there is one. What is odd
    about a record and may be right is reported too.

    Parameters
    ----------
    files : str, path or sequence of them
        Machines, scenarios, studies, channel maps, filters, experts, records, measured forces.
    machine : Machine, str or path, optional
        Compare records with it: rate, range, noise, signs; and judge filters on it.
    channels : str or path, optional
        Channel map: what is what in a log; `ambkit read guess` proposes one.

    Returns
    -------
    Document
        A line for each file that is valid; the problems are its notes.

    Raises
    ------
    AmbkitError
        The machine cannot be read.

    Examples
    --------
    $ ambkit check my.toml scenario.toml run.csv --machine my.toml
    """
    from ambkit.assessment.arguments import machine_argument
    from ambkit.base.quantity_arguments import names_in
    from ambkit.workflow.check import checked

    known = None if machine is None else machine_argument(machine)
    return checked(names_in(files=files), channels, known)


def schema(
    kind: Literal["bearing", "machine", "scenario", "study", "map", "filter", "force"],
) -> Document:
    """Print the JSON schema of a kind of TOML file.

    Parameters
    ----------
    kind : {"bearing", "machine", "scenario", "study", "map", "filter", "force"}
        Of the file; force is the channel map of a force map.

    Returns
    -------
    Document
        The schema.

    Examples
    --------
    $ ambkit schema bearing > bearing.schema.json
    """
    from ambkit.result.document import json_document
    from ambkit.workflow.check import schema_of

    return json_document(schema_of(kind))
