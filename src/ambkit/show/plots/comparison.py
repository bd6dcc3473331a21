"""Errors of several filters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from operator import methodcaller
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.escaping import label as escaped
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Bars, Item, Rule
from ambkit.show.plots.signal_styles import looks

if TYPE_CHECKING:
    from ambkit.judge.comparison import Score


def comparison_figure(scores: Mapping[str, Mapping[str, Score]], what: str = "step") -> Figure:
    """Show the errors of several filters as bars."""
    axes = {
        "x": Axis("error of position", "µm rms", 1e6),
        "v": Axis("error of velocity", "mm/s rms", 1e3),
        "f_d": Axis("error of disturbance force", "N rms"),
    }
    cases, names = list(scores), list(next(iter(scores.values())))

    def bars(
        figure_of: Callable[[Score], float], spread_of: Callable[[Score], float]
    ) -> list[Item]:
        return [
            Bars(
                [escaped(case) for case in cases],
                np.array([figure_of(scores[case][name]) for case in cases]),
                np.array([spread_of(scores[case][name]) for case in cases]),
                signal=style,
                label=label,
            )
            for name, (style, label) in zip(names, looks(names), strict=True)
        ]

    errors = [
        Panel(Axis(what), axis, bars(methodcaller("mean", signal), methodcaller("spread", signal)))
        for signal, axis in axes.items()
    ]
    nis = bars(lambda score: float(score.nis.mean()), lambda score: float(score.nis.std()))
    return Figure(
        id="comparison",
        title="Errors of the filters",
        caption="Means over the seeds; error bars: standard deviation over them.",
        panels=[
            *errors,
            Panel(Axis(what), Axis("mean NIS"), [*nis, Rule(1.0, signal="bound", label="")]),
        ],
        columns=2,
    )
