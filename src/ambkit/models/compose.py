"""From the parts of a machine to its sampled model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambkit.models.declaration import Part, Plan
from ambkit.models.model import Model
from ambkit.models.sampling import Sampling


def compose(parts: Sequence[Part], T: float, *, name: str = "model") -> Model:
    """Return the model of a machine, sampled."""
    if not (np.isfinite(T) and T > 0):
        raise ValueError(f"T must be positive, is {T!r}")
    plan = Plan(T)
    for part in parts:
        plan.add(part)
    plan.check()
    return Sampling(plan).model(name)
