"""Text of the report: Markdown with formulas, to HTML.

Formulas stand between dollar signs. A link without text, ``[](#fig15)``, is filled with the
name of what it points to: "Figure 7".
"""

import re
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

from ambkit.result.report.formula import mathml

if TYPE_CHECKING:
    from markdown_it import MarkdownIt

_FORMULA = re.compile(r"\$([^$\n]+)\$")
_SYMBOL = re.compile(
    r"(?<!\\)(?:\$[^$\n]*\$|`[^`]*`)"  # formulas and code stay as they are
    r"|(?<![\w.#/\\-])(?:(?P<k>k_[is])|F_(?P<of>St|mag))(?![\w-])"
)
_MARK = re.compile(r"\\([!-/:-@\[-`{-~])|\$")
_BARE_LINK = re.compile(r"\[\]\(#([\w.-]+)\)")


def markdown(text: str, names: Mapping[str, str] | None = None) -> str:
    """Markdown to HTML blocks."""
    return str(_renderer().render(_named(text, names or {})))


def inline(text: str, names: Mapping[str, str] | None = None) -> str:
    """Markdown of one line to HTML, without a paragraph around it; see `markdown`."""
    return str(_renderer().renderInline(_named(text, names or {})))


def plain(text: str) -> str:
    r"""Return Markdown of one line as a text without marks, for where there are none."""
    return _MARK.sub(r"\1", text)


def symbols(text: str) -> str:
    r"""Make formulas of the bearing's symbols that a terminal shows as they are."""

    def formula(match: re.Match[str]) -> str:
        if match["k"]:
            return f"${match['k']}$"
        return rf"$F_\mathrm{{{match['of']}}}$" if match["of"] else match[0]

    return _SYMBOL.sub(formula, text)


def _named(text: str, names: Mapping[str, str]) -> str:
    def fill(match: re.Match[str]) -> str:
        anchor = match[1]
        if anchor not in names:
            raise ValueError(f"link to #{anchor}: no figure, table or chapter has this id")
        return f"[{names[anchor]}](#{anchor})"

    return _BARE_LINK.sub(fill, symbols(text))


@cache
def _renderer() -> "MarkdownIt":
    from markdown_it import MarkdownIt

    renderer = MarkdownIt("commonmark", {"html": False, "typographer": False}).enable("table")
    renderer.disable("image")  # a picture would be fetched from somewhere: figures are the pictures
    renderer.inline.ruler.before("escape", "formula", _read_formula)
    renderer.add_render_rule("formula", _write_formula)
    return renderer


def _read_formula(state: Any, silent: bool) -> bool:
    match = _FORMULA.match(state.src, state.pos)
    if not match or match.end() > state.posMax:
        return False
    if not silent:
        state.push("formula", "math", 0).content = match[1]
    state.pos = match.end()
    return True


def _write_formula(_self: Any, tokens: Any, index: int, _options: Any, _env: Any) -> str:
    return mathml(tokens[index].content)
