"""A2L file (ASAM MCD-2 MC, ASAP2 1.6) for the calibration of an exported controller."""

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
    "request": "increment to have the requested set checked",
    "answered": "the last request that was checked",
    "refused": "sum of 1 << parameter of the rejected ones; 0 if all were accepted",
    "flying": "0: as exported; else the active set",
}


class Symbol(NamedTuple):
    """A variable of a program."""

    address: int
    size: int
    big_endian: bool


def symbol(elf: Path, name: str) -> Symbol:
    """Return the address that the linker gave a variable."""
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
            f"{folder}: is no export with --add calibration; {described.name} is not there"
        )
    export: dict[str, Any] = json.loads(files.read_text(described))
    if export.get("must_not_fly") and not force:
        raise AmbkitError(
            f"{folder}: not exported, the filter is inadequate: "
            f"{'; '.join(export['must_not_fly'])}. --force (in Python force=True) exports it"
        )
    at = symbol(Path(elf), variable)
    real = 4 if export["precision"] == "float" else 8
    n = export["room"]
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
    n = export["room"]
    body = []
    for k, parameter in enumerate(parameters):
        own, about = parameter["name"], parameter["about"]
        limits = f"{parameter['low']!r} {parameter['high']!r}"
        method, place = f"{prefix}.{own}", at.address + k * real
        demanded = f"VALUE 0x{place:08X} Real 0 {method} {limits}"
        in_use = f"{kind} {method} 0 0 {limits}", f"ECU_ADDRESS 0x{place + n * real:08X}"
        body += _block("CHARACTERISTIC", f"{variable}.wanted.{own}", about, demanded)
        body += _block("MEASUREMENT", f"{variable}.in_use.{own}", f"{about}: what flies", *in_use)
        body += _block("COMPU_METHOD", method, "", f'IDENTICAL "%12.6" "{parameter["unit"]}"')
    for k, (name, about) in enumerate(_COUNTS.items()):
        place = at.address + 2 * n * real + 4 * k
        if name == "request":
            count = f"VALUE 0x{place:08X} Count 0 NO_COMPU_METHOD 0 4294967295"
            body += _block("CHARACTERISTIC", f"{variable}.{name}", about, count)
        else:
            counter = "ULONG NO_COMPU_METHOD 0 0 0 4294967295", f"ECU_ADDRESS 0x{place:08X}"
            body += _block("MEASUREMENT", f"{variable}.{name}", about, *counter)
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


def _block(keyword: str, name: str, about: str, *lines: str) -> list[str]:
    inner = (f"  {line}" for line in lines)
    return [f'/begin {keyword} {name} "{about}"', *inner, f"/end {keyword}"]
