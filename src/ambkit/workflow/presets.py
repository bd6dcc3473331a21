"""The presets, as they are listed and printed."""

from __future__ import annotations

import shutil
import textwrap

from ambkit.machine import presets
from ambkit.machine.machine import Machine
from ambkit.result.result import Document


def listing() -> Document:
    """Return the names of all presets, and what each is."""
    machines = map(Machine.preset, presets.names())
    data = [
        {"name": item.name, "description": item.description, "source": item.source,
         "kind": _form(item)}
        for item in machines
    ]  # fmt: skip
    column = max(len(item["name"]) for item in data) + 2
    columns = min(shutil.get_terminal_size().columns, 100)
    lines = (
        textwrap.fill(item["description"], columns, initial_indent=item["name"].ljust(column),
                      subsequent_indent=" " * column)
        for item in data
    )  # fmt: skip
    return Document("".join(f"{line}\n" for line in lines), data)


def document(name: str) -> Document:
    """Return a preset as TOML, and as data."""
    toml, machine = presets.text(name), Machine.preset(name)
    return Document(toml, {"name": name, _form(machine): machine.model_dump(), "toml": toml})


def _form(machine: Machine) -> str:
    """Return the form of a machine's file, short or long."""
    return "bearing" if machine.single else "machine"
