"""What Frama-C's Eva shows of an exported filter or controller, and what is recorded of it.

``proof/prove.sh`` of an export analyses its C with the numbers of one rig. Results for the bearing
of the tests are in ``proof.json`` (``python -m firmware.proof``, ``tests/test_proof.py``).
"""

from __future__ import annotations

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
"""Files, and by which template."""

OPTIONS = (
    "-eva-slevel 6 -eva-subdivide-non-linear 8"
    " -eva-slevel-function amb_{tag}_envelope_bounds:200,rest_in_the_middle:40{others}"
    " -eva-auto-loop-unroll 128 -eva-split-return auto -eva-widening-delay 10"
)
"""How finely Eva looks: squares are not negative, loops unrolled, and the ways through the bounds
kept apart."""


@dataclass(frozen=True)
class Proof:
    """What two analyses left of one kind of filter."""

    finite: int  #: Alarms that were left, of any finite inputs, and of NaN and infinities as well.
    any: int
    open: int  #: Outputs of the second that are not shown to be finite.
    tool: str  #: Frama-C's version.

    @property
    def whole(self) -> bool:
        """Whether nothing was left."""
        return self.finite == self.any == self.open == 0


def stored_as(filter: Estimator, precision: CPrecision, control: Control | None = None) -> str:
    """Return what the proof of a kind is stored under, or that of a controller with it."""
    law = ""
    if control is not None:
        law = "lqg" if control.type == "lqg" else "pid"
        law += f" of the {control.feedback or 'estimate'}, "
        law += "feed-forward, " if control.feed_forward else ""
        law += "blocks, " if control.block else ""
    return f"{law}{cost.made_of(filter)}, {precision}"


def recorded(
    filter: Estimator, precision: CPrecision, control: Control | None = None, *, editable: bool
) -> Proof | None:
    """Return what is stored of an estimator's kind; None where that was not tried."""
    if not filter.engine.built_in or editable:
        return None
    stored = cost.stored(STORED)
    of = stored["filters" if control is None else "controllers"]
    result = of.get(stored_as(filter, precision, control))
    return None if result is None else Proof(**result, tool=stored["tool"])


def outputs(states: list[str], export: Export) -> list[str]:
    """Return the numbers of a step's struct, each as C names it."""
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
    """Return what the files of the proof say."""
    filter, one = export.filter, export.one
    sources = [text for name, text in export.core_files.items() if name.endswith(".c")]
    uses = {
        called: any(f"{called}(" in text for text in sources)
        for called in ("amb_exp_negative", "amb_root")
    }
    contracts = [called for called, used in uses.items() if used]
    by_contract = f" -eva-use-spec {','.join(contracts)}" if contracts else ""
    models = filter.core.own.get("n", 0)  # their number is data, no constant that Eva sees
    by_model = f" -eva-min-loop-unroll {models + 1}" if models else ""
    others = ",hold_each:60" if models else ""  # the ways through the bounds of each model
    others += "" if export.controller is None else ",see:60"
    return {
        "outputs": outputs([state.field for state in context["states"]], export),
        "options": OPTIONS.format(tag=context["tag"], others=others) + by_model + by_contract,
        "recorded": recorded(
            filter, export.precision, None if one is None else one.pid,
            editable=export.editable,
        ),
        "uses_exponential": uses["amb_exp_negative"],
        "uses_root": uses["amb_root"],
    }  # fmt: skip
