"""``ambkit export a2l``: addresses for a calibration tool."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ambkit.cli.parameters import Force, Json, file_option


def export_a2l(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="An export with --controller and --calibration.")
    ],
    elf: Annotated[
        Path, typer.Option(metavar="FILE", help="The firmware that was linked with it, ELF.")
    ],
    out: Annotated[Path, file_option("The file to write.", (".a2l",), "--out")],
    symbol: Annotated[
        str, typer.Option(metavar="NAME", help="The firmware's variable of type amb_calibration.")
    ] = "calibration",
    force: Force = False,
    json: Json = False,
) -> None:
    """Write an A2L file (ASAP2 1.6) for the calibration of an exported controller.

    The addresses are those of the firmware's ELF file. Needs readelf.

    For example:
      ambkit export a2l rig/ --elf firmware.elf --symbol calibration --out rig.a2l
    """
    from ambkit.cli import printing
    from ambkit.export import a2l

    at = a2l.symbol(elf, symbol)
    written = a2l.export_a2l(folder, elf, symbol, out, force=force)
    printing.deliver({"path": str(written), "address": at.address}, [], as_json=json)
    printing.note(f"wrote {written}, {symbol} at 0x{at.address:08X}")
