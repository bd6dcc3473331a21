"""Text of the report: Markdown with formulas, converted to HTML.

Formulas are between dollar signs. A link without text, ``[](#fig15)``, is filled with the name of
its target: "Figure 7".
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from html import escape
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element, fromstring, tostring

if TYPE_CHECKING:
    from markdown_it import MarkdownIt

_FORMULA = re.compile(r"\$([^$\n]+)\$")
_SYMBOL = re.compile(
    r"(?<!\\)(?:\$[^$\n]*\$|`[^`]*`)"  # formulas and code are unchanged
    r"|(?<![\w.#/\\-])(?:(?P<k>k_[is]|f_d)|F_(?P<of>St|mag))(?![\w-])"
)
_MARK = re.compile(r"\\([!-/:-@\[-`{-~])|\$")
_BARE_LINK = re.compile(r"\[\]\(#([\w.-]+)\)")


def markdown(text: str, names: Mapping[str, str] | None = None) -> str:
    """Convert Markdown to HTML blocks."""
    return str(_renderer().render(_named(text, names or {})))


def inline(text: str, names: Mapping[str, str] | None = None) -> str:
    """Convert one line of Markdown to HTML, without a paragraph; see `markdown`."""
    return str(_renderer().renderInline(_named(text, names or {})))


def plain(text: str) -> str:
    r"""Return one line of Markdown as plain text."""
    return _MARK.sub(r"\1", text)


def symbols(text: str) -> str:
    r"""Convert formulas of the symbols to text that a terminal can show."""

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
def _renderer() -> MarkdownIt:
    from markdown_it import MarkdownIt

    renderer = MarkdownIt("commonmark", {"html": False, "typographer": False}).enable("table")
    renderer.disable("image")  # a picture would be fetched: figures are the only pictures
    renderer.inline.ruler.before("escape", "formula", _read_formula)
    renderer.add_render_rule("formula", lambda _, tokens, at, *_more: mathml(tokens[at].content))
    return renderer


def _read_formula(state: Any, silent: bool) -> bool:
    match = _FORMULA.match(state.src, state.pos)
    if not match or match.end() > state.posMax:
        return False
    if not silent:
        state.push("formula", "math", 0).content = match[1]
    state.pos = match.end()
    return True


_ESCAPED = re.compile(r"\\.")
_DOLLAR = re.compile(r"(?<!\\)\$")  # "\$" is a dollar sign
_COMBINING = dict(zip("^¯~˙¨→", "\u0302\u0304\u0303\u0307\u0308\u20d7", strict=True))  # accents


def mathml(source: str, display: bool = False) -> str:
    """Write a formula as MathML."""
    return tostring(_parse(source, "block" if display else "inline"), encoding="unicode")


def label_html(text: str) -> str:
    """Write a label with formulas between dollar signs in the little HTML that plotly draws."""
    pieces = _DOLLAR.split(text)
    if len(pieces) % 2 == 0:
        raise ValueError(f"label {text!r}: a dollar sign is not closed")
    return "".join(
        _html(_parse(piece)) if place % 2 else escape(piece.replace(r"\$", "$"), quote=False)
        for place, piece in enumerate(pieces)
    )


def _html(node: Element) -> str:
    parts = [_html(child) for child in node]
    text = escape(node.text or "", quote=False)
    match node.tag:
        case "mi":
            return text if node.get("mathvariant") == "normal" else f"<i>{text}</i>"
        case "mn" | "mo" | "mtext":
            return text
        case "math" | "mrow":
            return "".join(parts)
        case "mspace":
            return " "
        case "msub":
            return f"{parts[0]}<sub>{parts[1]}</sub>"
        case "msup":
            return f"{parts[0]}<sup>{parts[1]}</sup>"
        case "msubsup":
            return f"{parts[0]}<sub>{parts[1]}</sub><sup>{parts[2]}</sup>"
        case "mover" if node[1].text in _COMBINING:
            # The accent belongs inside the italics of its letter.
            tail = "</i>" if parts[0].endswith("</i>") else ""
            return parts[0].removesuffix(tail) + _COMBINING[str(node[1].text)] + tail
    raise ValueError(f"a label holds letters, scripts and accents only, not <{node.tag}>")


def _parse(source: str, display: str = "inline") -> Element:
    """Return a formula as an element of HTML, whose names have no namespace."""
    from latex2mathml.converter import convert

    braces = _ESCAPED.sub("", source)
    if braces.count("{") != braces.count("}"):
        raise ValueError(f"formula {source!r}: its braces do not match")
    try:
        root = fromstring(convert(source, xmlns="", display=display))
    except Exception as error:  # its errors have no class in common
        raise ValueError(f"formula {source!r}: {type(error).__name__}") from None
    for node in root.iter():
        if (node.text or "").startswith("\\"):
            raise ValueError(f"formula {source!r}: {node.text} is not understood")
        if node.text == "|":  # a condition, as in k|k-1: no operator with space around it
            node.attrib.update(lspace="0", rspace="0")
    return root
