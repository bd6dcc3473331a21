"""The force laws of magnets (models/laws). Written by `python -m models`; do not edit."""

import math
from dataclasses import dataclass
from typing import Any

from ambkit.base.config import Part
from ambkit.base.errors import AmbkitError
from ambkit.machine.force_law import MU_0, ForceLaw, IsolatedAxis, Law


class LawKeys(Part):
    """The keys of ``[magnet]`` that laws add to the common ones."""


@dataclass(frozen=True)
class ClosedLaw(ForceLaw):
    """The closed force law, two-sided or one-sided.

    Parameters
    ----------
    machine : Machine
        A machine with one axis.

    References
    ----------
    Paper, eq. 1, first equality: ideal iron.
    """

    name = "closed"
    ideal = True

    @classmethod
    def parameters_of(cls, m: Any) -> dict[str, float]:
        return {"k": m.magnet_constant, "s0": m.air_gap, "i0": m.bias_current}


@dataclass(frozen=True)
class SaturatingLaw(ForceLaw):
    """The force law of saturating iron, two-sided or one-sided.

    Parameters
    ----------
    machine : Machine
        A machine with one axis.

    References
    ----------
    Froehlich, Investigations of dynamoelectric machines and electric power transmission, 1881.
    """

    name = "saturating"
    ideal = False

    @classmethod
    def holds_for(cls, m: Any) -> bool:
        return m.saturation is not None

    @classmethod
    def parameters_of(cls, m: Any) -> dict[str, float]:
        return {
            "k": m.magnet_constant,
            "s0": m.air_gap,
            "i0": m.bias_current,
            "iron": (m.iron_length or 0.0) / (2 * (m.relative_permeability or math.inf)),
            "knee": MU_0 * (m.turns or 0) / (2 * (m.saturation or math.inf)),
        }


LAWS: tuple[type[ForceLaw], ...] = (ClosedLaw, SaturatingLaw)
"""All laws; of each magnet one holds, the first where no other does."""


def law_of(machine: IsolatedAxis) -> Law:
    """Return the law that a magnet's description states, whatever force map it has."""
    laws = [law for law in LAWS if law.holds_for(machine.magnet)] or [LAWS[0]]
    if len(laws) > 1:
        names = ", ".join(law.__name__ for law in laws)
        raise AmbkitError(f"magnet: must have one force law, its keys state {names}")
    return laws[0](machine)
