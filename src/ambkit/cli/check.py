"""``ambkit check``: whether files are what ambkit can use, and all that is wrong with them."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.parameters import Json, MapFile, find_machine


class Schema(StrEnum):
    """The kinds of TOML files."""

    bearing = "bearing"
    machine = "machine"
    scenario = "scenario"
    study = "study"
    map = "map"
    filter = "filter"
    force = "force"


def check(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FILE",
            help="Bearings, machines, scenarios, studies, channel maps, filters, experts, records, "
            "measured forces.",
        ),
    ] = None,
    schema: Annotated[
        Schema | None, typer.Option(help="Print the JSON schema of such a TOML file.")
    ] = None,
    channel_map: MapFile = None,
    bearing: Annotated[
        str | None,
        typer.Option(
            "--bearing",
            metavar="BEARING",
            help="Compare records with it: rate, range, noise, signs; and judge filters on it. A "
            "preset, or a TOML file.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Check files and report every fault.

    Each problem is told with its file and line; the exit code is 2 if there is one. What is odd
    about a record and may be right is told too.

    For example:
      ambkit check my.toml scenario.toml run.csv --bearing my.toml
      ambkit check --schema bearing > bearing.schema.json
    """
    from ambkit.cli import printing
    from ambkit.workflow.check import inspect, schema_of

    if (schema is None) == (not files):
        raise AmbkitError("give either FILES or --schema")
    if schema is not None:
        printing.deliver(schema_of(schema.value), [], as_json=True)
        return
    known = find_machine(bearing) if bearing is not None else None
    results = [inspect(path, channel_map, known) for path in files or ()]
    data: list[dict[str, Any]] = [
        {
            "file": str(item.path),
            "kind": item.kind,
            "ok": item.ok,
            "about": item.about,
            "problems": list(item.problems),
            "remarks": list(item.remarks),
        }
        for item in results
    ]
    lines = [f"{item.path}: ok, {item.kind}: {item.about}" for item in results if item.ok]
    printing.deliver(data, lines, as_json=json)
    for entry in results:
        for problem in entry.problems:
            printing.note(problem)
        for remark in entry.remarks:
            printing.note(f"{entry.path}: note: {remark}")
    if not all(item.ok for item in results):
        raise typer.Exit(2)
