"""Where a trained stiffness has the wrong sign."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambkit.fuzzy.expert import Expert
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import evaluate_stiffness, magnet_of

CLEAR = 0.2
"""The law's k_i or k_s is clearly positive from this part of its largest on."""


@dataclass(frozen=True)
class WrongSign:
    """Where a trained stiffness is not positive though the bearing's law is clearly so."""

    share: float  #: Of the box.
    current: float  #: The worst place [A], [m].
    displacement: float
    least: float  #: The trained stiffness there, and the law's [N/A] or [N/m].
    law: float


def wrong_signs(expert: Expert, bearing: Machine) -> dict[str, WrongSign]:
    """Return where a trained k_i or k_s is not positive though the bearing's law is clearly so."""
    # Towards the ends of a one-sided magnet's box the law's own k_i and k_s, which share the force
    # between them, go through zero; there a sign tells nothing.
    box = range_grid(expert)
    results = {}
    known = evaluate_stiffness(magnet_of(bearing), *box)
    for name, values, law in zip(("k_i", "k_s"), expert.stiffness(*box), known, strict=True):
        wrong = (values <= 0) & (law > CLEAR * law.max())
        if wrong.any():
            worst = np.unravel_index(np.argmin(np.where(wrong, values, np.inf)), values.shape)
            at = [float(item[worst]) for item in (*box, values, law)]
            results[name] = WrongSign(float(wrong.mean()), *at)
    return results


def range_grid(expert: Expert) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return currents [A] and displacements [m] over the range of an expert, (41, 41) each."""
    iu, x = np.meshgrid(
        np.linspace(*expert.current_range, 41), np.linspace(*expert.displacement_range, 41)
    )
    return iu, x
