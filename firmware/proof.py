"""Prove anew what ``proof/README.md`` of an export records: ``python -m firmware.proof all``.

Kinds may be named in place of ``all``. Each is exported in both precisions, alone and with its
controllers, and its ``proof/prove.sh`` is run, minutes each, where its C is not that of the stored
result. The results are stored with hashes of the C, and are the table of ``firmware/README.md``.
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
from ambkit.control.control import Control
from ambkit.estimate.registry import KINDS
from ambkit.export.c import CExport, export_c, proof
from ambkit.export.c.c_literals import CPrecision
from ambkit.machine.magnets import Precision
from ambkit.simulation.scenario import Scenario
from firmware import measure

NAMES = tuple(name for name in KINDS if name not in ("steady-state", measure.UNMEASURED))
"""Kinds; what is steady-state is an observer, the same C with other numbers."""

PRECISIONS: tuple[CPrecision, ...] = ("float", "double")

CONTROLLERS = {
    "PID of the estimate": Control(),
    "PID of the reading": Control(feedback="measurement"),
    "PID and feed-forward of the estimate": Control(feed_forward=0.5),
    "LQG": Control(type="lqg"),
}
"""Controllers that are proved, with the linear filter."""

SAID = re.compile(r"^(finite|any) inputs: (\d+) alarms, (\d+) outputs", re.MULTILINE)


def tool() -> str | None:
    """Return Frama-C's name and version; None where it is not installed."""
    if shutil.which("frama-c") is None:
        return None
    done = subprocess.run(["frama-c", "-version"], capture_output=True, text=True, check=True)
    return f"Frama-C {done.stdout.strip()}"


def exported(
    kind: str, precision: CPrecision, folder: Path, control: Control | None = None
) -> CExport:
    """Export the kind that is proved into `folder`, or a controller that it feeds."""
    of_core: Precision = "float32" if precision == "float" else "float64"
    bearing = measure.bearing_of(kind)
    filter = KINDS[kind].make(bearing, measure.magnets()[kind], precision=of_core)
    scenario = None if control is None else Scenario(controller=control)
    return export_c(bearing, filter, folder, prefix="filter", scenario=scenario)


def hashes(made: CExport) -> dict[str, str]:
    """Return hashes of an export's files of the core, and of all that is analysed."""
    texts = {file: files.read_text(made.folder / file) for file in made.files}
    core = {file: text for file, text in texts.items() if file.startswith("core/")}
    return {"core": proof.hashed(core), "text": proof.hashed(texts)}


def prove(made: CExport) -> tuple[dict[str, Any], str]:
    """Run the script of an export; returns what is stored, and all that the script printed."""
    done = subprocess.run(
        ["sh", str(made.folder / "proof" / "prove.sh")], capture_output=True, text=True
    )
    said = {what: (int(alarms), int(left)) for what, alarms, left in SAID.findall(done.stdout)}
    if set(said) != {"finite", "any"}:
        raise RuntimeError(done.stdout + done.stderr)
    left = {"finite": said["finite"][0], "any": said["any"][0], "open": said["any"][1]}
    return left | hashes(made), done.stdout


def stored_as(kind: str, precision: CPrecision, control: Control | None = None) -> str:
    """Return what the proof of a kind is stored under, or of a controller that it feeds."""
    estimator = KINDS[kind].make(measure.BEARING, measure.magnets()[kind])
    return proof.stored_as(estimator, precision, control)


def controllers(kind: str) -> dict[str, Control]:
    """Return the controllers that are proved with a kind, by their names."""
    return CONTROLLERS if kind == "linear" else {}


def table() -> str:
    """Return what is stored of all kinds, as the table of ``firmware/README.md``."""
    stored = json.loads(proof.STORED.read_text(encoding="utf-8"))
    lines = ["| filter or controller | float | double |", "| --- | --- | --- |"]
    for kind in NAMES:
        rows = {KINDS[kind].label: (stored["filters"], None)}
        rows |= {
            f"{law} with it": (stored["controllers"], control)
            for law, control in controllers(kind).items()
        }
        for label, (of, control) in rows.items():
            found = [of.get(stored_as(kind, precision, control)) for precision in PRECISIONS]
            cells = " | ".join("not run" if left is None else _in_words(left) for left in found)
            lines.append(f"| {label} | {cells} |")
    return "\n".join(lines) + "\n"


def _in_words(left: dict[str, Any]) -> str:
    return f"{left['finite']}, {left['any']}, {left['open']}"


def main(kinds: list[str]) -> None:
    """Prove these kinds, and store what came out."""
    stored: dict[str, Any] = json.loads(proof.STORED.read_text(encoding="utf-8"))
    if stored["tool"] != tool():  # results of another prover are not this one's
        stored = {"tool": tool(), "filters": {}, "controllers": {}}
    tried = [
        (kind, precision, control)
        for kind in kinds
        for control in (None, *controllers(kind).values())
        for precision in PRECISIONS
    ]
    for kind, precision, control in tried:
        name = stored_as(kind, precision, control)
        of = stored["filters" if control is None else "controllers"]
        with tempfile.TemporaryDirectory() as folder:
            made = exported(kind, precision, Path(folder) / "out", control)
            if of.get(name, {}).items() >= hashes(made).items():
                continue
            of[name], said = prove(made)
        print(name, said, sep="\n", flush=True)
        files.write_text(proof.STORED, json.dumps(stored, indent=2) + "\n")
    print(table(), end="")


if __name__ == "__main__":
    if tool() is None:
        sys.exit("not there: frama-c; apt-get install --no-install-recommends frama-c-base")
    asked = sys.argv[1:]
    main(list(NAMES) if asked in ([], ["all"]) else asked)
