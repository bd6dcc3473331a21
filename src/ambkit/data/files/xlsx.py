"""Excel: the first sheet with numbers, read like the text file that it could be saved as."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from datetime import datetime
from typing import Any

from ambkit.base.errors import RecordError, library
from ambkit.base.escaping import one_line
from ambkit.data.files import csv_text
from ambkit.data.files.log import Log, Request, check_readable, library_errors


def read(path: str, request: Request) -> Log:
    """Read the columns; see `ambkit.data.files.tables.read_log`."""
    check_readable(path)
    openpyxl = library("openpyxl", f"{path}: an Excel file", "xlsx")
    with library_errors(path):
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        for sheet in book.worksheets:
            request.progress(f"reading the sheet {sheet.title}")
            rows = [_row(row) for row in sheet.iter_rows(values_only=True)]
            if any(isinstance(cell, float) for row, _ in rows for cell in row):
                remarks = [f"sheet {one_line(sheet.title)}"] if len(book.worksheets) > 1 else []
                text = "".join(f"{line}\n" for _, line in rows)
                log = csv_text.parse(text, path, request, [], "\t")
                return replace(log, remarks=(*remarks, *log.remarks[1:]))  # there are no tabs
    raise RecordError(f"{path}: no sheet has numbers")


def _row(cells: Iterable[Any]) -> tuple[list[Any], str]:
    """Return cells with their numbers as floats, and the equivalent line of text."""
    values = [
        float(cell) if isinstance(cell, int | float) and not isinstance(cell, bool) else cell
        for cell in cells
    ]
    return values, "\t".join(map(_text, values))


def _text(cell: Any) -> str:
    if cell is None:
        return ""
    if isinstance(cell, datetime):
        return cell.isoformat(" ")
    return one_line(str(cell)).replace("\t", " ")
