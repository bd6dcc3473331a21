"""Figures and the report: one description, drawn for paper and for the screen.

A `Figure` says what is to be seen, in SI. `static.save` draws it with matplotlib; `write_report`
draws all figures of a `Report` and puts them, with texts, formulas and tables, into one HTML page
that works without the net.
"""

from ambkit.result.report.blocks import (
    Block,
    Chapter,
    Equation,
    FigureBlock,
    Remark,
    Report,
    TableBlock,
    Text,
)
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import (
    Axis,
    Band,
    Bars,
    Cells,
    Heatmap,
    Intervals,
    Line,
    Note,
    Points,
    Rule,
    Span,
)
from ambkit.result.report.page import write_report
from ambkit.result.report.summary import SummaryRow

__all__ = [
    "Axis",
    "Band",
    "Bars",
    "Block",
    "Cells",
    "Chapter",
    "Equation",
    "Figure",
    "FigureBlock",
    "Heatmap",
    "Intervals",
    "Line",
    "Note",
    "Panel",
    "Points",
    "Remark",
    "Report",
    "Rule",
    "Span",
    "SummaryRow",
    "TableBlock",
    "Text",
    "write_report",
]
