"""Proof of an exported filter or controller by Frama-C's Eva, and recorded results.

``proof/prove.sh`` of an export analyses its C with its constants. Results for the machine of the
tests are in ``proof.json``, with hashes of the C that was analysed (``python -m firmware.proof``,
``tests/test_proof.py``).
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ambkit.control.control import Control
from ambkit.estimate.estimator import Estimator
from ambkit.export.c import cost
from ambkit.export.c.c_literals import CPrecision
from ambkit.export.c.exported import Export

STORED = Path(__file__).with_name("proof.json")

TEMPLATES = {
    "proof/{}_proof.c": "proof.c", "proof/prove.sh": "prove.sh", "proof/README.md": "PROOF.md",
}  # fmt: skip
"""Files and their templates."""

OPTIONS = (
    "-eva-slevel 6 -eva-subdivide-non-linear 8"
    " -eva-slevel-function amb_{tag}_envelope_bounds:200,rest_at_centre:40{others}"
    " -eva-auto-loop-unroll 128 -eva-split-return auto -eva-widening-delay 10"
)
"""Precision of Eva: squares are not negative, loops unrolled, and paths through the bounds
separated.
"""


@dataclass(frozen=True)
class Proof:
    """Results of two analyses of one kind of filter."""

    finite: int  #: Remaining alarms, for any finite inputs, and with NaN and infinities too.
    any: int
    open: int  #: Outputs of the second that are not proved to be finite.
    core: str  #: Hashes of the files of the core, and of all that was analysed.
    text: str
    tool: str  #: Frama-C's version.

    @property
    def complete(self) -> bool:
        """Whether nothing remained."""
        return self.finite == self.any == self.open == 0


def stored_as(filter: Estimator, precision: CPrecision, control: Control | None = None) -> str:
    """Return the key of a kind's proof, or of a controller with it."""
    law = ""
    if control is not None:
        law = "lqg" if control.type == "lqg" else "pid"
        law += f" of the {control.feedback or 'estimate'}, "
        law += "feed-forward, " if control.feed_forward else ""
        law += "blocks, " if control.block else ""
    return f"{law}{cost.made_of(filter)}, {precision}"


_IGNORED = re.compile(
    r"/\*(?!@).*?\*/|^#[ !][^\n]*|(?<=\bamb_)[fd][0-9a-f]{6}_|(?<=\bAMB_CORE_)[FD][0-9A-F]{6}\b",
    re.DOTALL | re.MULTILINE,
)
"""What does not change a proof: comments, but for those to the prover, and the tag of the core."""


def hashed(files: Mapping[str, str]) -> str:
    """Return a hash of the C and the script that Eva analyses, of the files of an export."""
    digest = hashlib.sha256()
    for name, text in sorted(files.items()):
        other = name.startswith("selftest/") or name.endswith("/precision.h")  # renames the core
        if name.endswith((".c", ".h", ".sh")) and not other:
            digest.update(" ".join([name, *_IGNORED.sub("", text).split()]).encode() + b"\0")
    return digest.hexdigest()[:16]


def recorded(export: Export) -> Proof | None:
    """Return the recorded proof of an export's kind; None if there is none of this C."""
    if not export.filter.engine.built_in or export.editable:
        return None
    stored, control = cost.stored(STORED), None if export.one is None else export.one.pid
    of = stored["filters" if control is None else "controllers"]
    result = of.get(stored_as(export.filter, export.precision, control))
    proof = None if result is None else Proof(**result, tool=stored["tool"])
    return proof if proof and proof.core == hashed(export.core_files) else None


def outputs(states: list[str], export: Export) -> list[str]:
    """Return the numbers of a step's struct, by their names in C."""
    machine, one = export.filter.machine, export.one
    if one is not None:
        coils = (f"coil[{k}]" for k in range(one.coils))
        return [*coils, "iu", "u", *states, "innovation", "variance"]
    if not export.several:
        return [*states, "k_i", "k_s", "innovation", "variance"]
    axes, readings = range(len(machine.axes)), range(len(machine.readings))
    names = [*states, *(f"{what}[{k}]" for what in ("k_i", "k_s") for k in axes)]
    names += [f"{what}[{k}]" for what in ("innovation", "variance") for k in readings]
    if not export.beside:
        return names
    of_axes = ("iu[{}]", "u[{}]", "coil[{}][0]", "coil[{}][1]")
    return [*(f"estimates.{name}" for name in names), *(w.format(k) for w in of_axes for k in axes)]


def context(export: Export, context: dict[str, Any]) -> dict[str, Any]:
    """Return the template variables of the proof."""
    filter = export.filter
    sources = [text for name, text in export.core_files.items() if name.endswith(".c")]
    uses = {
        called: any(f"{called}(" in text for text in sources)
        for called in ("amb_exp_negative", "amb_root")
    }
    contracts = [called for called, used in uses.items() if used]
    by_contract = f" -eva-use-spec {','.join(contracts)}" if contracts else ""
    models = filter.core.own.get("n", 0)  # their number is data, not a constant for Eva
    by_model = f" -eva-min-loop-unroll {models + 1}" if models else ""
    others = ",hold_each:60" if models else ""  # the paths through the bounds of each model
    others += "" if export.controller is None else ",see:60"
    return {
        "outputs": outputs([state.field for state in context["states"]], export),
        "options": OPTIONS.format(tag=context["tag"], others=others) + by_model + by_contract,
        "recorded": recorded(export),
        "uses_exponential": uses["amb_exp_negative"],
        "uses_root": uses["amb_root"],
    }  # fmt: skip
