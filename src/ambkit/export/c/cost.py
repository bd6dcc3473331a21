"""Cost of an exported filter on a Cortex-M4F: instructions per step, flash and memory.

Measured (``firmware/``) and stored in ``cost.json``: float, gcc, in qemu, which counts
instructions, not cycles. Other machines change the numbers by a few instructions.
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base.units import engineering
from ambkit.estimate.estimator import Estimator
from ambkit.export.c.c_literals import arrays_of
from ambkit.machine.magnets import core_module
from ambkit.result.row import Row, put

STORED = Path(__file__).with_name("cost.json")

CLOCK = 168e6  #: Clock of an STM32F4 [Hz].

CYCLES_PER_INSTRUCTION = 1.4
"""Assumed without wait states: of 300 instructions of the linear filter about 70 load or store a
float (2 cycles), one divides (14), ten branch (3); the rest takes one cycle each (ARM, Cortex-M4
technical reference manual).
"""

_REAL = 4  # bytes of a float


@dataclass(frozen=True)
class Cost:
    """Cost of one filter."""

    #: Instructions of a step: typical, and the most observed, with a fault.
    instructions: int
    most: int
    bound: int  #: Maximum of a step on any path through its code.
    #: Instructions of the step without input checks, of the paper's filter only.
    trusted: int | None
    code: int  #: Flash [bytes].
    constants: int
    state: int  #: Memory of an instance [bytes], the caller's.
    stack: int  #: Stack of a step [bytes].
    selftest: int | None  #: Instructions of the complete self-test; None if not counted.
    compiler: str  #: Name, version and flags of the compiler.

    def highest_rate(self, clock: float) -> float:
        """Return the highest sampling rate [Hz] on a processor with this clock [Hz]."""
        return clock / (self.most * CYCLES_PER_INSTRUCTION)

    def rows(self, clock: float) -> list[Row]:
        """Return the cost on a processor with this clock [Hz]."""
        cycles = f"{CYCLES_PER_INSTRUCTION} cycles an instruction assumed"
        return put([
            Row("instructions", "instructions per step, typical", self.instructions),
            Row("most", "  maximum observed", self.most),
            Row("bound", "  worst case (any path)", self.bound),
            Row("trusted", "  without checks of the input", self.trusted),
            Row("code", "code [byte]", self.code),
            Row("constants", "constants [byte]", self.constants),
            Row("state", "state of an instance [byte]", self.state),
            Row("stack", "stack, maximum observed [byte]", self.stack),
            Row("selftest", "instructions of the self-test", self.selftest, detail=True),
            Row("compiler", "compiler", self.compiler, detail=True),
            Row("clock", "clock", clock, "Hz", detail=True),
            Row("highest_rate", "highest sampling rate", self.highest_rate(clock), "Hz", 3,
                note=f"at {engineering(clock, 'Hz')}, {cycles}"),
        ], section=("cost",))  # fmt: skip


def of(filter: Estimator) -> Cost | None:
    """Return the stored cost of a float filter; None if it was not measured."""
    if not filter.engine.built_in:
        return None
    known = stored(STORED)
    figures = known["estimators"].get(made_of(filter))
    if figures is None:
        return None
    held = _held(filter).parameters
    of_rules = round(held.get("rules", 0) * figures.get("instructions_a_rule", 0))
    by_rules = round(held.get("rules", 0) * figures.get("bound_a_rule", 0))
    trusted = figures["trusted"]
    return Cost(
        instructions=figures["instructions"] + of_rules,
        most=figures["most"] + of_rules,
        bound=figures["bound"] + by_rules,
        trusted=None if trusted is None else trusted + of_rules,
        constants=figures["constants_without_arrays"] + bytes_of_arrays(filter),
        **{key: figures[key] for key in ("code", "state", "stack", "selftest")},
        compiler=known["compiler"],
    )


def made_of(filter: Estimator) -> str:
    """Return the key of all that determines a step's instructions, but an expert's rules."""
    own = filter.core.own
    parts = [type(filter.core).__name__]
    if "n" in own:
        parts.append(f"{own['n']} models")
    if own.get("brief", False):
        parts.append("short contacts")
    inner: Estimator | None = getattr(filter, "inner", None)
    if inner is not None:
        results = [name for name in ("measurement", "disturbance") if own[name]]
        often = "every sample" if own["window"] == 1 else "by windows"
        parts += [" and ".join(results), often, type(inner.core).__name__]
    return ", ".join([*parts, type(_held(filter)).__name__])


def bytes_of_arrays(filter: Estimator) -> int:
    """Return the flash of its magnet's arrays [bytes]."""
    held = arrays_of(_held(filter).parameters)
    return _REAL * sum(np.asarray(values).size for values in held.values())


def _held(filter: Estimator) -> Any:
    """Return the core's magnet of an estimator."""
    return filter.magnet.in_core(core_module(filter.precision))


@cache
def stored(path: Path) -> dict[str, Any]:
    """Return stored measurements of costs or proofs."""
    figures: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return figures
