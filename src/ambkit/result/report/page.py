"""The report as one HTML file without external resources: no network, no fonts, no folder.

Each figure is in the page twice: as static SVG for paper and browsers without scripts (compressed
in a page of many figures), and as the description that plotly.js draws over it when the figure
becomes visible.
"""

import base64
import gzip
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ambkit.base import escaping, files
from ambkit.result.report import screen
from ambkit.result.report.blocks import (
    Block,
    Cell,
    Chapter,
    Equation,
    FigureBlock,
    Remark,
    Report,
    TableBlock,
    Text,
    number,
)
from ambkit.result.report.figure import Figure
from ambkit.result.report.items import BUCKETS, Line
from ambkit.result.report.markup import inline, markdown, mathml, plain

_TEMPLATES = Path(__file__).parent / "templates"
_PLOTLY_JS = Path(__file__).parent / "plotly" / "plotly-cartesian.min.js"
HEAVY = 1_000_000
"""Total size of pictures [byte] above which they are compressed, and need the page's script."""
_MARKS = "†‡§¶‖#"


def write_report(
    report: Report, folder: Path, progress: Callable[[str], None] = lambda _message: None
) -> Path:
    """Render all figures and write ``report.html`` and ``figures/<id>.png`` and ``.svg``."""
    _anchors(report)  # before the slow part
    pictures = {}
    for place, figure in enumerate(report.figures, start=1):
        progress(f"figure {place} of {len(report.figures)}: {plain(figure.title)}")
        pictures[figure.id] = figure.image(".svg")
        files.make_folder(folder / "figures")
        files.write_bytes(folder / "figures" / f"{figure.id}.svg", pictures[figure.id])
        figure.save(folder / "figures" / f"{figure.id}.png")
    progress("report.html")
    page = render_page(report, pictures)
    files.write_text(folder / "report.html", page)
    return folder / "report.html"


def illustrated_page(report: Report) -> str:
    """Render all figures of a report, and return one self-contained HTML page."""
    return render_page(report, {figure.id: figure.image(".svg") for figure in report.figures})


def figure_page(figure: Figure) -> str:
    """Write a page with one figure."""
    chapter = Chapter("picture", "Picture", [FigureBlock(figure)])
    report = Report(plain(figure.title), "", "", version("ambkit"), [chapter])
    return illustrated_page(report)


Figure.page = figure_page


def render_page(report: Report, pictures: Mapping[str, bytes]) -> str:
    """Write the report as HTML."""
    names = _anchors(report)
    heavy = sum(map(len, pictures.values())) > HEAVY
    templates = escaping.templates(_TEMPLATES, autoescape=True)
    page: str = templates.get_template("report.html.j2").render(
        report=report,
        lead=markdown(report.lead, names),
        summary=report.summary(names) if report.summary else "",
        chapters=[_chapter(chapter, names, pictures) for chapter in report.chapters],
        heavy=heavy,
        names=names,
        style=(_TEMPLATES / "report.css").read_text(encoding="utf-8"),
        script=(_TEMPLATES / "report.js").read_text(encoding="utf-8"),
        plotly=_packed(_PLOTLY_JS.read_bytes()) if report.figures else "",
    )
    return page


def _anchors(report: Report) -> dict[str, str]:
    """Names of all chapters, figures and tables, by id."""
    names: dict[str, str] = {}
    counts = {"Chapter": 0, "Figure": 0, "Table": 0}

    def add(kind: str, anchor: str) -> None:
        if anchor in names:
            raise ValueError(f"id {anchor!r} is used twice: {names[anchor]} and another {kind}")
        counts[kind] += 1
        names[anchor] = f"{kind} {counts[kind]}"

    for chapter in report.chapters:
        add("Chapter", chapter.id)
        for block in chapter.blocks:
            match block:
                case FigureBlock():
                    add("Figure", block.figure.id)
                case TableBlock():
                    add("Table", block.id)
    return names


def _chapter(
    chapter: Chapter, names: Mapping[str, str], pictures: Mapping[str, bytes]
) -> dict[str, Any]:
    return {
        "id": chapter.id,
        "title": inline(chapter.title),
        "number": names[chapter.id].split()[-1],
        "lead": inline(chapter.lead, names),
        "blocks": [_block(block, names, pictures) for block in chapter.blocks],
    }


def _block(block: Block, names: Mapping[str, str], pictures: Mapping[str, bytes]) -> dict[str, Any]:
    match block:
        case Text():
            return {"kind": "text", "html": markdown(block.source, names)}
        case Equation():
            math = mathml(block.source, display=True)
            return {"kind": "equation", "math": math, "number": block.number}
        case Remark():
            text = markdown(block.source, names)
            return {"kind": "remark", "title": block.title, "html": text}
        case FigureBlock():
            return _figure(block.figure, names, pictures[block.figure.id])
        case TableBlock():
            return _table(block, names)


def _figure(figure: Figure, names: Mapping[str, str], picture: bytes) -> dict[str, Any]:
    longest = max(
        (item.x.size for panel in figure.panels for item in panel.items if isinstance(item, Line)),
        default=0,
    )
    described = screen.described(figure)
    return {
        "kind": "figure",
        "id": figure.id,
        "name": names[figure.id],
        "title": inline(figure.title),
        "caption": inline(figure.caption, names),
        "source": figure.source,
        "alt": figure.description(),
        "svg": base64.b64encode(picture).decode(),
        "packed": _packed(picture),
        "described": _packed(screen.to_json(described).encode()),
        "height": described["layout"]["height"],
        "wide": figure.columns > 1,
        "samples": f"{longest:,}" if longest > 4 * BUCKETS else "",
        "buckets": f"{BUCKETS:,}",
    }


def _table(table: TableBlock, names: Mapping[str, str]) -> dict[str, Any]:
    columns = len(table.headers)
    digits = [table.digits] * columns if isinstance(table.digits, str) else list(table.digits)
    marks = dict(zip(dict.fromkeys(table.highlight.values()), _MARKS, strict=False))
    rows = []
    for place, row in enumerate(table.rows):
        cells = []
        for column, value in enumerate(row):
            reason = table.highlight.get((place, column), "")
            mark = marks.get(reason, "*") if reason else ""
            cells.append({"html": _cell(value, digits[column], names), "mark": mark})
        rows.append(cells)
    return {
        "kind": "table",
        "id": table.id,
        "name": names[table.id],
        "title": inline(table.title),
        "caption": inline(table.caption, names),
        "source": table.source,
        "headers": [inline(header, names) for header in table.headers],
        "numeric": [all(not isinstance(row[c], str) for row in table.rows) for c in range(columns)],
        "row_heads": table.row_heads,
        "rows": rows,
        "notes": [(mark, inline(reason, names)) for reason, mark in marks.items()],
    }


def _cell(value: Cell, digits: str, names: Mapping[str, str]) -> str:
    if isinstance(value, str):
        return inline(value.replace(" ± ", " ±\u00a0"), names)
    return number(value, "d" if isinstance(value, int) else digits)


def _packed(content: bytes) -> str:
    """Compress bytes for the page's script, reproducibly."""
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
