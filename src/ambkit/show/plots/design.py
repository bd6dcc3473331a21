"""The filters that a design tried."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Bars, Item, Rule


def design_figure(
    names: Sequence[str], errors: Sequence[Mapping[str, float]], raw: float, title: str
) -> Figure:
    """Show the errors of the filters that were tried, beside those of the raw sensor."""

    def bars(signal: str) -> list[Item]:
        return [Bars(names, np.array([error[signal] for error in errors]), label="")]

    return Figure(
        id="design",
        title=title,
        caption="In simulated runs of the bearing that was found.",
        panels=[
            Panel(Axis(""), Axis("error of position", "µm rms", 1e6),
                  [*bars("x"), Rule(raw, signal="limit", label="raw sensor")]),
            Panel(Axis(""), Axis("error of disturbance force", "N rms"), bars("f_d")),
        ],
        columns=2,
    )  # fmt: skip
