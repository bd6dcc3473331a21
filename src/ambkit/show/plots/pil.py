"""What a step costs on a processor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Points
from ambkit.show.plots.signal_styles import TIME


def instructions_figure(t: NDArray[np.float64], instructions: NDArray[np.uint32]) -> Figure:
    """Show the instructions."""
    # t (n,) [s]; instructions (n,)
    counted = instructions > 0
    counts = instructions[counted].astype(float)
    points = Points(t[counted], counts, signal="estimate", label="counted")
    caption = "Counted in some of the samples."
    panel = Panel(TIME, Axis("instructions of a step"), [points])
    return Figure(id="instructions", title="Instructions", caption=caption, panels=[panel])
