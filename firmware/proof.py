"""Prove anew what ``proof/README.md`` of an export records: ``python -m firmware.proof all``.

Kinds may be named in place of ``all``. Each is exported in both precisions and its
``proof/prove.sh`` is run; minutes each. What came out is stored, and is the table of
``firmware/README.md``.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from ambkit.base import files
from ambkit.estimate.registry import KINDS
from ambkit.export.c import cost, export_c, proof
from ambkit.export.c.data import CPrecision
from firmware import measure

NAMES = tuple(name for name in KINDS if name != "steady-state")
"""Kinds; what is steady-state is an observer, the same C with other numbers."""

PRECISIONS: tuple[CPrecision, ...] = ("float", "double")

SAID = re.compile(r"^(finite|any) inputs: (\d+) alarms, (\d+) outputs", re.MULTILINE)


def tool() -> str | None:
    """Return Frama-C's name and version; None where it is not installed."""
    if shutil.which("frama-c") is None:
        return None
    done = subprocess.run(["frama-c", "-version"], capture_output=True, text=True, check=True)
    return f"Frama-C {done.stdout.strip()}"


def prove(kind: str, precision: CPrecision, folder: Path) -> tuple[str, dict[str, int], str]:
    """Export a kind into `folder` and run its script.

    Returns
    -------
    tuple
        What it is stored under; what was left; and all that the script said.
    """
    magnet = measure.magnets()[kind]
    of = measure.BEARING
    made = export_c(of, magnet, folder, kind=kind, precision=precision, prefix="filter")
    done = subprocess.run(
        ["sh", str(made.folder / "proof" / "prove.sh")], capture_output=True, text=True
    )
    said = {what: (int(alarms), int(left)) for what, alarms, left in SAID.findall(done.stdout)}
    if set(said) != {"finite", "any"}:
        raise RuntimeError(done.stdout + done.stderr)
    left = {"finite": said["finite"][0], "any": said["any"][0], "open": said["any"][1]}
    return stored_as(kind, precision), left, done.stdout


def stored_as(kind: str, precision: CPrecision) -> str:
    """Return what the proof of a kind is stored under."""
    estimator = KINDS[kind].make(measure.BEARING, measure.magnets()[kind])
    return f"{cost.made_of(estimator)}, {precision}"


def table() -> str:
    """Return what is stored of all kinds, as the table of ``firmware/README.md``."""
    stored = json.loads(proof.STORED.read_text(encoding="utf-8"))["filters"]
    lines = ["| filter | float | double |", "| --- | --- | --- |"]
    for kind in NAMES:
        found = [stored.get(stored_as(kind, precision)) for precision in PRECISIONS]
        cells = " | ".join("not run" if left is None else _in_words(left) for left in found)
        lines.append(f"| {KINDS[kind].label} | {cells} |")
    return "\n".join(lines) + "\n"


def _in_words(left: dict[str, int]) -> str:
    return f"{left['finite']}, {left['any']}, {left['open']}"


def main(kinds: list[str]) -> None:
    """Prove these kinds, and store what came out."""
    stored: dict[str, Any] = json.loads(proof.STORED.read_text(encoding="utf-8"))
    stored["tool"] = tool()
    for kind in kinds:
        for precision in PRECISIONS:
            with tempfile.TemporaryDirectory() as folder:
                name, left, said = prove(kind, precision, Path(folder) / "out")
            print(name, said, sep="\n", flush=True)
            stored["filters"][name] = left
            files.write_text(proof.STORED, json.dumps(stored, indent=2) + "\n")
    print(table(), end="")


if __name__ == "__main__":
    if tool() is None:
        sys.exit("not there: frama-c; apt-get install --no-install-recommends frama-c-base")
    asked = sys.argv[1:]
    main(list(NAMES) if asked in ([], ["all"]) else asked)
