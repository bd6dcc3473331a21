"""The expert, and the filter that asks it, from what a user names."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ambkit._core import MAX_RULES
from ambkit.assessment.arguments import arguments_of_the_user
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import in_si
from ambkit.fuzzy.rule_selection import Shape
from ambkit.fuzzy.training import train as train_network
from ambkit.machine.force_laws import isolated
from ambkit.machine.forces.force_points import ForcePoints, load_force_points
from ambkit.machine.machine import Machine
from ambkit.machine.stiffness import StiffnessMap
from ambkit.workflow.trained_expert import TrainedExpert
from ambkit.workflow.training import (
    RULES,
    check_within_gap,
    how_to_train,
    measured_force,
    train_expert,
)

AUTO = "auto"


def trained(
    machine: Machine | StiffnessMap, axis: str | None, rules: Any, *, reach: Any, method: str,
    plain: bool,
    scaling: str, source: Any, note: Callable[[str], None],
) -> TrainedExpert:  # fmt: skip
    """Train an expert on the law of a machine."""
    if isinstance(machine, StiffnessMap):
        expert = train_network(machine, **_how(method, plain, scaling))
        return TrainedExpert(None, expert, machine)
    shape = _shape(rules)
    if shape is None:
        raise AmbkitError("rules: auto needs points that were measured: train on a force map")
    with arguments_of_the_user():
        result = train_expert(
            isolated(machine, axis), shape, reach=in_si("reach", reach, "m"), note=note,
            **_how(method, plain, scaling),
        )  # fmt: skip
    return _named(result, source)


def trained_on_map(
    machine: Machine, force: Any, axis: str | None, rules: Any, *, channels: Any, law_error: Any,
    method: str, plain: bool, scaling: str, take: str | None, source: Any,
    note: Callable[[str], None],
) -> TrainedExpert:  # fmt: skip
    """Train an expert on a measured force, and compare it with law and surface."""
    shape, model, how = _shape(rules), isolated(machine, axis), _how(method, plain, scaling)
    error = in_si("law_error", law_error, "N")
    if error is not None and not error > 0:
        raise AmbkitError(f"law_error must be greater than 0 N, is {error:g} N")
    points = force if isinstance(force, ForcePoints) else load_force_points(force, channels)
    with arguments_of_the_user("force: "):
        check_within_gap(model, points)
    try:
        measured = measured_force(model, points, shape, law_error=error, note=note, **how)
    except AmbkitError as problem:
        raise AmbkitError(f"{force}: {problem}") from None
    result = train_expert(
        model, shape or RULES, measured=measured, take=take or "best", note=note, **how
    )
    return _named(result, source)


def _how(method: str, plain: bool, scaling: str) -> dict[str, Any]:
    weights = None if method == "steepest-gradient" else method == "least-squares"
    how = "least-squares" if method == "widths" else method
    return how_to_train(how, weights, normalised=not plain, scaling=scaling)


def _named(result: TrainedExpert, source: Any) -> TrainedExpert:
    return replace(result, source=source) if isinstance(source, str | os.PathLike) else result


def _shape(rules: Any) -> Shape | None:
    """Rules along current and displacement; None where they are to be chosen."""
    if rules == AUTO:
        return None
    sides = rules.lower().split("x") if isinstance(rules, str) else [str(side) for side in rules]
    if len(sides) != 2 or not all(side.isdecimal() for side in sides):
        raise AmbkitError(
            f"rules must be auto, or rules along current and displacement such as 7x5, is {rules!r}"
        )
    across, along = map(int, sides)
    if min(across, along) < 2 or across * along > MAX_RULES:
        raise AmbkitError(
            f"rules must be 2 or more in each direction, and {MAX_RULES} or less in total, is "
            f"{across}x{along}"
        )
    return across, along
