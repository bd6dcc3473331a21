"""The report on a processor in the loop: whether its bits are right, what it costs, how it flew."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from ambkit.base.escaping import markdown
from ambkit.result.report.blocks import Chapter, FigureBlock, Remark, Report, TableBlock
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Points
from ambkit.show.plots.looks import TIME


def write_pil(
    path: str | os.PathLike[str],
    name: str,
    passed: bool,
    rows: Sequence[tuple[str, str]],
    samples: int,
    figures: Sequence[Figure],
) -> None:
    """Write the page."""
    from ambkit.result.report.page import write_page

    said = (
        "Every number that the processor gave is Python's, to the last bit."
        if passed
        else "The processor gave other numbers than Python: the table says which."
    )
    report = Report(
        title=f"{name} flown by a processor",
        subtitle=f"{samples:,} samples",
        lead="The plant was simulated; estimator, controller, lift-off and landing ran as compiled "
        "for the processor, sample by sample.",
        version=version("ambkit"),
        chapters=[
            Chapter(
                "result", "What came out",
                [
                    Remark("Pass" if passed else "Fail", said),
                    TableBlock(
                        id="figures", title="Bits, cost and flight", headers=["", ""],
                        rows=[[markdown(what), markdown(value)] for what, value in rows],
                    ),
                ],
            ),
            Chapter("flight", "The flight", [FigureBlock(figure) for figure in figures]),
        ],
    )  # fmt: skip
    write_page(report, path)


def cost_figure(t: NDArray[np.float64], instructions: NDArray[np.uint32]) -> Figure:
    """Show the instructions."""
    # t (n,) [s]; instructions (n,)
    counted = instructions > 0
    shown = instructions[counted].astype(float)
    points = Points(t[counted], shown, signal="estimate", label="counted")
    caption = "Counted in some of the samples."
    panel = Panel(TIME, Axis("instructions of a step"), [points])
    return Figure(id="cost", title="Instructions", caption=caption, panels=[panel])
