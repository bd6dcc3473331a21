"""Figure and description of an expert."""

from typing import Any

import numpy as np

from ambkit import _core
from ambkit.base.arrays import Array
from ambkit.base.escaping import markdown
from ambkit.machine.stiffness import StiffnessMap
from ambkit.result.card import Card, value
from ambkit.result.report import Axis, Figure, Heatmap, Item, Line, Panel

CURRENT = Axis("control current $i_u$", "A")
PLACE = Axis("displacement $x$", "mm", 1e3)


def training_figure(expert: Any, stiff: StiffnessMap) -> Figure:
    """Plot the learning curve of an expert, and its force error over the range."""
    iu, x = (_fine(nodes[0], nodes[-1]) for nodes in (stiff.current, stiff.displacement))
    grid = np.meshgrid(iu, x)
    off = expert.force(*grid) - np.asarray(stiff.force(*grid))
    surface = Heatmap(iu, x, off, Axis("force error", "N"), diverging=True)
    return Figure(
        id="training",
        title=_title(expert),
        caption="The learning curve counts from the untrained network on.",
        panels=[
            _learning(expert),
            Panel(CURRENT, PLACE, [surface], title="force of the expert minus the training force"),
            *_stiffnesses(expert, iu, x),
        ],
        columns=2,
    )


def expert_figure(expert: Any) -> Figure:
    """Plot an expert over its range, and its learning curve if it was trained."""
    iu, x = _fine(*expert.current_range), _fine(*expert.displacement_range)
    force = Heatmap(iu, x, expert.force(*np.meshgrid(iu, x)), Axis("force", "N"), diverging=True)
    return Figure(
        id="expert",
        title=_title(expert),
        caption="",
        panels=[
            *_stiffnesses(expert, iu, x),
            Panel(CURRENT, PLACE, [force], title="force"),
            *([_learning(expert)] if expert.training else []),
        ],
        columns=2,
    )


def _title(expert: Any) -> str:
    return f"Expert of {len(expert.rules)} rules for {markdown(expert.source)}"


def _fine(low: float, high: float) -> Array:
    return np.linspace(low, high, 81)


def _learning(expert: Any) -> Panel:
    curve = expert.learning_curve
    learning: list[Item] = [
        Line(np.arange(curve.size, dtype=float), curve, signal="estimate", label="")
    ]
    return Panel(
        Axis("step of the training"), Axis("force error", "N rms"), learning, title="learning curve"
    )


def _stiffnesses(expert: Any, iu: Array, x: Array) -> list[Panel]:
    """Plot the slopes of the force, and the stiffnesses of the rules."""
    grid = np.meshgrid(iu, x)
    slopes = expert.in_core(_core).tangent(*(axis.ravel() for axis in grid))
    kinds = {
        "tangent {}, the slope of the force": [k.reshape(grid[0].shape) for k in slopes],
        "chord {}, from the origin to the force": expert.stiffness(*grid),
    }
    values = Axis("$k_i$", "N/A"), Axis("$k_s$", "N/mm", 1e-3)
    return [
        Panel(CURRENT, PLACE, [Heatmap(iu, x, k, axis)], title=title.format(axis.label))
        for title, pair in kinds.items()
        for k, axis in zip(pair, values, strict=True)
    ]


def expert_card(of: Any) -> Card:
    """Describe an expert by its range, its rules and its training."""
    (low_i, high_i), (low_x, high_x) = of.current_range, of.displacement_range
    rows = [
        ("rules", str(len(of.rules))),
        ("control current", f"{value(low_i, 'A')} to {value(high_i, 'A')}"),
        ("displacement", f"{value(low_x, 'm')} to {value(high_x, 'm')}"),
        ("memberships", "divided by their sum" if of.normalised else "as printed (eq. 33)"),
    ]
    if of.training is not None:
        first, last = of.training.force_rms[0], of.training.force_rms[-1]
        rows.append(("trained by", of.training.method))
        rows.append(("force error", f"{value(first, 'N')} untrained, {value(last, 'N')} trained"))
    return Card("Expert", rows, expert_figure(of), notes=[f"Of {of.source}."])
