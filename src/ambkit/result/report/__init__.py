"""Figures and report: declared once, rendered for paper and screen.

A `Figure` states its content in SI and saves itself; `write_report` draws all figures of a `Report`
and combines them with texts, formulas and tables in one self-contained HTML page.
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
from ambkit.result.report.figure import Figure
from ambkit.result.report.item import Axis, Item, Panel, Vector
from ambkit.result.report.items import Band, Bars, Intervals, Line, Note, Points, Rule, Span
from ambkit.result.report.page import write_report
from ambkit.result.report.surfaces import Cells, Heatmap

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
    "Item",
    "Line",
    "Note",
    "Panel",
    "Points",
    "Remark",
    "Report",
    "Rule",
    "Span",
    "TableBlock",
    "Text",
    "Vector",
    "write_report",
]
