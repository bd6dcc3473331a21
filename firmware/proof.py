"""Prove anew what an export's ``proof/README.md`` records: ``python -m firmware.proof [KIND ...]``.

Each kind is exported in both precisions and its ``proof/prove.sh`` is run; minutes each.
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
    numbers = {"float": "float32", "double": "float64"}[precision]
    estimator = KINDS[kind].make(measure.BEARING, magnet, precision=numbers)
    done = subprocess.run(
        ["sh", str(made.folder / "proof" / "prove.sh")], capture_output=True, text=True
    )
    said = {what: (int(alarms), int(left)) for what, alarms, left in SAID.findall(done.stdout)}
    if set(said) != {"finite", "any"}:
        raise RuntimeError(done.stdout + done.stderr)
    left = {"finite": said["finite"][0], "any": said["any"][0], "open": said["any"][1]}
    return f"{cost.made_of(estimator)}, {precision}", left, done.stdout


def main(kinds: list[str]) -> None:
    """Prove these kinds, and store what came out."""
    stored: dict[str, Any] = json.loads(proof.STORED.read_text(encoding="utf-8"))
    stored["tool"] = tool()
    precisions: tuple[CPrecision, ...] = ("float", "double")
    for kind in kinds:
        for precision in precisions:
            with tempfile.TemporaryDirectory() as folder:
                name, left, said = prove(kind, precision, Path(folder) / "out")
            print(name, said, sep="\n", flush=True)
            stored["filters"][name] = left
            files.write_text(proof.STORED, json.dumps(stored, indent=2) + "\n")


if __name__ == "__main__":
    if tool() is None:
        sys.exit("not there: frama-c; apt-get install --no-install-recommends frama-c-base")
    main(sys.argv[1:] or [kind for kind in KINDS if kind != "steady-state"])
