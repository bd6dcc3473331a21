"""From the parts of a machine to its sampled model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambkit.models.model import Model
from ambkit.models.plan import Part, Plan
from ambkit.models.sampling import Sampling


def compose(parts: Sequence[Part], T: float, *, name: str = "model") -> Model:
    """Return the model of a machine, sampled.

    Parameters
    ----------
    parts : sequence of parts
        Their states stand in this order.
    T : float
        Sampling time [s].
    name : str, optional
        What the kind of machine is called, an identifier of C.

    Raises
    ------
    ValueError
        A part names what no part declares, or two declare the same.
    """
    if not (np.isfinite(T) and T > 0):
        raise ValueError(f"T must be positive, is {T!r}")
    plan = Plan(T)
    for part in parts:
        plan.add(part)
    plan.check()
    return Sampling(plan).model(name)
