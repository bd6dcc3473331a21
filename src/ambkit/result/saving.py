"""A figure as a file: ``.png``, ``.svg``, ``.pdf`` or, to zoom in, ``.html``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ambkit.base.errors import AmbkitError
from ambkit.result.report.figure import Figure

ENDINGS = (".png", ".svg", ".pdf", ".html")
"""What `save_figure` can write."""


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Draw a figure into one file."""
    from ambkit.base import files
    from ambkit.result.report import static

    path = Path(path)
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise AmbkitError(f"{path}: cannot draw {ending or 'that'}, use {', '.join(ENDINGS)}")
    if ending == ".pdf":
        files.write_bytes(path, static.pdf(figure))
        return path
    picture = static.render(figure)
    if ending == ".html":
        files.write_text(path, _page(figure, picture))
    else:
        files.write_bytes(path, picture.png if ending == ".png" else picture.svg)
    return path


def _page(figure: Figure, picture: Any) -> str:
    from importlib.metadata import version

    from ambkit.result.report.blocks import Chapter, FigureBlock, Report
    from ambkit.result.report.markup import plain
    from ambkit.result.report.page import render_page

    report = Report(
        title=plain(figure.title),
        subtitle="",
        lead="",
        version=version("ambkit"),
        chapters=[Chapter("picture", "Picture", [FigureBlock(figure)])],
    )
    return render_page(report, {figure.id: picture})
