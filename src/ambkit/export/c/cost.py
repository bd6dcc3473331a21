"""What an exported filter costs on a Cortex-M4F: instructions a step, flash and memory.

The figures are measured (``firmware/``) and stored in ``cost.json``: float, gcc, in qemu, which
counts instructions and no cycles.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.export.c.data import arrays_of

STORED = Path(__file__).with_name("cost.json")

CYCLES_PER_INSTRUCTION = 1.4
"""Assumed where code runs without wait states: of 300 instructions of the linear filter about 70
load or store a float (2 cycles), one divides (14), ten branch (3); the rest takes one cycle each
(ARM, Cortex-M4 technical reference manual)."""

_REAL = 4  # bytes of a float


@dataclass(frozen=True)
class Cost:
    """What one filter costs.

    Attributes
    ----------
    instructions, most : int
        Of a step, as a rule; and of the dearest one, where something was the matter.
    trusted : int
        Of the step that trusts its input.
    code, constants : int
        Flash [bytes].
    state : int
        Memory of each instance [bytes]; the caller's.
    stack : int
        Memory that a step borrows [bytes].
    compiler : str
        Name, version and flags of the compiler.
    """

    instructions: int
    most: int
    trusted: int
    code: int
    constants: int
    state: int
    stack: int
    compiler: str

    def highest_rate(self, clock: float) -> float:
        """Return how many steps a second [Hz] a processor with this clock [Hz] has time for."""
        return clock / (self.most * CYCLES_PER_INSTRUCTION)


def of(magnet: str, parameters: dict[str, Any]) -> Cost:
    """Return what a float filter costs, from the stored figures.

    Parameters
    ----------
    magnet : str
        The core's name of its magnet, such as ``"Table"``.
    parameters : dict
        What the core's magnet holds: its arrays add to the constants, its rules to the
        instructions.
    """
    stored = _stored()
    figures = stored["magnets"][magnet]
    of_rules = round(parameters.get("rules", 0) * figures.get("instructions_a_rule", 0))
    reals = sum(np.asarray(values).size for values in arrays_of(parameters).values())
    return Cost(
        instructions=figures["instructions"] + of_rules,
        most=figures["most"] + of_rules,
        trusted=figures["trusted"] + of_rules,
        code=figures["code"],
        constants=figures["constants_without_arrays"] + _REAL * reals,
        state=figures["state"],
        stack=figures["stack"],
        compiler=stored["compiler"],
    )


@cache
def _stored() -> dict[str, Any]:
    read: dict[str, Any] = json.loads(STORED.read_text(encoding="utf-8"))
    return read
