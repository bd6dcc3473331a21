"""Formulas as MathML, by the same code as the report's: no script, nothing fetched from the net."""

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

from ambkit.result.report.markup import mathml


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    number = (node.get("label") or "").replace(".-", ". ")  # MyST makes "eq.-20" of "eq. 20"
    formula = mathml(node.astext(), display=True)
    translator.body.append(
        f'<div class="formula">{formula}<span>{translator.encode(number)}</span></div>'
    )
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Offer the renderer to Sphinx."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
