"""``ambkit presets``: the bearings and machines that come with ambkit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.parameters import Json, file_option


def presets(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Print this preset's TOML as it is.")
    ] = None,
    out: Annotated[
        Path | None, file_option("Write the TOML to a file.", (".toml",), "--out")
    ] = None,
    json: Json = False,
) -> None:
    """List the preset machines, or print one as TOML.

    Those that come with ambkit; as TOML they are ready to be edited.

    For example:
      ambkit presets zittau_axial > my.toml
    """
    from ambkit.base import files
    from ambkit.cli import printing
    from ambkit.machine import presets as collection
    from ambkit.machine.machine import Machine

    if name is None:
        if out is not None:
            raise AmbkitError("--out needs the NAME of a preset")
        known = map(Machine.preset, (*collection.names(), *collection.machine_names()))
        data = [
            {"name": b.name, "description": b.description, "source": b.source,
             "kind": "bearing" if b.single else "machine"}
            for b in known
        ]  # fmt: skip
        rows = [[b["name"], b["kind"], b["description"]] for b in data]
        preset_table = printing.table("Presets", ["name", "of a", "what"], rows, wide=True)
        printing.deliver(data, [preset_table], as_json=json)
        return
    text = collection.text(name)
    if json:
        result = Machine.preset(name)
        kind = "bearing" if result.single else "machine"
        content = {"name": name, kind: result.model_dump(), "toml": text}
    write = [(out, lambda path: files.write_text(path, text))]
    if json:
        printing.deliver(content, [], write, as_json=True)
    elif out is not None:
        printing.deliver(None, [], write, as_json=False)
    else:
        print(text, end="")
