"""Text of the report: Markdown with formulas, to HTML.

Formulas stand between dollar signs. A link without text, ``[](#fig15)``, is filled with the
name of what it points to: "Figure 7".
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from html import escape
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element, tostring

if TYPE_CHECKING:
    from markdown_it import MarkdownIt

_FORMULA = re.compile(r"\$([^$\n]+)\$")
_SYMBOL = re.compile(
    r"(?<!\\)(?:\$[^$\n]*\$|`[^`]*`)"  # formulas and code stay as they are
    r"|(?<![\w.#/\\-])(?:(?P<k>k_[is]|f_d)|F_(?P<of>St|mag))(?![\w-])"
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
def _renderer() -> MarkdownIt:
    from markdown_it import MarkdownIt

    renderer = MarkdownIt("commonmark", {"html": False, "typographer": False}).enable("table")
    renderer.disable("image")  # a picture would be fetched from somewhere: figures are the pictures
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


_TOKEN = re.compile(
    r"\\(?:text|mathrm|mathbf)\s*\{[^{}]*\}"  # words are one token, for spaces count in them
    r"|\\(?:begin|end)\{[a-z]+\}|\\[A-Za-z]+|\\.|\d+(?:\.\d+)?|\S"
)
_DOLLAR = re.compile(r"(?<!\\)\$")  # "\$" is one that is meant
_WORDS = re.compile(r"\\(text|mathrm|mathbf)\s*\{([^{}]*)\}")
_LETTERS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "varepsilon": "ε",
    "zeta": "ζ", "eta": "η", "theta": "θ", "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν",
    "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ", "phi": "φ", "varphi": "φ",
    "chi": "χ", "psi": "ψ", "omega": "ω", "Gamma": "Γ", "Delta": "Δ", "Theta": "Θ",
    "Lambda": "Λ", "Sigma": "Σ", "Phi": "Φ", "Psi": "Ψ", "Omega": "Ω", "infty": "∞",
    "partial": "∂", "ell": "ℓ", "ldots": "…", "cdots": "⋯", "vdots": "⋮",
}  # fmt: skip
_OPERATORS = {
    "cdot": "·", "times": "×", "pm": "±", "mp": "∓", "le": "≤", "leq": "≤", "ge": "≥", "geq": "≥",
    "ne": "≠", "neq": "≠", "approx": "≈", "equiv": "≡", "propto": "∝", "sim": "∼", "to": "→",
    "in": "∈", "sum": "∑", "prod": "∏", "int": "∫", "nabla": "∇", "top": "⊤", "mid": "|",
    "{": "{", "}": "}", "|": "‖", "%": "%", "-": "−", "'": "′", "*": "∗",
}  # fmt: skip
_SPACES = {",": "0.17em", ";": "0.28em", " ": "0.25em", "quad": "1em", "qquad": "2em"}
_FUNCTIONS = {"sin", "cos", "tan", "exp", "ln", "log", "min", "max", "tanh", "diag"}
_ACCENTS = {"hat": "^", "bar": "¯", "tilde": "~", "dot": "˙", "ddot": "¨", "vec": "→"}
_COMBINING = dict(zip("^¯~˙¨→", "\u0302\u0304\u0303\u0307\u0308\u20d7", strict=True))
_MATRICES = {"matrix": ("", ""), "bmatrix": ("[", "]"), "pmatrix": ("(", ")"), "cases": ("{", "")}


def mathml(source: str, display: bool = False) -> str:
    """Write a formula as MathML."""
    root = _node("math", _parse(source))
    if display:
        root.set("display", "block")
    return tostring(root, encoding="unicode")


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
        case "mrow":
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


def _node(tag: str, *children: Element, text: str | None = None, **attributes: str) -> Element:
    node = Element(tag, attributes)
    node.text = text
    node.extend(children)
    return node


def _fence(text: str) -> Element:
    return _node("mo", text=text, stretchy="true")


def _parse(source: str) -> Element:
    return _Reader(source).whole()


class _Reader:
    """Recursive descent through the tokens of one formula; every method returns MathML."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.tokens: list[str] = _TOKEN.findall(source)[::-1]

    @property
    def ahead(self) -> str:
        return self.tokens[-1] if self.tokens else ""

    def error(self, problem: str) -> ValueError:
        return ValueError(f"formula {self.source!r}: {problem}")

    def take(self, *expected: str) -> str:
        if expected and self.ahead not in expected:
            raise self.error(f"{expected[0]} expected, found {self.ahead or 'the end'}")
        if not self.tokens:
            raise self.error("ends too early")
        return self.tokens.pop()

    def whole(self) -> Element:
        row = self.row()
        if self.ahead:
            raise self.error(f"{self.ahead} closes nothing")
        return row

    def row(self) -> Element:
        """Read up to whatever closes a group."""
        row = Element("mrow")
        while self.ahead not in ("", "}", "&", r"\\", r"\right") and r"\end" not in self.ahead:
            row.append(self.scripted())
        return row

    def scripted(self) -> Element:
        """One piece with what hangs below and above it."""
        base = self.piece()
        hung: dict[str, Element] = {}
        while self.ahead and self.ahead in "_^":
            place = self.take()
            if place in hung:
                raise self.error(f"two {place} on one symbol")
            hung[place] = self.piece()
        if not hung:
            return base
        big = base.text in ("∑", "∏")
        names = {"_": "under" if big else "sub", "^": "over" if big else "sup"}
        order = [place for place in "_^" if place in hung]
        return _node("m" + "".join(names[p] for p in order), base, *(hung[p] for p in order))

    def piece(self) -> Element:
        token = self.take()
        if words := _WORDS.fullmatch(token):
            return self.words(*words.groups())
        if token.startswith(r"\begin"):
            return self.matrix(token[7:-1])
        if token == "{":
            group = self.row()
            self.take("}")
            return group
        if token.startswith("\\"):
            return self.command(token[1:])
        if token[0].isdigit():
            return _node("mn", text=token)
        if token.isalpha():
            return _node("mi", text=token)
        if token in "()[]|":
            spaces = {"lspace": "0", "rspace": "0"} if token == "|" else {}
            return _node("mo", text=token, stretchy="false", **spaces)
        if token in "_^&}":
            raise self.error(f"{token} stands alone")
        return _node("mo", text=_OPERATORS.get(token, token))

    def words(self, kind: str, text: str) -> Element:
        if kind == "mathbf":
            return _node("mi", text=text, style="font-weight:bold")
        return _node("mtext", text=text)

    def command(self, name: str) -> Element:
        if name in _LETTERS:
            upright = {"mathvariant": "normal"} if name[0].isupper() or name == "infty" else {}
            return _node("mi", text=_LETTERS[name], **upright)
        if name in _OPERATORS:
            return _node("mo", text=_OPERATORS[name])
        if name in _SPACES:
            return _node("mspace", width=_SPACES[name])
        if name in _FUNCTIONS:
            return _node("mi", text=name, mathvariant="normal")
        if name in _ACCENTS:
            return _node("mover", self.piece(), _node("mo", text=_ACCENTS[name]), accent="true")
        if name == "frac":
            return _node("mfrac", self.piece(), self.piece())
        if name == "sqrt":
            return _node("msqrt", self.piece())
        if name == "left":
            return self.fenced()
        raise self.error(f"\\{name} is not understood")

    def fenced(self) -> Element:
        opening = self.take().lstrip("\\")
        inside = self.row()
        self.take(r"\right")
        closing = self.take().lstrip("\\")
        fences = (_fence("" if f == "." else f) for f in (opening, closing))
        return _node("mrow", next(fences), inside, next(fences))

    def matrix(self, name: str) -> Element:
        if name not in _MATRICES:
            raise self.error(f"\\begin{{{name}}} is not understood")
        table = _node("mtable", _node("mtr"))
        while True:
            table[-1].append(_node("mtd", self.row()))
            separator = self.take("&", r"\\", rf"\end{{{name}}}")
            if separator.startswith(r"\end"):
                break
            if separator == r"\\":
                table.append(Element("mtr"))
        opening, closing = (_fence(text) for text in _MATRICES[name])
        return _node("mrow", opening, table, closing)
