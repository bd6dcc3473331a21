"""Blocks behind a PID, registered here."""

from collections.abc import Iterable, Sequence
from typing import Annotated

from pydantic import BeforeValidator, Field

from ambkit.base.errors import AmbkitError
from ambkit.control.blocks.block import Biquad, Block, LeadLag, Notch, SecondOrder
from ambkit.control.blocks.state_space import StateSpace, as_block

AnyBlock = Annotated[
    Annotated[Biquad | LeadLag | Notch | SecondOrder | StateSpace, Field(discriminator="type")],
    BeforeValidator(as_block),
]

MOST = 8  #: Maximum number of second-order sections behind a PID, ``AMB_SECTIONS`` of the core.
NOTHING = 1e-9  #: A static gain that counts as zero.


def sections_of(blocks: Sequence[Block], T: float) -> list[list[float]]:
    """Return the sections b0, b1, b2, a1, a2 of blocks in series at a sampling time [s]."""
    results = [section for block in blocks for section in block.sections(T)]
    if len(results) > MOST:
        raise AmbkitError(
            f"controller.block: there may be {MOST} sections of second order behind a PID, there "
            f"are {len(results)}"
        )
    if abs(gain_at_rest(results)) < NOTHING:
        raise AmbkitError("controller.block: no static gain, so the rotor's weight is not carried")
    return results


def gain_at_rest(sections: Iterable[Sequence[float]]) -> float:
    """Return the static gain of sections in series."""
    gain = 1.0
    for b0, b1, b2, a1, a2 in sections:
        gain *= (b0 + b1 + b2) / (1 + a1 + a2)
    return gain
