"""What is shown of an exported filter by abstract interpretation (Frama-C's Eva), and recorded.

The analysis takes the exported C as it is, with the numbers of one rig: ``proof/prove.sh`` of an
export runs it. What came out for the bearing of the tests is stored in ``proof.json``
(``python -m firmware.proof``), by what decides over the C that runs; ``tests/test_proof.py`` runs
it again.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.export.c import cost

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.export.c.data import CPrecision

STORED = Path(__file__).with_name("proof.json")

OPTIONS = (
    "-eva-slevel 6 -eva-subdivide-non-linear 8"
    " -eva-slevel-function amb_{tag}_envelope_bounds:200,rest_in_the_middle:40{of_each}"
    " -eva-auto-loop-unroll 128 -eva-split-return auto -eva-widening-delay 10"
)
"""How finely Eva looks: squares are not negative, loops unrolled, and the ways through the bounds
kept apart."""


@dataclass(frozen=True)
class Proof:
    """What two analyses left of one kind of filter.

    Attributes
    ----------
    finite, any : int
        Alarms that were left, of any finite inputs, and of NaN and infinities as well.
    open : int
        Outputs of the second that are not shown to be finite.
    tool : str
        Frama-C's version.
    """

    finite: int
    any: int
    open: int
    tool: str

    @property
    def whole(self) -> bool:
        """Whether nothing was left."""
        return self.finite == self.any == self.open == 0


def recorded(estimator: Estimator, precision: CPrecision, *, editable: bool) -> Proof | None:
    """Return what is stored of an estimator's kind; None where that was not tried."""
    if not estimator.engine.built_in or editable:
        return None
    stored = _stored()
    found = stored["filters"].get(f"{cost.made_of(estimator)}, {precision}")
    return None if found is None else Proof(**found, tool=stored["tool"])


def outputs(states: list[str], axes: int, sensors: int) -> list[str]:
    """Return the numbers of the estimates' struct, each as C names it.

    Parameters
    ----------
    states : list of str
        Their fields.
    axes, sensors : int
        Elements of the arrays; 0 where there is one of each, and no array.
    """

    def each(field: str, n: int) -> list[str]:
        return [f"{field}[{i}]" for i in range(n)] if n else [field]

    of_axes = [each(field, axes) for field in ("k_i", "k_s")]
    of_sensors = [each(field, sensors) for field in ("innovation", "variance")]
    return [*states, *(name for names in (*of_axes, *of_sensors) for name in names)]


@cache
def _stored() -> dict[str, Any]:
    read: dict[str, Any] = json.loads(STORED.read_text(encoding="utf-8"))
    return read


def context(
    estimator: Estimator, context: dict[str, Any], core_files: dict[str, str]
) -> dict[str, Any]:
    """Return what the files of the proof say.

    Parameters
    ----------
    estimator : Estimator
        What is exported.
    context : dict
        What the templates say.
    core_files : dict
        The core's files of the export, by their names.
    """
    several = context["several"]
    axes, sensors = (len(several["axes"]), len(several["readings"])) if several else (0, 0)
    fields = [state.field for state in context["states"]]
    asked = {name: text for name, text in core_files.items() if name.endswith(".c")}
    uses = {
        called: any(f"{called}(" in text for text in asked.values())
        for called in ("amb_exp_negative", "amb_root")
    }
    contracts = [called for called, used in uses.items() if used]
    by_contract = f" -eva-use-spec {','.join(contracts)}" if contracts else ""
    models = estimator.core.own.get("n", 0)  # their number is data, no constant that Eva sees
    by_model = f" -eva-min-loop-unroll {models + 1}" if models else ""
    of_each = ",hold_each:60" if models else ""  # the ways through the bounds of each model
    return {
        "outputs": outputs(fields, axes, sensors),
        "options": OPTIONS.format(tag=context["tag"], of_each=of_each) + by_model + by_contract,
        "recorded": recorded(estimator, context["precision"], editable=bool(context["editable"])),
        "uses_exponential": uses["amb_exp_negative"],
        "uses_root": uses["amb_root"],
    }
