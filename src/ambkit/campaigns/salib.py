"""SALib's problem dictionary, in and out: how others state what varies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.campaigns.distributions import Normal, NormalOf, OneOf, Truncated, Uniform, UniformOn

if TYPE_CHECKING:
    from ambkit.campaigns.distributions import Varied
    from ambkit.campaigns.plan import Plan


def problem_of(plan: Plan) -> dict[str, Any]:
    """Return what varies as SALib has it: names, bounds and distributions, in SI."""
    # A choice is its index, even from 0 to the number of its values.
    bounds: list[list[float]] = []
    dists: list[str] = []
    for of in plan.marginals:
        if isinstance(of, UniformOn):
            bounds.append([of.low, of.high])
            dists.append("unif")
        elif isinstance(of, OneOf):
            bounds.append([0.0, float(len(of.values))])
            dists.append("unif")
        elif isinstance(of, NormalOf) and np.isfinite([of.low, of.high]).all():
            bounds.append([of.low, of.high, of.mean, of.std])
            dists.append("truncnorm")
        elif isinstance(of, NormalOf):
            bounds.append([of.mean, of.std])
            dists.append("norm")
    names = list(plan.names)
    return {"num_vars": len(names), "names": names, "bounds": bounds, "dists": dists}


def vary_from(problem: Mapping[str, Any]) -> tuple[Varied, ...]:
    """Return what varies by SALib's problem dictionary, whose names are keys and values in SI."""
    names, bounds = problem.get("names"), problem.get("bounds")
    if not isinstance(names, list | tuple) or bounds is None or len(names) != len(bounds):
        raise AmbkitError("a problem of SALib has as many bounds as names")
    dists = problem.get("dists") or ["unif"] * len(names)
    if len(dists) != len(names):
        raise AmbkitError(f"a problem of SALib has as many dists as names, {len(names)}")
    results: list[Varied] = []
    for name, ends, dist in zip(names, bounds, dists, strict=True):
        values = [float(end) for end in ends]
        match dist, values:
            case "unif", [low, high]:
                results.append(Uniform(what=name, low=low, high=high))
            case "norm", [mean, std]:
                results.append(Normal(what=name, mean=mean, std=std))
            case "truncnorm", [low, high, mean, std]:
                results.append(Truncated(what=name, low=low, high=high, mean=mean, std=std))
            case _:
                raise AmbkitError(
                    f"{name}: a study has no distribution {dist!r} with {len(values)} numbers; it "
                    "has unif, norm, truncnorm"
                )
    return tuple(results)
