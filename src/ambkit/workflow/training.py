"""Training of an expert for k_i and k_s, on a force law or a measured force."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ambkit._core import MAX_RULES
from ambkit.arguments import arguments_of_the_user
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import in_si
from ambkit.base.units import engineering
from ambkit.fuzzy.cross_validation import choose_model
from ambkit.fuzzy.rule_selection import Shape, choose_rules, measured_map
from ambkit.fuzzy.training import train
from ambkit.machine.axes import isolated
from ambkit.machine.forces.force_points import ForcePoints, load_force_points
from ambkit.machine.forces.force_surface import ForceSurface
from ambkit.machine.machine import Machine
from ambkit.machine.stiffness import StiffnessMap, stiffness_map
from ambkit.workflow.trained_expert import MeasuredForce, TrainedExpert

RULES: Shape = (5, 5)  #: Default rules along current and displacement: the paper's.


def train_on_law(
    machine: Machine, shape: Shape = RULES, reach: float | None = None, *, weights: bool = True,
    **how: Any,
) -> TrainedExpert:  # fmt: skip
    """Train an expert on a machine's force law, over all currents."""
    travel = machine.clearance
    far = travel / 2 if reach is None else reach
    if not 0 < far <= travel:
        limit = engineering(travel, "m")
        raise ValueError(
            f"reach must be above 0 m and at most the travel, {limit}, is {engineering(far, 'm')}"
        )
    stiffness = stiffness_map(
        machine,
        currents=np.linspace(machine.current_min, machine.current_max, shape[0]),
        displacements=np.linspace(-far, far, shape[1]),
    )
    return TrainedExpert(machine, train(stiffness, weights=weights, **how), stiffness)


def check_within_gap(machine: Machine, points: ForcePoints) -> None:
    """Reject points outside the air gap."""
    gap, farthest = machine.magnet.air_gap, max(points.displacement.tolist(), key=abs)
    if abs(farthest) >= gap:
        raise ValueError(
            f"x must stay within the air gap, {engineering(gap, 'm')}, reaches "
            f"{engineering(farthest, 'm')}: is a unit, scale or offset wrong?"
        )


def measured_force(
    machine: Machine,
    points: ForcePoints,
    shape: Shape | None = RULES,
    *,
    law_error: float | None = None,
    note: Callable[[str], None] = lambda _text: None,
    **how: Any,
) -> MeasuredForce:
    """Fit the force to measured points, and evaluate its stiffnesses at the expert's rules."""
    check_within_gap(machine, points)
    surface = ForceSurface(machine, points, law_error)
    choice = None
    if shape is None:
        choice = choose_rules(machine, points, law_error=law_error, note=note, **how)
        shape = choice.chosen.shape
        note("training")
    stiffness = measured_map(machine, surface, shape)
    return MeasuredForce(surface, stiffness, choice, law_error is not None)


AUTO = "auto"


def trained(
    machine: Machine | StiffnessMap, axis: str | None, rules: Any, *, reach: Any, method: str,
    plain: bool, scaling: str, source: Any,
) -> TrainedExpert:  # fmt: skip
    """Train an expert on the force law of a machine."""
    how = _how(method, plain, scaling)
    if isinstance(machine, StiffnessMap):
        return TrainedExpert(None, train(machine, **how), machine)
    shape = _shape(rules)
    if shape is None:
        raise AmbkitError("rules: auto needs points that were measured: train on a force map")
    with arguments_of_the_user():
        model = isolated(machine, axis)
        result = train_on_law(model, shape, in_si("reach", reach, "m"), **how)
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
    stiffness = measured.stiffness
    expert = train(stiffness, **how)
    nodes = (stiffness.current.size, stiffness.displacement.size)
    models = choose_model(model, measured.surface, nodes, note, **how)
    return _named(TrainedExpert(model, expert, stiffness, measured, models, take), source)


def _how(method: str, plain: bool, scaling: str) -> dict[str, Any]:
    return {
        "method": "least-squares" if method == "widths" else method,
        "weights": method == "least-squares", "normalised": not plain, "scaling": scaling,
    }  # fmt: skip


def _named(result: TrainedExpert, source: Any) -> TrainedExpert:
    return replace(result, source=source) if isinstance(source, str | os.PathLike) else result


def _shape(rules: Any) -> Shape | None:
    """Return the rules along current and displacement; None if they are to be selected."""
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
