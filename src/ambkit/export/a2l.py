"""An A2L file (ASAM MCD-2 MC, ASAP2 1.6) for the calibration of an exported controller."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

from ambkit.base import files
from ambkit.base.errors import AmbkitError

READERS = ("readelf", "arm-none-eabi-readelf")
_COUNTS = {
    "request": "count up, and what is wanted is looked at",
    "answered": "the last request that was looked at",
    "refused": "sum of 1 << parameter of those that cannot be; 0 where all is taken over",
    "flying": "0: as exported; else the set that flies",
}


class Symbol(NamedTuple):
    """A variable of a program."""

    address: int
    size: int
    big_endian: bool


def symbol(elf: Path, name: str) -> Symbol:
    """Return where the linker has put a variable."""
    reader = next((match for match in map(shutil.which, READERS) if match), None)
    if reader is None:
        raise AmbkitError(f"{READERS[0]} is needed and not there: apt-get install binutils")
    words = [reader, "--wide", "--file-header", "--symbols", str(elf)]
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode != 0 or "ELF Header" not in done.stdout:
        raise AmbkitError(f"{elf}: is no ELF file that {reader} reads")
    row = rf"^\s*\d+: ([0-9a-f]+)\s+(\w+) OBJECT\s+\w+\s+\w+\s+\d+ {re.escape(name)}$"
    result = re.findall(row, done.stdout, re.MULTILINE)
    if len(result) != 1:
        count = "no variable" if not result else f"{len(result)} variables"
        raise AmbkitError(f"{elf}: has {count} {name}; one is wanted")
    address, size = result[0]
    return Symbol(int(address, 16), int(size, 0), "big endian" in done.stdout)


def export_a2l(
    folder: str | os.PathLike[str],
    elf: str | os.PathLike[str],
    variable: str,
    out: str | os.PathLike[str],
    *,
    force: bool = False,
) -> Path:
    """Write an A2L file for the ``amb_calibration`` of a program."""
    described = Path(folder) / "calibration.json"
    if not described.is_file():
        raise AmbkitError(
            f"{folder}: is no export with --calibration; {described.name} is not there"
        )
    export: dict[str, Any] = json.loads(files.read_text(described))
    if export.get("must_not_fly") and not force:
        raise AmbkitError(
            f"{folder}: not exported, the filter is inadequate: "
            f"{'; '.join(export['must_not_fly'])}. --force (in Python force=True) exports it"
        )
    at = symbol(Path(elf), variable)
    real = 4 if export["precision"] == "float" else 8
    n = len(export["parameters"])
    least = 2 * n * real + 4 * len(_COUNTS)
    if at.size < least:
        raise AmbkitError(
            f"{elf}: {variable} has {at.size} bytes; an amb_calibration has more than {least}"
        )
    files.write_text(Path(out), text(export, at, variable))
    return Path(out)


def text(export: dict[str, Any], at: Symbol, variable: str) -> str:
    """Return the A2L file."""
    prefix, parameters = export["prefix"], export["parameters"]
    kind, real = ("FLOAT32_IEEE", 4) if export["precision"] == "float" else ("FLOAT64_IEEE", 8)
    n = len(parameters)
    body = []
    for k, parameter in enumerate(parameters):
        low, high = parameter["low"], parameter["high"]
        place = at.address + k * real
        body += [
            f'/begin CHARACTERISTIC {variable}.wanted.{parameter["name"]} "{parameter["about"]}"',
            f"  VALUE 0x{place:08X} Real 0 {prefix}.{parameter['name']} {low!r} {high!r}",
            "/end CHARACTERISTIC",
        ]
        body += _measured(
            f"{variable}.in_use.{parameter['name']}", f"{parameter['about']}: what flies", kind,
            f"{prefix}.{parameter['name']}", (low, high), place + n * real,
        )  # fmt: skip
        body += [
            f'/begin COMPU_METHOD {prefix}.{parameter["name"]} ""',
            f'  IDENTICAL "%12.6" "{parameter["unit"]}"',
            "/end COMPU_METHOD",
        ]
    for k, (name, about) in enumerate(_COUNTS.items()):
        place = at.address + 2 * n * real + 4 * k
        if name == "request":
            body += [
                f'/begin CHARACTERISTIC {variable}.{name} "{about}"',
                f"  VALUE 0x{place:08X} Count 0 NO_COMPU_METHOD 0 4294967295",
                "/end CHARACTERISTIC",
            ]
        else:
            body += _measured(
                f"{variable}.{name}", about, "ULONG", "NO_COMPU_METHOD", (0, 4294967295), place
            )
    order = "MSB_FIRST" if at.big_endian else "MSB_LAST"
    lines = [
        "ASAP2_VERSION 1 60",
        f'/begin PROJECT {prefix} ""',
        f'  /begin MODULE {prefix} "calibration, written by ambkit"',
        f'    /begin MOD_COMMON "" BYTE_ORDER {order} /end MOD_COMMON',
        f"    /begin RECORD_LAYOUT Real FNC_VALUES 1 {kind} ROW_DIR DIRECT /end RECORD_LAYOUT",
        "    /begin RECORD_LAYOUT Count FNC_VALUES 1 ULONG ROW_DIR DIRECT /end RECORD_LAYOUT",
        *(f"    {line}" for line in body),
        "  /end MODULE",
        "/end PROJECT",
    ]
    return "\n".join(lines) + "\n"


def _measured(
    name: str, about: str, kind: str, method: str, limits: tuple[float, float], place: int
) -> list[str]:
    return [
        f'/begin MEASUREMENT {name} "{about}"',
        f"  {kind} {method} 0 0 {limits[0]!r} {limits[1]!r}",
        f"  ECU_ADDRESS 0x{place:08X}",
        "/end MEASUREMENT",
    ]
